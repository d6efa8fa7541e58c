//! The Delassus operator of a grasp, applied without ever being assembled.
//!
//! ```text
//! W = W_rigid + W_deform
//! W_rigid  = sum over bodies of (J S)(J S)^T,          A^-1 = S S^T
//! W_deform = axes_i^T (g_ij I + t_ij P_i P_j + n_ij m_i m_j^T + K_ij) axes_j           between contacts of one patch
//! ```
//!
//! `J S` is 3x6 (contact rows over the factored coordinates of a body; unused columns zero), so the rigid part
//! of a row of `W f` is `(J S) y` with one accumulator `y = sum (J S)^T f` of 6 numbers per body. `axes` is the
//! rotation from a contact frame to the elastic axes of its patch, where an isotropic compliance is one number
//! `g` (m/N) per pair and the forces `F_j = axes_j f_j` need turning once, not once per pair. One that differs along the
//! surface's normal `m` and across it is two numbers, `n` and `t` (m/N; `P = I - m m^T`), and `P_j F_j` and `m_j . F_j`
//! are found once, too. A row then costs two 3x6 products and one multiply-add of four numbers per neighbour.
//!
//! How it is filled is in the file `fill.rs`.

mod fill;
mod stored;

use super::{ContactBlock, Delassus};
use crate::math::{Mat3, Real, Vec3};
use serde::{Deserialize, Serialize};

/// The body slot of something that does not move.
pub const NO_BODY: u32 = u32::MAX;

/// Rows (normal, tangent1, tangent2) of `J S`, one after the other in memory: `y += row * f` is then six multiply-adds side by side.
type Rows = [[Real; 6]; 3];
/// A 3-vector and a fourth number, so that two pairs fill two vector registers.
type Padded = [Real; 4];

/// One contact: two bodies and the rotation to the elastic axes. 408 bytes.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Contact {
    a: u32,
    b: u32,
    ja: Rows,
    jb: Rows,
    /// Contact frame to elastic axes: `F = axes f`.
    axes: Mat3,
    /// Unit normal `m` of the surface, elastic axes; any where no entry asks for it.
    normal: Vec3,
}

/// `W` of a set of contacts, matrix-free, with the reactions it is applied to. See the module.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct MatrixFree {
    contacts: Vec<Contact>,
    blocks: Vec<ContactBlock>,
    /// Per body `y = sum (J S)^T f`.
    bodies: Vec<[Real; 6]>,
    /// Per contact `F = axes f`, N.
    forces: Vec<Padded>,
    /// Entries of contact `i`: from `starts[i]` to `starts[i + 1]`, or to the end for the last one.
    isotropic_starts: Vec<u32>,
    isotropic_columns: Vec<u32>,
    isotropic_values: Vec<Real>,
    /// Per contact `P F` and `m . F`, N.
    split_forces: Vec<Padded>,
    axial_starts: Vec<u32>,
    axial_columns: Vec<u32>,
    /// `t` and `n` of the module, m/N.
    axial_values: Vec<[Real; 2]>,
    tensor_starts: Vec<u32>,
    tensor_columns: Vec<u32>,
    tensor_values: Vec<Mat3>,
    /// Contacts with a viscous drag, and the drag, N/m.
    drags: Vec<(u32, Real)>,
    /// Whether the elastic rows are those of an earlier time, found to be sound then.
    #[serde(skip)]
    rows_kept: bool,
}

impl MatrixFree {
    /// An operator with no contact.
    pub fn new() -> Self {
        Self::default()
    }

    /// The block `W_ij` (m/N), put together from its parts. Slow: for the diagonal, for tests and for [`crate::delassus::Assembled`].
    pub fn block(&self, i: usize, j: usize) -> Mat3 {
        let (ci, cj) = (&self.contacts[i], &self.contacts[j]);
        let mut w = Mat3::zeros();
        for (slot, rows_i) in [(ci.a, &ci.ja), (ci.b, &ci.jb)] {
            for (other, rows_j) in [(cj.a, &cj.ja), (cj.b, &cj.jb)] {
                if slot == other && slot != NO_BODY {
                    w += Mat3::from_fn(|r, c| (0..6).map(|k| rows_i[r][k] * rows_j[c][k]).sum());
                }
            }
        }
        let mut elastic = Mat3::zeros();
        let (columns, values) = self.isotropic_row(i);
        for (_, g) in columns.iter().zip(values).filter(|(c, _)| **c as usize == j) {
            elastic += Mat3::identity() * *g;
        }
        let (columns, values) = self.axial_row(i);
        for (_, [t, n]) in columns.iter().zip(values).filter(|(c, _)| **c as usize == j) {
            let [across_i, across_j] = [ci, cj].map(|contact| Mat3::identity() - contact.normal * contact.normal.transpose());
            elastic += across_i * across_j * *t + ci.normal * (cj.normal * *n).transpose();
        }
        let (columns, values) = self.tensor_row(i);
        for (_, k) in columns.iter().zip(values).filter(|(c, _)| **c as usize == j) {
            elastic += k;
        }
        w + ci.axes.transpose() * elastic * cj.axes
    }

    /// The contacts that contact `i` acts on or is acted on by: those on a common body, and its elastic neighbours.
    pub(crate) fn is_coupled(&self, i: usize, j: usize) -> bool {
        let (ci, cj) = (&self.contacts[i], &self.contacts[j]);
        let common = |slot: u32| slot != NO_BODY && (slot == cj.a || slot == cj.b);
        let columns = [self.isotropic_row(i).0, self.axial_row(i).0, self.tensor_row(i).0];
        common(ci.a) || common(ci.b) || columns.iter().any(|columns| columns.contains(&(j as u32)))
    }

    fn isotropic_row(&self, i: usize) -> (&[u32], &[Real]) {
        let start = self.isotropic_starts[i] as usize;
        let end = self.isotropic_starts.get(i + 1).map_or(self.isotropic_columns.len(), |&end| end as usize);
        (&self.isotropic_columns[start..end], &self.isotropic_values[start..end])
    }

    fn axial_row(&self, i: usize) -> (&[u32], &[[Real; 2]]) {
        let start = self.axial_starts[i] as usize;
        let end = self.axial_starts.get(i + 1).map_or(self.axial_columns.len(), |&end| end as usize);
        (&self.axial_columns[start..end], &self.axial_values[start..end])
    }

    fn tensor_row(&self, i: usize) -> (&[u32], &[Mat3]) {
        let start = self.tensor_starts[i] as usize;
        let end = self.tensor_starts.get(i + 1).map_or(self.tensor_columns.len(), |&end| end as usize);
        (&self.tensor_columns[start..end], &self.tensor_values[start..end])
    }

    /// Row `i` of `W_deform f` in elastic axes, m.
    #[inline]
    fn elastic_displacement(&self, i: usize) -> Vec3 {
        // Four independent sums: one alone would wait for its own last addition.
        let mut sums = [[0.0; 4]; 4];
        let (columns, values) = self.isotropic_row(i);
        let (columns4, rest_columns) = columns.as_chunks::<4>();
        let (values4, rest_values) = values.as_chunks::<4>();
        for (columns, values) in columns4.iter().zip(values4) {
            for lane in 0..4 {
                add_scaled(&mut sums[lane], &self.forces[columns[lane] as usize], values[lane]);
            }
        }
        for (column, value) in rest_columns.iter().zip(rest_values) {
            add_scaled(&mut sums[0], &self.forces[*column as usize], *value);
        }
        let [s0, s1, s2, s3] = sums;
        let mut u = Vec3::from_fn(|k, _| (s0[k] + s1[k]) + (s2[k] + s3[k]));
        let (columns, values) = self.axial_row(i);
        if !columns.is_empty() {
            let mut sums = [[0.0; 4]; 4];
            let (columns4, rest_columns) = columns.as_chunks::<4>();
            let (values4, rest_values) = values.as_chunks::<4>();
            for (columns, values) in columns4.iter().zip(values4) {
                for lane in 0..4 {
                    add_split(&mut sums[lane], &self.split_forces[columns[lane] as usize], values[lane]);
                }
            }
            for (column, value) in rest_columns.iter().zip(rest_values) {
                add_split(&mut sums[0], &self.split_forces[*column as usize], *value);
            }
            let [s0, s1, s2, s3] = sums;
            let sum: Padded = std::array::from_fn(|k| (s0[k] + s1[k]) + (s2[k] + s3[k]));
            let (across, normal) = (Vec3::new(sum[0], sum[1], sum[2]), &self.contacts[i].normal);
            u += across + normal * (sum[3] - normal.dot(&across));
        }
        let (columns, values) = self.tensor_row(i);
        for (column, k) in columns.iter().zip(values) {
            let [f0, f1, f2, _] = self.forces[*column as usize];
            u += k.column(0) * f0 + k.column(1) * f1 + k.column(2) * f2;
        }
        u
    }
}

impl Delassus for MatrixFree {
    fn len(&self) -> usize {
        self.contacts.len()
    }

    fn diagonal_block(&self, i: usize) -> &ContactBlock {
        &self.blocks[i]
    }

    fn set_reactions(&mut self, f: &[Vec3]) {
        for body in &mut self.bodies {
            *body = [0.0; 6];
        }
        for force in self.forces.iter_mut().chain(&mut self.split_forces) {
            *force = [0.0; 4];
        }
        for (i, f) in f.iter().enumerate() {
            if *f != Vec3::zeros() {
                self.add_reaction(i, f);
            }
        }
    }

    #[inline]
    fn displacement(&self, i: usize) -> Vec3 {
        let contact = &self.contacts[i];
        let mut delta = contact.axes.tr_mul(&self.elastic_displacement(i));
        for (slot, rows) in [(contact.a, &contact.ja), (contact.b, &contact.jb)] {
            if slot != NO_BODY {
                let y = &self.bodies[slot as usize];
                delta += Vec3::from_fn(|r, _| dot(&rows[r], y));
            }
        }
        delta
    }

    #[inline]
    fn add_reaction(&mut self, i: usize, change: &Vec3) {
        let contact = &self.contacts[i];
        let turned = contact.axes * change;
        let along = contact.normal.dot(&turned);
        let across = turned - contact.normal * along;
        for k in 0..3 {
            self.forces[i][k] += turned[k];
            self.split_forces[i][k] += across[k];
        }
        self.split_forces[i][3] += along;
        for (slot, rows) in [(contact.a, &contact.ja), (contact.b, &contact.jb)] {
            if slot != NO_BODY {
                let y = &mut self.bodies[slot as usize];
                for k in 0..6 {
                    y[k] += rows[0][k] * change.x + rows[1][k] * change.y + rows[2][k] * change.z;
                }
            }
        }
    }
}

#[inline]
fn add_scaled(sum: &mut Padded, force: &Padded, g: Real) {
    for k in 0..4 {
        sum[k] += g * force[k];
    }
}

#[inline]
fn add_split(sum: &mut Padded, force: &Padded, [t, n]: [Real; 2]) {
    for (k, factor) in [t, t, t, n].into_iter().enumerate() {
        sum[k] += factor * force[k];
    }
}

/// Dot product as two interleaved sums, which two-lane vector registers hold side by side.
#[inline]
fn dot(x: &[Real; 6], y: &[Real; 6]) -> Real {
    let even = x[0] * y[0] + x[2] * y[2] + x[4] * y[4];
    let odd = x[1] * y[1] + x[3] * y[3] + x[5] * y[5];
    even + odd
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::Assembled;
    use crate::math::Mat3x6;
    use nalgebra::{DMatrix, DVector};

    const CONTACTS: usize = 9;
    const BODIES: usize = 3;

    /// An operator of arbitrary numbers, and the dense matrix of the formula at the head of the file.
    struct Example {
        rigid: Vec<[(u32, Mat3x6); 2]>,
        axes: Vec<Mat3>,
        isotropic: DMatrix<Real>,
        tensor: DMatrix<Real>,
    }

    /// Numbers from -1 to 1, the same ones every time.
    fn numbers(seed: usize) -> impl FnMut() -> Real {
        let mut k = seed as Real;
        move || {
            k += 1.0;
            (k * k * 0.7 + 1.3 * k).sin()
        }
    }

    impl Example {
        fn new(seed: usize) -> Self {
            let mut next = numbers(seed);
            let slots = [0, 1, 2, NO_BODY];
            let mut side = |k: usize| (slots[k % 4], Mat3x6::from_fn(|_, _| next()));
            // Some contacts within one body, some against nothing.
            let rigid = (0..CONTACTS).map(|i| [side(i), side(i / 3 + 1)]).collect();
            let axes = (0..CONTACTS).map(|_| {
                let rotation =
                    crate::math::Rot::from_scaled_axis(Vec3::new(next(), next(), next()) * 2.0).to_rotation_matrix().into_inner();
                rotation * Mat3::from_diagonal(&Vec3::new(1.0, 1.0, 0.6))
            });
            let axes = axes.collect();
            // Positive definite and sparse: contacts 0 to 4 and 5 to 8 are patches of their own, tensors only in the first.
            let patch = |i: usize| usize::from(i > 4);
            let spread = DMatrix::from_fn(CONTACTS, CONTACTS, |i, j| if patch(i) == patch(j) { next() } else { 0.0 });
            let isotropic = &spread * spread.transpose() + DMatrix::identity(CONTACTS, CONTACTS) * 0.1;
            let spread = DMatrix::from_fn(3 * CONTACTS, 3 * CONTACTS, |i, j| if i.max(j) < 15 { next() } else { 0.0 });
            Self { rigid, axes, isotropic, tensor: &spread * spread.transpose() }
        }

        fn push(&self, w: &mut MatrixFree, with_rows: bool) {
            for (i, ([a, b], axes)) in self.rigid.iter().zip(&self.axes).enumerate() {
                w.push_contact(a.0, &a.1, b.0, &b.1, axes);
                for j in (0..CONTACTS).filter(|_| with_rows) {
                    if self.isotropic[(i, j)] != 0.0 {
                        w.push_isotropic(j, self.isotropic[(i, j)]);
                    }
                    let block = self.tensor.fixed_view::<3, 3>(3 * i, 3 * j).into_owned();
                    if block != Mat3::zeros() {
                        w.push_tensor(j, &block);
                    }
                }
            }
            w.finish().unwrap();
        }

        fn dense(&self) -> DMatrix<Real> {
            let mut js = DMatrix::zeros(3 * CONTACTS, 6 * BODIES);
            let mut axes = DMatrix::zeros(3 * CONTACTS, 3 * CONTACTS);
            for (i, sides) in self.rigid.iter().enumerate() {
                for (slot, rows) in sides.iter().filter(|(slot, _)| *slot != NO_BODY) {
                    let mut place = js.fixed_view_mut::<3, 6>(3 * i, 6 * *slot as usize);
                    place += rows;
                }
                axes.fixed_view_mut::<3, 3>(3 * i, 3 * i).copy_from(&self.axes[i]);
            }
            let elastic = self.isotropic.kronecker(&DMatrix::identity(3, 3)) + &self.tensor;
            &js * js.transpose() + axes.transpose() * elastic * axes
        }
    }

    fn displacements(w: &MatrixFree) -> DVector<Real> {
        DVector::from_iterator(3 * CONTACTS, (0..CONTACTS).flat_map(|i| w.displacement(i).iter().copied().collect::<Vec<_>>()))
    }

    fn forces(seed: usize) -> Vec<Vec3> {
        let mut next = numbers(seed);
        (0..CONTACTS).map(|i| if i == 3 { Vec3::zeros() } else { Vec3::new(next(), next(), next()) }).collect()
    }

    fn flat(f: &[Vec3]) -> DVector<Real> {
        DVector::from_iterator(3 * f.len(), f.iter().flat_map(|f| f.iter().copied()))
    }

    #[test]
    fn without_being_assembled_it_is_the_dense_operator_symmetric_and_positive() {
        let mut w = MatrixFree::new();
        for seed in 1..20 {
            let example = Example::new(seed);
            let dense = example.dense();
            w.clear(BODIES);
            example.push(&mut w, true);
            let mut f = forces(seed);
            w.set_reactions(&f);
            let off = (displacements(&w) - &dense * flat(&f)).amax() / dense.amax();
            assert!(off < 1e-14, "seed {seed}: W f is off by {off:e} of the largest entry");
            for (i, change) in forces(seed + 100).iter().enumerate() {
                w.add_reaction(i, change);
                f[i] += change;
            }
            let off = (displacements(&w) - &dense * flat(&f)).amax() / dense.amax();
            assert!(off < 3e-14, "seed {seed}: after changes one by one W f is off by {off:e} of the largest entry");
            let blocks = DMatrix::from_fn(3 * CONTACTS, 3 * CONTACTS, |i, j| w.block(i / 3, j / 3)[(i % 3, j % 3)]);
            let (off, skew) = ((&blocks - &dense).amax() / dense.amax(), (&blocks - blocks.transpose()).amax() / dense.amax());
            assert!(off < 1e-14 && skew < 1e-15, "seed {seed}: blocks are off by {off:e}, asymmetric by {skew:e} of the largest entry");
            let smallest = ((&blocks + blocks.transpose()) * 0.5).symmetric_eigenvalues().min();
            assert!(smallest > 0.0, "seed {seed}: an eigenvalue of {smallest:e} m/N");
            let mut assembled = Assembled::from_matrix_free(&w).unwrap();
            assembled.set_reactions(&f);
            let off = (0..CONTACTS).map(|i| (assembled.displacement(i) - w.displacement(i)).amax()).fold(0.0, Real::max) / dense.amax();
            assert!(off < 3e-14, "seed {seed}: assembled it is off by {off:e} of the largest entry");
        }
    }

    #[test]
    fn kept_elastic_rows_with_another_rigid_part_are_what_a_new_operator_is() {
        let (mut kept, mut new) = (MatrixFree::new(), MatrixFree::new());
        let first = Example::new(1);
        kept.clear(BODIES);
        first.push(&mut kept, true);
        let then = Example { rigid: Example::new(2).rigid, axes: Example::new(3).axes, ..first };
        kept.clear_rigid(BODIES);
        then.push(&mut kept, false);
        new.clear(BODIES);
        then.push(&mut new, true);
        for w in [&mut kept, &mut new] {
            w.set_reactions(&forces(5));
        }
        assert_eq!(displacements(&kept), displacements(&new));
    }

    #[test]
    fn an_elastic_row_that_is_not_finite_or_names_no_contact_is_refused() {
        for spoil in [|w: &mut MatrixFree| w.push_isotropic(0, Real::NAN), |w: &mut MatrixFree| w.push_isotropic(CONTACTS, 1.0)] {
            let mut w = MatrixFree::new();
            w.clear(BODIES);
            let [a, b] = Example::new(1).rigid[0];
            w.push_contact(a.0, &a.1, b.0, &b.1, &Mat3::identity());
            w.push_isotropic(0, 1.0);
            spoil(&mut w);
            assert_eq!(w.finish(), Err(0));
        }
    }
}

//! The Delassus operator of a grasp, applied without ever being assembled.
//!
//! ```text
//! W = W_rigid + W_deform
//! W_rigid  = sum over bodies of (J S)(J S)^T,          A^-1 = S S^T
//! W_deform = axes_i^T (g_ij I + K_ij) axes_j           between contacts of one patch
//! ```
//!
//! `J S` is 3x6 (contact rows over the factored coordinates of a body; unused columns zero), so the rigid part of a row of `W f` is `(J S) y` with one
//! accumulator `y = sum (J S)^T f` of 6 numbers per body. `axes` is the rotation from a contact frame to the elastic axes of its patch, where an
//! isotropic compliance is one number `g` (m/N) per pair and the forces `F_j = axes_j f_j` need turning once, not once per pair. A row then costs two
//! 3x6 products and one multiply-add of a 3-vector per neighbour.
//!
//! Filled contact by contact: [`MatrixFree::clear`], then for each contact [`MatrixFree::push_contact`] followed by the entries of its elastic row
//! ([`MatrixFree::push_isotropic`], [`MatrixFree::push_tensor`]), then [`MatrixFree::finish`]. The memory is kept from one step to the next.

use super::contact_solve::ContactBlock;
use super::delassus::Delassus;
use crate::math::{Mat3, Mat3x6, Real, Vec3};

/// The body slot of something that does not move.
pub const NO_BODY: u32 = u32::MAX;

/// Rows (normal, tangent1, tangent2) of `J S`, one after the other in memory: `y += row * f` is then six multiply-adds side by side.
type Rows = [[Real; 6]; 3];
/// A 3-vector with an unused fourth number, so that two pairs fill two vector registers.
type Padded = [Real; 4];

/// One contact: two bodies and the rotation to the elastic axes. 384 bytes.
#[derive(Debug, Clone)]
struct Contact {
    a: u32,
    b: u32,
    ja: Rows,
    jb: Rows,
    /// Contact frame to elastic axes: `F = axes f`.
    axes: Mat3,
}

/// `W` of a set of contacts, matrix-free, with the reactions it is applied to. See the module.
#[derive(Debug, Clone, Default)]
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
    tensor_starts: Vec<u32>,
    tensor_columns: Vec<u32>,
    tensor_values: Vec<Mat3>,
    /// Contacts with a viscous drag, and the drag, N/m.
    drags: Vec<(u32, Real)>,
    /// Whether the elastic rows are those of an earlier time, found to be sound then.
    rows_kept: bool,
}

impl MatrixFree {
    /// An operator with no contact.
    pub fn new() -> Self {
        Self::default()
    }

    /// Forgets all contacts but keeps their elastic rows: for the same contacts in the same order, given by [`MatrixFree::push_contact`] alone, whose rigid part is new.
    pub fn clear_rigid(&mut self, bodies: usize) {
        self.contacts.clear();
        self.blocks.clear();
        self.bodies.clear();
        self.bodies.resize(bodies, [0.0; 6]);
        self.forces.clear();
        self.drags.clear();
        self.rows_kept = true;
    }

    /// Forgets all contacts and keeps the memory. `bodies` is the number of body slots that the contacts will use.
    pub fn clear(&mut self, bodies: usize) {
        self.clear_rigid(bodies);
        self.rows_kept = false;
        self.isotropic_starts.clear();
        self.isotropic_columns.clear();
        self.isotropic_values.clear();
        self.tensor_starts.clear();
        self.tensor_columns.clear();
        self.tensor_values.clear();
    }

    /// Adds a contact between body slots `a` and `b` ([`NO_BODY`] for a side that does not move).
    ///
    /// `ja`, `jb`: `J S` of each side in the contact frame, with the sign that makes `ja y_a + jb y_b` the relative displacement (m).
    /// `axes`: from the contact frame to the elastic axes of the patch, a rotation (with a column stretched where friction has a grain); any if there is no elastic row.
    pub fn push_contact(&mut self, a: u32, ja: &Mat3x6, b: u32, jb: &Mat3x6, axes: &Mat3) {
        if !self.rows_kept {
            self.isotropic_starts.push(self.isotropic_columns.len() as u32);
            self.tensor_starts.push(self.tensor_columns.len() as u32);
        }
        self.contacts.push(Contact { a, b, ja: rows(ja), jb: rows(jb), axes: *axes });
    }

    /// Gives the contact pushed last a viscous drag, N/m; see [`ContactBlock::set_drag`].
    pub fn set_drag(&mut self, drag: Real) {
        if let Some(last) = self.contacts.len().checked_sub(1) {
            self.drags.push((last as u32, drag));
        }
    }

    /// Entry of the row of the contact pushed last: `g` (m/N) times the force of contact `j`, the same in all directions.
    #[inline]
    pub fn push_isotropic(&mut self, j: usize, g: Real) {
        self.isotropic_columns.push(j as u32);
        self.isotropic_values.push(g);
    }

    /// Entry of the row of the contact pushed last: `k` (m/N, in elastic axes) times the force of contact `j`.
    #[inline]
    pub fn push_tensor(&mut self, j: usize, k: &Mat3) {
        self.tensor_columns.push(j as u32);
        self.tensor_values.push(*k);
    }

    /// Prepares the diagonal blocks and sets all reactions to zero.
    ///
    /// # Errors
    /// The first contact that cannot be solved: its block is not finite and positive definite, or it names a body or a contact that does not exist.
    pub fn finish(&mut self) -> Result<(), usize> {
        let n = self.contacts.len();
        if self.isotropic_starts.len() != n {
            return Err(self.isotropic_starts.len().min(n.saturating_sub(1)));
        }
        self.blocks.clear();
        self.forces.clear();
        self.forces.resize(n, [0.0; 4]);
        for body in &mut self.bodies {
            *body = [0.0; 6];
        }
        for i in 0..n {
            let block = self.sound_block(i).ok_or(i)?;
            self.blocks.push(block);
        }
        for &(i, drag) in &self.drags {
            self.blocks[i as usize].set_drag(drag);
        }
        Ok(())
    }

    /// Whether contact `i` can be solved, with whatever others: whether [`MatrixFree::finish`] would not refuse it.
    pub(crate) fn is_well_posed(&self, i: usize) -> bool {
        self.sound_block(i).is_some()
    }

    /// The diagonal block of contact `i`, if it can be solved.
    fn sound_block(&self, i: usize) -> Option<ContactBlock> {
        let contact = &self.contacts[i];
        let bodies_exist = [contact.a, contact.b].iter().all(|&slot| slot == NO_BODY || (slot as usize) < self.bodies.len());
        if bodies_exist && (self.rows_kept || self.row_is_sound(i)) { ContactBlock::new(&self.block(i, i)) } else { None }
    }

    /// Whether the elastic row of contact `i` is finite and names contacts that exist.
    fn row_is_sound(&self, i: usize) -> bool {
        let (isotropic, tensor) = (self.isotropic_row(i), self.tensor_row(i));
        let columns_exist = isotropic.0.iter().chain(tensor.0).all(|&j| (j as usize) < self.contacts.len());
        columns_exist && isotropic.1.iter().all(|g| g.is_finite()) && tensor.1.iter().flat_map(|k| k.iter()).all(|x| x.is_finite())
    }

    /// The block `W_ij` (m/N), put together from its parts. Slow: for the diagonal, for tests and for [`super::Assembled`].
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
        let (columns, values) = self.tensor_row(i);
        for (_, k) in columns.iter().zip(values).filter(|(c, _)| **c as usize == j) {
            elastic += k;
        }
        w + ci.axes.transpose() * elastic * cj.axes
    }

    /// The contacts that contact `i` acts on or is acted on by: those on a common body, and its elastic neighbours.
    pub(super) fn is_coupled(&self, i: usize, j: usize) -> bool {
        let (ci, cj) = (&self.contacts[i], &self.contacts[j]);
        let common = |slot: u32| slot != NO_BODY && (slot == cj.a || slot == cj.b);
        common(ci.a) || common(ci.b) || self.isotropic_row(i).0.contains(&(j as u32)) || self.tensor_row(i).0.contains(&(j as u32))
    }

    fn isotropic_row(&self, i: usize) -> (&[u32], &[Real]) {
        let start = self.isotropic_starts[i] as usize;
        let end = self.isotropic_starts.get(i + 1).map_or(self.isotropic_columns.len(), |&end| end as usize);
        (&self.isotropic_columns[start..end], &self.isotropic_values[start..end])
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
        for force in &mut self.forces {
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
        for k in 0..3 {
            self.forces[i][k] += turned[k];
        }
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

fn rows(j: &Mat3x6) -> Rows {
    std::array::from_fn(|r| std::array::from_fn(|k| j[(r, k)]))
}

#[inline]
fn add_scaled(sum: &mut Padded, force: &Padded, g: Real) {
    for k in 0..4 {
        sum[k] += g * force[k];
    }
}

/// Dot product as two interleaved sums, which two-lane vector registers hold side by side.
#[inline]
fn dot(x: &[Real; 6], y: &[Real; 6]) -> Real {
    let even = x[0] * y[0] + x[2] * y[2] + x[4] * y[4];
    let odd = x[1] * y[1] + x[3] * y[3] + x[5] * y[5];
    even + odd
}

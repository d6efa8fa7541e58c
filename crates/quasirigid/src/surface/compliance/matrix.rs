//! A compliance that the user brings: any symmetric positive semidefinite matrix over the control
//! points of one surface, such as a finite-element model condensed to its surface.

use crate::error::{Error, Result, check_finite};
use crate::math::{Mat3, Real, Vec3};
use crate::surface::control_points::ControlPoints;
use crate::surface::sphere_tree::SphereTree;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::fmt;

/// Largest `|C_ij - C_ji|` that is taken for rounding, over the largest entry. A condensation in double precision stays below 1e-10.
const ROUNDING: Real = 1e-8;

/// An eigenvalue may be this much below zero, over the largest entry, before the matrix
/// is refused: singular ones come out of rounding on either side of zero.
const BELOW_ZERO: Real = 1e-9;

/// `K^-1` of a surface, m/N: displacement of each control point under a unit force at
/// each, in the frame of the body. Checked when it is made, then constant.
#[derive(Clone, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct ComplianceMatrix {
    control_points: usize,
    /// `C_ij` for i, then j.
    blocks: Vec<Mat3>,
    asymmetry: Real,
}

/// Equal matrices are equal however symmetric they were when they were given.
impl PartialEq for ComplianceMatrix {
    fn eq(&self, other: &Self) -> bool {
        self.control_points == other.control_points && self.blocks == other.blocks
    }
}

/// What is read where a matrix is expected, before it is checked.
#[derive(Deserialize)]
struct Unchecked {
    control_points: usize,
    blocks: Vec<Mat3>,
    asymmetry: Real,
}

/// Whether a matrix is positive semidefinite takes seconds and was checked when it was made; here only what takes no time is checked.
impl TryFrom<Unchecked> for ComplianceMatrix {
    type Error = Error;

    fn try_from(read: Unchecked) -> Result<Self> {
        let Unchecked { control_points: n, blocks, asymmetry } = read;
        if n == 0 || n.checked_mul(n) != Some(blocks.len()) {
            let (expected, got) = (format!("{n} x {n} blocks"), blocks.len());
            return Err(Error::shape("compliance matrix", expected, got, "read what was written"));
        }
        check_finite("compliance matrix", blocks.iter().flatten().chain([&asymmetry]))?;
        let mirrored = |k: usize| blocks[k] == blocks[k % n * n + k / n].transpose();
        if (0..n * n).all(mirrored) {
            return Ok(Self { control_points: n, blocks, asymmetry });
        }
        Err(Error::value("compliance matrix", "a symmetric matrix", "another one", "read what was written"))
    }
}

impl ComplianceMatrix {
    /// Checks `matrix` (3n x 3n, m/N): row and column `3 i + k` are axis `k` (x, y, z of the
    /// body's frame) of control point `i`, in the order of [`ControlPoints`].
    ///
    /// Kept is the symmetric part `(C + C^T)/2`, which differs from what was given by rounding only: see
    /// [`ComplianceMatrix::asymmetry`]. Positive semidefinite means that a Cholesky factorisation of `C + 1e-9 c I`
    /// exists, `c` being the largest entry: about two seconds for 1,000 control points.
    ///
    /// # Errors
    /// [`Error::InvalidShape`] for a matrix that is not 3n x 3n; [`Error::InvalidValue`] for an entry that is not finite, an
    /// asymmetry above 1e-8 of the largest entry, an eigenvalue below zero. The message says what was found.
    pub fn new(matrix: &DMatrix<Real>) -> Result<Self> {
        let what = "compliance matrix";
        let (rows, columns) = matrix.shape();
        if rows != columns || rows == 0 || rows % 3 != 0 {
            return Err(Error::shape(
                what,
                "shape (3n, 3n) for n control points",
                format!("shape ({rows}, {columns})"),
                "give x, y and z of every control point a row and a column",
            ));
        }
        if let Some((place, value)) = matrix.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            let got = format!("{value} in row {}, column {}", place % rows, place / rows);
            return Err(Error::value(what, "finite numbers only", got, "remove or repair the non-finite entries"));
        }
        let largest = matrix.amax();
        if largest == 0.0 {
            return Err(Error::value(
                what,
                "a surface that deforms somewhere",
                "zeros",
                "use a stiff material for a surface that does not",
            ));
        }
        let (difference, row, column) = largest_asymmetry(matrix);
        let asymmetry = difference / largest;
        if asymmetry > ROUNDING {
            return Err(Error::value(
                what,
                format!("symmetric within {ROUNDING:e} of its largest entry"),
                format!("a difference of {asymmetry:.1e} of it between entry ({row}, {column}) and its mirror image"),
                "elastic bodies have a symmetric compliance; ratio (C + C.T) / 2 if the difference is noise",
            ));
        }
        let mut symmetric = (matrix + matrix.transpose()) * 0.5;
        let n = rows / 3;
        let blocks = (0..n * n).map(|k| symmetric.fixed_view::<3, 3>(3 * (k / n), 3 * (k % n)).into_owned()).collect();
        for k in 0..rows {
            symmetric[(k, k)] += BELOW_ZERO * largest;
        }
        if symmetric.clone().cholesky().is_none() {
            let smallest = symmetric.symmetric_eigenvalues().min() - BELOW_ZERO * largest;
            return Err(Error::value(
                what,
                "positive semidefinite: no force may push its own point backwards",
                format!("an eigenvalue of {smallest:.3e} m/N, the largest entry being {largest:.3e} m/N"),
                "invert a stiffness matrix whose rigid motions are held, and check signs and units",
            ));
        }
        Ok(Self { control_points: n, blocks, asymmetry })
    }

    /// Number of control points `n` that it is for.
    pub fn control_points(&self) -> usize {
        self.control_points
    }

    /// Largest `|C_ij - C_ji|` that was found, over the largest entry: at most 1e-8.
    pub fn asymmetry(&self) -> Real {
        self.asymmetry
    }

    /// `C_ij`: displacement of control point `i` for a unit force at `j`, axes of the body's frame, m/N.
    #[inline]
    pub fn block(&self, i: usize, j: usize) -> &Mat3 {
        &self.blocks[i * self.control_points + j]
    }

    /// Refuses a surface with another number of control points.
    ///
    /// # Errors
    /// [`Error::InvalidShape`].
    pub fn check_for(&self, control: &ControlPoints) -> Result<()> {
        if control.len() == self.control_points {
            return Ok(());
        }
        Err(Error::shape(
            "compliance matrix",
            format!("shape ({0}, {0}) for a surface of {1} control points", 3 * control.len(), control.len()),
            format!("shape ({0}, {0})", 3 * self.control_points),
            "make it for the control points of this very surface",
        ))
    }

    /// Own block of control point `i` when it stands for `area`, that of a node above it (a traversal stopped
    /// early): the mean over the node, whose force is then spread over the control points below it.
    pub fn self_block(&self, tree: &SphereTree, i: usize, area: Real) -> Mat3 {
        let mut node = tree.leaf(i);
        while node.area < area && node.level > 0 {
            node = &tree.nodes[node.parent as usize];
        }
        if node.leaf_count == 1 {
            return *self.block(i, i);
        }
        let leaves = || (node.first_leaf..node.first_leaf + node.leaf_count).map(|leaf| leaf as usize);
        let share = |leaf: usize| tree.leaf(leaf).area / node.area;
        leaves().flat_map(|k| leaves().map(move |l| (k, l))).map(|(k, l)| self.block(k, l) * (share(k) * share(l))).sum()
    }

    /// Largest displacement of the surface under a uniform pressure of 1 Pa over a patch of `area` (m^2), in whatever direction, m/Pa.
    pub fn patch_compliance(&self, control: &ControlPoints, area: Real) -> Real {
        let reach2 = area / PI;
        let around = |i: usize| {
            let near = |j: &usize| *j != i && (control.points[*j] - control.points[i]).norm_squared() < reach2;
            let others: Mat3 = (0..control.len()).filter(near).map(|j| self.block(i, j) * control.areas[j]).sum();
            (self.block(i, i) * control.areas[i].min(area) + others).norm()
        };
        (0..control.len()).map(around).fold(0.0, Real::max)
    }

    /// Whether a force at `j` moves `i` at all.
    #[inline]
    pub fn reaches(&self, i: usize, j: usize) -> bool {
        *self.block(i, j) != Mat3::zeros()
    }

    /// Displacement of control point `i` under `forces` at the control points `loaded`, m.
    pub fn displacement(&self, i: usize, loaded: &[u32], forces: &[Vec3]) -> Vec3 {
        loaded.iter().map(|&j| self.block(i, j as usize) * forces[j as usize]).sum()
    }
}

impl fmt::Debug for ComplianceMatrix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ComplianceMatrix").field("control_points", &self.control_points).field("asymmetry", &self.asymmetry).finish()
    }
}

/// The largest `|C_ij - C_ji|`, and i and j.
fn largest_asymmetry(matrix: &DMatrix<Real>) -> (Real, usize, usize) {
    let mut worst = (0.0, 0, 0);
    for j in 0..matrix.ncols() {
        for i in 0..j {
            let difference = (matrix[(i, j)] - matrix[(j, i)]).abs();
            if difference > worst.0 {
                worst = (difference, i, j);
            }
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Surface, shapes};
    use proptest::prelude::*;

    /// `B B^T` over `n` control points, of rank `rank`.
    fn semidefinite(n: usize, rank: usize) -> DMatrix<Real> {
        let b = DMatrix::from_fn(3 * n, rank, |i, j| (1.7 * i as Real + 0.9 * (j * j) as Real).sin());
        &b * b.transpose() * 1e-6
    }

    fn message(matrix: &DMatrix<Real>) -> String {
        ComplianceMatrix::new(matrix).unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_compliance_is_refused_with_what_was_found() {
        let good = semidefinite(4, 12);
        assert!(ComplianceMatrix::new(&good).is_ok());
        assert!(message(&DMatrix::zeros(12, 9)).contains("(12, 9)"));
        assert!(message(&DMatrix::zeros(4, 4)).contains("(3n, 3n)"));
        assert!(message(&DMatrix::zeros(0, 0)).contains("(0, 0)"));
        assert!(message(&DMatrix::zeros(6, 6)).contains("zeros"));
        let mut bad = good.clone();
        bad[(5, 2)] = Real::NAN;
        assert!(message(&bad).contains("row 5, column 2"), "{}", message(&bad));
        let mut bad = good.clone();
        bad[(5, 2)] += 1e-3 * good.amax();
        assert!(message(&bad).contains("1.0e-3") && message(&bad).contains("(2, 5)"), "{}", message(&bad));
    }

    #[test]
    fn rounding_and_rank_deficiency_are_no_reason_to_refuse() {
        let mut matrix = semidefinite(5, 4);
        matrix[(1, 7)] += 1e-9 * matrix.amax();
        let made = ComplianceMatrix::new(&matrix).unwrap();
        assert!((made.asymmetry() / 1e-9 - 1.0).abs() < 1e-3, "asymmetry {:e}", made.asymmetry());
        assert_eq!(made.block(0, 2)[(1, 1)], made.block(2, 0)[(1, 1)]);
    }

    proptest! {
        #[test]
        fn an_eigenvalue_below_zero_is_found_and_named(
            n in 2..8usize, direction in prop::collection::vec(-1.0..1.0f64, 24), share in 0.001..0.5f64,
        ) {
            let mut v = nalgebra::DVector::from_iterator(3 * n, direction.into_iter().take(3 * n));
            prop_assume!(v.norm() > 0.1);
            v.normalize_mut();
            // All eigenvalues 1e-6 but one, along v.
            let matrix = (DMatrix::identity(3 * n, 3 * n) - &v * v.transpose() * (1.0 + share)) * 1e-6;
            let text = message(&matrix);
            prop_assert!(text.contains("eigenvalue of -"), "{text}");
            let found: Real = text.split("eigenvalue of ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            prop_assert!((found / (-share * 1e-6) - 1.0).abs() < 2e-3, "{share}: {text}");
        }
    }

    #[test]
    fn a_coarse_contact_has_the_mean_of_what_lies_below_it() {
        let surface = Surface::build(shapes::sample_half_space(0.02, 512).unwrap(), Some(64)).unwrap();
        let control = &surface.control;
        // Independent springs of a foundation modulus k: the mean over a node is one spring of its whole area.
        let k = 1e8;
        let springs = DMatrix::from_fn(192, 192, |i, j| if i == j { 1.0 / (k * control.areas[i / 3]) } else { 0.0 });
        let matrix = ComplianceMatrix::new(&springs).unwrap();
        for i in [0, 17, 63] {
            let mut node = surface.tree.leaf(i);
            loop {
                let own = matrix.self_block(&surface.tree, i, node.area)[(2, 2)];
                assert!((own * k * node.area - 1.0).abs() < 1e-12, "{own} at an area of {}", node.area);
                if node.level == 0 {
                    break;
                }
                node = &surface.tree.nodes[node.parent as usize];
            }
        }
        assert!(matrix.check_for(control).is_ok());
        assert!(ComplianceMatrix::new(&semidefinite(3, 9)).unwrap().check_for(control).unwrap_err().to_string().contains("(192, 192)"));
    }

    #[test]
    fn patch_compliance_is_that_of_the_patch() {
        let surface = Surface::build(shapes::sample_half_space(0.02, 512).unwrap(), Some(64)).unwrap();
        let control = &surface.control;
        // All move as one: a pressure of 1 Pa over an area gives 1e-3 times that area.
        let rigid = DMatrix::from_fn(192, 192, |i, j| if i % 3 == j % 3 { 1e-3 } else { 0.0 });
        let matrix = ComplianceMatrix::new(&rigid).unwrap();
        let area = 16.0 * control.spacing.powi(2);
        let ratio = matrix.patch_compliance(control, area) / (1e-3 * area * Real::sqrt(3.0));
        assert!((0.8..1.3).contains(&ratio), "{ratio} of the truth");
        let narrow = matrix.patch_compliance(control, 0.1 * control.areas[0]) / (1e-4 * control.areas[0] * Real::sqrt(3.0));
        assert!((narrow - 1.0).abs() < 0.2, "{narrow} of the truth");
    }
}

//! The solver as a library: a problem that somebody else has set up, in whatever units.
//!
//! The sign conventions are those of the stage, with the letters of the literature: `u = W r + q`, `r` in the friction cone,
//! `u` with De Saxce's shift in its dual, both orthogonal. `W` is solved as it is given. Real ones are slightly asymmetric,
//! from rounding or from condensation; how much is measured ([`ContactSystem::asymmetry`]), not repaired.

use crate::delassus::{Assembled, ContactStatus, Delassus};
use crate::error::{Error, Result, check_finite};
use crate::gauss_seidel::{Stop, check_problem};
use crate::math::{Mat3, Real, Vec3};

/// A contact problem: `W` (3n x 3n), `q` (3n), `mu` (n), contact frames (normal, tangent1, tangent2).
#[derive(Debug, Clone)]
pub struct ContactSystem {
    pub(crate) w: Assembled,
    pub(crate) q: Vec<Vec3>,
    pub(crate) mu: Vec<Real>,
    asymmetry: Real,
}

/// What [`crate::solve_system::solve_system`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemSolution {
    /// `r`, one per contact, exactly in the friction cones.
    pub reactions: Vec<Vec3>,
    /// `u = W r + q`.
    pub velocities: Vec<Vec3>,
    /// What each contact does.
    pub status: Vec<ContactStatus>,
    /// [`crate::delassus::residual_as_given`] of `reactions`.
    pub residual: Real,
    /// [`crate::delassus::natural_map_residual`] of `reactions`: the same in all units.
    pub unit_free_residual: Real,
    /// Sweeps done, Newton steps counted as one each.
    pub sweeps: u32,
    /// How many of the sweeps were Newton steps.
    pub newton_steps: u32,
    /// Why the solver stopped.
    pub stop: Stop,
}

impl ContactSystem {
    /// From all entries of `w`, row by row; `3n x 3n`, `n` being the length of `mu`.
    ///
    /// # Errors
    /// `InvalidShape` if the lengths do not fit together; `InvalidValue` for a number that is not finite,
    /// a negative `mu`, or a block on the diagonal of `w` that is not positive definite.
    pub fn from_dense(w: &[Real], q: &[Real], mu: &[Real]) -> Result<Self> {
        let n = mu.len();
        let width = 3 * n;
        if w.len() != width * width {
            return Err(Error::shape(
                "W",
                format!("{width} x {width} numbers for {n} contacts"),
                w.len(),
                "give W, q and mu of one problem",
            ));
        }
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in 0..n {
            let [first, second, third] = std::array::from_fn(|r| &w[(3 * i + r) * width..(3 * i + r + 1) * width]);
            for (j, ((a, b), c)) in first.chunks_exact(3).zip(second.chunks_exact(3)).zip(third.chunks_exact(3)).enumerate() {
                // Not `== 0.0` on a sum, which two entries may cancel in. NaN is not zero: it stays in and is found.
                if i == j || a.iter().chain(b).chain(c).any(|x| *x != 0.0) {
                    columns.push(j as u32);
                    values.push(Mat3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]));
                }
            }
            starts.push(values.len());
        }
        Self::from_block_rows(starts, columns, values, q, mu)
    }

    /// From block rows as in [`Assembled::from_block_rows`]; the columns of a row must rise.
    ///
    /// # Errors
    /// As [`ContactSystem::from_dense`].
    pub fn from_block_rows(starts: Vec<usize>, columns: Vec<u32>, values: Vec<Mat3>, q: &[Real], mu: &[Real]) -> Result<Self> {
        let n = mu.len();
        if starts.len() != n + 1 {
            return Err(Error::shape(
                "W",
                format!("{n} block rows, one for each mu"),
                starts.len().saturating_sub(1),
                "give W, q and mu of one problem",
            ));
        }
        if q.len() != 3 * n {
            return Err(Error::shape("q", format!("{} numbers for {n} contacts", 3 * n), q.len(), "give W, q and mu of one problem"));
        }
        let w = Assembled::from_block_rows(starts, columns, values)?;
        if let Some(row) = (0..n).find(|&i| !w.row(i).map(|(j, _)| j).is_sorted_by(|a, b| a < b)) {
            let hint = "sort the blocks of each row and add up those of the same place";
            return Err(Error::value(
                "block columns of W",
                "columns that rise within each row",
                format!("row {row}, where they do not"),
                hint,
            ));
        }
        check_finite("q", q)?;
        let q: Vec<Vec3> = q.chunks_exact(3).map(Vec3::from_column_slice).collect();
        check_problem(n, &q, mu)?;
        let asymmetry = asymmetry(&w);
        Ok(Self { w, q, mu: mu.to_vec(), asymmetry })
    }

    /// Number of contacts.
    pub fn len(&self) -> usize {
        self.mu.len()
    }

    /// Whether there is no contact.
    pub fn is_empty(&self) -> bool {
        self.mu.is_empty()
    }

    /// Largest entry of `W - W^T` over the largest of `W`. About 1e-16 is rounding;
    /// real problems go up to 1e-3, and more. 0 without contacts.
    pub fn asymmetry(&self) -> Real {
        self.asymmetry
    }
}

/// Largest entry of `W - W^T` over the largest of `W`.
fn asymmetry(w: &Assembled) -> Real {
    let (mut largest, mut skew): (Real, Real) = (0.0, 0.0);
    for i in 0..w.len() {
        for (j, block) in w.row(i) {
            largest = largest.max(block.amax());
            // A block above the diagonal is compared with its mirror image; one below only if that does not exist.
            if j >= i {
                skew = skew.max(w.block(j, i).map_or(block.amax(), |mirrored| (block - mirrored.transpose()).amax()));
            } else if w.block(j, i).is_none() {
                skew = skew.max(block.amax());
            }
        }
    }
    if largest > 0.0 { skew / largest } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::solve_system;
    use super::*;
    use crate::gauss_seidel::SolverParameters;

    #[test]
    fn asymmetry_is_relative_to_the_largest_entry() {
        let mut w = [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0];
        let of = |w: &[Real]| ContactSystem::from_dense(w, &[0.0; 3], &[0.5]).unwrap().asymmetry();
        assert_eq!(of(&w), 0.0);
        w[1] = 0.01;
        assert_eq!(of(&w), 0.005);
        let above = Assembled::from_block_rows(vec![0, 2, 3], vec![0, 1, 1], vec![Mat3::identity(); 3]).unwrap();
        let below = Assembled::from_block_rows(vec![0, 1, 3], vec![0, 0, 1], vec![Mat3::identity(); 3]).unwrap();
        assert_eq!((asymmetry(&above), asymmetry(&below)), (1.0, 1.0));
    }

    #[test]
    fn bad_systems_are_refused() {
        let eye = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        assert!(ContactSystem::from_dense(&eye[1..], &[0.0; 3], &[0.5]).is_err());
        assert!(ContactSystem::from_dense(&eye, &[0.0; 2], &[0.5]).is_err());
        assert!(ContactSystem::from_dense(&eye, &[Real::NAN; 3], &[0.5]).is_err());
        assert!(ContactSystem::from_dense(&eye, &[0.0; 3], &[-0.5]).is_err());
        assert!(ContactSystem::from_dense(&[0.0; 9], &[0.0; 3], &[0.5]).is_err());
        let two = |columns: &[u32]| {
            let starts = vec![0, columns.len() - 1, columns.len()];
            ContactSystem::from_block_rows(starts, columns.to_vec(), vec![Mat3::identity(); columns.len()], &[0.0; 6], &[0.5; 2])
        };
        assert!(two(&[0, 1]).is_ok() && two(&[0, 1, 1]).is_ok());
        for columns in [&[1, 0, 1], &[0, 0, 1], &[0, 2, 1]] {
            assert!(two(columns).is_err(), "{columns:?}");
        }
        let system = ContactSystem::from_dense(&eye, &[0.0; 3], &[0.5]).unwrap();
        let parameters = SolverParameters::default();
        assert!(solve_system(&system, &parameters, Some(&[])).is_err());
        assert!(solve_system(&system, &parameters, Some(&[Vec3::repeat(Real::NAN)])).is_err());
        assert!(solve_system(&system, &SolverParameters { tolerance: -1.0, ..parameters }, None).is_err());
    }
}

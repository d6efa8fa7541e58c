//! The solver as a library: a problem that somebody else has set up, in whatever units.
//!
//! The sign conventions are those of the stage, with the letters of the literature: `u = W r + q`, `r` in the friction cone, `u` with De Saxce's shift in its dual,
//! both orthogonal. `W` is solved as it is given. Real ones are slightly asymmetric, from rounding or from condensation; how much is measured
//! ([`ContactSystem::asymmetry`]), not repaired.

use super::assembled::Assembled;
use super::contact_solve::ContactStatus;
use super::delassus::Delassus;
use super::parameters::{Measure, SolverParameters, Stop, check_problem};
use super::residual::{AsGiven, natural_map_residual};
use super::sweep::{Scratch, solve};
use crate::error::{Error, Result, check_finite};
use crate::math::{Mat3, Real, Vec3};

/// A contact problem: `W` (3n x 3n), `q` (3n), `mu` (n), contact frames (normal, tangent1, tangent2).
#[derive(Debug, Clone)]
pub struct ContactSystem {
    w: Assembled,
    q: Vec<Vec3>,
    mu: Vec<Real>,
    asymmetry: Real,
}

/// What [`solve_system`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemSolution {
    /// `r`, one per contact, exactly in the friction cones.
    pub reactions: Vec<Vec3>,
    /// `u = W r + q`.
    pub velocities: Vec<Vec3>,
    /// What each contact does.
    pub status: Vec<ContactStatus>,
    /// [`super::residual_as_given`] of `reactions`.
    pub residual: Real,
    /// [`super::natural_map_residual`] of `reactions`: the same in all units.
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
    /// `InvalidShape` if the lengths do not fit together; `InvalidValue` for a number that is not finite, a negative `mu`, or a block on the diagonal of `w` that is not
    /// positive definite.
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

    /// Largest entry of `W - W^T` over the largest of `W`. About 1e-16 is rounding; real problems go up to 1e-3, and more. 0 without contacts.
    pub fn asymmetry(&self) -> Real {
        self.asymmetry
    }
}

/// Solves the problem until [`super::residual_as_given`] is within the tolerance. `measure` and `min_sweeps` of the parameters are not used.
///
/// Without `warm_start` it begins with no reactions. An unconverged problem is no error: `stop` says so, and the reactions are the best that were found.
///
/// # Errors
/// `InvalidValue` for bad parameters or a warm start that is not finite, `InvalidShape` if the warm start does not have one entry per contact.
pub fn solve_system(system: &ContactSystem, parameters: &SolverParameters, warm_start: Option<&[Vec3]>) -> Result<SystemSolution> {
    parameters.check()?;
    let n = system.len();
    if let Some(start) = warm_start {
        if start.len() != n {
            return Err(Error::shape(
                "warm_start",
                format!("one entry for each of {n} contacts"),
                start.len(),
                "give the reactions of a like problem",
            ));
        }
        check_finite("warm_start", start.iter().flat_map(|r| r.iter()))?;
    }
    let mut w = system.w.clone();
    let mut reactions = warm_start.map_or_else(|| vec![Vec3::zeros(); n], <[Vec3]>::to_vec);
    let mut status = vec![ContactStatus::Open; n];
    let parameters = SolverParameters { measure: Measure::AsGiven, min_sweeps: 0, ..parameters.clone() };
    let report = solve(&mut w, &system.q, &system.mu, &mut reactions, &mut status, &parameters, &mut Scratch::default());
    let velocities: Vec<Vec3> = (0..n).map(|i| w.displacement(i) + system.q[i]).collect();
    let mut sums = AsGiven::default();
    for i in 0..n {
        sums.add(&velocities[i], &reactions[i], &system.q[i], system.mu[i]);
    }
    let rho: Vec<Real> = (0..n).map(|i| w.diagonal_block(i).rho()).collect();
    let unit_free_residual = natural_map_residual(&velocities, &reactions, &system.mu, &rho);
    Ok(SystemSolution {
        reactions,
        velocities,
        status,
        residual: sums.residual(),
        unit_free_residual,
        sweeps: report.sweeps,
        newton_steps: report.newton_steps,
        stop: report.stop,
    })
}

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

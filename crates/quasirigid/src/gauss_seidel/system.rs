//! The solver as a library: a problem that somebody else has set up, in whatever units.
//!
//! The sign conventions are those of the stage, with the letters of the literature: `u = W r + q`, `r` in the friction cone, `u` with De Saxce's shift in its dual,
//! both orthogonal. `W` is solved as it is given. Real ones are slightly asymmetric, from rounding or from condensation; how much is measured
//! ([`ContactSystem::asymmetry`]), not repaired.

use super::assembled::Assembled;
use super::contact_solve::ContactStatus;
use super::delassus::Delassus;
use super::interior_point::interior_point;
use super::parameters::{Measure, SolverParameters, Stop, check_problem};
use super::residual::{AsGiven, natural_map_residual};
use super::sweep::{Scratch, WORST_ERROR, name_statuses, solve};
use crate::error::{Error, Result, check_finite};
use crate::math::{Mat3, Real, Vec3};
use std::time::Instant;

/// Sweeps and Newton steps before heavier means: 40 of the one, 30 of the other.
const FIRST_TRY: u32 = 72;

/// How the interior-point method is run, one after the other until it succeeds.
const HOLDS: [Real; 3] = [0.1, 0.01, 1.0];

/// Contacts at most in a part for the interior-point method, whose matrix is full: 70 MB each for two of them.
const LARGEST_DENSE: usize = 1000;

/// Below that, rounding is in the way.
const LEAST_TOLERANCE: Real = 1e-14;

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
    let deadline = parameters.time_budget.and_then(|budget| Instant::now().checked_add(budget));
    let mut attempt = Attempt {
        reactions: warm_start.map_or_else(|| vec![Vec3::zeros(); n], <[Vec3]>::to_vec),
        status: vec![ContactStatus::Open; n],
        sweeps: 0,
        newton_steps: 0,
        max_sweeps: parameters.max_sweeps,
        tolerance: parameters.tolerance,
        deadline,
    };
    let mut w = system.w.clone();
    let mut stop = attempt.sweep(&mut w, &system.q, &system.mu, FIRST_TRY);
    let mut sums = attempt.sums(&mut w, &system.q, &system.mu);
    if stop == Stop::SweepCap && !attempt.is_over() {
        let parts = connected_parts(&system.w);
        // The second round is for parts that looked good enough by a scale that has changed since.
        for share in [0.5, 0.1] {
            attempt.solve_parts(system, &parts, share * parameters.tolerance * sums.scale().sqrt());
            sums = attempt.sums(&mut w, &system.q, &system.mu);
            if sums.residual() <= parameters.tolerance || attempt.is_over() {
                break;
            }
        }
        stop = if sums.residual() <= parameters.tolerance {
            Stop::Converged
        } else if attempt.is_late() {
            Stop::TimeBudget
        } else {
            Stop::SweepCap
        };
    }
    let Attempt { reactions, status, sweeps, newton_steps, .. } = attempt;
    let velocities: Vec<Vec3> = (0..n).map(|i| w.displacement(i) + system.q[i]).collect();
    let rho: Vec<Real> = (0..n).map(|i| w.diagonal_block(i).rho()).collect();
    let unit_free_residual = natural_map_residual(&velocities, &reactions, &system.mu, &rho);
    if stop == Stop::Converged && !is_sound(&reactions, &system.q, &rho, unit_free_residual) {
        stop = Stop::SweepCap;
    }
    let residual = if stop == Stop::NonFinite { Real::INFINITY } else { sums.residual() };
    Ok(SystemSolution { reactions, velocities, status, residual, unit_free_residual, sweeps, newton_steps, stop })
}

/// A solve under way: the reactions so far, and what is left of the limits.
struct Attempt {
    reactions: Vec<Vec3>,
    status: Vec<ContactStatus>,
    sweeps: u32,
    newton_steps: u32,
    max_sweeps: u32,
    tolerance: Real,
    deadline: Option<Instant>,
}

impl Attempt {
    fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    fn is_over(&self) -> bool {
        self.sweeps >= self.max_sweeps || self.is_late()
    }

    /// [`solve`] with at most `sweeps` more sweeps.
    fn sweep(&mut self, w: &mut Assembled, q: &[Vec3], mu: &[Real], sweeps: u32) -> Stop {
        let parameters = SolverParameters {
            tolerance: self.tolerance,
            max_sweeps: sweeps.min(self.max_sweeps.saturating_sub(self.sweeps)).max(1),
            min_sweeps: 0,
            time_budget: self.deadline.map(|deadline| deadline.saturating_duration_since(Instant::now())),
            measure: Measure::AsGiven,
            foretold: false,
        };
        let report = solve(w, q, mu, &mut self.reactions, &mut self.status, &parameters, &mut Scratch::default());
        self.sweeps += report.sweeps;
        self.newton_steps += report.newton_steps;
        report.stop
    }

    /// What the residual is made of; `w` holds the reactions afterwards.
    fn sums(&self, w: &mut Assembled, q: &[Vec3], mu: &[Real]) -> AsGiven {
        w.set_reactions(&self.reactions);
        let mut sums = AsGiven::default();
        for i in 0..q.len() {
            sums.add(&(w.displacement(i) + q[i]), &self.reactions[i], &q[i], mu[i]);
        }
        sums
    }

    /// Solves the parts one by one until the errors of all together are below `goal` (norm of the natural map).
    fn solve_parts(&mut self, system: &ContactSystem, parts: &[Vec<usize>], goal: Real) {
        for part in parts {
            if self.is_over() {
                return;
            }
            let goal = goal * (part.len() as Real / system.len() as Real).sqrt();
            let pick = |from: &[Vec3]| part.iter().map(|&i| from[i]).collect::<Vec<_>>();
            let (q, mu) = (pick(&system.q), part.iter().map(|&i| system.mu[i]).collect::<Vec<_>>());
            let mut w = if parts.len() == 1 { system.w.clone() } else { system.w.part(part) };
            let mut local = Attempt { reactions: pick(&self.reactions), status: part.iter().map(|&i| self.status[i]).collect(), ..*self };
            local.solve_part(&mut w, &q, &mu, goal, parts.len() > 1);
            (self.sweeps, self.newton_steps) = (local.sweeps, local.newton_steps);
            for (k, &i) in part.iter().enumerate() {
                (self.reactions[i], self.status[i]) = (local.reactions[k], local.status[k]);
            }
        }
    }

    /// One part, by everything there is. `fresh`: sweeps have not been tried on it alone.
    fn solve_part(&mut self, w: &mut Assembled, q: &[Vec3], mu: &[Real], goal: Real, fresh: bool) {
        let sums = self.sums(w, q, mu);
        let mut best = sums.error.sqrt();
        if best <= goal {
            return;
        }
        self.tolerance = (goal / sums.scale().sqrt()).clamp(LEAST_TOLERANCE, 1.0);
        if fresh && self.improve(w, q, mu, FIRST_TRY, &mut best) <= goal {
            return;
        }
        if q.len() <= LARGEST_DENSE {
            for hold in HOLDS {
                let (kept, deadline) = ((self.reactions.clone(), self.status.clone()), self.deadline);
                let late = || deadline.is_some_and(|deadline| Instant::now() >= deadline);
                // From an iterate that is not the best so far, a sweep may still find the solution.
                let left = self.max_sweeps.saturating_sub(self.sweeps);
                let outcome = interior_point(w, q, mu, &mut self.reactions, Real::INFINITY, 0.1 * goal, hold, left, late);
                self.sweeps += outcome.steps;
                self.newton_steps += outcome.steps;
                if outcome.error <= best {
                    name_statuses(&self.reactions, mu, &mut self.status);
                    best = outcome.error;
                    self.improve(w, q, mu, FIRST_TRY, &mut best);
                } else {
                    let mut here = outcome.error;
                    if self.improve(w, q, mu, FIRST_TRY, &mut here) < best {
                        best = here;
                    } else {
                        (self.reactions, self.status) = kept;
                    }
                }
                if best <= goal || self.is_over() {
                    return;
                }
            }
        }
        self.improve(w, q, mu, u32::MAX, &mut best);
    }

    /// Sweeps, taken back if they made things worse than `best`, which is returned.
    fn improve(&mut self, w: &mut Assembled, q: &[Vec3], mu: &[Real], sweeps: u32, best: &mut Real) -> Real {
        if self.is_over() {
            return *best;
        }
        let kept = (self.reactions.clone(), self.status.clone());
        self.sweep(w, q, mu, sweeps);
        let error = self.sums(w, q, mu).error.sqrt();
        if error < *best {
            *best = error;
        } else {
            (self.reactions, self.status) = kept;
        }
        *best
    }
}

/// Whether errors are small beside `q` too. Where there is no solution, such as a rigid block in a rigid gap that is too narrow, forces grow without
/// end, and errors become small in comparison with them alone.
fn is_sound(r: &[Vec3], q: &[Vec3], rho: &[Real], unit_free_residual: Real) -> bool {
    let force = r.iter().map(Vec3::norm_squared).sum::<Real>().sqrt();
    let free_force = q.iter().zip(rho).map(|(q, rho)| (q * *rho).norm_squared()).sum::<Real>().sqrt();
    unit_free_residual * force <= WORST_ERROR * free_force
}

/// The contacts that act on each other, directly or through others, in rising order.
fn connected_parts(w: &Assembled) -> Vec<Vec<usize>> {
    let n = w.len();
    // Each contact points to one of a lower index in its part, or to itself.
    let mut lower: Vec<usize> = (0..n).collect();
    let root = |lower: &mut [usize], mut i: usize| {
        while lower[i] != i {
            lower[i] = lower[lower[i]];
            i = lower[i];
        }
        i
    };
    for i in 0..n {
        for (j, _) in w.row(i) {
            let (a, b) = (root(&mut lower, i), root(&mut lower, j));
            lower[a.max(b)] = a.min(b);
        }
    }
    let (mut parts, mut part_of): (Vec<Vec<usize>>, Vec<usize>) = (Vec::new(), vec![0; n]);
    for i in 0..n {
        let first = root(&mut lower, i);
        if first == i {
            part_of[i] = parts.len();
            parts.push(Vec::new());
        }
        parts[part_of[first]].push(i);
    }
    parts
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

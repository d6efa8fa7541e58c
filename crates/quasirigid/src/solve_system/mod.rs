//! How a problem from elsewhere is solved: by the sweeps of a step first, and by heavier means on those parts where that is not enough.

mod interior_point;
mod proximal_point;
mod system;

pub use system::{ContactSystem, SystemSolution};

use crate::delassus::{AsGiven, Assembled, ContactStatus, Delassus, natural_map_residual, project_on_cone};
use crate::error::{Error, Result, check_finite};
use crate::gauss_seidel::deadline::Deadline;
use crate::gauss_seidel::sweep::{Run, Scratch, WORST_ERROR, name_statuses};
use crate::gauss_seidel::{Measure, SolverParameters, Stop};
use crate::math::{Real, Vec3};
use interior_point::{Until, interior_point};
use proximal_point::proximal_newton;

/// Sweeps and Newton steps before heavier means. Most of them are not used:
/// where sweeps converge slowly, they end after 40, and Newton steps after 30.
const FIRST_TRY: u32 = 400;

/// See [`Cascade::tighten`].
const LOOSE: Real = 100.0;

/// What is tried on a part, one after the other until one succeeds. Each solves problems that the other does not, see `docs/solver.md`.
const METHODS: [Method; 2] = [Method::InteriorPoint, Method::Proximal];

/// Steps of the proximal-point method at most.
const PROXIMAL_STEPS: u32 = 400;

/// Contacts at most in a part for direct methods.
const LARGEST_DENSE: usize = 10_000;

/// Below that, rounding is in the way.
const LEAST_TOLERANCE: Real = 1e-14;

/// Solves the problem until [`crate::delassus::residual_as_given`] is within the
/// tolerance. `measure` and `min_sweeps` of the parameters are not used.
///
/// Without `warm_start` it begins with no reactions. An unconverged problem is no
/// error: `stop` says so, and the reactions are the best that were found.
///
/// # Errors
/// `InvalidValue` for bad parameters or a warm start that is not finite,
/// `InvalidShape` if the warm start does not have one entry per contact.
pub fn solve_system(system: &ContactSystem, parameters: &SolverParameters, warm_start: Option<&[Vec3]>) -> Result<SystemSolution> {
    solve_system_until(system, parameters, warm_start, None)
}

/// [`solve_system`] with a way to end it: `interrupted` is asked every fraction of a millisecond,
/// and should answer as quickly. The solution then stops with [`Stop::Interrupted`].
///
/// # Errors
/// As [`solve_system`].
pub fn solve_system_until(
    system: &ContactSystem,
    parameters: &SolverParameters,
    warm_start: Option<&[Vec3]>,
    interrupted: Option<&dyn Fn() -> bool>,
) -> Result<SystemSolution> {
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
    let deadline = Deadline::new(parameters.time_budget, interrupted);
    let mut cascade = Cascade {
        reactions: warm_start.map_or_else(|| vec![Vec3::zeros(); n], <[Vec3]>::to_vec),
        status: vec![ContactStatus::Open; n],
        sweeps: 0,
        newton_steps: 0,
        max_sweeps: parameters.max_sweeps,
        tolerance: parameters.tolerance,
        deadline,
    };
    let mut w = system.w.clone();
    let mut stop = cascade.sweep(&mut w, &system.q, &system.mu, FIRST_TRY);
    let mut sums = cascade.sums(&mut w, &system.q, &system.mu);
    if matches!(stop, Stop::SweepCap | Stop::Stagnated) && !cascade.is_over() {
        let parts = connected_parts(&system.w);
        // The second round is for parts that looked good enough by a scale that has changed since.
        for share in [0.5, 0.1] {
            cascade.solve_parts(system, &parts, share * parameters.tolerance * sums.scale().sqrt());
            sums = cascade.sums(&mut w, &system.q, &system.mu);
            if sums.residual() <= parameters.tolerance || cascade.is_over() {
                break;
            }
        }
        stop = if sums.residual() <= parameters.tolerance { Stop::Converged } else { Stop::Stagnated };
    }
    if stop == Stop::Converged {
        cascade.tighten(system, &mut w);
        sums = cascade.sums(&mut w, &system.q, &system.mu);
    }
    let unfinished = cascade.reason().unwrap_or(Stop::Stagnated);
    let Cascade { reactions, status, sweeps, newton_steps, .. } = cascade;
    let velocities: Vec<Vec3> = (0..n).map(|i| w.displacement(i) + system.q[i]).collect();
    let rho: Vec<Real> = (0..n).map(|i| w.diagonal_block(i).rho()).collect();
    let unit_free_residual = natural_map_residual(&velocities, &reactions, &system.mu, &rho);
    stop = match stop {
        Stop::Converged if is_sound(&reactions, &system.q, &rho, unit_free_residual) => stop,
        // The reason why a run of sweeps ended need not be why the whole solve ended.
        Stop::Converged | Stop::SweepCap | Stop::Stagnated => unfinished,
        Stop::TimeBudget | Stop::Interrupted | Stop::NonFinite => stop,
    };
    let residual = if stop == Stop::NonFinite { Real::INFINITY } else { sums.residual() };
    Ok(SystemSolution { reactions, velocities, status, residual, unit_free_residual, sweeps, newton_steps, stop })
}

/// A method that is heavier than sweeps, and how it is run.
#[derive(Debug, Clone, Copy)]
enum Method {
    /// [`interior_point`], from the middle of the cones.
    InteriorPoint,
    /// [`proximal_newton`], from the best so far.
    Proximal,
}

/// The fallback cascade under way: the reactions so far, and what is left of the limits.
struct Cascade<'a> {
    reactions: Vec<Vec3>,
    status: Vec<ContactStatus>,
    sweeps: u32,
    newton_steps: u32,
    max_sweeps: u32,
    tolerance: Real,
    deadline: Deadline<'a>,
}

impl Cascade<'_> {
    fn is_over(&self) -> bool {
        self.reason().is_some()
    }

    /// The limit that was reached, if one was.
    fn reason(&self) -> Option<Stop> {
        if self.sweeps >= self.max_sweeps { Some(Stop::SweepCap) } else { self.deadline.reason() }
    }

    /// [`solve`] with at most `sweeps` more sweeps.
    fn sweep(&mut self, w: &mut Assembled, q: &[Vec3], mu: &[Real], sweeps: u32) -> Stop {
        let parameters = SolverParameters {
            tolerance: self.tolerance,
            max_sweeps: sweeps.min(self.max_sweeps.saturating_sub(self.sweeps)).max(1),
            min_sweeps: 0,
            time_budget: None,
            measure: Measure::AsGiven,
            predicted: false,
        };
        let run = Run::start(w, q, mu, &mut self.reactions, &mut self.status, &parameters, self.deadline);
        let report = run.finish(&mut Scratch::default());
        self.sweeps += report.sweeps;
        self.newton_steps += report.newton_steps;
        report.stop
    }

    /// Where forces are large numbers and velocities small ones, as with a `W` in m/N, the residual as given says
    /// little about velocities. In units in which `W` is of order one it must be within [`LOOSE`] tolerances, or
    /// sweeps and Newton steps go on until it is. As they cannot always reach that, it is no condition.
    fn tighten(&mut self, system: &ContactSystem, w: &mut Assembled) {
        let n = system.len();
        let compliance = (0..n).map(|i| system.w.diagonal_block(i).matrix().trace()).sum::<Real>() / (3 * n.max(1)) as Real;
        let goal = (LOOSE * self.tolerance).min(1.0);
        if compliance >= 1.0 || self.is_over() || self.residual_in_units_of(compliance, w, system) <= goal {
            return;
        }
        let Some(mut scaled) = system.w.scaled(1.0 / compliance) else { return };
        let (kept, tolerance) = ((self.reactions.clone(), self.status.clone()), self.tolerance);
        for r in &mut self.reactions {
            *r *= compliance;
        }
        self.tolerance = goal;
        let stop = self.sweep(&mut scaled, &system.q, &system.mu, FIRST_TRY);
        self.tolerance = tolerance;
        for (r, mu) in self.reactions.iter_mut().zip(&system.mu) {
            *r = project_on_cone(&(*r / compliance), *mu);
        }
        let still_good = self.sums(w, &system.q, &system.mu).residual() <= tolerance;
        if !(stop == Stop::Converged && still_good) {
            (self.reactions, self.status) = kept;
        }
    }

    /// The residual as it is when forces are in units in which `compliance` is one.
    fn residual_in_units_of(&self, compliance: Real, w: &mut Assembled, system: &ContactSystem) -> Real {
        w.set_reactions(&self.reactions);
        let mut sums = AsGiven::default();
        for (i, r) in self.reactions.iter().enumerate() {
            sums.add(&(w.displacement(i) + system.q[i]), &(r * compliance), &system.q[i], system.mu[i]);
        }
        sums.residual()
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
            let mut local = Cascade { reactions: pick(&self.reactions), status: part.iter().map(|&i| self.status[i]).collect(), ..*self };
            local.solve_part(&mut w, &q, &mu, goal, parts.len() > 1);
            (self.sweeps, self.newton_steps) = (local.sweeps, local.newton_steps);
            for (k, &i) in part.iter().enumerate() {
                (self.reactions[i], self.status[i]) = (local.reactions[k], local.status[k]);
            }
        }
    }

    /// One part, by all methods. `fresh`: sweeps have not been tried on it alone.
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
            for method in METHODS {
                self.try_method(w, q, mu, goal, method, &mut best);
                if best <= goal || self.is_over() {
                    return;
                }
            }
        }
        while !self.is_over() && best > goal {
            let before = best;
            self.improve(w, q, mu, u32::MAX, &mut best);
            if best >= before {
                break;
            }
        }
    }

    /// One of the heavier methods, and sweeps after it; all taken back if that is no better than `best`.
    fn try_method(&mut self, w: &mut Assembled, q: &[Vec3], mu: &[Real], goal: Real, method: Method, best: &mut Real) {
        let kept = (self.reactions.clone(), self.status.clone());
        let (deadline, left) = (self.deadline, self.max_sweeps.saturating_sub(self.sweeps));
        let late = || deadline.passed();
        let outcome = match method {
            Method::InteriorPoint => interior_point(w, q, mu, &mut self.reactions, Until { goal: 0.1 * goal, steps: left, late: &late }),
            Method::Proximal => {
                let steps = left.min(PROXIMAL_STEPS);
                proximal_newton(w, q, mu, &mut self.reactions, Until { goal: 0.5 * goal, steps, late: &late })
            }
        };
        self.sweeps += outcome.steps;
        self.newton_steps += outcome.steps;
        // From an iterate that is not the best so far, a sweep may still find the solution.
        let mut here = outcome.error;
        if here <= *best {
            name_statuses(&self.reactions, mu, &mut self.status);
        }
        if self.improve(w, q, mu, FIRST_TRY, &mut here) <= *best {
            *best = here;
        } else {
            (self.reactions, self.status) = kept;
        }
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

/// Whether errors are small beside `q` too. Where there is no solution, such as a rigid block in a rigid gap that
/// is too narrow, forces grow without end, and errors become small in comparison with them alone.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::residual_as_given;
    use crate::math::Mat3;

    /// Rigid boxes on each other, four contacts between each two: 12 forces for 6
    /// coordinates per box, and nothing deforms. The topmost is pushed sideways.
    fn rigid_stack(levels: usize, push: Real) -> (Vec<Real>, Vec<Real>, Vec<Real>) {
        let n = 4 * levels;
        // Rows of H: contact, box, 3x6 in frames (up, x, y).
        let lever = |contact: usize, on: usize| {
            let level = contact / 4;
            let (x, y) = ([-0.5, 0.5][contact % 2], [-0.5, 0.5][contact / 2 % 2]);
            let (z, sign) = if on == level { (-0.5, 1.0) } else { (0.5, -1.0) };
            let present = on == level || on + 1 == level;
            nalgebra::Matrix3x6::new(1.0, 0.0, 0.0, 0.0, y, -x, 0.0, 1.0, 0.0, -y, 0.0, z, 0.0, 0.0, 1.0, x, -z, 0.0)
                * if present { sign } else { 0.0 }
        };
        // Columns: up, x, y velocity; spin about up, x, y with unit inertia. Only H H^T and H v matter.
        let mut w = vec![0.0; 9 * n * n];
        let mut q = vec![0.0; 3 * n];
        for i in 0..n {
            for body in 0..levels {
                let velocity =
                    nalgebra::Vector6::new(-0.1, if body + 1 == levels { push } else { 0.0 }, 0.01, 0.02, 0.01 * body as Real, 0.0);
                let u = lever(i, body) * velocity;
                for r in 0..3 {
                    q[3 * i + r] += u[r];
                }
                for j in 0..n {
                    let block = lever(i, body) * lever(j, body).transpose();
                    for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                        w[(3 * i + r) * 3 * n + 3 * j + c] += block[(r, c)];
                    }
                }
            }
        }
        (w, q, vec![0.5; n])
    }

    #[test]
    fn rigid_stacks_are_solved_and_the_residual_is_that_of_the_reactions() {
        for levels in [1, 2, 3, 6] {
            for push in [0.0, 0.03, 0.3] {
                let (w, q, mu) = rigid_stack(levels, push);
                let system = ContactSystem::from_dense(&w, &q, &mu).unwrap();
                let solution = solve_system(&system, &SolverParameters::default(), None).unwrap();
                assert!(solution.stop.converged(), "{levels} levels, push {push}: {:e}", solution.residual);
                let n = mu.len();
                let u: Vec<Vec3> = (0..n)
                    .map(|i| {
                        Vec3::from_fn(|r, _| {
                            q[3 * i + r] + (0..3 * n).map(|k| w[(3 * i + r) * 3 * n + k] * solution.reactions[k / 3][k % 3]).sum::<Real>()
                        })
                    })
                    .collect();
                let residual = residual_as_given(&u, &solution.reactions, &system.q, &mu);
                assert!(
                    residual <= 1.001e-8 && (residual - solution.residual).abs() < 1e-13,
                    "{residual:e} against {:e}",
                    solution.residual
                );
            }
        }
    }

    #[test]
    fn interior_point_finds_what_sweeps_slowly_converge_to() {
        let (w, q, mu) = rigid_stack(3, 0.03);
        let system = ContactSystem::from_dense(&w, &q, &mu).unwrap();
        let mut r = vec![Vec3::zeros(); mu.len()];
        let outcome = interior_point(&system.w, &system.q, &mu, &mut r, Until { goal: 1e-9, steps: 60, late: &|| false });
        assert!(outcome.error < 1e-6, "{:e} after {} steps", outcome.error, outcome.steps);
    }

    #[test]
    fn parts_are_those_contacts_that_reach_each_other() {
        let eye = Mat3::identity();
        let w = Assembled::from_block_rows(vec![0, 2, 3, 5, 7], vec![0, 2, 1, 0, 2, 2, 3], vec![eye; 7]).unwrap();
        assert_eq!(connected_parts(&w), vec![vec![0, 2, 3], vec![1]]);
        assert_eq!(connected_parts(&w.part(&[1])), vec![vec![0]]);
    }
}

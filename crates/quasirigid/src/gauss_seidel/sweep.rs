//! The solver: block Gauss-Seidel sweeps, accelerated on hard problems.
//!
//! A sweep visits the contacts in order and solves each exactly against the newest reactions of all others. It
//! never leaves the cones, needs no step length, and on a warm start of a resting grasp one is enough. Cost:
//! one row of `W` per contact, and nothing more where the contact is and stays open.
//!
//! From sweep [`PLAIN_SWEEPS`] on, the sweeps are extrapolated ([`crate::gauss_seidel::anderson`]); an
//! extrapolation after which a sweep has to change more than twice as much as before is taken back. After
//! [`PATIENCE`] sweeps the problem is one of those where reactions wander from contact to contact, and
//! Newton steps take over ([`crate::gauss_seidel::newton`]), closed by one last sweep.
//!
//! What was tried, sweeps from cold to 1e-8, 164 contacts on three pads (`tests/common/problems.rs`):
//!
//! | pads | plain | forward and backward in turn | accelerated |
//! | --- | --- | --- | --- |
//! | local, beta 0.7 | 30 | 72 | 18 |
//! | local, beta 0.7, 30 times stiffer | 87 | 284 | 30 |
//! | local, beta 0.99 | 356 | more than 1000 | 70; 44 with Newton steps |
//! | half-space | 80 | 214 | 30 |
//!
//! Sweeps in alternating direction lose to sweeps in one direction everywhere. `docs/solver.md` has the rest of the figures.

use super::anderson::Anderson;
use super::deadline::Deadline;
use super::newton::{Newton, residual_about};
use super::{Measure, SolveReport, SolverParameters, Stop};
use crate::delassus::{AsGiven, ContactStatus, Delassus, relative};
use crate::math::{Real, Vec3};

/// Sweeps before acceleration begins. The first ones find out which contacts are open, stick and slip;
/// until that settles there is no straight line to follow, and most warm solves end before.
const PLAIN_SWEEPS: u32 = 8;

/// Sweeps before Newton steps take over. Soft grasps are done by then; a Newton step costs 10 to 20 sweeps.
const PATIENCE: u32 = 40;

/// Where there is no step to end in time, sweeps are given this many more for as long as
/// the last as many have brought the residual down by [`GOOD_PROGRESS`].
const STRETCH: u32 = 20;

/// See [`STRETCH`]. From one sweep to the next 0.93.
const GOOD_PROGRESS: Real = 0.25;

/// Newton steps for a problem from elsewhere; then the caller tries something else.
const NEWTON_STEPS: u32 = 30;

/// A warm start is improved at least by this factor, even if that is far below the tolerance: errors that the motion of the
/// step feeds again would otherwise stay just below the tolerance for ever, and a held object would creep by them.
const IMPROVEMENT: Real = 0.01;

/// Below this share of the tolerance a predicted warm start of something in motion need not be improved by as much.
const WELL_BELOW: Real = 0.1;

/// Sweeps that a step does even without any time left. With one a step a grasp at rest creeps by 0.1 mm/s, with four it stays where it is.
const LEAST_SWEEPS_OUT_OF_TIME: u32 = 4;

/// Sweeps that may be spent on that once the residual is within the tolerance.
const REFINEMENT: u32 = 8;

/// Where something rests, sweeps that have been spent on it and have not come below
/// this share of the tolerance converge too slowly: Newton steps follow.
const SETTLED: Real = 0.01;

/// A first sweep that changes the reactions by less than this share has nothing to improve on: a creep of 1e-14 m/s at most.
const FINEST: Real = 1e-11;

/// An extrapolation that makes the next sweep change the reactions by this factor more is taken back.
const SETBACK: Real = 2.0;

/// Converged means also that the errors are below this share of the forces that would undo `delta_free`
/// contact by contact. Where there is no solution, such as a rigid block in a rigid gap that is too
/// narrow, forces grow without end, and errors become small in comparison with them alone.
pub(crate) const WORST_ERROR: Real = 1e-2;

/// Forces this many times larger than those that would undo `delta_free` contact by
/// contact are not extrapolated to: there is no solution that way.
const LARGEST_FORCE: Real = 1e8;

/// Scratch memory of [`solve`], kept from one call to the next so that a step allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    anderson: Anderson,
    newton: Newton,
    /// Reactions to compare with or to come back to, N.
    before: Vec<Vec3>,
}

impl Scratch {
    /// Makes room for `contacts`, so that solves of up to as many allocate nothing. About 1.6 kB per contact.
    pub fn reserve(&mut self, contacts: usize) {
        if self.before.len() < contacts {
            self.before.resize(contacts, Vec3::zeros());
        }
        self.anderson.reserve(contacts);
        self.newton.reserve(contacts);
    }
}

/// Solves the frictional contact problem `delta = W f + delta_free` of [`super`].
///
/// `delta_free` in m, contact frames; `mu` without unit; `f` in N: the warm
/// start on entry, the reactions on return, exactly in their cones;
/// `status` is only written. On return `w` holds `f`. A warm start is always
/// improved, however good it is. A non-finite warm start counts as none.
///
/// The residual of the report is that of the returned `f`, evaluated on its own. It is evaluated
/// only when a sweep has changed little, because it costs as much as a sweep.
///
/// # Panics
/// If the arrays do not have one entry per contact of `w` (checked by [`crate::gauss_seidel::check_problem`]).
pub fn solve<W: Delassus>(
    w: &mut W,
    delta_free: &[Vec3],
    mu: &[Real],
    f: &mut [Vec3],
    status: &mut [ContactStatus],
    parameters: &SolverParameters,
    scratch: &mut Scratch,
) -> SolveReport {
    Run::start(w, delta_free, mu, f, status, parameters, Deadline::new(parameters.time_budget, None)).finish(scratch)
}

/// One call of [`solve`] under way.
pub(crate) struct Run<'a, W> {
    w: &'a mut W,
    delta_free: &'a [Vec3],
    mu: &'a [Real],
    f: &'a mut [Vec3],
    status: &'a mut [ContactStatus],
    parameters: &'a SolverParameters,
    deadline: Deadline<'a>,
    /// Norm of `rho_i delta_free_i`, N.
    free_force: Real,
    /// Estimate that decides whether the residual is evaluated: the change of the last sweep, or
    /// the residual as given that its contacts had when it came to them.
    seen: Real,
    sweeps: u32,
    newton_steps: u32,
}

impl<'a, W: Delassus> Run<'a, W> {
    /// What [`solve`] is given, with a deadline in place of the time budget of the parameters.
    pub(crate) fn start(
        w: &'a mut W,
        delta_free: &'a [Vec3],
        mu: &'a [Real],
        f: &'a mut [Vec3],
        status: &'a mut [ContactStatus],
        parameters: &'a SolverParameters,
        deadline: Deadline<'a>,
    ) -> Self {
        let n = w.len();
        assert!([delta_free.len(), mu.len(), f.len(), status.len()].iter().all(|&length| length == n), "one entry per contact");
        if f.iter().any(|f| !f.iter().all(|x| x.is_finite())) {
            f.fill(Vec3::zeros());
        }
        let free_force = delta_free.iter().enumerate().map(|(i, d)| (w.diagonal_block(i).rho() * d).norm_squared()).sum::<Real>().sqrt();
        if free_force == 0.0 {
            // Nothing to undo: no force is the solution, and sweeps would only halve the warm start time and again.
            f.fill(Vec3::zeros());
        }
        w.set_reactions(f);
        Self { w, delta_free, mu, f, status, parameters, deadline, free_force, seen: Real::INFINITY, sweeps: 0, newton_steps: 0 }
    }

    /// Sweeps, and Newton steps if those are not enough.
    pub(crate) fn finish(mut self, scratch: &mut Scratch) -> SolveReport {
        scratch.reserve(self.f.len());
        self.sweep_until_patience_ends(scratch).unwrap_or_else(|| self.step_until_done(scratch))
    }

    /// Sweeps, accelerated after the first few. `None` if the problem needs more than that.
    fn sweep_until_patience_ends(&mut self, scratch: &mut Scratch) -> Option<SolveReport> {
        let n = self.f.len();
        let Scratch { anderson, before, .. } = scratch;
        let before = &mut before[..n];
        anderson.restart();
        let tolerance = self.parameters.tolerance;
        // What the change of a sweep must be below before the residual is evaluated.
        let mut look_below = 2.0 * tolerance;
        // What a good warm start is improved to, and since which sweep the residual is within the tolerance.
        let mut aim = tolerance;
        let mut good_since = None;
        // Whether the sweep under way starts from an extrapolation, and the change of the sweep before it.
        let mut extrapolated = false;
        let mut last_change = Real::INFINITY;
        // A Newton step needs a sweep before and one after it: with less than that left, sweeps are better.
        let mut patience = if self.parameters.max_sweeps < PATIENCE + 3 { self.parameters.max_sweeps } else { PATIENCE };
        // The least that was seen, now and some sweeps ago.
        let (mut least, mut least_before) = (Real::INFINITY, Real::INFINITY);
        while self.sweeps < patience.max(self.parameters.min_sweeps) {
            if self.parameters.measure == Measure::AsGiven && self.sweeps.is_multiple_of(STRETCH) {
                // A problem from elsewhere has time: sweeps that converge well may go on.
                if self.sweeps + STRETCH >= patience
                    && least <= GOOD_PROGRESS * least_before
                    && patience + STRETCH + 3 <= self.parameters.max_sweeps
                {
                    patience += STRETCH;
                }
                least_before = least;
            }
            let accelerate = self.sweeps >= PLAIN_SWEEPS;
            if accelerate {
                before.copy_from_slice(self.f);
            }
            let change = self.sweep();
            if !change.is_finite() {
                return Some(self.give_up());
            }
            // A problem from elsewhere has no next step that could creep.
            if self.sweeps == 1 && change > FINEST && self.parameters.measure == Measure::UnitFree {
                let enough = if self.parameters.predicted { WELL_BELOW * tolerance } else { 0.0 };
                aim = (IMPROVEMENT * change).clamp(enough, tolerance);
            }
            let must_go_on = self.parameters.measure == Measure::UnitFree && self.sweeps < LEAST_SWEEPS_OUT_OF_TIME;
            let out_of_time = self.out_of_time(0).filter(|stop| !(must_go_on && *stop == Stop::TimeBudget));
            let seen = self.seen;
            least = least.min(seen);
            let refined = good_since.is_some_and(|since| self.sweeps >= since + REFINEMENT);
            if out_of_time.is_some() || refined || (self.sweeps >= self.parameters.min_sweeps && seen <= look_below) {
                let residual = self.residual();
                if self.converged(residual) {
                    let since = *good_since.get_or_insert(self.sweeps);
                    let refined = self.sweeps >= since + REFINEMENT;
                    let enough = if self.parameters.predicted { tolerance } else { SETTLED * tolerance };
                    // Newton steps need a sweep before and one after them.
                    let last_chance = out_of_time.is_some() || self.out_of_time(3).is_some();
                    if residual <= aim || refined && (residual <= enough || last_chance) || out_of_time.is_some() {
                        return Some(self.report(residual, Stop::Converged));
                    }
                    if refined {
                        return None;
                    }
                }
                if let Some(stop) = out_of_time {
                    return Some(self.report(residual, stop));
                }
                // Residual and change decrease together: evaluate again when the change has decreased by the factor that is missing.
                look_below = seen * (aim / residual).clamp(0.01, 0.7);
            }
            if accelerate {
                if extrapolated && change > SETBACK * last_change {
                    self.f.copy_from_slice(anderson.last_image(n));
                    anderson.restart();
                    extrapolated = false;
                } else {
                    let (w, mu) = (&*self.w, self.mu);
                    extrapolated = anderson.extrapolate(before, self.f, |i, f| w.diagonal_block(i).feasible(f, mu[i]));
                    last_change = change;
                    if extrapolated && self.force() > LARGEST_FORCE * self.free_force {
                        self.f.copy_from_slice(anderson.last_image(n));
                        anderson.restart();
                        extrapolated = false;
                    }
                }
                self.w.set_reactions(self.f);
            }
        }
        None
    }

    /// Newton steps, and a last sweep.
    fn step_until_done(&mut self, scratch: &mut Scratch) -> SolveReport {
        let Scratch { newton, before, .. } = scratch;
        newton.direct = self.parameters.measure == Measure::AsGiven;
        let tolerance = self.parameters.tolerance;
        // A feasible state to come back to, should the steps lead nowhere before time is
        // up. The sweep makes it one: an extrapolation may have come last.
        self.sweep();
        let first_residual = self.residual();
        newton.restart(first_residual);
        let before = &mut before[..self.f.len()];
        before.copy_from_slice(self.f);
        loop {
            let given_up = self.parameters.measure == Measure::AsGiven && self.newton_steps >= NEWTON_STEPS;
            if self.out_of_time(1).is_none() && !given_up {
                let deadline = self.deadline;
                newton.advance(self.w, self.delta_free, self.mu, self.f, LARGEST_FORCE * self.free_force, &|| deadline.passed());
                self.newton_steps += 1;
                self.sweeps += 1;
            }
            let out_of_time = self.out_of_time(1).or(given_up.then_some(Stop::Stagnated));
            if out_of_time.is_some() || self.residual() <= 0.5 * tolerance {
                if !self.sweep().is_finite() {
                    return self.give_up();
                }
                let residual = self.residual();
                if self.converged(residual) {
                    return self.report(residual, Stop::Converged);
                }
                if let Some(stop) = out_of_time {
                    if residual <= first_residual {
                        return self.report(residual, stop);
                    }
                    self.f.copy_from_slice(before);
                    let residual = self.residual();
                    name_statuses(self.f, self.mu, self.status);
                    return self.report(residual, stop);
                }
            }
        }
    }

    /// One pass over all contacts. Returns how much it changed the reactions, relative to them.
    fn sweep(&mut self) -> Real {
        let (mut changed, mut force) = (0.0, 0.0);
        let as_given = self.parameters.measure == Measure::AsGiven;
        let mut met = AsGiven::default();
        for i in 0..self.f.len() {
            let block = self.w.diagonal_block(i);
            let delta = self.w.displacement(i) + self.delta_free[i];
            if as_given {
                met.add(&delta, &self.f[i], &self.delta_free[i], self.mu[i]);
            }
            let b = delta - block.matrix() * self.f[i];
            let (new, status) = block.solve(&b, self.mu[i]);
            self.status[i] = status;
            let change = new - self.f[i];
            if change != Vec3::zeros() {
                self.f[i] = new;
                self.w.add_reaction(i, &change);
                changed += change.norm_squared();
            }
            force += new.norm_squared();
        }
        self.sweeps += 1;
        let change = relative(changed, force);
        self.seen = if as_given { met.residual() } else { change };
        change
    }

    /// The residual of the reactions, as the parameters want it measured. They are handed to `w` again: its running sums carry rounding.
    fn residual(&mut self) -> Real {
        self.w.set_reactions(self.f);
        match self.parameters.measure {
            Measure::UnitFree => self.unit_free_residual(),
            Measure::AsGiven => {
                let mut sums = AsGiven::default();
                for i in 0..self.f.len() {
                    sums.add(&(self.w.displacement(i) + self.delta_free[i]), &self.f[i], &self.delta_free[i], self.mu[i]);
                }
                sums.residual()
            }
        }
    }

    /// [`crate::delassus::natural_map_residual`] of the reactions that `w` holds.
    fn unit_free_residual(&self) -> Real {
        residual_about(self.w, self.delta_free, self.mu, self.f, 0.0, &[])
    }

    /// Norm of all reactions, N.
    fn force(&self) -> Real {
        self.f.iter().map(|f| f.norm_squared()).sum::<Real>().sqrt()
    }

    /// Whether a residual is as good as asked for, and not only because the forces have grown.
    fn converged(&self, residual: Real) -> bool {
        if residual > self.parameters.tolerance {
            return false;
        }
        let unit_free = if self.parameters.measure == Measure::UnitFree { residual } else { self.unit_free_residual() };
        unit_free * self.force() <= WORST_ERROR * self.free_force
    }

    /// Why to stop here, if `kept` sweeps are to be left.
    fn out_of_time(&self, kept: u32) -> Option<Stop> {
        if let Some(stop) = self.deadline.reason() {
            Some(stop)
        } else if self.sweeps + kept >= self.parameters.max_sweeps {
            Some(Stop::SweepCap)
        } else {
            None
        }
    }

    fn report(&self, residual: Real, stop: Stop) -> SolveReport {
        SolveReport { sweeps: self.sweeps, newton_steps: self.newton_steps, residual, stop }
    }

    fn give_up(&mut self) -> SolveReport {
        self.f.fill(Vec3::zeros());
        self.status.fill(ContactStatus::Open);
        self.w.set_reactions(self.f);
        self.report(Real::INFINITY, Stop::NonFinite)
    }
}

/// Sets the statuses from the reactions alone.
pub(crate) fn name_statuses(f: &[Vec3], mu: &[Real], status: &mut [ContactStatus]) {
    for ((status, f), mu) in status.iter_mut().zip(f).zip(mu) {
        *status = match f.y.hypot(f.z) {
            _ if f.x == 0.0 => ContactStatus::Open,
            friction if friction < mu * f.x * (1.0 - 1e-12) => ContactStatus::Stick,
            _ => ContactStatus::Slip,
        };
    }
}

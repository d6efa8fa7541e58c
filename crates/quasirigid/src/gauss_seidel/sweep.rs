//! Block Gauss-Seidel sweeps, accelerated when a problem turns out to be a hard one.
//!
//! A sweep visits the contacts in order and solves each exactly against the newest reactions of all others. It never leaves the cones, needs no step
//! length, and on a warm start of a resting grasp one sweep is enough. Cost: one row of `W` per contact, and nothing more where the contact is open.

use std::time::Instant;

use super::anderson::Anderson;
use super::contact_solve::ContactStatus;
use super::delassus::Delassus;
use super::parameters::{SolveReport, SolverParameters, Stop};
use super::residual::{natural_map, relative};
use crate::math::{Real, Vec3};

/// Sweeps before acceleration begins. The first ones find out which contacts are open, stick and slip; until that settles there is no straight line to
/// follow, and most warm solves end before.
const PLAIN_SWEEPS: u32 = 8;

/// Scratch memory of [`solve`], kept from one call to the next so that a step allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    anderson: Anderson,
    /// Reactions that the sweep under way started from, N.
    before: Vec<Vec3>,
}

impl Scratch {
    /// Makes room for `contacts`, so that later solves of up to as many allocate nothing.
    pub fn reserve(&mut self, contacts: usize) {
        self.before.resize(contacts, Vec3::zeros());
        self.anderson.reset(contacts);
    }
}

/// Solves the frictional contact problem `delta = W f + delta_free` of [`super`].
///
/// `delta_free` in m, contact frames; `mu` without unit; `f` in N: the warm start on entry, the reactions on return, exactly in their cones;
/// `status` is only written. On return `w` holds `f`. At least one sweep is done whatever the warm start.
///
/// The residual of the report is that of the returned `f`, evaluated on its own. It is looked at only when a sweep has changed little, because it costs as
/// much as a sweep. A non-finite warm start counts as none.
///
/// # Panics
/// If the arrays do not have one entry per contact of `w` (checked by [`super::check_problem`]).
pub fn solve<W: Delassus>(
    w: &mut W,
    delta_free: &[Vec3],
    mu: &[Real],
    f: &mut [Vec3],
    status: &mut [ContactStatus],
    parameters: &SolverParameters,
    scratch: &mut Scratch,
) -> SolveReport {
    let n = w.len();
    assert!([delta_free.len(), mu.len(), f.len(), status.len()].iter().all(|&length| length == n), "one entry per contact");
    let start = parameters.time_budget.map(|budget| (Instant::now(), budget));
    if f.iter().any(|f| !f.iter().all(|x| x.is_finite())) {
        f.fill(Vec3::zeros());
    }
    w.set_reactions(f);
    let mut sweeps = 0;
    // Change of a sweep below which the residual is worth a look.
    let mut look_below = 2.0 * parameters.tolerance;
    // Whether the sweep under way starts from an extrapolation, and the change of the sweep before it.
    let mut extrapolated = false;
    let mut last_change = Real::INFINITY;
    loop {
        let accelerate = sweeps >= PLAIN_SWEEPS;
        if accelerate {
            scratch.before.resize(n, Vec3::zeros());
            scratch.before.copy_from_slice(f);
        }
        let change = sweep(w, delta_free, mu, f, status);
        sweeps += 1;
        if !change.is_finite() {
            f.fill(Vec3::zeros());
            status.fill(ContactStatus::Open);
            w.set_reactions(f);
            return SolveReport { sweeps, residual: Real::INFINITY, stop: Stop::NonFinite };
        }
        let late = start.is_some_and(|(start, budget)| start.elapsed() >= budget);
        let last = late || sweeps >= parameters.max_sweeps;
        if last || (sweeps >= parameters.min_sweeps && change <= look_below) {
            // From scratch: the sums that the operator updates contact by contact carry rounding.
            w.set_reactions(f);
            let residual = residual(w, delta_free, mu, f);
            if residual <= parameters.tolerance || last {
                let stop = if residual <= parameters.tolerance {
                    Stop::Converged
                } else if late {
                    Stop::TimeBudget
                } else {
                    Stop::SweepCap
                };
                return SolveReport { sweeps, residual, stop };
            }
            // Residual and change fall together: look again when the change has fallen by the factor that is missing.
            look_below = change * (parameters.tolerance / residual).min(0.7);
        }
        if accelerate {
            if extrapolated && change > 2.0 * last_change {
                // The extrapolation made it worse: back to the plain sweep before it.
                f.copy_from_slice(scratch.anderson.last_image());
                scratch.anderson.restart();
                extrapolated = false;
            } else {
                if sweeps == PLAIN_SWEEPS + 1 {
                    scratch.anderson.reset(n);
                }
                extrapolated = scratch.anderson.extrapolate(&scratch.before, f, mu);
                last_change = change;
            }
            w.set_reactions(f);
        }
    }
}

/// One pass over all contacts. Returns how much it changed the reactions, relative to them.
fn sweep<W: Delassus>(w: &mut W, delta_free: &[Vec3], mu: &[Real], f: &mut [Vec3], status: &mut [ContactStatus]) -> Real {
    let (mut changed, mut force) = (0.0, 0.0);
    for i in 0..f.len() {
        let block = w.diagonal_block(i);
        let b = w.displacement(i) + delta_free[i] - block.matrix() * f[i];
        let (new, new_status) = block.solve(&b, mu[i]);
        status[i] = new_status;
        let change = new - f[i];
        if change != Vec3::zeros() {
            f[i] = new;
            w.add_reaction(i, &change);
            changed += change.norm_squared();
        }
        force += new.norm_squared();
    }
    relative(changed, force)
}

/// The natural-map residual of `f`, which `w` holds.
fn residual<W: Delassus>(w: &W, delta_free: &[Vec3], mu: &[Real], f: &[Vec3]) -> Real {
    let (mut error, mut force) = (0.0, 0.0);
    for i in 0..f.len() {
        let delta = w.displacement(i) + delta_free[i];
        error += natural_map(&delta, &f[i], mu[i], w.diagonal_block(i).rho()).norm_squared();
        force += f[i].norm_squared();
    }
    relative(error, force)
}

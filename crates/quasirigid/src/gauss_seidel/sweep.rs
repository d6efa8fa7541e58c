//! Block Gauss-Seidel sweeps over the contacts.

use std::time::Instant;

use super::anderson::Anderson;
use super::contact_solve::ContactStatus;
use super::delassus::Delassus;
use super::parameters::{SolveReport, SolverParameters, Stop};
use super::residual::{natural_map, relative};
use crate::math::{Real, Vec3};

/// Scratch memory of [`solve`], kept from one call to the next.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    anderson: Anderson,
    before: Vec<Vec3>,
}

/// Solves the frictional contact problem `delta = W f + delta_free` (see [`super`]); `f` is the warm start on entry, the reactions on return (N).
///
/// # Panics
/// If the arrays are not of the length of `w`.
pub fn solve<W: Delassus>(
    w: &mut W,
    delta_free: &[Vec3],
    mu: &[Real],
    f: &mut [Vec3],
    status: &mut [ContactStatus],
    parameters: &SolverParameters,
    scratch: &mut Scratch,
) -> SolveReport {
    let plain = 8;
    let start = Instant::now();
    let n = f.len();
    scratch.before.resize(n, Vec3::zeros());
    w.set_reactions(f);
    let mut sweeps = 0;
    let mut check_below = 2.0 * parameters.tolerance;
    let mut extrapolated = false;
    let mut last_change = Real::INFINITY;
    loop {
        sweeps += 1;
        let accelerating = sweeps > plain;
        if accelerating {
            scratch.before.copy_from_slice(f);
        }
        let change = sweep(w, delta_free, mu, f, status);
        let timeout = parameters.time_budget.is_some_and(|budget| start.elapsed() >= budget);
        let last = sweeps >= parameters.max_sweeps || timeout;
        if last || (sweeps >= parameters.min_sweeps && change <= check_below) {
            w.set_reactions(f);
            let residual = residual(w, delta_free, mu, f);
            if residual <= parameters.tolerance {
                return SolveReport { sweeps, residual, stop: Stop::Converged };
            }
            if last {
                return SolveReport { sweeps, residual, stop: if timeout { Stop::TimeBudget } else { Stop::SweepCap } };
            }
            check_below = change * (parameters.tolerance / residual).min(0.7);
        }
        if accelerating {
            if extrapolated && !(change <= 2.0 * last_change) {
                f.copy_from_slice(scratch.anderson.last_image());
                scratch.anderson.restart();
                w.set_reactions(f);
                extrapolated = false;
                continue;
            }
            if sweeps == plain + 1 {
                scratch.anderson.reset(n);
            }
            extrapolated = scratch.anderson.extrapolate(&scratch.before, f, mu);
            if extrapolated {
                w.set_reactions(f);
            }
        }
        last_change = change;
    }
}

fn sweep<W: Delassus>(w: &mut W, delta_free: &[Vec3], mu: &[Real], f: &mut [Vec3], status: &mut [ContactStatus]) -> Real {
    let (mut changed, mut force) = (0.0, 0.0);
    for i in 0..f.len() {
        one(i, w, delta_free, mu, f, status, &mut changed, &mut force);
    }
    relative(changed, force)
}
#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn one<W: Delassus>(
    i: usize,
    w: &mut W,
    delta_free: &[Vec3],
    mu: &[Real],
    f: &mut [Vec3],
    status: &mut [ContactStatus],
    changed: &mut Real,
    force: &mut Real,
) {
    let block = w.diagonal_block(i);
    let b = w.displacement(i) + delta_free[i] - block.matrix() * f[i];
    let (new, new_status) = block.solve(&b, mu[i]);
    let change = new - f[i];
    status[i] = new_status;
    if change != Vec3::zeros() {
        f[i] = new;
        w.add_reaction(i, &change);
        *changed += change.norm_squared();
    }
    *force += new.norm_squared();
}

fn residual<W: Delassus>(w: &W, delta_free: &[Vec3], mu: &[Real], f: &[Vec3]) -> Real {
    let (mut error, mut force) = (0.0, 0.0);
    for i in 0..f.len() {
        let delta = w.displacement(i) + delta_free[i];
        error += natural_map(&delta, &f[i], mu[i], w.diagonal_block(i).rho()).norm_squared();
        force += f[i].norm_squared();
    }
    relative(error, force)
}

//! The proximal-point method: Newton's method on problems that are made easy, one after the other.
//!
//! Around a centre `c` the contacts are made softer by the share `alpha`: `alpha W_ii (f_i - c_i)`
//! is added to the displacement. With a large `alpha` a few Newton steps find the
//! solution; it becomes the next centre, and `alpha` falls for as long as that stays so and
//! rises when it does not. At the end `f = c`, and the solution is that of the
//! problem itself. Acary, Brémond and Huber (2018) compare methods for
//! such problems, this one among them.
//!
//! [`crate::gauss_seidel::newton`] damps in the same way but moves the centre with every step, which
//! is faster on most problems and leads nowhere on some: heaps, where most contacts are at the edge
//! of sticking. Steps and slopes are the same, written for the damped problem.

use super::interior_point::{Outcome, Until};
use crate::delassus::{Assembled, Delassus, natural_map, project_on_cone, slope};
use crate::math::{Mat3, Real, Vec3};

/// Step lengths tried.
const LENGTHS: [Real; 7] = [1.0, 0.5, 0.25, 0.1, 0.04, 0.015, 0.005];

/// `alpha` of the first centre: contacts twice as soft.
const FIRST_ALPHA: Real = 1.0;

/// Bounds of `alpha`.
const ALPHA: (Real, Real) = (1e-10, 10.0);

/// A centre moves when the residual of the problem around it has fallen by this factor, or after [`INNER_STEPS`].
const INNER_SHARE: Real = 0.1;

/// See [`INNER_SHARE`].
const INNER_STEPS: u32 = 10;

/// So few steps mean that the next problem may be harder.
const FEW_STEPS: u32 = 3;

struct Point {
    f: Vec<Vec3>,
    /// `W f + q`.
    delta: Vec<Vec3>,
    /// Norm of the natural map of the damped problem, N.
    merit: Real,
}

/// `f` in the problem around `centre`.
fn evaluate(w: &mut Assembled, q: &[Vec3], mu: &[Real], f: Vec<Vec3>, alpha: Real, centre: &[Vec3]) -> Point {
    w.set_reactions(&f);
    let n = f.len();
    let mut delta = Vec::with_capacity(n);
    let mut merit = 0.0;
    for i in 0..n {
        let d = w.displacement(i) + q[i];
        let block = w.diagonal_block(i);
        let damped = d + block.matrix() * (f[i] - centre[i]) * alpha;
        merit += natural_map(&damped, &f[i], mu[i], block.rho()).norm_squared();
        delta.push(d);
    }
    Point { f, delta, merit: merit.sqrt() }
}

/// Starts from `r` and overwrites it by the best centre, in its cones, which is better or worse than what it was.
pub(crate) fn proximal_newton(w: &mut Assembled, q: &[Vec3], mu: &[Real], r: &mut [Vec3], until: Until<'_>) -> Outcome {
    let Until { goal, steps, late } = until;
    let n = q.len();
    let mut alpha = FIRST_ALPHA;
    let mut centre = r.to_vec();
    let mut outcome = Outcome { error: Real::INFINITY, steps: 0 };
    let mut here = evaluate(w, q, mu, centre.clone(), alpha, &centre);
    let mut outer = here.merit;
    let mut inner = 0;
    while outcome.steps < steps && !late() {
        // As in `Newton`: the damped contact has block (1 + alpha) W_ii, and its solution for b is that of W_ii for b / (1 + alpha).
        let softer = 1.0 + alpha;
        let (mut slopes, mut diagonal, mut d) = (vec![Mat3::zeros(); n], vec![Mat3::zeros(); n], vec![Vec3::zeros(); n]);
        for i in 0..n {
            let block = w.diagonal_block(i);
            let b = (here.delta[i] - block.matrix() * (here.f[i] + centre[i] * alpha)) / softer;
            let (solution, status) = block.solve(&b, mu[i]);
            d[i] = solution - here.f[i];
            slopes[i] = slope(block.matrix(), &b, mu[i], 0.0, &solution, status) / softer;
            diagonal[i] = Mat3::identity() - slopes[i] * block.matrix();
        }
        let Some(factors) = w.pattern().factor(w.rows(), &slopes, &diagonal, late) else { break };
        factors.solve(&mut d);
        outcome.steps += 1;
        inner += 1;
        let mut best: Option<Point> = None;
        for length in LENGTHS {
            let f: Vec<Vec3> = here.f.iter().zip(&d).map(|(f, d)| f + d * length).collect();
            let there = evaluate(w, q, mu, f, alpha, &centre);
            if best.as_ref().is_none_or(|best| there.merit < best.merit) {
                best = Some(there);
            }
            if best.as_ref().is_some_and(|best| best.merit <= (1.0 - 0.3 * length) * here.merit) {
                break;
            }
        }
        let Some(best) = best else { break };
        here = best;
        if !here.merit.is_finite() {
            break;
        }
        if here.merit <= INNER_SHARE * outer || inner >= INNER_STEPS {
            let solved = here.merit <= INNER_SHARE * outer;
            let cones: Vec<Vec3> = here.f.iter().zip(mu).map(|(f, mu)| project_on_cone(f, *mu)).collect();
            w.set_reactions(&cones);
            let error = (0..n).map(|i| natural_map(&(w.displacement(i) + q[i]), &cones[i], mu[i], 1.0).norm_squared()).sum::<Real>().sqrt();
            if error < outcome.error {
                outcome.error = error;
                r.copy_from_slice(&cones);
                if error <= goal {
                    break;
                }
            }
            centre.copy_from_slice(&here.f);
            alpha = match (solved, inner <= FEW_STEPS) {
                (false, _) => (4.0 * alpha).min(ALPHA.1),
                (true, true) => (0.2 * alpha).max(ALPHA.0),
                (true, false) => alpha,
            };
            here = evaluate(w, q, mu, here.f, alpha, &centre);
            outer = here.merit;
            inner = 0;
        }
    }
    outcome
}

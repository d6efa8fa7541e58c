//! An interior-point method, for the few problems on which sweeps and Newton steps from contact to
//! contact do not converge: stacks with many more supports than coordinates, some of which slip.
//!
//! With the friction coefficient scaled away, `x = (mu r_n, r_t)` and `y = (v_n / mu, u_t)` where `v_n = u_n + mu |u_t|` is the
//! normal velocity with De Saxce's shift, the laws of a contact say that `x` and `y` lie in the cone `K = { |z_t| <= z_n }` and
//! are orthogonal. Let `P = diag(mu, 1, 1)`, `A = P^-1 W P^-1`, `b = P^-1 q`. Then
//!
//! ```text
//! y = A x + b + |y_t| n,     x in K,  y in K,  x . y = 0
//! ```
//!
//! Without the shift that is a convex program over second-order cones, and this would
//! be the textbook method: stay inside the cones, replace `x . y = 0` by
//! `x o y = m e` with a barrier parameter `m` that goes to zero, scale with the point of Nesterov and Todd (1997),
//! and take Newton steps. The shift is kept in and differentiated along with the rest, as `sqrt(|y_t|^2 + eps^2)`
//! with `eps` falling with `m`; Acary, Armand, Nguyen and Shpakovych (2022) treat the convex part in the same way.
//! With `t = y_t / |y_t|` and `G` the identity plus `t` in the normal row, a step solves
//!
//! ```text
//! (A + G^-1 Theta) dx = G^-1 (m x^-1 - y) + p,     dy = G (A dx - p)
//! ```
//!
//! where `p` is by how much the first equation fails and `Theta x = y`. The matrix is that of the problem
//! with other blocks on its diagonal, and is factored as it is ([`crate::linear::block_lu`]).

use crate::delassus::{Assembled, Delassus, natural_map, project_on_cone};
use crate::linear::block_rows::BlockRows;
use crate::math::{Mat3, Real, Vec3};

/// Steps at most. Most problems take 25 to 40.
const STEPS: u32 = 60;

/// Steps without a better iterate after which the search ends.
const PATIENCE: u32 = 12;

/// Smallest friction coefficient that the scaling can stand. What is below is treated as this; the sweep that follows has the true one.
const LEAST_FRICTION: Real = 1e-6;

/// `eps` of the smoothed shift, as a share of the barrier parameter.
const SMOOTHING: Real = 1e-3;

/// The barrier parameter is kept above this share of `|p|`, so that the iterates do not come to the edge before the
/// equation is met. With 0.01 or 1 nothing is solved that is not with this and the method after it.
const HOLD: Real = 0.1;

/// Share of the way to the edge of the cones that a step may go.
const TO_THE_EDGE: Real = 0.98;

/// Iterates of one run.
pub(crate) struct Outcome {
    /// Norm of the natural map with `rho = 1` of the forces that were left in `r`.
    pub(crate) error: Real,
    pub(crate) steps: u32,
}

/// When a run ends.
#[derive(Clone, Copy)]
pub(crate) struct Until<'a> {
    /// Norm of the natural map with `rho = 1` that is good enough.
    pub(crate) goal: Real,
    /// Steps at most.
    pub(crate) steps: u32,
    /// Asked before every step: whether time is up.
    pub(crate) late: &'a dyn Fn() -> bool,
}

/// Looks for a solution from the middle of the cones. `r` is overwritten by the best iterate, in its cones.
pub(crate) fn interior_point(w: &Assembled, q: &[Vec3], mu: &[Real], r: &mut [Vec3], until: Until<'_>) -> Outcome {
    let Until { goal, steps, late } = until;
    let n = mu.len();
    let mut outcome = Outcome { error: Real::INFINITY, steps: 0 };
    // Forces and velocities of order one.
    let compliance = (0..n).map(|i| w.diagonal_block(i).matrix().trace()).sum::<Real>() / (3 * n) as Real;
    let velocity = (q.iter().map(Vec3::norm_squared).sum::<Real>() / n as Real).sqrt();
    if velocity == 0.0 {
        return outcome;
    }
    let force = velocity / compliance;
    let friction: Vec<Real> = mu.iter().map(|mu| mu.max(LEAST_FRICTION)).collect();
    let unscaled = |i: usize, z: &Vec3| Vec3::new(z.x / friction[i], z.y, z.z);
    // A, with the blocks that W has.
    let a = w.map(|i, j, block| {
        Mat3::from_fn(|row, column| {
            let left = if row == 0 { friction[i] } else { 1.0 };
            let right = if column == 0 { friction[j] } else { 1.0 };
            block[(row, column)] / (compliance * left * right)
        })
    });
    let b: Vec<Vec3> = (0..n).map(|i| unscaled(i, &q[i]) / velocity).collect();
    let (mut x, mut y) = (vec![Vec3::x(); n], vec![Vec3::x(); n]);
    let mut product = vec![Vec3::zeros(); n];
    let (mut p, mut tangents, mut theta) = (product.clone(), product.clone(), vec![Mat3::zeros(); n]);
    let (mut dx, mut dy) = (product.clone(), product.clone());
    let mut since_best = 0;
    let unit = vec![Mat3::identity(); n];
    while outcome.steps < steps.min(STEPS) && since_best < PATIENCE && !late() {
        multiply(&a, &x, &mut product);
        // The forces as they are now, by the measure that counts.
        let mut error = 0.0;
        for i in 0..n {
            let reaction = project_on_cone(&(unscaled(i, &x[i]) * force), mu[i]);
            let ax = product[i];
            // P (A x + b) is the velocity of the forces before projection, which
            // differ by rounding (or, without friction, by the least one).
            let u = Vec3::new((ax.x + b[i].x) * friction[i], ax.y + b[i].y, ax.z + b[i].z) * velocity;
            error += natural_map(&u, &reaction, mu[i], 1.0).norm_squared();
        }
        let error = error.sqrt();
        if !error.is_finite() {
            break;
        }
        since_best += 1;
        if error < outcome.error {
            since_best = 0;
            outcome.error = error;
            for i in 0..n {
                r[i] = project_on_cone(&(unscaled(i, &x[i]) * force), mu[i]);
            }
            if error <= goal {
                break;
            }
        }
        let barrier = x.iter().zip(&y).map(|(x, y)| x.dot(y)).sum::<Real>() / n as Real;
        let mut unmet = 0.0;
        for i in 0..n {
            let slip = (y[i].y * y[i].y + y[i].z * y[i].z + (SMOOTHING * barrier).powi(2)).sqrt();
            tangents[i] = Vec3::new(0.0, y[i].y, y[i].z) / slip;
            p[i] = y[i] - product[i] - b[i] - Vec3::x() * slip;
            unmet += p[i].norm_squared();
        }
        let unmet = (unmet / n as Real).sqrt();
        // G^-1 Theta
        for i in 0..n {
            let t = tangents[i];
            let Some(mut block) = scaling(&x[i], &y[i]) else { return outcome };
            let normal = block.row(0) - block.row(1) * t.y - block.row(2) * t.z;
            block.set_row(0, &normal);
            theta[i] = block;
        }
        let Some(factors) = w.pattern().factor(&a, &unit, &theta, late) else { return outcome };
        let direction = |target: Real, dx: &mut [Vec3], dy: &mut [Vec3]| {
            for i in 0..n {
                let inverse = Vec3::new(x[i].x, -x[i].y, -x[i].z) / determinant(&x[i]);
                let mut right = inverse * target - y[i];
                right.x -= tangents[i].dot(&right);
                dx[i] = right + p[i];
            }
            factors.solve(dx);
            multiply(&a, dx, dy);
            for i in 0..n {
                dy[i] -= p[i];
                dy[i].x += tangents[i].dot(&dy[i]);
            }
        };
        // The largest step without a barrier says how much of the barrier is still needed.
        direction(0.0, &mut dx, &mut dy);
        let reach = to_the_edge(&x, &dx).min(to_the_edge(&y, &dy)).min(1.0);
        let share = (1.0 - reach).powi(2).max(1e-3);
        direction((share * barrier).max(HOLD * unmet.min(1.0)), &mut dx, &mut dy);
        let length = (TO_THE_EDGE * to_the_edge(&x, &dx).min(to_the_edge(&y, &dy))).min(1.0);
        outcome.steps += 1;
        if length.is_nan() || length < 1e-8 {
            break;
        }
        for i in 0..n {
            x[i] += dx[i] * length;
            y[i] += dy[i] * length;
        }
    }
    outcome
}

/// `A x`.
fn multiply(a: &BlockRows, x: &[Vec3], product: &mut [Vec3]) {
    for (i, product) in product.iter_mut().enumerate() {
        *product = a.row(i).map(|(j, block)| block * x[j]).sum();
    }
}

/// `z_n^2 - |z_t|^2`, without cancellation.
fn determinant(z: &Vec3) -> Real {
    let tangent = z.y.hypot(z.z);
    (z.x - tangent) * (z.x + tangent)
}

/// The scaling of Nesterov and Todd: the `Theta` of this form with `Theta x = y`. `None` at the edge of the cone.
fn scaling(x: &Vec3, y: &Vec3) -> Option<Mat3> {
    let (det_x, det_y) = (determinant(x), determinant(y));
    if !(det_x > 0.0 && det_y > 0.0) {
        return None;
    }
    let (x, y) = (x / det_x.sqrt(), y / det_y.sqrt());
    let gamma = ((1.0 + x.dot(&y)) * 0.5).sqrt();
    let v = (y + Vec3::new(x.x, -x.y, -x.z)) / (2.0 * gamma);
    Some((v * v.transpose() * 2.0 - Mat3::from_diagonal(&Vec3::new(1.0, -1.0, -1.0))) * (det_y / det_x).sqrt())
}

/// The largest step along `d` with which every `z` stays in its cone; infinite if nothing is in the way.
fn to_the_edge(z: &[Vec3], d: &[Vec3]) -> Real {
    let mut least = Real::INFINITY;
    for (z, d) in z.iter().zip(d) {
        // det(z + s d) = det d s^2 + 2 (z, d) s + det z
        let (quadratic, constant) = (determinant(d), determinant(z));
        let linear = z.x * d.x - z.y * d.y - z.z * d.z;
        let discriminant = linear * linear - quadratic * constant;
        if discriminant >= 0.0 {
            let root = discriminant.sqrt();
            if linear < 0.0 {
                least = least.min(constant / (root - linear));
            } else if quadratic < 0.0 {
                least = least.min((linear + root) / -quadratic);
            }
        }
        if d.x < 0.0 {
            least = least.min(-z.x / d.x);
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn scaling_maps_one_point_to_the_other(x in prop::array::uniform3(-1.0..1.0f64), y in prop::array::uniform3(-1.0..1.0f64)) {
            let inside = |z: [Real; 3]| Vec3::new(z[1].hypot(z[2]) + 0.1 + z[0].abs(), z[1], z[2]);
            let (x, y) = (inside(x), inside(y));
            let theta = scaling(&x, &y).unwrap();
            prop_assert!((theta * x - y).norm() < 1e-12 * y.norm());
            prop_assert!((theta - theta.transpose()).norm() < 1e-14 * theta.norm());
        }

        #[test]
        fn a_step_to_the_edge_ends_there(z in prop::array::uniform3(-1.0..1.0f64), d in prop::array::uniform3(-1.0..1.0f64)) {
            let z = Vec3::new(z[1].hypot(z[2]) + 0.1 + z[0].abs(), z[1], z[2]);
            let d = Vec3::from(d);
            let s = to_the_edge(&[z], &[d]);
            let inside = |s: Real| { let end = z + d * s; end.x - end.y.hypot(end.z) };
            if s.is_finite() {
                prop_assert!(inside(s).abs() < 1e-9 * (1.0 + s), "{s}: {}", inside(s));
                prop_assert!(inside(0.999 * s) > 0.0);
            } else {
                prop_assert!(inside(1e6) > 0.0);
            }
        }
    }
}

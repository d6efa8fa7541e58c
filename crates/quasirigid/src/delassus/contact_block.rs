//! One contact, solved exactly: Signorini's condition and Coulomb's cone for a single 3x3 block.
//!
//! Contact frame (normal, tangent1, tangent2). With `W` (m/N, symmetric positive definite) the block of the contact and `b` (m)
//! its displacement when `f_i = 0`, find the reaction `f` (N) such that `delta = W f + b` obeys
//!
//! ```text
//! 0 <= f_n  perp  delta_n >= 0
//! |f_t| < mu f_n  =>  delta_t = 0;      |f_t| = mu f_n  =>  delta_t = -s f_t,  s >= 0
//! ```
//!
//! Three cases, tried in this order; the first that fits is the answer.
//!
//! 1. Open, `b_n >= 0`: `f = 0`.
//! 2. Stick: `f = -W^-1 b`, if it lies in the cone.
//! 3. Slip. The normal row gives `f_n = -(b_n + w_nt . f_t) / w_nn`. Put into the tangential rows it leaves a problem in the plane,
//!
//!    ```text
//!    (Wt + s I) f_t = -bt,    Wt = W_tt - w_tn w_nt / w_nn,    bt = b_t - w_tn b_n / w_nn
//!    ```
//!
//!    with one unknown `s >= 0` (m/N), the slip per unit of friction. `Wt` is
//!    symmetric positive definite, so `f_t(s)` is two divisions in its
//!    eigenbasis. Stick failed, so at `s = 0` the force is outside the cone; for
//!    `s -> inf`, `f_t -> 0` and `f_n -> -b_n / w_nn > 0`, inside.
//!    The root in between is found by Newton's method on `mu f_n / |f_t| - 1`, which is almost a straight line in `s` (exactly
//!    one if `W` is isotropic in the tangent plane and uncoupled), kept inside a bracket.
//!
//! **Drag.** A contact may have a viscous drag `d` (N/m, force per displacement over the step;
//! 0 unless [`ContactBlock::set_drag`] says otherwise) on top, while it slips:
//!
//! ```text
//! |f_t| < mu f_n  =>  delta_t = 0;      delta_t /= 0  =>  f_t = -(mu f_n / |delta_t| + d) delta_t
//! ```
//!
//! With `delta_t = -s f_t` that is `(1 - d s) |f_t| = mu f_n`: the same one unknown, `psi(s) = mu f_n / |f_t| - 1 + d s` with
//! its root in `0 < s <= 1/d`. Implicit: no drag is too large. If drag alone would lift the contact (`f_n < 0` at `s = 1/d`),
//! it just touches, `f_n = 0 = delta_n`, and drags by the share that leaves it there.
//!
//! A single contact with strong coupling may have more than one solution
//! (Painleve). The order above then decides: open before stick before slip.

use super::project_on_cone;
use crate::math::{Mat3, Real, Vec3};
use serde::{Deserialize, Serialize};

/// What a contact does over the step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[repr(u8)]
pub enum ContactStatus {
    /// No force: the surfaces separate, or just touch.
    #[default]
    Open = 0,
    /// Force inside the friction cone: the two material points stay together.
    Stick = 1,
    /// Force on the friction cone: the surfaces slide, against the friction. A closed contact without friction counts as slipping.
    Slip = 2,
}

/// The diagonal block `W_ii` of one contact, prepared for [`ContactBlock::solve`]. 17 numbers of 8 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactBlock {
    /// `W_ii`, symmetric part, m/N.
    w: Mat3,
    /// `1 / w_nn`, N/m.
    inverse_nn: Real,
    /// First eigenvector of `Wt` in the tangent plane: (cosine, sine). The second is (-sine, cosine).
    axis: [Real; 2],
    /// `w_nt` in the eigenbasis, m/N.
    coupling: [Real; 2],
    /// Eigenvalues of `Wt`, m/N.
    eigenvalues: [Real; 2],
    /// Viscous drag `d`, N/m.
    drag: Real,
}

/// Newton or bisection steps at most. Newton alone takes 2 to 6; bisection alone would need about 60 for the last bit.
const MAX_ITERATIONS: u32 = 100;

/// A reduced eigenvalue below this share of the trace of `W` is rounding, not compliance.
const SINGULAR: Real = 1e-14;

impl ContactBlock {
    /// Prepares the block. `None` if it is not finite or not positive definite.
    ///
    /// Only the symmetric part of `w` (m/N) is kept. The sweep takes `b = delta - W_ii f_i` with the same kept block, so that a skew
    /// part, in a matrix that somebody measured or rounded, slows convergence but does not move the solution.
    pub fn new(w: &Mat3) -> Option<Self> {
        let w = (w + w.transpose()) * 0.5;
        let trace = w.trace();
        if !(w.iter().all(|x| x.is_finite()) && w[(0, 0)] > SINGULAR * trace) {
            return None;
        }
        let inverse_nn = 1.0 / w[(0, 0)];
        let (n1, n2) = (w[(0, 1)], w[(0, 2)]);
        // Wt = [p, q; q, r]
        let p = w[(1, 1)] - n1 * n1 * inverse_nn;
        let q = w[(1, 2)] - n1 * n2 * inverse_nn;
        let r = w[(2, 2)] - n2 * n2 * inverse_nn;
        let (half_difference, mean) = (0.5 * (p - r), 0.5 * (p + r));
        let radius = half_difference.hypot(q);
        let angle = 0.5 * q.atan2(half_difference);
        let (sine, cosine) = if radius > 0.0 { angle.sin_cos() } else { (0.0, 1.0) };
        let eigenvalues = [mean + radius, mean - radius];
        if eigenvalues[1].is_nan() || eigenvalues[1] <= SINGULAR * trace {
            return None;
        }
        let coupling = [cosine * n1 + sine * n2, -sine * n1 + cosine * n2];
        Some(Self { w, inverse_nn, axis: [cosine, sine], coupling, eigenvalues, drag: 0.0 })
    }

    /// Sets the viscous drag `d >= 0`, N/m. It acts while the contact slips; reactions hold it then and may lie outside the cone of `mu`.
    pub fn set_drag(&mut self, drag: Real) {
        self.drag = drag;
    }

    /// The viscous drag `d`, N/m.
    pub fn drag(&self) -> Real {
        self.drag
    }

    /// The reaction (N) that is nearest to `f` among those that the contact can have: in its cone, or not pulling if it has a drag.
    pub fn feasible(&self, f: &Vec3, mu: Real) -> Vec3 {
        if self.drag == 0.0 { project_on_cone(f, mu) } else { Vec3::new(f.x.max(0.0), f.y, f.z) }
    }

    /// `f` (N) without what is drag in it at the displacement `delta` (m): the part that obeys Coulomb's law.
    pub fn without_drag(&self, f: &Vec3, delta: &Vec3) -> Vec3 {
        if self.drag == 0.0 {
            return *f;
        }
        let drag = Vec3::new(0.0, delta.y, delta.z) * self.drag;
        let size = drag.norm_squared();
        // Drag in full under pressure; without, whatever share of it is in `f`.
        let share = if f.x > 0.0 || size == 0.0 { 1.0 } else { (-f.dot(&drag) / size).clamp(0.0, 1.0) };
        f + drag * share
    }

    /// The block, m/N.
    pub fn matrix(&self) -> &Mat3 {
        &self.w
    }

    /// The step `rho = 3 / trace(W_ii)` of the natural map, N/m; see [`crate::delassus::natural_map_residual`].
    pub fn rho(&self) -> Real {
        3.0 / self.w.trace()
    }

    /// The reaction (N) of this contact for the displacement `b` (m) that it would have with `f = 0`, and friction coefficient `mu >= 0`.
    #[inline]
    pub fn solve(&self, b: &Vec3, mu: Real) -> (Vec3, ContactStatus) {
        self.solve_dragged(b, mu, self.drag)
    }

    /// The same with another drag, N/m.
    #[inline]
    pub(crate) fn solve_dragged(&self, b: &Vec3, mu: Real, drag: Real) -> (Vec3, ContactStatus) {
        let b_n = b.x;
        if b_n >= 0.0 {
            return (Vec3::zeros(), ContactStatus::Open);
        }
        if mu == 0.0 && drag == 0.0 {
            return (Vec3::new(-b_n * self.inverse_nn, 0.0, 0.0), ContactStatus::Slip);
        }
        let [cosine, sine] = self.axis;
        let normal_share = b_n * self.inverse_nn;
        // bt in the eigenbasis, m.
        let bt =
            [cosine * b.y + sine * b.z - self.coupling[0] * normal_share, -sine * b.y + cosine * b.z - self.coupling[1] * normal_share];
        let f = self.at(&bt, b_n, 0.0);
        let stick = f[0] >= 0.0 && f[1] * f[1] + f[2] * f[2] <= mu * mu * f[0] * f[0];
        let f = if stick { f } else { self.slip(&bt, b_n, mu, drag) };
        let status = if stick { ContactStatus::Stick } else { ContactStatus::Slip };
        (Vec3::new(f[0], cosine * f[1] - sine * f[2], sine * f[1] + cosine * f[2]), status)
    }

    /// The force (normal, first, second eigenvector) with `delta_n = 0` and `delta_t = -s f_t`, N.
    #[inline]
    fn at(&self, bt: &[Real; 2], b_n: Real, s: Real) -> [Real; 3] {
        let (f1, f2) = (-bt[0] / (self.eigenvalues[0] + s), -bt[1] / (self.eigenvalues[1] + s));
        [-(b_n + self.coupling[0] * f1 + self.coupling[1] * f2) * self.inverse_nn, f1, f2]
    }

    /// The force with `f_n = 0 = delta_n` and `delta_t = -s f_t`, in the eigenbasis: the larger
    /// root of `(lambda_1 + s)(lambda_2 + s) f_n(s) = 0`, a quadratic in `s`.
    fn touching(&self, bt: &[Real; 2], b_n: Real) -> [Real; 3] {
        let [l1, l2] = self.eigenvalues;
        let [g1, g2] = [self.coupling[0] * bt[0], self.coupling[1] * bt[1]];
        // b_n s^2 + p s + q = 0, b_n < 0
        let p = b_n * (l1 + l2) - g1 - g2;
        let q = b_n * l1 * l2 - g1 * l2 - g2 * l1;
        let root = (p * p - 4.0 * b_n * q).max(0.0).sqrt();
        let s = (-p - root) / (2.0 * b_n);
        let [_, f1, f2] = self.at(bt, b_n, s.max(0.0));
        [0.0, f1, f2]
    }

    /// The root of `psi(s) = mu f_n(s) / |f_t(s)| - 1 + d s` on `s > 0`, and the force there, in the eigenbasis.
    fn slip(&self, bt: &[Real; 2], b_n: Real, mu: Real, drag: Real) -> [Real; 3] {
        if drag > 0.0 {
            let all_drag = self.at(bt, b_n, 1.0 / drag);
            if all_drag[0] < 0.0 {
                return self.touching(bt, b_n);
            }
            if mu == 0.0 {
                return all_drag;
            }
        }
        // psi(low) < 0; psi(high) > 0 once high is finite.
        let (mut low, mut high) = (0.0, Real::INFINITY);
        let mut s = 0.0;
        let mut f = self.at(bt, b_n, s);
        for _ in 0..MAX_ITERATIONS {
            let [f_n, f1, f2] = f;
            let squared = f1 * f1 + f2 * f2;
            let length = squared.sqrt();
            let psi = (mu * f_n / length - 1.0) + drag * s;
            if psi < 0.0 {
                low = s
            } else {
                high = s
            }
            // f_t' = -f_t / (eigenvalue + s);  f_n' = -w_nt . f_t' / w_nn;  |f_t|' = f_t . f_t' / |f_t|
            let (d1, d2) = (-f1 / (self.eigenvalues[0] + s), -f2 / (self.eigenvalues[1] + s));
            let slope = mu
                * (-(self.coupling[0] * d1 + self.coupling[1] * d2) * self.inverse_nn / length
                    - f_n * (f1 * d1 + f2 * d2) / (squared * length))
                + drag;
            let newton = s - psi / slope;
            // Newton is quadratic: a step this small leaves an error below the last bit.
            let done = (newton - s).abs() <= 1e-10 * (s + self.eigenvalues[1]);
            s = if done || (newton > low && newton < high) {
                newton
            } else if high.is_finite() {
                0.5 * (low + high)
            } else {
                // Growing steps until the bracket closes; the larger eigenvalue is the scale of s.
                2.0 * low + self.eigenvalues[0]
            };
            f = self.at(bt, b_n, s);
            if done {
                break;
            }
        }
        if drag > 0.0 {
            // The rows hold at any s, and s is good to its last bit. The widened cone
            // mu / (1 - d s) is not: near s = 1/d its digits cancel.
            return [f[0].max(0.0), f[1], f[2]];
        }
        // Exactly on the cone: keep the direction d of the friction, solve w_nn f_n + mu f_n w_nt . d + b_n = 0, set |f_t| = mu f_n.
        let length = f[1].hypot(f[2]);
        let direction = [f[1] / length, f[2] / length];
        let stiffness = 1.0 + mu * (self.coupling[0] * direction[0] + self.coupling[1] * direction[1]) * self.inverse_nn;
        let f_n = if stiffness > 0.0 { -b_n * self.inverse_nn / stiffness } else { f[0] };
        [f_n, mu * f_n * direction[0], mu * f_n * direction[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spd() -> impl Strategy<Value = Mat3> {
        // L L^T with a strong normal-tangential coupling, then a scale from 1e-9 to 1e-3 m/N.
        (prop::array::uniform3(0.2..1.0f64), prop::array::uniform3(-2.0..2.0f64), -9.0..-3.0f64).prop_map(|(d, l, scale)| {
            let l = Mat3::new(d[0], 0.0, 0.0, l[0], d[1], 0.0, l[1], l[2], d[2]);
            l * l.transpose() * 10f64.powf(scale)
        })
    }

    fn rotation_about_normal(angle: Real) -> Mat3 {
        let (s, c) = angle.sin_cos();
        Mat3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
    }

    /// Largest violation of the three laws, relative to the sizes of force and displacement.
    fn violation(w: &Mat3, b: &Vec3, mu: Real, f: &Vec3, status: ContactStatus) -> Real {
        let delta = w * f + b;
        let displacement = w.norm() * f.norm() + b.norm();
        let force = f.norm().max(1e-300);
        let (f_t, delta_t) = (Vec3::new(0.0, f.y, f.z), Vec3::new(0.0, delta.y, delta.z));
        let cone = (f_t.norm() - mu * f.x).max(0.0) / force;
        match status {
            ContactStatus::Open => f.norm() + (-delta.x).max(0.0),
            ContactStatus::Stick => (delta.norm() / displacement).max(cone).max(-f.x / force),
            ContactStatus::Slip => {
                let on_cone = (f_t.norm() - mu * f.x).abs() / force;
                let across = f_t.cross(&delta_t).norm() / (force * displacement);
                let along = f_t.dot(&delta_t).max(0.0) / (force * displacement);
                let across = if mu == 0.0 { 0.0 } else { across };
                (delta.x.abs() / displacement).max(on_cone).max(across).max(along).max(-f.x / force)
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn laws_hold_to_rounding(w in spd(), b in prop::array::uniform3(-1.0..1.0f64), mu in prop_oneof![Just(0.0), 0.0..2.0f64]) {
            let b = Vec3::from(b) * 1e-4;
            let block = ContactBlock::new(&w).unwrap();
            let (f, status) = block.solve(&b, mu);
            let v = violation(&w, &b, mu, &f, status);
            prop_assert!(v < 1e-12, "{status:?}: violation {v:e}");
        }

        #[test]
        fn laws_hold_with_drag(
            w in spd(), b in prop::array::uniform3(-1.0..1.0f64), mu in prop_oneof![Just(0.0), 0.0..2.0f64], drag in -3.0..3.0f64,
        ) {
            let b = Vec3::from(b) * 1e-4;
            let mut block = ContactBlock::new(&w).unwrap();
            block.set_drag(10f64.powf(drag) * block.rho());
            let (f, status) = block.solve(&b, mu);
            let delta = w * f + b;
            let coulomb = block.without_drag(&f, &delta);
            prop_assert!((coulomb - f).norm() <= block.drag() * delta.norm() * (1.0 + 1e-9) + 1e-12 * f.norm(), "more drag than there is");
            prop_assert!(status != ContactStatus::Stick || f == ContactBlock::new(&w).unwrap().solve(&b, mu).0, "drag while stuck");
            // What is left without drag obeys Coulomb's law at the displacement that the whole makes.
            let map = crate::delassus::natural_map(&delta, &coulomb, mu, block.rho());
            let (violation, force) = (map.norm(), f.norm());
            prop_assert!(
                violation <= 1e-9 * (force + block.rho() * b.norm()), "{status:?}: natural map {violation:e} of {force:e}"
            );
        }

        #[test]
        fn scaling_displacement_or_compliance_scales_the_force(w in spd(), b in prop::array::uniform3(-1.0..1.0f64), mu in 0.0..1.5f64) {
            let b = Vec3::from(b);
            let (f, status) = ContactBlock::new(&w).unwrap().solve(&b, mu);
            // Powers of two: every rounding is the same.
            let (scaled, scaled_status) = ContactBlock::new(&(w * 4.0)).unwrap().solve(&(b * 0.25), mu);
            prop_assert_eq!(status, scaled_status);
            prop_assert!((scaled * 16.0 - f).norm() <= 1e-12 * f.norm(), "{} against {}", scaled * 16.0, f);
        }

        #[test]
        fn turning_the_tangents_turns_the_force(
            w in spd(), b in prop::array::uniform3(-1.0..1.0f64), mu in 0.05..0.6f64, angle in -3.0..3.0f64,
        ) {
            let b = Vec3::from(b);
            let rotation = rotation_about_normal(angle);
            let (f, status) = ContactBlock::new(&w).unwrap().solve(&b, mu);
            let (turned, turned_status) = ContactBlock::new(&(rotation * w * rotation.transpose())).unwrap().solve(&(rotation * b), mu);
            // On the very border of the cone the two may differ in name, never in force.
            prop_assert!(status == turned_status || (turned - rotation * f).norm() <= 1e-10 * f.norm());
            prop_assert!((turned - rotation * f).norm() <= 1e-8 * f.norm(), "{turned} against {}", rotation * f);
        }

        #[test]
        fn slip_agrees_with_brute_force_over_the_angle(w in spd(), b in prop::array::uniform3(-1.0..1.0f64), mu in 0.05..1.0f64) {
            let b = Vec3::new(-b[0].abs() - 0.01, b[1], b[2]);
            let (f, status) = ContactBlock::new(&w).unwrap().solve(&b, mu);
            if status != ContactStatus::Slip {
                return Ok(());
            }
            // For every direction of friction the normal row gives f; the law holds where delta_t is parallel to f_t and against it.
            let ray_at = |angle: Real| Vec3::new(1.0, mu * angle.cos(), mu * angle.sin());
            let force_at = |angle: Real| ray_at(angle) * (-b.x / (w * ray_at(angle)).x);
            // Times the denominator of the force, so that there is no pole beside a
            // root: strong coupling brings them within a step of each other.
            let across = |angle: Real| {
                let moved = w * ray_at(angle);
                let delta = moved * -b.x + b * moved.x;
                delta.y * angle.sin() - delta.z * angle.cos()
            };
            let steps = 3600;
            let mut best = Real::INFINITY;
            for k in 0..steps {
                let (mut low, mut high) = (k as Real, (k + 1) as Real);
                let to_angle = |k: Real| k * std::f64::consts::TAU / steps as Real;
                if across(to_angle(low)) * across(to_angle(high)) > 0.0 {
                    continue;
                }
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if across(to_angle(low)) * across(to_angle(middle)) <= 0.0 { high = middle } else { low = middle }
                }
                best = best.min((force_at(to_angle(low)) - f).norm() / f.norm());
            }
            prop_assert!(best < 1e-6, "nearest brute-force solution differs by {best:e}");
        }
    }

    #[test]
    fn without_coupling_the_closed_form_comes_out() {
        let block = ContactBlock::new(&Mat3::from_diagonal(&Vec3::new(2e-5, 1e-5, 1e-5))).unwrap();
        let (stick, status) = block.solve(&Vec3::new(-2e-5, 3e-6, 0.0), 0.5);
        assert_eq!(status, ContactStatus::Stick);
        assert!((stick - Vec3::new(1.0, -0.3, 0.0)).norm() < 1e-15, "{stick}");
        let (slip, status) = block.solve(&Vec3::new(-2e-5, 3e-5, -4e-5), 0.5);
        assert_eq!(status, ContactStatus::Slip);
        assert!((slip - Vec3::new(1.0, -0.3, 0.4)).norm() < 1e-15, "{slip}");
        assert_eq!(block.solve(&Vec3::new(0.0, 1.0, 1.0), 0.5), (Vec3::zeros(), ContactStatus::Open));
    }

    /// Next to all of the tangential force is drag here, 1 - d s = 2e-7: the force must come from the rows, not from the widened cone.
    #[test]
    fn drag_that_leaves_friction_nothing_keeps_the_laws() {
        let coupling = 0.00010511436182189198;
        let w = Mat3::new(4e-5, coupling, 0.0, coupling, 0.0003162257265305906, 0.0, 0.0, 0.0, 4e-5);
        let b = Vec3::new(-0.0022544728196445397, 0.0, -0.20052820890117254) * 1e-4;
        let mu = 2.189267003998095e-5;
        let mut block = ContactBlock::new(&w).unwrap();
        block.set_drag(10f64.powf(2.7737883416554165) * block.rho());
        let (f, status) = block.solve(&b, mu);
        let delta = w * f + b;
        let map = crate::delassus::natural_map(&delta, &block.without_drag(&f, &delta), mu, block.rho());
        assert_eq!(status, ContactStatus::Slip);
        assert!(map.norm() <= 1e-12 * f.norm(), "natural map {:e} of {:e}", map.norm(), f.norm());
    }

    #[test]
    fn a_block_that_is_not_positive_definite_is_refused() {
        for w in [
            Mat3::zeros(),
            Mat3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0)),
            Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0)),
            Mat3::from_element(1.0),
            Mat3::from_diagonal(&Vec3::new(1.0, Real::NAN, 1.0)),
            Mat3::from_diagonal(&Vec3::new(Real::INFINITY, 1.0, 1.0)),
        ] {
            assert!(ContactBlock::new(&w).is_none(), "{w}");
        }
    }
}

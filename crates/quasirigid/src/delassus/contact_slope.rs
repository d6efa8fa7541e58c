//! The derivative of the exact solution of one contact, which Newton's methods need.

use super::ContactStatus;
use crate::math::{Mat3, Real, Vec3};

/// `T = -dS/db` (N/m) of one contact with block `w`, at displacement `b` (m) and its solution `f` (N).
///
/// Open: 0. Stick: `W^-1`. Slip: the equations `W f + s P f + b = 0`, with `P` the tangential part and `s` the slip per friction,
/// and `|f_t|^2 = mu^2 f_n^2`, differentiated: with `M = W + s P`, `u = M^-1 (0, f_t)` and `v = (-mu^2 f_n, f_t)`,
///
/// ```text
/// M df + (0, f_t) ds = -db,   v . df = 0      =>      T = M^-1 - u (M^-1 v)^T / (v . u)
/// ```
///
/// With a drag `d` (N/m) the last equation is `(1 - d s) |f_t| = mu f_n`: `v = (-mu |f_t|, (1 - d s) f_t)`, and `d |f_t|^2`
/// is added to `v . u`. Where drag holds the contact at `f_n = 0` it is `f_n = 0`: `v = (1, 0)`.
pub(crate) fn slope(w: &Mat3, b: &Vec3, mu: Real, drag: Real, f: &Vec3, status: ContactStatus) -> Mat3 {
    match status {
        ContactStatus::Open => Mat3::zeros(),
        ContactStatus::Stick => w.try_inverse().unwrap_or_else(Mat3::zeros),
        ContactStatus::Slip if mu == 0.0 && drag == 0.0 => Mat3::from_diagonal(&Vec3::new(1.0 / w[(0, 0)], 0.0, 0.0)),
        ContactStatus::Slip => {
            let delta = w * f + b;
            let friction = Vec3::new(0.0, f.y, f.z);
            let s = (-delta.dot(&friction) / friction.norm_squared()).max(0.0);
            let Some(inverse) = (w + Mat3::from_diagonal(&Vec3::new(0.0, s, s))).try_inverse() else {
                return Mat3::zeros();
            };
            let u = inverse * friction;
            let v = if drag > 0.0 && f.x == 0.0 {
                Vec3::x()
            } else if drag > 0.0 {
                let grip = (1.0 - drag * s).max(0.0);
                Vec3::new(-mu * friction.norm(), grip * f.y, grip * f.z)
            } else {
                Vec3::new(-mu * mu * f.x, f.y, f.z)
            };
            let stiffened = if drag > 0.0 && f.x != 0.0 { drag * friction.norm_squared() } else { 0.0 };
            let denominator = v.dot(&u) + stiffened;
            if denominator == 0.0 { inverse } else { inverse - u * (inverse * v).transpose() / denominator }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::ContactBlock;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn slope_is_the_derivative_of_the_local_solve(
            d in prop::array::uniform3(0.5..2.0f64), c in prop::array::uniform3(-0.3..0.3f64),
            b in prop::array::uniform3(-1.0..1.0f64), db in prop::array::uniform3(-1.0..1.0f64), mu in prop_oneof![Just(0.0), 0.1..0.9f64],
            drag in prop_oneof![Just(0.0), 0.1..5.0f64],
        ) {
            let w = Mat3::new(d[0], c[0], c[1], c[0], d[1], c[2], c[1], c[2], d[2]);
            let (b, db) = (Vec3::from(b), Vec3::from(db) * 1e-6);
            let Some(mut block) = ContactBlock::new(&w) else { return Ok(()) };
            block.set_drag(drag);
            let (f, status) = block.solve(&b, mu);
            let (after, status_after) = block.solve(&(b + db), mu);
            let (before, status_before) = block.solve(&(b - db), mu);
            // At a kink there is no derivative; far from the apex only, where the curvature is bounded.
            if status != status_after || status != status_before || (f.x < 0.05 && status != ContactStatus::Open) {
                return Ok(());
            }
            let error = (slope(&w, &b, mu, drag, &f, status) * db * 2.0 + (after - before)).norm() / db.norm();
            prop_assert!(error < 1e-6, "{status:?}: {error:e}");
        }
    }
}

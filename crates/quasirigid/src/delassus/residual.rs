//! How far reactions are from the solution: the natural map with De Saxce's shift.
//!
//! With `K_mu = { f : |f_t| <= mu f_n }` (N) and the shifted displacement `delta + mu |delta_t| n` (m),
//! Signorini and Coulomb together say that the shifted displacement lies in the dual cone and is orthogonal
//! to `f` (De Saxce and Feng 1998). That is the case if and only if, for any `rho > 0`,
//!
//! ```text
//! f = proj_K( f - rho (delta + mu |delta_t| n) )
//! ```
//!
//! so the difference of the two sides, in N, measures every law at once: penetration, pulling contacts,
//! forces outside the cone, slip without full friction, friction that does not oppose slip.
//!
//! Two choices make a number of it that means the same in every scene.
//! `rho_i = 3 / trace(W_ii)` (N/m), the inverse of the mean compliance of the contact: it turns a displacement into
//! the force that would undo it. The sum over contacts is divided by `|f|`. So `1e-8` reads: the forces are wrong by
//! a hundred-millionth of what they are, in the contacts' own stiffness. If `f` is zero, every error is as large as
//! what it is compared with: the residual is 0 for an exact solution and 1 otherwise.

use crate::math::{Real, Vec3};

/// Orthogonal projection of `x` (N) on the cone `|x_t| <= mu x_n`; normal first.
#[inline]
pub fn project_on_cone(x: &Vec3, mu: Real) -> Vec3 {
    let squared = x.y * x.y + x.z * x.z;
    if x.x >= 0.0 && squared <= mu * mu * x.x * x.x {
        return *x;
    }
    let tangent = squared.sqrt();
    // In the plane of axis and x the nearest edge has direction (1, mu) / sqrt(1 + mu^2).
    let along = x.x + mu * tangent;
    if along <= 0.0 {
        return Vec3::zeros();
    }
    let normal = along / (1.0 + mu * mu);
    // `tangent` is zero only for a point inside the cone or on the negative axis: both have been answered.
    let scale = if mu == 0.0 { 0.0 } else { mu * normal / tangent };
    Vec3::new(normal, x.y * scale, x.z * scale)
}

/// The natural map `f - proj_K(f - rho (delta + mu |delta_t| n))` of one contact, N.
/// `delta` in m, `f` in N, both in the contact frame; `rho` in N/m.
#[inline]
pub fn natural_map(delta: &Vec3, f: &Vec3, mu: Real, rho: Real) -> Vec3 {
    let slip = (delta.y * delta.y + delta.z * delta.z).sqrt();
    let shifted = Vec3::new(delta.x + mu * slip, delta.y, delta.z);
    f - project_on_cone(&(f - shifted * rho), mu)
}

/// The residual over all contacts, no unit: norm of [`natural_map`] over norm of `f`.
///
/// With `rho_i = 3 / trace(W_ii)` ([`crate::delassus::ContactBlock::rho`]) an error in displacement counts as the
/// force that would undo it. If `f` is zero the residual is 0 for an exact solution and 1 otherwise.
///
/// `delta` (m) and `f` (N) in contact frames, `mu` and `rho` (N/m, see the module)
/// one per contact; all of the same length, the shortest counts.
pub fn natural_map_residual(delta: &[Vec3], f: &[Vec3], mu: &[Real], rho: &[Real]) -> Real {
    let (mut error, mut force) = (0.0, 0.0);
    for (((delta, f), mu), rho) in delta.iter().zip(f).zip(mu).zip(rho) {
        error += natural_map(delta, f, *mu, *rho).norm_squared();
        force += f.norm_squared();
    }
    relative(error, force)
}

/// The residual as the literature has it: the natural map with `rho = 1`, so that forces and displacements are
/// compared as plain numbers, over the largest of `|q|`, `|f|` and `|delta|` (norms over all contacts). What
/// `fc3d_compute_error` of Siconos gives. It depends on the units of `W`; [`natural_map_residual`] does not.
///
/// `delta = W f + q`, `f` and `q` in contact frames, `mu` one per contact; all of the same length, the shortest counts.
pub fn residual_as_given(delta: &[Vec3], f: &[Vec3], q: &[Vec3], mu: &[Real]) -> Real {
    let mut sums = AsGiven::default();
    for (((delta, f), q), mu) in delta.iter().zip(f).zip(q).zip(mu) {
        sums.add(delta, f, q, *mu);
    }
    sums.residual()
}

/// The squared norms that [`residual_as_given`] is made of.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct AsGiven {
    pub(crate) error: Real,
    pub(crate) force: Real,
    pub(crate) displacement: Real,
    pub(crate) free: Real,
}

impl AsGiven {
    #[inline]
    pub(crate) fn add(&mut self, delta: &Vec3, f: &Vec3, q: &Vec3, mu: Real) {
        self.error += natural_map(delta, f, mu, 1.0).norm_squared();
        self.force += f.norm_squared();
        self.displacement += delta.norm_squared();
        self.free += q.norm_squared();
    }

    /// What the error is divided by, squared.
    pub(crate) fn scale(&self) -> Real {
        self.force.max(self.displacement).max(self.free)
    }

    pub(crate) fn residual(&self) -> Real {
        relative(self.error, self.scale())
    }
}

/// Ratio of two squared norms, with the convention of the module for `f = 0`.
pub(crate) fn relative(error: Real, force: Real) -> Real {
    if error == 0.0 {
        0.0
    } else if force == 0.0 {
        1.0
    } else {
        (error / force).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::ContactBlock;
    use super::*;
    use crate::math::Mat3;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// The definition: p is in the cone, and (x - p).(q - p) <= 0 for every q in it; for a cone, for its edges and its apex.
        #[test]
        fn projection_is_the_nearest_point_of_the_cone(
            x in prop::array::uniform3(-1.0..1.0f64), mu in prop_oneof![Just(0.0), 0.0..3.0f64],
        ) {
            let x = Vec3::from(x);
            let p = project_on_cone(&x, mu);
            prop_assert!(p.x >= 0.0 && p.y.hypot(p.z) <= mu * p.x * (1.0 + 1e-14) + 1e-300);
            prop_assert!((x - p).dot(&p).abs() < 1e-14, "not orthogonal: {:e}", (x - p).dot(&p));
            for k in 0..64 {
                let angle = k as Real * std::f64::consts::TAU / 64.0;
                let edge = Vec3::new(1.0, mu * angle.cos(), mu * angle.sin());
                prop_assert!((x - p).dot(&edge) <= 1e-14 * edge.norm(), "edge {k} is nearer");
            }
            prop_assert!((project_on_cone(&p, mu) - p).norm() <= 1e-15);
        }

        #[test]
        fn an_exact_solution_has_no_residual_and_any_other_has(
            d in prop::array::uniform3(0.5..2.0f64), c in prop::array::uniform3(-0.4..0.4f64),
            b_n in prop_oneof![-1.0..-0.05, 0.05..1.0f64], b_t in prop::array::uniform2(-1.0..1.0f64),
            mu in prop_oneof![Just(0.0), 0.05..1.0f64],
            rho in 0.1..10.0f64,
        ) {
            let w = Mat3::new(d[0], c[0], c[1], c[0], d[1], c[2], c[1], c[2], d[2]);
            let b = Vec3::new(b_n, b_t[0], b_t[1]);
            let Some(block) = ContactBlock::new(&w) else { return Ok(()) };
            let (f, _) = block.solve(&b, mu);
            let exact = natural_map_residual(&[w * f + b], &[f], &[mu], &[rho]);
            prop_assert!(exact < 1e-12, "{exact:e}");
            let wrong = f * 1.01 + Vec3::new(1e-3, 0.0, 0.0);
            let not_exact = natural_map_residual(&[w * wrong + b], &[wrong], &[mu], &[rho]);
            prop_assert!(not_exact > 1e-5, "{not_exact:e}");
        }
    }

    #[test]
    fn the_number_has_no_unit() {
        let (delta, f) = (Vec3::new(-1e-4, 2e-4, 0.0), Vec3::new(1.0, 0.1, 0.2));
        let reference = natural_map_residual(&[delta], &[f], &[0.5], &[1e4]);
        // Micrometre and kilonewton instead of metre and newton.
        let other = natural_map_residual(&[delta * 1e6], &[f * 1e-3], &[0.5], &[1e4 * 1e-9]);
        assert!((reference - other).abs() < 1e-12 * reference, "{reference} against {other}");
    }

    #[test]
    fn without_forces_it_is_all_or_nothing() {
        assert_eq!(natural_map_residual(&[Vec3::new(1e-3, 0.0, 0.0)], &[Vec3::zeros()], &[0.5], &[1e4]), 0.0);
        assert_eq!(natural_map_residual(&[Vec3::new(-1e-9, 0.0, 0.0)], &[Vec3::zeros()], &[0.5], &[1e4]), 1.0);
        assert_eq!(natural_map_residual(&[], &[], &[], &[]), 0.0);
    }
}

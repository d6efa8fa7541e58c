//! The direction in which a set of points is flattest: eigenvector of the smallest eigenvalue of a symmetric 3x3 matrix.

use crate::math::{Mat3, Real, Vec3};

/// Two eigenvalues closer than this, as a share of the trace, leave no direction to speak of.
const SEPARATION: Real = 1e-6;
/// Newton steps before the two smallest eigenvalues count as one (a single root takes under ten).
const MAX_NEWTON: usize = 30;

/// Unit eigenvector of the smallest eigenvalue of the symmetric positive semi-definite `m`, sign arbitrary. `None` where the
/// smallest eigenvalue is not simple (points on a line, or as thick as they are wide), or `m` is zero or not finite.
///
/// With `m` scaled to trace 1, the characteristic polynomial `x^3 - x^2 + c1 x - c0` (c1: sum of the principal 2x2 minors,
/// c0: determinant) increases and is concave below its smallest root, so Newton's method from 0 climbs to that root without
/// overshooting; for a flat patch one or two steps do. The rows of `m - x I` then span the plane across the eigenvector, and
/// the longest of their cross products is the best conditioned. No trigonometry: faster, and the same bits on every platform.
pub fn smallest_eigenvector(m: &Mat3) -> Option<Vec3> {
    let trace = m.m11 + m.m22 + m.m33;
    if !(trace > Real::MIN_POSITIVE && trace.is_finite()) {
        return None;
    }
    let scale = 1.0 / trace;
    let (a, b, c) = (m.m11 * scale, m.m22 * scale, m.m33 * scale);
    let (d, e, f) = (m.m12 * scale, m.m13 * scale, m.m23 * scale);
    let c1 = (a * b - d * d) + (a * c - e * e) + (b * c - f * f);
    let c0 = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e);
    let mut x = 0.0;
    for _ in 0..MAX_NEWTON {
        let value = ((x - 1.0) * x + c1) * x - c0;
        let slope = (3.0 * x - 2.0) * x + c1;
        if slope <= 0.0 {
            break;
        }
        let step = value / slope;
        x -= step;
        if step.abs() < 1e-15 {
            break;
        }
    }
    let (r0, r1, r2) = (Vec3::new(a - x, d, e), Vec3::new(d, b - x, f), Vec3::new(e, f, c - x));
    let crosses = [r0.cross(&r1), r1.cross(&r2), r2.cross(&r0)];
    let mut longest = crosses[0];
    for cross in &crosses[1..] {
        if cross.norm_squared() > longest.norm_squared() {
            longest = *cross;
        }
    }
    // The length is at least a third of the product of the distances to the two other eigenvalues.
    let length = longest.norm();
    (length > SEPARATION).then(|| longest / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SymmetricEigen;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_the_eigen_decomposition_of_nalgebra(
            rows in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 3..20), flat in 0.0..1.0f64, size in -6i32..6,
        ) {
            let size = (10.0 as Real).powi(size);
            let m: Mat3 = rows.iter().map(|r| Vec3::new(r[0], r[1], r[2] * flat) * size).map(|p| p * p.transpose()).sum();
            let eigen = SymmetricEigen::new(m);
            let mut order = [0, 1, 2];
            order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
            let trace = m.trace();
            let gap = (eigen.eigenvalues[order[1]] - eigen.eigenvalues[order[0]]) / trace;
            prop_assume!(gap > 1e-4);
            let n = smallest_eigenvector(&m).unwrap();
            let angle = n.cross(&eigen.eigenvectors.column(order[0]).into_owned()).norm();
            prop_assert!(angle < 1e-12 / gap, "angle {:e} at separation {:e}", angle, gap);
        }
    }

    #[test]
    fn exact_plane_line_ball_and_nonsense() {
        assert_eq!(smallest_eigenvector(&Mat3::from_diagonal(&Vec3::new(2.0, 3.0, 0.0))).unwrap().abs(), Vec3::z());
        assert_eq!(smallest_eigenvector(&Mat3::from_diagonal(&Vec3::new(0.0, 3.0, 3.0))).unwrap().abs(), Vec3::x());
        assert_eq!(smallest_eigenvector(&Mat3::from_diagonal(&Vec3::new(1.0, 0.0, 0.0))), None);
        assert_eq!(smallest_eigenvector(&Mat3::identity()), None);
        assert_eq!(smallest_eigenvector(&Mat3::zeros()), None);
        assert_eq!(smallest_eigenvector(&Mat3::repeat(Real::NAN)), None);
    }
}

//! The one scalar, and short names for the vectors, matrices and poses used everywhere.

use nalgebra as na;

/// The scalar of the engine.
pub type Real = f64;
/// A point or vector, m or N unless its name says otherwise.
pub type Vec3 = na::Vector3<Real>;
/// A 3x3 matrix.
pub type Mat3 = na::Matrix3<Real>;
/// Six generalised coordinates: translation first, rotation second.
pub type Vec6 = na::Vector6<Real>;
/// A 6x6 matrix over [`Vec6`].
pub type Mat6 = na::Matrix6<Real>;
/// Rows of a contact (normal, tangent1, tangent2) over the generalised coordinates of one body.
pub type Mat3x6 = na::Matrix3x6<Real>;
/// A rotation.
pub type Rot = na::UnitQuaternion<Real>;
/// A pose; `pose12` is "2 in the frame of 1".
pub type Pose = na::Isometry3<Real>;

/// Most generalised coordinates that one body has: 6 for a free body, up to 6 joints for a finger.
pub const MAX_DOF: usize = 6;

/// The matrix `[v]x` with `[v]x w = v x w`.
pub fn skew(v: &Vec3) -> Mat3 {
    Mat3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// An orthonormal frame whose columns are (normal, tangent1, tangent2), right-handed.
/// `tangent1` follows `hint` as far as it can, so that a frame turns smoothly with its body.
pub fn contact_frame(normal: &Vec3, hint: &Vec3) -> Mat3 {
    let mut tangent1 = hint - normal * normal.dot(hint);
    if tangent1.norm_squared() < 1e-6 * hint.norm_squared() || tangent1.norm_squared() == 0.0 {
        tangent1 = any_perpendicular(normal);
    }
    let tangent1 = tangent1.normalize();
    let tangent2 = normal.cross(&tangent1);
    Mat3::from_columns(&[*normal, tangent1, tangent2])
}

/// A unit vector perpendicular to `v`, always the same for the same `v`.
pub fn any_perpendicular(v: &Vec3) -> Vec3 {
    let axis = match v.iamin() {
        0 => Vec3::x(),
        1 => Vec3::y(),
        _ => Vec3::z(),
    };
    v.cross(&axis).normalize()
}

/// Whether every component of a pose is finite.
pub fn pose_is_finite(pose: &Pose) -> bool {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn contact_frame_is_a_rotation(n in prop::array::uniform3(-1.0..1.0f64), h in prop::array::uniform3(-1.0..1.0f64)) {
            let n = Vec3::from(n);
            prop_assume!(n.norm() > 1e-3);
            let n = n.normalize();
            for hint in [Vec3::from(h), n, Vec3::zeros()] {
                let e = contact_frame(&n, &hint);
                prop_assert!((e.transpose() * e - Mat3::identity()).norm() < 1e-12);
                prop_assert!((e.determinant() - 1.0).abs() < 1e-12);
                prop_assert!((e.column(0) - n).norm() < 1e-15);
            }
        }
    }
}

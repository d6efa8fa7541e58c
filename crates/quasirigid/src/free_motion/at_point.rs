//! Displacement of a point of a body by its free motion.

use super::FreeMotion;
use crate::math::Vec3;
use crate::objects::Side;

/// Displacement in this step, before contact forces, of the material point at `point` (world, m), all to first order: free motion
/// and prescribed motion. A bound on how far bodies go; the contacts of a pair use [`crate::pair::Pair::free_displacement`].
pub(crate) fn free_displacement(side: Side<'_>, free: &FreeMotion, point: &Vec3) -> Vec3 {
    let prescribed = side.body.body.prescribed_displacement(point);
    if free.dof == 0 {
        return prescribed;
    }
    side.point_jacobian(point) * free.displacement + prescribed
}

/// Displacement in this step, before contact forces, that is not in [`super::Expected`]: all of that of a free body, none of a fixed one.
pub(crate) fn unexpected_displacement(side: Side<'_>, free: &FreeMotion, point: &Vec3) -> Vec3 {
    if free.dof == 0 {
        return Vec3::zeros();
    }
    side.point_jacobian(point) * (free.displacement - free.expected_joints)
}

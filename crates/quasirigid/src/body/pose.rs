//! Poses: what is refused as one, and the way from one to another.

use crate::error::{Error, Result};
use crate::math::{Pose, Vec3, pose_is_finite};

/// Translation of the origin (m) and rotation vector (rad, world) that take one pose to another.
pub(crate) fn displacement_between(start: &Pose, end: &Pose) -> (Vec3, Vec3) {
    (end.translation.vector - start.translation.vector, (end.rotation * start.rotation.inverse()).scaled_axis())
}

/// Refuses a pose with NaN or infinity in it.
pub(crate) fn check_pose(what: &str, pose: &Pose) -> Result<()> {
    if pose_is_finite(pose) {
        return Ok(());
    }
    Err(Error::value(what, "finite position and quaternion", "a pose with NaN or infinity", "check where the pose comes from"))
}

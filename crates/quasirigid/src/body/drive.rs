//! The damped spring that pulls a free body to a pose given from outside: a tracked hand, a recorded path.

use super::rigid::check_pose;
use crate::error::{Result, check_finite, check_non_negative};
use crate::math::{Mat3, Mat6, Pose, Real, Vec3, Vec6};

/// A damped spring in six directions between a free body and a target pose, taken implicitly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseDrive {
    /// Where the body frame should be at the end of the step (world).
    pub target: Pose,
    /// Velocity of the target: of the point where the centre of mass should be (m/s), then angular (rad/s), world axes.
    pub target_velocity: Vec6,
    /// Stiffness in translation (N/m) and rotation (N m/rad).
    pub stiffness: [Real; 2],
    /// Damping in translation (N s/m) and rotation (N m s/rad).
    pub damping: [Real; 2],
}

impl PoseDrive {
    /// A spring to a target at rest.
    ///
    /// # Errors
    /// Non-finite numbers, negative stiffness or damping.
    pub fn new(target: Pose, stiffness: [Real; 2], damping: [Real; 2]) -> Result<Self> {
        let drive = Self { target, target_velocity: Vec6::zeros(), stiffness, damping };
        drive.check()?;
        Ok(drive)
    }

    /// Refuses non-finite numbers and negative stiffness or damping.
    ///
    /// # Errors
    /// As said.
    pub fn check(&self) -> Result<()> {
        check_pose("target of the drive", &self.target)?;
        check_finite("target velocity of the drive", self.target_velocity.iter())?;
        check_non_negative("translational stiffness of the drive", self.stiffness[0], "N/m")?;
        check_non_negative("rotational stiffness of the drive", self.stiffness[1], "N m/rad")?;
        check_non_negative("translational damping of the drive", self.damping[0], "N s/m")?;
        check_non_negative("rotational damping of the drive", self.damping[1], "N m s/rad")
    }

    /// Adds the drive to the equations of a step, `A dx = g`.
    ///
    /// The pull at the end of the step (e: error at its start, world axes; v: target velocity; K, D diagonal)
    ///
    /// ```text
    ///     F = K (e - dx) + D (v - dx/dt)      so      A += K + D/dt,      g += K e + D v
    /// ```
    ///
    /// with e = (target centre - centre, rotation vector of R_target R^T).
    pub(crate) fn add_to(&self, pose: &Pose, center_of_mass: &Vec3, dt: Real, matrix: &mut Mat6, force: &mut Vec6) {
        let center = nalgebra::Point3::from(*center_of_mass);
        let linear = self.target * center - pose * center;
        let angular = (self.target.rotation * pose.rotation.inverse()).scaled_axis();
        for (block, error) in [linear, angular].into_iter().enumerate() {
            let (k, d) = (self.stiffness[block], self.damping[block]);
            let velocity: Vec3 = self.target_velocity.fixed_rows::<3>(3 * block).into();
            let mut rows = force.fixed_rows_mut::<3>(3 * block);
            rows += error * k + velocity * d;
            let mut diagonal = matrix.fixed_view_mut::<3, 3>(3 * block, 3 * block);
            diagonal += Mat3::identity() * (k + d / dt);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_drives_are_refused() {
        assert!(PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, 0.0]).is_ok());
        assert!(PoseDrive::new(Pose::identity(), [-1.0, 1.0], [0.0, 0.0]).is_err());
        assert!(PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, Real::NAN]).is_err());
        assert!(PoseDrive::new(Pose::translation(Real::NAN, 0.0, 0.0), [1.0, 1.0], [0.0, 0.0]).is_err());
    }
}

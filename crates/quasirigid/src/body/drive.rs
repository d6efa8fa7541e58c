//! The damped spring that pulls a free body to a pose given from outside: a tracked hand, a recorded path.

use crate::body::pose::check_pose;
use crate::error::{Error, Result, check_finite, check_non_negative};
use crate::math::{Mat3, Mat6, Pose, Real, Vec3, Vec6};
use serde::{Deserialize, Serialize};

/// A damped spring in six directions between a free body and a target pose, taken implicitly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseDrive {
    /// Where the body frame should be at the end of the step (world).
    pub target: Pose,
    /// Velocity of the target: of the point where the centre of mass should be (m/s), then angular (rad/s), world axes.
    pub target_velocity: Vec6,
    /// Stiffness in translation (N/m) and rotation (N m/rad).
    pub stiffness: [Real; 2],
    /// Damping in translation (N s/m) and rotation (N m s/rad).
    pub damping: [Real; 2],
    /// Largest force (N) and torque (N m) of the pull. Infinite for a spring without a limit.
    pub max_pull: [Real; 2],
    /// Largest speed to which it brings a body that nothing else moves: m/s and rad/s. Infinite for one without a limit.
    pub max_speed: [Real; 2],
}

impl PoseDrive {
    /// A spring to a target at rest, without limits.
    ///
    /// # Errors
    /// Non-finite numbers, negative stiffness or damping.
    pub fn new(target: Pose, stiffness: [Real; 2], damping: [Real; 2]) -> Result<Self> {
        let unlimited = [Real::INFINITY; 2];
        let drive = Self { target, target_velocity: Vec6::zeros(), stiffness, damping, max_pull: unlimited, max_speed: unlimited };
        drive.check()?;
        Ok(drive)
    }

    /// Refuses non-finite numbers, negative stiffness or damping, and limits that are not above 0.
    ///
    /// # Errors
    /// As said.
    pub fn check(&self) -> Result<()> {
        check_pose("target of the drive", &self.target)?;
        check_finite("target velocity of the drive", self.target_velocity.iter())?;
        check_non_negative("translational stiffness of the drive", self.stiffness[0], "N/m")?;
        check_non_negative("rotational stiffness of the drive", self.stiffness[1], "N m/rad")?;
        check_non_negative("translational damping of the drive", self.damping[0], "N s/m")?;
        check_non_negative("rotational damping of the drive", self.damping[1], "N m s/rad")?;
        check_limit("largest force of the drive", self.max_pull[0], "N")?;
        check_limit("largest torque of the drive", self.max_pull[1], "N m")?;
        check_limit("largest speed of the drive", self.max_speed[0], "m/s")?;
        check_limit("largest angular speed of the drive", self.max_speed[1], "rad/s")
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
    ///
    /// A limited spring saturates. Of the pull P = K e + D v on a body at rest it has the share r = min(1,
    /// F_max / |P|), so that K e and D v become r K e and r D v. D is |r P| / v_max at least: a body that
    /// nothing holds comes to the speed v_max at most. If the pull on the body as it moves now (w: its
    /// velocity) is still too large, all of it is weakened by s = min(1, F_max / |r P - D w|):
    ///
    /// ```text
    ///     F = s (r K (e - dx) + r D v - D dx/dt)
    /// ```
    ///
    /// F is linear in dx, so the step stays implicit and stable. It is within F_max where the body is at rest in the
    /// step and where it keeps its velocity, and so for all velocities between. The spring is passive: where dx
    /// shortens it, it does no more work than the spring with the force min(K |e|, F_max) has stored.
    pub(crate) fn add_to(&self, body: &DrivenBody, dt: Real, matrix: &mut Mat6, force: &mut Vec6) {
        let center = nalgebra::Point3::from(body.center_of_mass);
        let linear = self.target * center - body.pose * center;
        let angular = (self.target.rotation * body.pose.rotation.inverse()).scaled_axis();
        for (block, error) in [linear, angular].into_iter().enumerate() {
            let (k, d) = (self.stiffness[block], self.damping[block]);
            let target_velocity: Vec3 = self.target_velocity.fixed_rows::<3>(3 * block).into();
            let body_velocity = [body.linear_velocity, body.angular_velocity][block];
            let (largest, fastest) = (self.max_pull[block], self.max_speed[block]);
            let whole: Vec3 = error * k + target_velocity * d;
            let r = share_within(largest, &whole);
            let pull = whole * r;
            let d = d.max(pull.norm() / fastest);
            let s = share_within(largest, &(pull - body_velocity * d));
            let mut rows = force.fixed_rows_mut::<3>(3 * block);
            rows += pull * s;
            let mut diagonal = matrix.fixed_view_mut::<3, 3>(3 * block, 3 * block);
            diagonal += Mat3::identity() * ((k * r + d / dt) * s);
        }
    }
}

/// What a drive needs to know of the body that it pulls, at the start of a step.
pub(crate) struct DrivenBody {
    pub pose: Pose,
    /// Body frame, m.
    pub center_of_mass: Vec3,
    /// Of the centre of mass, m/s, world.
    pub linear_velocity: Vec3,
    /// rad/s, world.
    pub angular_velocity: Vec3,
}

/// Share of `pull` that is no longer than `largest`.
fn share_within(largest: Real, pull: &Vec3) -> Real {
    (largest / pull.norm()).min(1.0)
}

fn check_limit(what: &str, value: Real, unit: &str) -> Result<()> {
    if value > 0.0 {
        return Ok(());
    }
    Err(Error::value(what, format!("a number > 0 ({unit})"), value, "give a positive limit in SI units, or none"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bad_drives_are_refused() {
        assert!(PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, 0.0]).is_ok());
        assert!(PoseDrive::new(Pose::identity(), [-1.0, 1.0], [0.0, 0.0]).is_err());
        assert!(PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, Real::NAN]).is_err());
        assert!(PoseDrive::new(Pose::translation(Real::NAN, 0.0, 0.0), [1.0, 1.0], [0.0, 0.0]).is_err());
        let drive = PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, 0.0]).unwrap();
        for limit in [0.0, -1.0, Real::NAN] {
            assert!(PoseDrive { max_pull: [limit, 1.0], ..drive }.check().is_err());
            assert!(PoseDrive { max_speed: [1.0, limit], ..drive }.check().is_err());
        }
    }

    /// A and g of a drive in translation along x, for a body at the origin.
    fn along_x(drive: &PoseDrive, speed: Real, dt: Real) -> (Real, Real) {
        let body = DrivenBody {
            pose: Pose::identity(),
            center_of_mass: Vec3::zeros(),
            linear_velocity: Vec3::x() * speed,
            angular_velocity: Vec3::zeros(),
        };
        let (mut matrix, mut force) = (Mat6::zeros(), Vec6::zeros());
        drive.add_to(&body, dt, &mut matrix, &mut force);
        (matrix[(0, 0)], force[0])
    }

    proptest! {
        #[test]
        fn a_limited_drive_pulls_within_its_limit_and_makes_no_energy(
            error in -1.0..1.0, target_speed in -50.0..50.0, speed in -5.0..5.0, k in 0.0..1e5, d in 0.0..100.0,
            step in -1.0..1.0, dt in 1e-4..1e-2,
        ) {
            const LARGEST: Real = 40.0;
            let mut drive = PoseDrive::new(Pose::translation(error, 0.0, 0.0), [k, 0.0], [d, 0.0]).unwrap();
            drive.target_velocity[0] = target_speed;
            drive.max_pull[0] = LARGEST;
            drive.max_speed[0] = 5.0;
            let (a, g) = along_x(&drive, speed, dt);
            // At rest in the step, and at the speed of before; to first order in the step the stretch is that of its start.
            let stretch_changes = |dx: Real| (k * LARGEST / (k * error + d * target_speed).abs().max(LARGEST) * dx).abs();
            prop_assert!(g.abs() <= LARGEST * (1.0 + 1e-12), "{g} N on a body at rest");
            let moving: Real = g - a * speed * dt;
            prop_assert!(moving.abs() <= LARGEST + stretch_changes(speed * dt) + 1e-9, "{moving} N at {speed} m/s");
            // Nothing but the drive moves it: F = 0.
            let free: Real = if a > 0.0 { g / a / dt } else { 0.0 };
            prop_assert!(free.abs() <= 5.0 * (1.0 + 1e-12), "drawn at {free} m/s");
            // Without dampers: work done in a step of dx against what a spring of the force min(k |e|, F_max) stores.
            let spring = PoseDrive { damping: [0.0; 2], max_speed: [Real::INFINITY; 2], target_velocity: Vec6::zeros(), ..drive };
            let (a, g) = along_x(&spring, 0.0, dt);
            let stored = |e: Real| {
                let knee = LARGEST / k.max(1e-12);
                if e.abs() < knee { 0.5 * k * e * e } else { LARGEST * (e.abs() - 0.5 * knee) }
            };
            let work: Real = (g - a * step) * step;
            let given = stored(error) - stored(error - step);
            prop_assert!(work <= given + 1e-9 * (1.0 + work.abs()), "{work} J of {given} J");
        }

        #[test]
        fn a_drive_far_from_its_limits_is_one_without(error in -0.01..0.01, speed in -1.0..1.0) {
            let drive = PoseDrive::new(Pose::translation(error, 0.0, 0.0), [600.0, 0.5], [8.0, 0.01]).unwrap();
            let limited = PoseDrive { max_pull: [40.0, 0.4], max_speed: [5.0, 40.0], ..drive };
            prop_assert_eq!(along_x(&drive, speed, 1e-3), along_x(&limited, speed, 1e-3));
        }
    }
}

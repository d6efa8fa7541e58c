//! An articulated finger: a serial chain of revolute joints on a base with prescribed motion.

pub mod dynamics;
pub mod hand;
pub mod model;

use crate::body::Motion;
use crate::body::pose::{check_pose, displacement_between};
use crate::error::{Error, Result, check_positive};
use crate::math::{MAX_DOF, Mat3, Mat3x6, Pose, Real, Vec3, Vec6, pose_is_finite};
use dynamics::{Kinematics, forward_kinematics};
use model::FingerModel;
use serde::{Deserialize, Serialize};

/// Least compliance of a finger in every direction where a force is computed from a distance, m/N: a thousandth of that of a bent one.
const STRETCHED_COMPLIANCE: Real = 1e-6;
/// A joint without stiffness counts as this stiff there, N m/rad.
const SLACK_JOINT: Real = 1e-9;

/// Which of its limits a joint is at. A joint at a stop is locked for the step: its row and column leave the
/// equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum JointStop {
    /// Free to move.
    #[default]
    None,
    /// Held by the lower stop.
    Lower,
    /// Held by the upper stop.
    Upper,
}

/// What changes from step to step; copied to roll a finger back. Entries beyond the joints are zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FingerState {
    /// Hand frame in the world.
    pub base: Pose,
    /// Velocity of the origin of the hand frame (m/s, world) over the last step.
    pub base_linear_velocity: Vec3,
    /// Angular velocity of the hand frame (rad/s, world) over the last step.
    pub base_angular_velocity: Vec3,
    /// Joint positions (rad).
    pub positions: Vec6,
    /// Joint velocities (rad/s).
    pub velocities: Vec6,
    /// Torques that the motors applied in the last step (N m).
    pub motor_torques: Vec6,
    /// Torques of the contacts in the last step, J^T f (N m).
    pub contact_torques: Vec6,
    /// Which joints are at a stop.
    pub stops: [JointStop; MAX_DOF],
}

/// A finger: model, state, and the targets of its controllers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finger {
    model: FingerModel,
    motion: Motion,
    state: FingerState,
    targets: Vec6,
    target_velocities: Vec6,
    base_target: Option<Pose>,
    /// Link poses and joint axes at the present state.
    #[serde(skip)]
    kinematics: Kinematics,
}

impl Finger {
    /// A finger at rest, its hand frame at `hand` in the world, at joint positions `q` (rad), which are also its targets.
    ///
    /// # Errors
    /// A pose that is not finite; joint positions of wrong number or beyond the limits; a quasi-static finger with a joint
    /// without viscosity.
    pub fn new(model: FingerModel, motion: Motion, hand: Pose, q: &[Real]) -> Result<Self> {
        check_pose("base of the finger", &hand)?;
        if motion == Motion::QuasiStatic {
            for joint in model.joints() {
                check_positive(&format!("viscosity of joint '{}' of a quasi-static finger", joint.name), joint.viscosity, "N m s/rad")?;
            }
        }
        let state = FingerState {
            base: hand,
            base_linear_velocity: Vec3::zeros(),
            base_angular_velocity: Vec3::zeros(),
            positions: Vec6::zeros(),
            velocities: Vec6::zeros(),
            motor_torques: Vec6::zeros(),
            contact_torques: Vec6::zeros(),
            stops: [JointStop::None; MAX_DOF],
        };
        let (targets, target_velocities, kinematics) = (Vec6::zeros(), Vec6::zeros(), Kinematics::default());
        let mut finger = Self { model, motion, state, targets, target_velocities, base_target: None, kinematics };
        finger.set_joint_positions(q)?;
        finger.targets = finger.state.positions;
        Ok(finger)
    }

    /// The constant part.
    pub fn model(&self) -> &FingerModel {
        &self.model
    }

    /// With inertia or without.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// Hand frame in the world.
    pub fn base_pose(&self) -> &Pose {
        &self.state.base
    }

    /// Where the hand frame will be after the next step, if a target was set.
    pub fn base_target(&self) -> Option<&Pose> {
        self.base_target.as_ref()
    }

    /// Joint positions (rad).
    pub fn joint_positions(&self) -> &[Real] {
        &self.state.positions.as_slice()[..self.model.dof()]
    }

    /// Joint velocities (rad/s).
    pub fn joint_velocities(&self) -> &[Real] {
        &self.state.velocities.as_slice()[..self.model.dof()]
    }

    /// Target positions of the joint controllers (rad).
    pub fn joint_targets(&self) -> &[Real] {
        &self.targets.as_slice()[..self.model.dof()]
    }

    /// Torques that the motors applied in the last step (N m). A motor keeps to its limit, but for the one step in which a
    /// contact that was not there before loads it: its torque is chosen with the contact forces of the step before.
    pub fn motor_torques(&self) -> &[Real] {
        &self.state.motor_torques.as_slice()[..self.model.dof()]
    }

    /// Torques of the contact forces about the joints in the last step, J^T f (N m).
    pub fn contact_torques(&self) -> &[Real] {
        &self.state.contact_torques.as_slice()[..self.model.dof()]
    }

    /// Which joints are at a stop.
    pub fn stops(&self) -> &[JointStop] {
        &self.state.stops[..self.model.dof()]
    }

    /// Pose of a link frame in the world; `link` below the number of joints.
    pub fn link_pose(&self, link: usize) -> &Pose {
        &self.kinematics.links[link]
    }

    /// Where a link frame will be after the next step if the joints turn by `joints` (rad).
    pub(crate) fn link_pose_after(&self, link: usize, joints: &Vec6) -> Pose {
        let mut after = Kinematics::default();
        forward_kinematics(
            &self.model,
            self.base_target.as_ref().unwrap_or(&self.state.base),
            &(self.state.positions + joints),
            &mut after,
        );
        after.links[link]
    }

    /// Puts the joints elsewhere at once, at rest. Targets stay as they are.
    ///
    /// # Errors
    /// Wrong number, non-finite values, or values beyond the limits.
    pub fn set_joint_positions(&mut self, q: &[Real]) -> Result<()> {
        let mut positions = self.model.joint_vector("joint positions", q)?;
        for (joint, position) in self.model.joints().iter().zip(positions.iter_mut()) {
            // Room for the rounding of degrees to radians.
            if *position < joint.lower - 1e-9 || *position > joint.upper + 1e-9 {
                return Err(Error::value(
                    format!("position of joint '{}'", joint.name),
                    format!("{:.4} to {:.4} rad", joint.lower, joint.upper),
                    *position,
                    "stay within the joint limits",
                ));
            }
            *position = position.clamp(joint.lower, joint.upper);
        }
        self.state.positions = positions;
        self.state.velocities = Vec6::zeros();
        self.state.stops = [JointStop::None; MAX_DOF];
        self.update_kinematics();
        Ok(())
    }

    /// Sets the target positions (rad) of the controllers; target velocities become zero. Targets beyond the limits are
    /// allowed: the joint then leans on its stop.
    ///
    /// # Errors
    /// Wrong number or non-finite values.
    pub fn set_joint_targets(&mut self, q: &[Real]) -> Result<()> {
        self.targets = self.model.joint_vector("joint targets", q)?;
        self.target_velocities = Vec6::zeros();
        Ok(())
    }

    /// Sets target positions (rad) and velocities (rad/s) of the controllers.
    ///
    /// # Errors
    /// Wrong number or non-finite values.
    pub fn set_moving_joint_targets(&mut self, q: &[Real], velocities: &[Real]) -> Result<()> {
        let velocities = self.model.joint_vector("joint target velocities", velocities)?;
        self.set_joint_targets(q)?;
        self.target_velocities = velocities;
        Ok(())
    }

    /// Moves the hand frame to `target` during the next step, carrying the finger and what it
    /// holds; for [`crate::World::move_hand_to`], which moves all fingers of a hand.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub(crate) fn move_base_to(&mut self, target: Pose) -> Result<()> {
        check_pose("target of the base", &target)?;
        self.base_target = Some(target);
        Ok(())
    }

    /// The state, to keep.
    pub fn state(&self) -> FingerState {
        self.state
    }

    /// Back to a state kept earlier.
    pub fn restore(&mut self, state: &FingerState) {
        self.state = *state;
        self.update_kinematics();
    }

    /// Whether every number of the state is finite.
    pub fn is_finite(&self) -> bool {
        let s = &self.state;
        let joints = [s.positions, s.velocities, s.motor_torques, s.contact_torques];
        let base = [s.base_linear_velocity, s.base_angular_velocity];
        pose_is_finite(&s.base)
            && joints.iter().flat_map(|v| v.iter()).all(|x| x.is_finite())
            && base.iter().flat_map(|v| v.iter()).all(|x| x.is_finite())
    }

    /// Target positions and velocities of the controllers, zero beyond the joints.
    pub(crate) fn controller_targets(&self) -> (&Vec6, &Vec6) {
        (&self.targets, &self.target_velocities)
    }

    /// Link poses and joint axes at the present state.
    pub(crate) fn kinematics(&self) -> &Kinematics {
        &self.kinematics
    }

    /// Jacobian of the point of `link` at `point` (m, world): column j is `z_j x (p - o_j)` for the joints up to the link's.
    pub(crate) fn point_jacobian(&self, link: usize, point: &Vec3) -> Mat3x6 {
        self.kinematics.point_jacobian(link, point)
    }

    /// Force (N, world) with which the point of `link` at `point` (m, world) would press on something that holds it
    /// where it is, if the controllers had the targets `q` (rad): without damping, weight and torque limits.
    ///
    /// The joints are displaced by dq so that J dq = 0 under the reaction -F (K:
    /// stiffness of the joints, e: their distance to the targets):
    ///
    /// ```text
    ///     K (e - dq) = J^T F      so      F = (J K^-1 J^T)^-1 J e
    /// ```
    ///
    /// A stretched finger has no compliance along itself; it is given that of [`STRETCHED_COMPLIANCE`].
    ///
    /// # Errors
    /// Wrong number or non-finite values.
    pub fn blocked_force(&self, link: usize, point: &Vec3, q: &[Real]) -> Result<Vec3> {
        let jacobian = self.point_jacobian(link, point);
        let away = self.model.joint_vector("joint targets", q)? - self.state.positions;
        let mut compliance = Mat3::identity() * STRETCHED_COMPLIANCE;
        for (j, joint) in self.model.joints().iter().enumerate() {
            let column = jacobian.column(j);
            compliance += column * column.transpose() / joint.stiffness.max(SLACK_JOINT);
        }
        Ok(compliance.cholesky().map_or_else(Vec3::zeros, |factor| factor.solve(&(jacobian * away))))
    }

    /// Displacement of the hand frame over the step: translation of its origin (m), rotation vector (rad), world.
    pub(crate) fn prescribed_motion(&self) -> (Vec3, Vec3) {
        match &self.base_target {
            Some(target) => displacement_between(&self.state.base, target),
            None => (Vec3::zeros(), Vec3::zeros()),
        }
    }

    /// Sets the state at the end of a step; the caller is `constrained_motion`.
    pub(crate) fn finish_step(
        &mut self,
        positions: Vec6,
        velocities: Vec6,
        motor_torques: Vec6,
        contact_torques: Vec6,
        stops: [JointStop; MAX_DOF],
        dt: Real,
    ) {
        let (linear, angular) = self.prescribed_motion();
        let base = self.base_target.take().unwrap_or(self.state.base);
        let (base_linear_velocity, base_angular_velocity) = (linear / dt, angular / dt);
        self.state =
            FingerState { base, base_linear_velocity, base_angular_velocity, positions, velocities, motor_torques, contact_torques, stops };
        self.update_kinematics();
    }

    fn update_kinematics(&mut self) {
        forward_kinematics(&self.model, &self.state.base, &self.state.positions, &mut self.kinematics);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::HandModel;

    #[test]
    fn bad_joint_values_are_refused() {
        let model = HandModel::three_finger().unwrap().fingers()[0].clone();
        let mut finger = Finger::new(model, Motion::Inertial, Pose::identity(), &[0.0; 4]).unwrap();
        assert!(finger.set_joint_positions(&[0.0; 3]).unwrap_err().to_string().contains("4 values"));
        assert!(finger.set_joint_positions(&[0.0, 9.0, 0.0, 0.0]).unwrap_err().to_string().contains("joint limits"));
        assert!(finger.set_joint_targets(&[0.0, 9.0, 0.0, 0.0]).is_ok(), "a target may lie beyond a stop");
        assert!(finger.set_joint_targets(&[0.0, Real::NAN, 0.0, 0.0]).is_err());
        assert!(finger.set_moving_joint_targets(&[0.0; 4], &[0.0; 5]).is_err());
        assert!(finger.move_base_to(Pose::translation(Real::NAN, 0.0, 0.0)).is_err());
    }

    #[test]
    fn quasi_static_finger_needs_viscosity() {
        let mut joints = HandModel::three_finger().unwrap().fingers()[0].joints().to_vec();
        joints[0].viscosity = 0.0;
        let model = FingerModel::new("finger", Pose::identity(), joints).unwrap();
        assert!(Finger::new(model.clone(), Motion::Inertial, Pose::identity(), &[0.0; 4]).is_ok());
        assert!(Finger::new(model, Motion::QuasiStatic, Pose::identity(), &[0.0; 4]).is_err());
    }
}

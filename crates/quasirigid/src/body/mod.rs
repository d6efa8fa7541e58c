//! Bodies, what moves: free and fixed rigid bodies, articulated fingers, hands, and what drives them.

pub mod articulation;
pub mod drive;
pub mod entry;
pub mod mass_properties;
pub(crate) mod pose;
pub mod rigid;

pub use articulation::hand::{FingerTip, HandModel};
pub use articulation::model::{FingerModel, JointModel};
pub use articulation::{Finger, FingerState, JointStop};
pub use drive::PoseDrive;
pub use entry::BodyEntry;
pub use mass_properties::{Amount, MassProperties};
pub use rigid::{Mobility, RigidBody, RigidState};

use crate::math::{Mat3x6, Pose, Real, Vec3};
use serde::{Deserialize, Serialize};

/// Whether a body has inertia.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Motion {
    /// Newton and Euler: `M dv/dt = forces`.
    Inertial,
    /// The paper's body without inertia (equation 15): `B v = forces`. At rest as soon as no force acts.
    QuasiStatic,
}

/// One body of a world: its generalised displacements are the unknowns of a step.
// A world has few bodies and steps through them by reference: a box around the larger variant would save nothing.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Body {
    /// A rigid body, one link.
    Rigid(RigidBody),
    /// A chain of revolute joints on a base with prescribed motion, one link per joint.
    Finger(Finger),
}

/// The state of a [`Body`], to keep and to go back to. Copying it allocates nothing.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BodyState {
    /// Of a rigid body.
    Rigid(RigidState),
    /// Of a finger.
    Finger(FingerState),
}

impl BodyState {
    /// Visits every number, always in the same order.
    pub fn for_each_number(&self, mut visit: impl FnMut(Real)) {
        let pose = |pose: &Pose, visit: &mut dyn FnMut(Real)| {
            pose.translation.vector.iter().chain(pose.rotation.coords.iter()).for_each(|&x| visit(x));
        };
        match self {
            BodyState::Rigid(state) => {
                pose(&state.pose, &mut visit);
                state.linear_velocity.iter().chain(state.angular_momentum.iter()).for_each(|&x| visit(x));
            }
            BodyState::Finger(state) => {
                pose(&state.base, &mut visit);
                state.positions.iter().chain(state.velocities.iter()).for_each(|&x| visit(x));
            }
        }
    }
}

impl Body {
    /// What the body is called.
    pub fn name(&self) -> &str {
        match self {
            Body::Rigid(body) => body.name(),
            Body::Finger(finger) => finger.model().name(),
        }
    }

    /// Degrees of freedom, at most [`crate::math::MAX_DOF`].
    pub fn dof(&self) -> usize {
        match self {
            Body::Rigid(body) => body.dof(),
            Body::Finger(finger) => finger.model().dof(),
        }
    }

    /// Number of links, that is of frames that a surface can be attached to.
    pub fn link_count(&self) -> usize {
        match self {
            Body::Rigid(_) => 1,
            Body::Finger(finger) => finger.model().dof(),
        }
    }

    /// Pose of the frame of a link in the world. `link` must be below [`Body::link_count`]; a rigid body has only one.
    pub fn link_pose(&self, link: usize) -> Pose {
        match self {
            Body::Rigid(body) => *body.pose(),
            Body::Finger(finger) => *finger.link_pose(link),
        }
    }

    /// Jacobian of the material point of `link` that is at `point` (m, world): `dp = J dx`, rows in world axes, columns beyond
    /// the degrees of freedom zero.
    pub fn point_jacobian(&self, link: usize, point: &Vec3) -> Mat3x6 {
        match self {
            Body::Rigid(body) => body.point_jacobian(point),
            Body::Finger(finger) => finger.point_jacobian(link, point),
        }
    }

    /// Displacement (m, world) in this step of the material point at `point`, due to prescribed motion: that of a fixed
    /// body on its way to its target, or of the base of a finger.
    ///
    /// To first order in the motion, `t + theta x (p - o)`, o the origin of what moves: a bound on
    /// how far it goes. The contact problem uses [`crate::pair::RelativeMotion`].
    pub fn prescribed_displacement(&self, point: &Vec3) -> Vec3 {
        let ((translation, theta), origin) = match self {
            Body::Rigid(body) => (body.prescribed_motion(), body.pose().translation.vector),
            Body::Finger(finger) => (finger.prescribed_motion(), finger.base_pose().translation.vector),
        };
        translation + theta.cross(&(point - origin))
    }

    /// Whether every number of the state is finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Body::Rigid(body) => body.is_finite(),
            Body::Finger(finger) => finger.is_finite(),
        }
    }

    /// The state, to keep.
    pub fn state(&self) -> BodyState {
        match self {
            Body::Rigid(body) => BodyState::Rigid(body.state()),
            Body::Finger(finger) => BodyState::Finger(finger.state()),
        }
    }

    /// Back to a state kept earlier. A state of the other kind of body is ignored.
    pub fn restore(&mut self, state: &BodyState) {
        match (self, state) {
            (Body::Rigid(body), BodyState::Rigid(state)) => body.restore(state),
            (Body::Finger(finger), BodyState::Finger(state)) => finger.restore(state),
            _ => {}
        }
    }
}

//! Where a body is expected to go in a step, in full and not to first order: what the equations of a pair are linearised about.

use crate::body::pose::displacement_between;
use crate::body::{Body, Mobility};
use crate::math::{Real, Vec3, Vec6};
use crate::objects::Side;

/// Rotations (rad) below this count as none: half their square, over any lever, is less than rounding.
const LEAST_ROTATION: Real = 1e-8;
/// Rotations (rad) above this in a step are no longer predicted from the last one.
const MOST_PREDICTED: Real = 1.0;

/// The motion that a collider is expected to make: `d(p) = shift + (R - 1)(p - origin)`, world axes.
///
/// Prescribed motion is known: that of a fixed body on its way to its target, or of the base of a finger. Joints and free
/// bodies are assumed to go on as in the last step; what they do differently is in the equations to first order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// Whether its motion is prescribed, at least in part (fixed bodies and fingers),
    /// so that a free body follows it and not the other way round.
    pub leads: bool,
    /// A point of it, m.
    pub origin: Vec3,
    /// Displacement of that point, m. Zero for a free body, where it is not used.
    pub shift: Vec3,
    /// Rotation vector of `R`, rad.
    pub theta: Vec3,
    /// Displacements of the joints that are in it, rad; zero for rigid bodies.
    pub joints: Vec6,
    /// Mass of a free body, kg; 0 for others, where it is not used.
    pub mass: Real,
}

impl Expected {
    /// At rest.
    pub fn at_rest() -> Self {
        Self { leads: true, origin: Vec3::zeros(), shift: Vec3::zeros(), theta: Vec3::zeros(), joints: Vec6::zeros(), mass: 0.0 }
    }

    /// Of a collider over a step of `dt` (s).
    pub(crate) fn of(side: Side<'_>, dt: Real) -> Self {
        match &side.body.body {
            Body::Rigid(body) if body.mobility() == Mobility::Fixed => {
                let (shift, theta) = body.prescribed_motion();
                Self { origin: body.pose().translation.vector, shift, theta, ..Self::at_rest() }
            }
            Body::Rigid(body) => {
                let theta = predicted(body.state().angular_velocity * dt);
                Self { leads: false, origin: body.center_of_mass(), theta, mass: body.mass_properties().mass(), ..Self::at_rest() }
            }
            Body::Finger(finger) => {
                let joints = joints(&side.body.body, dt);
                let start = finger.link_pose(side.collider.link);
                if finger.base_target().is_none() && joints == Vec6::zeros() {
                    return Self { origin: start.translation.vector, ..Self::at_rest() };
                }
                let (shift, theta) = displacement_between(start, &finger.link_pose_after(side.collider.link, &joints));
                Self { origin: start.translation.vector, shift, theta, joints, ..Self::at_rest() }
            }
        }
    }
}

/// Displacements of the joints of a body if they go on as in the last step of `dt` (s), rad.
pub(super) fn joints(body: &Body, dt: Real) -> Vec6 {
    match body {
        Body::Rigid(_) => Vec6::zeros(),
        Body::Finger(finger) => {
            let rotated = finger.state().velocities * dt;
            if rotated.amax() > LEAST_ROTATION && rotated.amax() < MOST_PREDICTED { rotated } else { Vec6::zeros() }
        }
    }
}

/// The rotation vector `theta` of the last step (rad), zero if it is too small or too large to be predicted from.
fn predicted(theta: Vec3) -> Vec3 {
    let angle = theta.amax();
    if angle > LEAST_ROTATION && angle < MOST_PREDICTED { theta } else { Vec3::zeros() }
}

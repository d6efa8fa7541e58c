//! Poses and joints at the end of the step.

use crate::body::{Body, Finger, JointStop};
use crate::free_motion::{FreeMotion, StepContext};
use crate::math::{Real, Vec6};

/// Takes a body to the end of the step.
///
/// `dx`: total generalised displacement, free and by contacts. `generalized_contact_force`: J^T f (N, N m), which decides whether
/// a joint leaves its stop. Poses are integrated on SE(3); prescribed motion ends exactly on its target.
pub fn advance(body: &mut Body, free: &FreeMotion, dx: &Vec6, generalized_contact_force: &Vec6, context: &StepContext) {
    match body {
        Body::Rigid(body) => body.integrate(dx, context.dt),
        Body::Finger(finger) => advance_finger(finger, free, dx, generalized_contact_force, context.dt),
    }
}

/// Joint positions, motor torques, and who stands at a stop.
///
/// A stop gives what the equations of the joint lack, `reaction = A_j dq - g_j - (J^T f)_j`. It can only push into the range:
/// at the upper stop the reaction is <= 0, at the lower >= 0. A joint whose reaction has the other sign is let go, from the next
/// step on.
fn advance_finger(finger: &mut Finger, free: &FreeMotion, dq: &Vec6, contact_torques: &Vec6, dt: Real) {
    let state = finger.state();
    let (mut positions, mut velocities, mut stops) = (state.positions, Vec6::zeros(), free.stops);
    let reaction = free.matrix * dq - free.generalized_force - contact_torques;
    for (j, joint) in finger.model().joints().iter().enumerate() {
        match stops[j] {
            JointStop::None => {
                positions[j] += dq[j];
                velocities[j] = dq[j] / dt;
                // A contact pushed the joint past a stop that the free motion did not see coming.
                if positions[j] > joint.upper {
                    (positions[j], velocities[j], stops[j]) = (joint.upper, 0.0, JointStop::Upper);
                } else if positions[j] < joint.lower {
                    (positions[j], velocities[j], stops[j]) = (joint.lower, 0.0, JointStop::Lower);
                }
            }
            JointStop::Upper => {
                positions[j] = joint.upper;
                if reaction[j] > 0.0 {
                    stops[j] = JointStop::None;
                }
            }
            JointStop::Lower => {
                positions[j] = joint.lower;
                if reaction[j] < 0.0 {
                    stops[j] = JointStop::None;
                }
            }
        }
    }
    let motor_torques = free.motor_torque - free.motor_slope.component_mul(dq);
    finger.finish_step(positions, velocities, motor_torques, *contact_torques, stops, dt);
}

//! Free motion of a finger.

use crate::body::articulation::dynamics::{BaseMotion, bias_torques, mass_matrix};
use crate::body::{Finger, JointStop, Motion};
use crate::free_motion::{FreeMotion, StepContext, inverse_root};
use crate::math::{MAX_DOF, Mat6, Real, Vec3, Vec6};

/// `A dq = g + J^T f` of a finger (M: mass matrix, h: bias torques with the mean acceleration of the base over the step, qd: joint
/// velocities, B: viscosity, K, D: gains of the position controller, q_t, qd_t: its targets):
///
/// ```text
///     A = M/dt^2 + B/dt + K + D/dt             g = M qd/dt - h + K (q_t - q) + D qd_t
/// ```
///
/// from the controller's torque at the end of the step, `tau = K (q_t - q - dq) - D (dq/dt - qd_t)`. A quasi-static finger has no
/// M, and of h only the weight.
///
/// Two things are not linear, and are decided here once per step:
/// - a motor whose torque would exceed its limit gives the limit instead, with no stiffness and no damping;
/// - a joint that would pass a stop goes to the stop and no further: its dq is given, its row and column leave the equations.
///
/// Both are predicted by solving the step with the contact torques of the step before. They are found again in each step, except
/// that a joint at a stop stays there until `constrained_motion` finds that the torques push it back into its range.
pub(super) fn free_motion(finger: &Finger, context: &StepContext) -> FreeMotion {
    let (model, dt, state) = (finger.model(), context.dt, finger.state());
    let dof = model.dof();
    let (targets, target_velocities) = finger.controller_targets();

    let (mut matrix, mut g) = match finger.motion() {
        Motion::Inertial => inertial_terms(finger, context),
        Motion::QuasiStatic => (Mat6::zeros(), -weight_torques(finger, &context.gravity)),
    };
    let (mut motor_torque, mut motor_slope) = (Vec6::zeros(), Vec6::zeros());
    for (j, joint) in model.joints().iter().enumerate() {
        motor_torque[j] = joint.stiffness * (targets[j] - state.positions[j]) + joint.damping * target_velocities[j];
        motor_slope[j] = joint.stiffness + joint.damping / dt;
        matrix[(j, j)] += joint.viscosity / dt + motor_slope[j];
        g[j] += motor_torque[j];
    }

    // Every pass either settles, or takes one more motor to its limit or one more joint to its stop: at most 2 dof + 1 passes.
    let mut stops = state.stops;
    let (mut root, mut prediction) = solve(&matrix, &g, &state.contact_torques, finger, &stops);
    for _ in 0..2 * dof {
        let mut changed = false;
        for (j, joint) in model.joints().iter().enumerate() {
            let torque = motor_torque[j] - motor_slope[j] * prediction[j];
            if motor_slope[j] > 0.0 && torque.abs() > joint.torque_limit {
                let limit = joint.torque_limit.copysign(torque);
                g[j] += limit - motor_torque[j];
                matrix[(j, j)] -= motor_slope[j];
                (motor_torque[j], motor_slope[j]) = (limit, 0.0);
                changed = true;
            }
        }
        // Stops are judged only once the motors are settled: a motor at its limit may well not reach a stop.
        if !changed {
            for (j, joint) in model.joints().iter().enumerate() {
                if stops[j] == JointStop::None {
                    stops[j] = passed_stop(state.positions[j] + prediction[j], joint.lower, joint.upper);
                    changed |= stops[j] != JointStop::None;
                }
            }
        }
        if !changed {
            break;
        }
        (root, prediction) = solve(&matrix, &g, &state.contact_torques, finger, &stops);
    }
    let displacement = given_and_free(&matrix, &root, &g, finger, &stops);
    FreeMotion {
        dof,
        matrix,
        inverse_root: root,
        displacement,
        generalized_force: g,
        motor_torque,
        motor_slope,
        stops,
        ..FreeMotion::none()
    }
}

/// The stop that a joint at `position` (rad) has passed.
fn passed_stop(position: Real, lower: Real, upper: Real) -> JointStop {
    if position > upper {
        JointStop::Upper
    } else if position < lower {
        JointStop::Lower
    } else {
        JointStop::None
    }
}

/// `M/dt^2` and `M qd/dt - h`.
fn inertial_terms(finger: &Finger, context: &StepContext) -> (Mat6, Vec6) {
    let (state, dt) = (finger.state(), context.dt);
    let mass = mass_matrix(finger.model(), finger.kinematics());
    let (translation, rotation) = finger.prescribed_motion();
    let base = BaseMotion {
        angular_velocity: state.base_angular_velocity,
        linear_acceleration: (translation / dt - state.base_linear_velocity) / dt,
        angular_acceleration: (rotation / dt - state.base_angular_velocity) / dt,
    };
    let origin = state.base.translation.vector;
    let bias = bias_torques(finger.model(), finger.kinematics(), &origin, &state.velocities, &base, &context.gravity);
    (mass / (dt * dt), mass * state.velocities / dt - bias)
}

/// Bias torques of a finger at rest.
fn weight_torques(finger: &Finger, gravity: &Vec3) -> Vec6 {
    let origin = finger.base_pose().translation.vector;
    bias_torques(finger.model(), finger.kinematics(), &origin, &Vec6::zeros(), &BaseMotion::at_rest(), gravity)
}

/// S, and the displacement under `g` and contact torques.
fn solve(matrix: &Mat6, g: &Vec6, contact_torques: &Vec6, finger: &Finger, stops: &[JointStop; MAX_DOF]) -> (Mat6, Vec6) {
    let dof = finger.model().dof();
    let active = std::array::from_fn(|j| j < dof && stops[j] == JointStop::None);
    let root = inverse_root(matrix, &active);
    (root, given_and_free(matrix, &root, &(g + contact_torques), finger, stops))
}

/// Displacement d of the joints at a stop (what is left to the stop), and of the free ones: `A_ff dq_f = g_f - A_fs d_s`.
fn given_and_free(matrix: &Mat6, root: &Mat6, g: &Vec6, finger: &Finger, stops: &[JointStop; MAX_DOF]) -> Vec6 {
    let positions = finger.joint_positions();
    let mut given = Vec6::zeros();
    for (j, joint) in finger.model().joints().iter().enumerate() {
        given[j] = match stops[j] {
            JointStop::None => 0.0,
            JointStop::Lower => joint.lower - positions[j],
            JointStop::Upper => joint.upper - positions[j],
        };
    }
    given + root * root.tr_mul(&(g - matrix * given))
}

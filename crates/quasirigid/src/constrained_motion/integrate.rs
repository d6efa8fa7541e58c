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

/// Joint positions, motor torques, and which joints are at a stop.
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
                // A contact pushed the joint past a stop that the free motion did not reach.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{FingerModel, HandModel, JointModel, MassProperties, Motion};
    use crate::math::{Pose, Rot, Vec3};
    use proptest::prelude::*;

    const STILL: StepContext = StepContext { dt: 1e-3, gravity: Vec3::new(0.0, 0.0, 0.0) };

    /// One joint about y, a link of 0.1 kg whose centre hangs 0.05 m below, no controller.
    fn pendulum(change: impl Fn(&mut JointModel)) -> Finger {
        let mut joint = JointModel {
            name: "hinge".into(),
            origin: Pose::identity(),
            axis: Vec3::y(),
            lower: -3.0,
            upper: 3.0,
            viscosity: 0.0,
            armature: 0.0,
            stiffness: 0.0,
            damping: 0.0,
            torque_limit: 1.0,
            link: MassProperties::new(0.1, Vec3::new(0.0, 0.0, -0.05), nalgebra::Matrix3::identity() * 1e-5).unwrap(),
        };
        change(&mut joint);
        let model = FingerModel::new("pendulum", Pose::identity(), vec![joint]).unwrap();
        Finger::new(model, Motion::Inertial, Pose::identity(), &[0.0]).unwrap()
    }

    fn finger_of(body: &Body) -> &Finger {
        match body {
            Body::Finger(finger) => finger,
            Body::Rigid(_) => unreachable!(),
        }
    }

    /// One step under joint torques of a contact.
    fn step(body: &mut Body, torques: &[Real], context: &StepContext) {
        let torques = Vec6::from_fn(|i, _| torques.get(i).copied().unwrap_or(0.0));
        let free = crate::free_motion::free_motion(body, context);
        let dx = free.displacement + free.response(&torques);
        advance(body, &free, &dx, &torques, context);
    }

    #[test]
    fn finger_stops_at_its_limit_and_comes_back() {
        for dt in [1e-3, 1e-2] {
            let context = StepContext { dt, ..STILL };
            let mut fingers = HandModel::three_finger().unwrap().instantiate(Pose::identity(), Motion::Inertial).unwrap();
            let mut finger = fingers.remove(1);
            let upper = finger.model().joints()[1].upper;
            finger.set_joint_targets(&[0.0, upper + 0.3, 0.0, 0.0]).unwrap();
            let mut body = Body::Finger(finger);
            let mut highest: Real = 0.0;
            for _ in 0..(0.5 / dt) as usize {
                step(&mut body, &[], &context);
                highest = highest.max(finger_of(&body).joint_positions()[1]);
            }
            let finger = finger_of(&body);
            assert_eq!(highest, upper, "dt {dt}: went to {highest}");
            assert_eq!((finger.joint_positions()[1], finger.stops()[1]), (upper, JointStop::Upper), "dt {dt}");
            let lean = finger.model().joints()[1].stiffness * 0.3;
            let torque = finger.motor_torques()[1];
            assert!((torque - lean.min(finger.model().joints()[1].torque_limit)).abs() < 1e-9, "dt {dt}: leans with {torque} N m");

            let Body::Finger(finger) = &mut body else { unreachable!() };
            finger.set_joint_targets(&[0.0, 1.0, 0.0, 0.0]).unwrap();
            (0..(0.5 / dt) as usize).for_each(|_| step(&mut body, &[], &context));
            let position = finger_of(&body).joint_positions()[1];
            assert!((position - 1.0).abs() < 1e-6, "dt {dt}: came back to {position}");
        }
    }

    #[test]
    fn contact_that_pushes_past_a_stop_is_stopped_and_one_that_pulls_frees() {
        let mut body = Body::Finger(pendulum(|joint| joint.upper = 0.01));
        for _ in 0..100 {
            step(&mut body, &[0.5], &STILL);
            assert!(finger_of(&body).joint_positions()[0] <= 0.01);
        }
        assert_eq!(finger_of(&body).stops()[0], JointStop::Upper);
        step(&mut body, &[-0.5], &STILL);
        assert_eq!(finger_of(&body).stops()[0], JointStop::None);
        step(&mut body, &[-0.5], &STILL);
        assert!(finger_of(&body).joint_positions()[0] < 0.01, "let go");
    }

    #[test]
    fn locked_joint_does_not_answer_to_contacts() {
        let mut body = Body::Finger(pendulum(|joint| joint.upper = 0.0));
        (0..2).for_each(|_| step(&mut body, &[0.5], &STILL));
        let free = crate::free_motion::free_motion(&body, &STILL);
        assert_eq!(free.response(&Vec6::x()), Vec6::zeros());
    }

    #[test]
    fn blocked_motor_gives_its_limit_and_no_more() {
        // A stiff wall (spring of the contact, taken explicitly small steps apart) holds the joint near zero; target far beyond.
        for dt in [1e-3, 1e-2] {
            let mut finger = pendulum(|joint| {
                (joint.stiffness, joint.damping, joint.torque_limit, joint.viscosity) = (10.0, 0.05, 0.5, 0.01);
            });
            finger.set_joint_targets(&[1.0]).unwrap();
            let mut body = Body::Finger(finger);
            let context = StepContext { dt, ..STILL };
            let wall = 200.0;
            for _ in 0..400 {
                // Implicit wall: torque at the end of the step, tau = -wall (q + dq) with dq = dq_free + tau / A.
                let free = crate::free_motion::free_motion(&body, &context);
                let q = finger_of(&body).joint_positions()[0];
                let response = free.response(&Vec6::x())[0];
                let torque = Vec6::x() * (-wall * (q + free.displacement[0]) / (1.0 + wall * response));
                advance(&mut body, &free, &(free.displacement + free.response(&torque)), &torque, &context);
            }
            let finger = finger_of(&body);
            assert!((finger.motor_torques()[0] - 0.5).abs() < 1e-9, "dt {dt}: {} N m", finger.motor_torques()[0]);
            assert!((finger.contact_torques()[0] + 0.5).abs() < 1e-6, "dt {dt}: wall {} N m", finger.contact_torques()[0]);
            assert!((finger.joint_positions()[0] - 0.5 / wall).abs() < 1e-6, "dt {dt}: {}", finger.joint_positions()[0]);
        }
    }

    #[test]
    fn pendulum_swings_with_its_period() {
        // Small swings: T = 2 pi sqrt(I_o / (m g l)), I_o about the hinge.
        let mut finger = pendulum(|_| {});
        finger.set_joint_positions(&[0.02]).unwrap();
        let mut body = Body::Finger(finger);
        let context = StepContext { dt: 1e-4, gravity: Vec3::new(0.0, 0.0, -9.81) };
        let inertia = 1e-5 + 0.1 * 0.05 * 0.05;
        let quarter = 0.5 * std::f64::consts::PI * (inertia / (0.1 * 9.81 * 0.05_f64)).sqrt();
        let mut time = 0.0;
        while finger_of(&body).joint_positions()[0] > 0.0 {
            step(&mut body, &[], &context);
            time += context.dt;
        }
        assert!((time - quarter).abs() < 0.01 * quarter, "quarter period {time} s against {quarter} s");
    }

    #[test]
    fn held_weight_sags_by_torque_over_stiffness() {
        for motion in [Motion::Inertial, Motion::QuasiStatic] {
            let model = pendulum(|joint| (joint.stiffness, joint.damping, joint.viscosity) = (2.0, 0.02, 0.01)).model().clone();
            let mut finger = Finger::new(model, motion, Pose::identity(), &[0.0]).unwrap();
            // A target that the weight pulls away from: the link stands out along -x (a turn of +pi/2 about y takes -z to -x).
            finger.set_joint_targets(&[1.5]).unwrap();
            let mut body = Body::Finger(finger);
            let context = StepContext { dt: 1e-2, gravity: Vec3::new(0.0, 0.0, -9.81) };
            (0..1000).for_each(|_| step(&mut body, &[], &context));
            let finger = finger_of(&body);
            let q = finger.joint_positions()[0];
            let weight = 0.1 * 9.81 * 0.05 * q.sin();
            assert!((2.0 * (1.5 - q) - weight).abs() < 1e-9, "{motion:?}: {} against {weight}", 2.0 * (1.5 - q));
            assert!((finger.motor_torques()[0] - weight).abs() < 1e-9);
        }
    }

    #[test]
    fn moved_base_ends_on_its_target_and_carries_the_finger() {
        let mut fingers = HandModel::three_finger().unwrap().instantiate(Pose::identity(), Motion::QuasiStatic).unwrap();
        let target = Pose::from_parts(Vec3::new(1e-3, 2e-3, 3e-3).into(), Rot::from_scaled_axis(Vec3::new(1e-3, 0.0, 2e-3)));
        let mut finger = fingers.remove(0);
        finger.move_base_to(target).unwrap();
        let mut body = Body::Finger(finger);
        let before = body.link_pose(3).translation.vector;
        let prescribed = body.prescribed_displacement(&before);
        step(&mut body, &[], &STILL);
        let after = body.link_pose(3).translation.vector;
        assert_eq!(finger_of(&body).base_pose(), &target);
        // Linear in the motion: off by theta^2/2 times the arm.
        assert!((after - before - prescribed).norm() < 5e-6 * 0.1, "{:e}", (after - before - prescribed).norm());
        assert_eq!(body.prescribed_displacement(&after), Vec3::zeros());
    }

    #[test]
    fn fixed_body_ends_exactly_on_its_target() {
        let mut rigid = crate::body::RigidBody::fixed("support", Pose::identity()).unwrap();
        let target = Pose::from_parts(Vec3::new(0.1, 0.2, 0.3).into(), Rot::from_scaled_axis(Vec3::new(0.3, -0.2, 0.1)));
        rigid.move_to(target).unwrap();
        let mut body = Body::Rigid(rigid);
        assert_eq!(body.dof(), 0);
        assert!((body.prescribed_displacement(&Vec3::zeros()) - target.translation.vector).norm() < 1e-15);
        step(&mut body, &[], &STILL);
        assert_eq!(body.link_pose(0), target);
        assert_eq!(body.prescribed_displacement(&Vec3::x()), Vec3::zeros());
    }

    #[test]
    fn non_finite_forces_are_seen() {
        let mut body = Body::Finger(pendulum(|_| {}));
        let kept = body.state();
        step(&mut body, &[Real::NAN], &STILL);
        assert!(!body.is_finite());
        body.restore(&kept);
        assert!(body.is_finite() && body.state() == kept);
    }

    proptest! {
        /// The Jacobian of a free body against the motion that a small generalised displacement makes.
        #[test]
        fn rigid_jacobian_is_the_derivative(p in prop::array::uniform3(-0.1..0.1f64), d in prop::array::uniform6(-1.0..1.0f64)) {
            let mass = MassProperties::new(1.0, Vec3::new(0.01, 0.02, -0.03), nalgebra::Matrix3::identity()).unwrap();
            let pose = Pose::from_parts(Vec3::new(0.1, 0.2, 0.3).into(), Rot::from_scaled_axis(Vec3::new(0.5, 1.0, -0.3)));
            let (p, dx) = (Vec3::from(p), Vec6::from(d) * 1e-6);
            let start = Body::Rigid(crate::body::RigidBody::free("body", mass, Motion::Inertial, pose).unwrap());
            let mut end = start.clone();
            let free = crate::free_motion::free_motion(&end, &STILL);
            advance(&mut end, &free, &dx, &Vec6::zeros(), &STILL);
            let local = pose.inverse() * nalgebra::Point3::from(p);
            let moved = (end.link_pose(0) * local).coords - p;
            prop_assert!((moved - start.point_jacobian(0, &p) * dx).norm() < 1e-11);
        }
    }
}

//! Free flight: a body that touches nothing obeys Newton and Euler, or Stokes.

use quasirigid::body::{Amount, Body, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::constrained_motion::advance;
use quasirigid::free_motion::{StepContext, free_motion};
use quasirigid::math::{Pose, Real, Rot, Vec3, Vec6};

const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

fn box_body(motion: Motion) -> RigidBody {
    let mass = MassProperties::cuboid(Vec3::new(0.04, 0.08, 0.12), Amount::Mass(0.2)).unwrap();
    // A centre of mass off the body's origin, as of most meshes.
    let mass = mass.transformed(&Pose::translation(0.01, -0.02, 0.03)).unwrap();
    RigidBody::free("box", mass, motion, Pose::identity()).unwrap()
}

fn fly(body: RigidBody, context: &StepContext, duration: Real, mut each: impl FnMut(&RigidBody)) -> RigidBody {
    let mut body = Body::Rigid(body);
    for _ in 0..(duration / context.dt).round() as usize {
        let free = free_motion(&body, context);
        advance(&mut body, &free, &free.displacement, &Vec6::zeros(), context);
        if let Body::Rigid(body) = &body {
            each(body);
        }
    }
    match body {
        Body::Rigid(body) => body,
        Body::Finger(_) => unreachable!(),
    }
}

#[test]
fn free_fall_is_a_parabola_to_first_order() {
    let mut errors = Vec::new();
    for dt in [2e-3, 1e-3] {
        let mut body = box_body(Motion::Inertial);
        let (start, v) = (body.center_of_mass(), Vec3::new(1.0, -0.5, 3.0));
        body.set_velocity(v, Vec3::zeros()).unwrap();
        let end = fly(body, &StepContext::new(dt, GRAVITY).unwrap(), 0.5, |_| {});
        assert!((end.linear_velocity() - (v + GRAVITY * 0.5)).norm() < 1e-12, "velocity is exact");
        errors.push((end.center_of_mass() - (start + v * 0.5 + GRAVITY * 0.125)).norm());
    }
    // Implicit Euler falls ahead by g t dt / 2.
    assert!((errors[1] - 0.5 * 9.81 * 0.5 * 1e-3).abs() < 1e-9, "{errors:?}");
    assert!((errors[0] / errors[1] - 2.0).abs() < 1e-6, "{errors:?}");
}

#[test]
fn spinning_asymmetric_top_keeps_momentum_exactly_and_energy_to_first_order() {
    let mut errors = Vec::new();
    for dt in [1e-3, 5e-4, 2.5e-4] {
        let mut body = box_body(Motion::Inertial);
        // Near the middle axis: the top tumbles.
        body.set_velocity(Vec3::zeros(), Vec3::new(0.3, 5.0, 0.2)).unwrap();
        let (momentum, energy) = (*body.angular_momentum(), body.kinetic_energy());
        let mut worst: Real = 0.0;
        let end = fly(body, &StepContext::new(dt, Vec3::zeros()).unwrap(), 2.0, |body| {
            worst = worst.max((body.kinetic_energy() - energy).abs() / energy);
        });
        let drift = (end.angular_momentum() - momentum).norm() / momentum.norm();
        assert!(drift < 1e-12, "dt {dt}: momentum drifts by {drift:e}");
        errors.push(worst);
    }
    println!("energy errors {errors:?}");
    assert!(errors[0] < 0.02, "energy errors {errors:?}");
    for pair in errors.windows(2) {
        assert!((1.6..2.5).contains(&(pair[0] / pair[1])), "halving dt: energy errors {errors:?}");
    }
}

#[test]
fn asymmetric_top_turns_as_euler_says() {
    // Reference: Euler's equations in the body frame and the quaternion by a fine Runge-Kutta of fourth order.
    let body = box_body(Motion::Inertial);
    let inertia = *body.mass_properties().inertia();
    let inverse = inertia.try_inverse().unwrap();
    let spin = Vec3::new(2.0, 3.0, 1.0);
    let momentum = inertia * spin;
    let rate = |q: &nalgebra::Quaternion<Real>| {
        let rotation = Rot::from_quaternion(*q);
        let omega = rotation * (inverse * (rotation.inverse() * momentum));
        nalgebra::Quaternion::from_imag(omega) * q * 0.5
    };
    let (mut q, h) = (nalgebra::Quaternion::identity(), 1e-4);
    for _ in 0..5000 {
        let k1 = rate(&q);
        let k2 = rate(&(q + k1 * (0.5 * h)));
        let k3 = rate(&(q + k2 * (0.5 * h)));
        let k4 = rate(&(q + k3 * h));
        q += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
    }
    let truth = Rot::from_quaternion(q);
    let mut errors = Vec::new();
    for dt in [1e-3, 5e-4] {
        let mut body = body.clone();
        body.set_velocity(Vec3::zeros(), spin).unwrap();
        let end = fly(body, &StepContext::new(dt, Vec3::zeros()).unwrap(), 0.5, |_| {});
        errors.push(end.pose().rotation.angle_to(&truth));
    }
    assert!(errors[0] < 0.01 && (1.8..2.2).contains(&(errors[0] / errors[1])), "angle errors {errors:?} rad");
}

#[test]
fn quasi_static_body_falls_at_its_terminal_velocity_at_once() {
    for dt in [1e-3, 1e-2] {
        let mut body = box_body(Motion::QuasiStatic);
        body.set_viscosity(4.0, 2e-3).unwrap();
        body.set_external_wrench(Vec3::new(0.4, 0.0, 0.0), Vec3::new(0.0, 0.0, 1e-3)).unwrap();
        let start = body.center_of_mass();
        let velocity = Vec3::new(0.1, 0.0, -0.2 * 9.81 / 4.0);
        let end = fly(body, &StepContext::new(dt, GRAVITY).unwrap(), 0.5, |body| {
            assert!((body.linear_velocity() - velocity).norm() < 1e-13, "{}", body.linear_velocity());
            assert!((body.angular_velocity() - Vec3::z() * 0.5).norm() < 1e-13, "{}", body.angular_velocity());
        });
        assert!((end.center_of_mass() - start - velocity * 0.5).norm() < 1e-12);
        assert!((end.pose().rotation.scaled_axis() - Vec3::z() * 0.25).norm() < 1e-12);
    }
}

#[test]
fn default_viscosity_is_mass_over_its_time_constant() {
    let end = fly(box_body(Motion::QuasiStatic), &StepContext::new(1e-3, GRAVITY).unwrap(), 0.1, |_| {});
    assert!((end.linear_velocity().z + 9.81 * 0.05).abs() < 1e-12, "{}", end.linear_velocity());
}

#[test]
fn quasi_static_body_rests_when_left_alone() {
    let mut body = box_body(Motion::QuasiStatic);
    body.set_velocity(Vec3::x(), Vec3::y()).unwrap();
    let start = *body.pose();
    let end = fly(body, &StepContext::new(1e-3, Vec3::zeros()).unwrap(), 0.1, |_| {});
    assert_eq!(end.pose(), &start);
}

#[test]
fn drive_takes_a_body_to_its_target_whatever_the_step() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        for dt in [1e-3, 1e-2] {
            let mut body = box_body(motion);
            let target = Pose::from_parts(Vec3::new(0.1, -0.1, 0.2).into(), Rot::from_scaled_axis(Vec3::new(0.5, -1.0, 2.0)));
            // Far stiffer than an explicit spring could be at this step: sqrt(k/m) dt is 10 at 10 ms.
            body.set_drive(Some(PoseDrive::new(target, [2e5, 200.0], [400.0, 0.5]).unwrap())).unwrap();
            let end = fly(body, &StepContext::new(dt, Vec3::zeros()).unwrap(), 1.0, |_| {});
            let (off, turned) =
                ((end.pose().translation.vector - target.translation.vector).norm(), end.pose().rotation.angle_to(&target.rotation));
            assert!(off < 1e-9 && turned < 1e-7, "{motion:?} dt {dt}: {off:e} m, {turned:e} rad");
        }
    }
}

#[test]
fn driven_body_sags_by_weight_over_stiffness() {
    let mut body = box_body(Motion::Inertial);
    body.set_drive(Some(PoseDrive::new(Pose::identity(), [500.0, 1.0], [20.0, 0.01]).unwrap())).unwrap();
    let end = fly(body, &StepContext::new(1e-3, GRAVITY).unwrap(), 3.0, |_| {});
    let sag = end.pose().translation.vector.z;
    assert!((sag + 0.2 * 9.81 / 500.0).abs() < 1e-12, "{sag}");
}

//! Balance: contact forces carry weight and inertia, action equals reaction, and the contact problem predicts what the step does.

#[path = "common/matrices.rs"]
mod matrices;

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::delassus::Delassus;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

fn pinch(model: Option<ComplianceModel>) -> Pinch {
    let mut options = PinchOptions::fingertips(0.8).unwrap();
    options.box_points = (3_000, 400);
    options.pad_points = (750, 100);
    if let Some(model) = model {
        options.pad_material = options.pad_material.with_model(model).unwrap();
    }
    let mut pinch = Pinch::new(&options).unwrap();
    pinch.squeeze(4.0).unwrap();
    pinch.set_gravity(GRAVITY).unwrap();
    pinch
}

/// Torque of the contact forces on a body about `center`, N m.
fn contact_torque_on(world: &World, body: BodyHandle, center: &Vec3) -> Vec3 {
    let dense = body.slot();
    let torques = world.contacts().iter().zip(&world.contact_problem().reactions).map(|(contact, f)| {
        let sign = Real::from(u8::from(contact.body_a == dense)) - Real::from(u8::from(contact.body_b == dense));
        (contact.acts_at - center).cross(&(contact.acts_along * f)) * sign
    });
    torques.sum()
}

#[test]
fn contact_forces_carry_the_weight_of_a_held_box() {
    for model in [None, Some(ComplianceModel::HalfSpace)] {
        let mut pinch = pinch(model.clone());
        pinch.run(6.0);
        let report = pinch.world.step();
        let weight = 0.2 * 9.81;
        let error = (pinch.world.contact_force_on(pinch.object).unwrap() - Vec3::z() * weight).norm() / weight;
        println!("{model:?}: off by {error:.1e} of the weight, residual {:.1e}", report.residual);
        assert!(error < 1e-6, "{model:?}: off by {error:e} of the weight");
    }
}

#[test]
fn contact_forces_are_mass_times_acceleration_while_the_hand_accelerates() {
    let mut pinch = pinch(None);
    pinch.run(0.5);
    let (dt, mass) = (pinch.world.parameters().dt, 0.2);
    let mut speed = 0.0;
    for k in 0..300 {
        // Up to 3 m/s^2, upwards and aside.
        speed += 3.0 * (k as Real / 50.0).min(1.0) * dt;
        for pad in [0, 1] {
            pinch.shift_pad(pad, Vec3::new(0.0, 0.6, 0.8) * (speed * dt)).unwrap();
        }
        let before = *pinch.world.body(pinch.object).unwrap().linear_velocity();
        let (l0, center) = {
            let body = pinch.world.body(pinch.object).unwrap();
            (*body.angular_momentum(), body.center_of_mass())
        };
        pinch.world.step();
        let body = pinch.world.body(pinch.object).unwrap();
        let force = pinch.world.contact_force_on(pinch.object).unwrap();
        let off = (force - ((body.linear_velocity() - before) / dt - GRAVITY) * mass).norm();
        assert!(off < 1e-9, "step {k}: forces are off by {off:e} N");
        let torque = contact_torque_on(&pinch.world, pinch.object, &center);
        let off = (torque - (body.angular_momentum() - l0) / dt).norm();
        assert!(off < 1e-10, "step {k}: torques are off by {off:e} N m");
    }
    // Once the pads accelerate steadily so does the box, by Newton's law of the whole.
    let force = pinch.world.contact_force_on(pinch.object).unwrap();
    let truth = (Vec3::new(0.0, 0.6, 0.8) * 3.0 - GRAVITY) * mass;
    let error = (force - truth).norm() / truth.norm();
    println!("steady acceleration: {force:?} N, off by {error:.1e}");
    assert!(error < 0.02, "steady acceleration: {force:?} N against {truth:?}");
}

fn ball(world: &mut World, name: &str, points: usize, position: Vec3, velocity: Vec3, spin: Vec3) -> BodyHandle {
    let radius = 0.02;
    let surface = Arc::new(Surface::build(shapes::sample_sphere(radius, points).unwrap(), Some(points / 4)).unwrap());
    let mass = MassProperties::sphere(radius, Amount::Mass(0.03)).unwrap();
    let mut body = RigidBody::free(name, mass, Motion::Inertial, Pose::from_parts(position.into(), Rot::identity())).unwrap();
    body.set_velocity(velocity, spin).unwrap();
    world.add_body(body, Some((surface, Material::preset("ecoflex").unwrap()))).unwrap()
}

#[test]
fn colliding_bodies_keep_their_momentum_and_angular_momentum() {
    // Action = reaction, at one point: both momenta of the whole are kept to rounding, whatever the contacts do.
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let a = ball(&mut world, "a", 1500, Vec3::new(-0.021, 0.0, 0.0), Vec3::new(0.3, 0.02, 0.0), Vec3::new(3.0, -8.0, 20.0));
    let b = ball(&mut world, "b", 800, Vec3::new(0.021, 0.009, 0.003), Vec3::new(-0.2, 0.0, 0.01), Vec3::new(0.0, 5.0, 9.0));
    let total = |world: &World, about: &Vec3| {
        let bodies = [a, b].map(|h| world.body(h).unwrap().clone());
        let momentum: Vec3 = bodies.iter().map(|body| body.linear_velocity() * body.mass_properties().mass()).sum();
        let angular = bodies.iter().map(|body| {
            body.angular_momentum() + (body.center_of_mass() - about).cross(&(body.linear_velocity() * body.mass_properties().mass()))
        });
        (momentum, angular.sum::<Vec3>())
    };
    let about = Vec3::new(0.3, -0.1, 0.2);
    let (p0, l0) = total(&world, &about);
    let (mut most, mut exchanged) = (0, 0.0);
    for _ in 0..150 {
        most = most.max(world.step().contacts);
        exchanged += world.contact_force_on(a).unwrap().norm() * 1e-3;
        let sum = world.contact_force_on(a).unwrap() + world.contact_force_on(b).unwrap();
        assert_eq!(sum, Vec3::zeros(), "action and reaction");
        let torques = contact_torque_on(&world, a, &about) + contact_torque_on(&world, b, &about);
        assert!(torques.norm() < 1e-15, "torques add up to {:e} N m", torques.norm());
    }
    let (p1, l1) = total(&world, &about);
    let (dp, dl) = ((p1 - p0).norm() / exchanged, (l1 - l0).norm() / (exchanged * 0.4));
    println!("{most} contacts, {exchanged:.3e} N s exchanged, momentum off by {dp:.1e}, angular momentum by {dl:.1e}");
    assert!(most > 3 && exchanged > 1e-3, "they did not meet: {most} contacts, {exchanged} N s");
    assert!(dp < 1e-12, "momentum off by {dp:e} of what was exchanged");
    assert!(dl < 1e-12, "angular momentum off by {dl:e} of what was exchanged");
}

#[test]
fn contact_torques_of_a_finger_are_those_of_its_contact_forces() {
    let options = GraspOptions { object_points: (3_000, 400), pad_points: (750, 100), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    let poses: Vec<_> = (0..3).map(|k| scene.world.finger(scene.hand, k).unwrap().clone()).collect();
    scene.world.step();
    for (k, before) in poses.iter().enumerate() {
        let handle = scene.world.finger_handle(scene.hand, k).unwrap();
        let dense = handle.slot();
        let body = quasirigid::body::Body::Finger(before.clone());
        let mut torques = quasirigid::math::Vec6::zeros();
        for (contact, f) in scene.world.contacts().iter().zip(&scene.world.contact_problem().reactions) {
            let sign = Real::from(u8::from(contact.body_a == dense)) - Real::from(u8::from(contact.body_b == dense));
            torques += body.point_jacobian(3, &contact.acts_at).tr_mul(&(contact.acts_along * f)) * sign;
        }
        let found = scene.world.finger(scene.hand, k).unwrap().contact_torques();
        assert!(torques.norm() > 1e-3, "finger {k} carries {torques}");
        for j in 0..4 {
            assert!((found[j] - torques[j]).abs() < 1e-12, "finger {k} joint {j}: {} against {} N m", found[j], torques[j]);
        }
    }
}

#[test]
fn assembled_operator_is_the_matrix_free_one_symmetric_and_positive() {
    let plain = GraspOptions { object_points: (3_000, 400), pad_points: (600, 80), ..GraspOptions::default() };
    let same = GraspScene::new(&plain).unwrap();
    let matrix = plain.object_material.clone().with_model(matrices::as_matrix(&same.world, same.object)).unwrap();
    for (model, material) in [
        ("local", plain.object_material.clone()),
        ("half-space", plain.object_material.clone().with_model(ComplianceModel::HalfSpace).unwrap()),
        ("matrix", matrix),
    ] {
        let mut options = GraspOptions { object_material: material, ..plain.clone() };
        if model == "half-space" {
            options.pad_material = options.pad_material.with_model(ComplianceModel::HalfSpace).unwrap();
        }
        let mut scene = GraspScene::new(&options).unwrap();
        assert!(scene.close(3.0).unwrap(), "{model}");
        let problem = scene.world.contact_problem();
        let n = problem.len();
        let mut assembled = problem.assembled().unwrap();
        let mut free = problem.w.clone();
        let reactions: Vec<Vec3> = (0..n).map(|i| Vec3::new((i as Real).sin(), (2.0 * i as Real).cos(), (0.3 * i as Real).sin())).collect();
        free.set_reactions(&reactions);
        assembled.set_reactions(&reactions);
        let largest = (0..n).map(|i| assembled.displacement(i).norm()).fold(0.0, Real::max);
        for i in 0..n {
            let off = (free.displacement(i) - assembled.displacement(i)).norm() / largest;
            assert!(off < 1e-12, "{model}: row {i} of {n} is off by {off:e}");
        }
        let w = nalgebra::DMatrix::from_row_slice(3 * n, 3 * n, &assembled.to_dense());
        let asymmetry = (&w - w.transpose()).amax() / w.amax();
        let eigenvalues = ((&w + w.transpose()) * 0.5).symmetric_eigenvalues();
        let (low, high) = (eigenvalues.min(), eigenvalues.max());
        println!("{model}: {n} contacts, asymmetry {asymmetry:.1e}, eigenvalues {low:.2e} to {high:.2e} m/N");
        assert!(n > 40, "{model}: {n} contacts");
        assert!(asymmetry < 1e-12, "{model}: asymmetry {asymmetry:e}");
        assert!(low > 0.0, "{model}: eigenvalues {low:e} to {high:e} m/N");
    }
}

/// Gap and slip that a contact problem predicted against those of the step that followed, for a soft
/// pad that presses, slides and turns on a plate. Returns the worst errors (m) of gap and slip over
/// all steps and loaded contacts, and the largest displacement of a step (m).
fn predicted_against_done(model: ComplianceModel, dt: Real) -> (Real, Real, Real) {
    let mut world = World::new(Parameters { dt, gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let pulp = Material::preset("fingertip_pulp").unwrap().with_friction(0.6).unwrap().with_model(model).unwrap();
    let rubber = Material::preset("rubber").unwrap().with_friction(0.6).unwrap();
    let pad = Surface::build(shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 900).unwrap(), Some(120)).unwrap();
    let plate = Surface::build(shapes::sample_box(Vec3::new(0.06, 0.06, 0.02), 2_400).unwrap(), Some(320)).unwrap();
    // The pad looks down at the plate.
    let down = Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    let place = |z: Real, x: Real, turn: Real| {
        Pose::from_parts(Vec3::new(x, 0.3 * x, 0.01 + 0.008 + z).into(), Rot::from_axis_angle(&Vec3::z_axis(), turn) * down)
    };
    let fingertip = world.add_body(RigidBody::fixed("pad", place(-2e-4, 0.0, 0.0)).unwrap(), Some((Arc::new(pad), pulp))).unwrap();
    let mass = MassProperties::cuboid(Vec3::new(0.06, 0.06, 0.02), Amount::Mass(0.1)).unwrap();
    let mut body = RigidBody::free("plate", mass, Motion::Inertial, Pose::identity()).unwrap();
    body.set_drive(Some(PoseDrive::new(Pose::identity(), [2e3, 2.0], [20.0, 0.02]).unwrap())).unwrap();
    let slab = world.add_body(body, Some((Arc::new(plate), rubber))).unwrap();

    let (mut worst_gap, mut worst_slip, mut largest): (Real, Real, Real) = (0.0, 0.0, 0.0);
    let state = |world: &World| {
        let poses = [fingertip, slab].map(|body| *world.body(body).unwrap().pose());
        let u = [fingertip, slab].map(|body| world.skin(body).unwrap().unwrap().displacement.clone());
        (poses, u)
    };
    for k in 0..(0.2 / dt) as usize {
        let t = (k + 1) as Real * dt;
        let target = place(-2e-4 - 8e-3 * t, 0.01 * (20.0 * t).sin(), 0.2 * (15.0 * t).sin());
        world.body_mut(fingertip).unwrap().move_to(target).unwrap();
        let ([a0, b0], [ua0, ub0]) = state(&world);
        let report = world.step();
        assert!(report.converged(), "step {k}: {:?}", report.stop);
        if t < 0.02 {
            // The pad starts pressed in: what the surface does in the first step is large whatever dt.
            continue;
        }
        let ([a1, b1], [ua1, ub1]) = state(&world);
        let problem = world.contact_problem();
        let mut w = problem.w.clone();
        w.set_reactions(&problem.reactions);
        let control = &world.skin(fingertip).unwrap().unwrap().surface.control;
        for (i, contact) in world.contacts().iter().enumerate().filter(|(i, _)| problem.reactions[*i].x > 0.0) {
            assert_eq!(contact.body_a, fingertip.slot(), "the pad is the finer side");
            let delta = w.displacement(i) + problem.delta_free[i];
            // The two material points, followed by hand. That of the plate is the foot of the contact.
            let c = contact.control_point as usize;
            let point_a = |pose: &Pose, u: &[Vec3]| pose.rotation * (control.points[c] + u[c]) + pose.translation.vector;
            let blend = |u: &[Vec3]| contact.weights_b.iter().map(|(k, weight)| u[k] * weight).sum::<Vec3>();
            let foot = contact.point - contact.frame.column(0) * contact.gap;
            let local = b0.rotation.inverse() * (foot - b0.translation.vector) - blend(&ub0);
            let point_b = |pose: &Pose, u: &[Vec3]| pose.rotation * (local + blend(u)) + pose.translation.vector;
            let apart = |a: &Pose, ua: &[Vec3], b: &Pose, ub: &[Vec3]| point_a(a, ua) - point_b(b, ub);
            assert!((point_a(&a0, &ua0) - contact.point).norm() < 1e-12, "the contact is at its control point");
            // As the pad sees it, which leads: what is remembered is remembered in its axes.
            let back = a0.rotation * a1.rotation.inverse();
            let relative = contact.frame.transpose() * (back * apart(&a1, &ua1, &b1, &ub1) - apart(&a0, &ua0, &b0, &ub0));
            worst_gap = worst_gap.max((relative.x + contact.gap - delta.x).abs());
            worst_slip = worst_slip.max((relative.yz() - delta.yz()).norm());
            largest = largest.max((a1.translation.vector - a0.translation.vector).norm());
        }
    }
    (worst_gap, worst_slip, largest)
}

#[test]
fn contact_problem_predicts_gap_and_slip_to_second_order() {
    let pulp = Material::preset("fingertip_pulp").unwrap();
    for model in [ComplianceModel::Local, pulp.gaussian().unwrap(), ComplianceModel::HalfSpace] {
        let coarse = predicted_against_done(model.clone(), 2e-3);
        let fine = predicted_against_done(model.clone(), 1e-3);
        println!(
            "{model:?}: gap {:.1e} -> {:.1e} m, slip {:.1e} -> {:.1e} m, in steps of {:.1e} m",
            coarse.0, fine.0, coarse.1, fine.1, fine.2
        );
        // Angles of a step are some 3 mrad at 10 mm: 5e-8 m at second order, against steps of 2e-4 m.
        assert!(fine.2 > 1e-4, "the pad moved by {:e} m in a step", fine.2);
        assert!(fine.0 < 1e-7 && fine.1 < 1e-7, "{model:?}: gap off by {:e}, slip by {:e} m", fine.0, fine.1);
        for (large, small) in [(coarse.0, fine.0), (coarse.1, fine.1)] {
            assert!(large / small > 3.0 || small < 1e-9, "{model:?}: halving dt takes {large:e} to {small:e} m");
        }
    }
}

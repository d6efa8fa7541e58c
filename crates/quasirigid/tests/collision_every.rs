//! Looking at the surfaces only in every fourth step changes next to nothing: what is
//! held does not creep, and what rolls and slides feels the same force.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{Pinch, PinchOptions};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::Arc;

#[test]
fn a_pinched_box_does_not_creep() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        let mut options = PinchOptions::fingertips(0.6).unwrap();
        options.params = Parameters { collision_every: 4, ..Parameters::default() };
        options.motion = motion;
        (options.box_points, options.pad_points) = ((4_800, 640), (900, 120));
        let mut pinch = Pinch::new(&options).unwrap();
        pinch.squeeze(4.0).unwrap();
        pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
        pinch.run(if motion == Motion::Inertial { 6.0 } else { 1.0 });
        let pose = |pinch: &Pinch| *pinch.world.body(pinch.object).unwrap().pose();
        let before = pose(&pinch);
        pinch.run(0.5);
        let after = pose(&pinch);
        let speed = (after.translation.vector - before.translation.vector).norm() / 0.5;
        println!("{motion:?}: {speed:.1e} m/s");
        assert!(after.translation.z > -5e-3, "{motion:?}: the box fell to {} m", after.translation.z);
        assert!(speed < 1e-9, "{motion:?}: {speed:e} m/s");
    }
}

/// Forces (N) on a soft pad that rolls over a ball and slides on it, at up to 0.05
/// m/s, over 300 steps, and how many of its contacts were projected again.
fn forces_of_a_dance(collision_every: u32) -> (Vec<Vec3>, usize) {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), collision_every, ..Parameters::default() }).unwrap();
    let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
    let pad = surface(shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 2_400).unwrap(), 320);
    let pose = |t: Real| {
        let swing =
            Rot::from_axis_angle(&Vec3::y_axis(), 0.12 * (10.0 * t).sin()) * Rot::from_axis_angle(&Vec3::x_axis(), 0.05 * (7.0 * t).sin());
        let roll = Rot::from_axis_angle(&Vec3::y_axis(), 0.2 * (10.0 * t).sin());
        let down = Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
        Pose::from_parts((swing * Vec3::new(0.0, 0.0, 0.025 + 0.007 - 8e-4)).into(), roll * down)
    };
    let pulp = Material::preset("fingertip_pulp").unwrap();
    let pad = world.add_body(RigidBody::fixed("pad", pose(0.0)).unwrap(), Some((pad, pulp))).unwrap();
    let mut ball =
        RigidBody::free("ball", MassProperties::sphere(0.025, Amount::Mass(0.1)).unwrap(), Motion::Inertial, Pose::identity()).unwrap();
    ball.set_drive(Some(PoseDrive::new(Pose::identity(), [1e6, 1e3], [0.0, 0.0]).unwrap())).unwrap();
    let wood = Material::preset("wood").unwrap();
    world.add_body(ball, Some((surface(shapes::sample_sphere(0.025, 6_000).unwrap(), 800), wood))).unwrap();
    let (mut forces, mut projected) = (Vec::new(), 0);
    for k in 0..300 {
        world.body_mut(pad).unwrap().move_to(pose((k + 1) as Real * 1e-3)).unwrap();
        assert!(world.step().converged());
        projected += world.contacts().iter().filter(|contact| contact.projected).count();
        forces.push(world.contact_force_on(pad).unwrap());
    }
    (forces, projected)
}

#[test]
fn a_pad_that_rolls_and_slides_feels_the_same_force() {
    let ((every, projected), (fourth, fewer)) = (forces_of_a_dance(1), forces_of_a_dance(4));
    // Once the pad is in: the first steps come from nothing.
    let largest = every.iter().map(|f| f.norm()).fold(0.0, Real::max);
    let off = every.iter().zip(&fourth).skip(20).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max) / largest;
    println!(
        "largest force {largest:.3} N, off by {:.3} % at most; {projected} projections, {fewer} with a look in every fourth step",
        100.0 * off
    );
    assert!(off < 0.01, "force off by {:.3} %", 100.0 * off);
    assert!(fewer * 3 < projected, "{fewer} projections against {projected}");
}

//! The smallest grasp: two fingertips take a box from a stand and hold it by friction. The README has the same in Python.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::delassus::ContactStatus;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::Arc;

/// From the middle of the box to a pad's centre before it closes, m, and how far it closes.
const START: Real = 0.034;
const TRAVEL: Real = 2.5e-3;

fn main() -> quasirigid::Result<()> {
    let mut world = World::new(Parameters::default())?;

    let surface = Arc::new(Surface::build(shapes::sample_box(Vec3::new(0.02, 0.02, 0.01), 1_000)?, None)?);
    let body = RigidBody::fixed("stand", Pose::translation(0.0, 0.0, -0.005))?;
    let stand = world.add_body(body, Some((surface, Material::preset("rubber")?)))?;

    let size = Vec3::new(0.05, 0.05, 0.05);
    let surface = Arc::new(Surface::build(shapes::sample_box(size, 12_000)?, None)?);
    let mass = MassProperties::cuboid(size, Amount::Mass(0.2))?;
    let body = RigidBody::free("box", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.025))?;
    let object = world.add_body(body, Some((surface, Material::preset("wood")?)))?;

    let surface = Arc::new(Surface::build(shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 2_400)?, Some(320))?);
    let pose = |side: Real, distance: Real| {
        // The pad's +z turns to point at the box.
        let rotation = Rot::from_axis_angle(&Vec3::y_axis(), -side * std::f64::consts::FRAC_PI_2);
        Pose::from_parts(Vec3::new(side * distance, 0.0, 0.025).into(), rotation)
    };
    let mut pads = Vec::new();
    for side in [-1.0, 1.0] {
        let body = RigidBody::fixed("pad", pose(side, START))?;
        pads.push((side, world.add_body(body, Some((surface.clone(), Material::preset("fingertip_pulp")?)))?));
    }

    let steps = 300;
    for k in 1..=steps {
        for &(side, pad) in &pads {
            world.body_mut(pad)?.move_to(pose(side, START - TRAVEL * Real::from(k) / Real::from(steps)))?;
        }
        world.step();
    }
    world.remove_body(stand)?;
    for _ in 0..10 {
        let before = *world.body(object)?.pose();
        let mut report = world.step();
        for _ in 1..100 {
            report = world.step();
        }
        let moved = (world.body(object)?.pose().translation.vector - before.translation.vector).norm();
        let stick = world.contact_problem().status.iter().filter(|&&status| status == ContactStatus::Stick).count();
        println!(
            "t {:.1} s: {} contacts, {stick} stick, {} sweeps, residual {:.0e}, moved {:.1e} m, pad forces {:.2?} N",
            report.time,
            report.contacts,
            report.sweeps,
            report.residual,
            moved,
            world.contact_force_on(pads[0].1)?.as_slice(),
        );
    }
    Ok(())
}

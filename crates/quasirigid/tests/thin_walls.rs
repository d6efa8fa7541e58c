//! Thin walls: what comes at a plate as thick as a step is long does not go through it,
//! whatever the phase of the step, the angle, and who is soft or light.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const HALF_WIDTH: Real = 0.02;
const SPEED: Real = 1.0;

fn surface(points: PointSurface, leaves: usize) -> Arc<Surface> {
    Arc::new(Surface::build(points, Some(leaves)).unwrap())
}

/// What meets what.
struct Shot {
    thickness: Real,
    /// Spacing of the plate's points, m.
    spacing: Real,
    free: bool,
    radius: Real,
    mass: Real,
    material: &'static str,
}

/// A plate in the plane z = 0, and a ball that has its lowest point `before` (m)
/// ahead of the plane or rim through `at`, coming along `way` at 1 m/s.
fn shoot(shot: &Shot, at: Vec3, way: Vec3, before: Real, turn: Real) -> (World, BodyHandle, BodyHandle) {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let size = Vec3::new(2.0 * HALF_WIDTH, 2.0 * HALF_WIDTH, shot.thickness);
    let points = (2.0 * size.x * size.y / (shot.spacing * shot.spacing)) as usize;
    let mass = MassProperties::cuboid(size, Amount::Mass(0.05)).unwrap();
    let body = if shot.free {
        RigidBody::free("plate", mass, Motion::Inertial, Pose::identity())
    } else {
        RigidBody::fixed("plate", Pose::identity())
    };
    let skin = (surface(shapes::sample_box(size, points).unwrap(), points / 8), Material::preset("wood").unwrap());
    let plate = world.add_body(body.unwrap(), Some(skin)).unwrap();
    let start = at - way * (shot.radius + shot.thickness + before);
    let pose = Pose::from_parts(start.into(), Rot::from_scaled_axis(Vec3::new(0.1, 0.2, 0.3) * turn));
    let mass = MassProperties::sphere(shot.radius, Amount::Mass(shot.mass)).unwrap();
    let mut body = RigidBody::free("ball", mass, Motion::Inertial, pose).unwrap();
    body.set_velocity(way * SPEED, Vec3::zeros()).unwrap();
    let skin = (surface(shapes::sample_sphere(shot.radius, 600).unwrap(), 80), Material::preset(shot.material).unwrap());
    let ball = world.add_body(body, Some(skin)).unwrap();
    (world, plate, ball)
}

/// Centre of the ball as the plate sees it.
fn seen_from_plate(world: &World, plate: BodyHandle, ball: BodyHandle) -> Vec3 {
    let center = world.body(ball).unwrap().pose().translation.vector;
    world.body(plate).unwrap().pose().inverse_transform_point(&center.into()).coords
}

#[test]
fn a_ball_at_1_m_per_s_does_not_pass_a_plate_of_1_mm_or_less() {
    let sideways = Vec3::new(0.8, 0.0, -0.6);
    let ways = [
        ("from above", Vec3::new(1e-3, 2e-3, 0.0), -Vec3::z()),
        ("aslant", Vec3::new(1e-3, 2e-3, 0.0), sideways),
        ("on the rim from above", Vec3::new(HALF_WIDTH - 5e-4, 2e-3, 0.0), -Vec3::z()),
        ("edge-on", Vec3::new(HALF_WIDTH, 2e-3, 0.0), -Vec3::x()),
        ("edge-on, aslant", Vec3::new(HALF_WIDTH, 2e-3, 0.0), Vec3::new(-0.8, 0.0, -0.6)),
    ];
    let (mut shots, mut closest) = (0, Real::INFINITY);
    for thickness in [0.5e-3, 1e-3] {
        for (free, spacing) in [(false, 0.8e-3), (true, 1.5e-3)] {
            for (radius, mass, material) in [(2e-3, 1e-4, "steel"), (2e-3, 5e-3, "fingertip_pulp"), (8e-3, 0.02, "fingertip_pulp")] {
                let shot = Shot { thickness, spacing, free, radius, mass, material };
                for (name, at, way) in ways {
                    for phase in 0..4 {
                        let what = format!(
                            "{material} ball of {radius} m, {mass} kg, {name} on {} plate of {thickness} m, phase {phase}",
                            if free { "a free" } else { "a fixed" }
                        );
                        let (mut world, plate, ball) = shoot(&shot, at, way, 1e-3 + 0.25e-3 * Real::from(phase), Real::from(phase));
                        let mut fastest: Real = 0.0;
                        for _ in 0..(1.5 * radius / SPEED / 1e-3) as usize + 12 {
                            world.step();
                            fastest = fastest.max(world.body(ball).unwrap().linear_velocity().norm());
                            let center = seen_from_plate(&world, plate, ball);
                            if name.starts_with("edge-on") {
                                // Not into the plate's own slab; past it, over or under, is where a ball may go that glances off the edge.
                                let into = HALF_WIDTH - center.x;
                                assert!(into < 1e-3 || center.z.abs() > 0.5 * radius, "{what}: {center:?} from the plate");
                            } else if center.x.abs() < HALF_WIDTH {
                                closest = closest.min(center.z);
                                assert!(center.z > 0.0, "{what}: {center:?} from the plate");
                            }
                        }
                        assert!(fastest < 1.01 * SPEED, "{what}: {fastest} m/s");
                        shots += 1;
                    }
                }
            }
        }
    }
    println!("{shots} shots; closest that a centre came to the middle of a plate: {closest:.2e} m");
}

#[test]
fn a_fingertip_that_is_pulled_through_a_plate_and_along_it_stays_on_its_side() {
    for (thickness, spacing) in [(0.5e-3, 0.8e-3), (1e-3, 1.5e-3)] {
        let shot = Shot { thickness, spacing, free: false, radius: 8e-3, mass: 0.02, material: "fingertip_pulp" };
        let (mut world, plate, ball) = shoot(&shot, Vec3::zeros(), -Vec3::z(), 1e-3, 0.3);
        let mut lowest = Real::INFINITY;
        for step in 0..600 {
            // The spring's far end is 10 mm behind the plate and wanders over most of it, at up to 0.4 m/s.
            let target = Vec3::new(0.012 * (0.03 * Real::from(step)).sin(), 0.012 * (0.017 * Real::from(step)).sin(), -0.01);
            let drive = PoseDrive::new(Pose::from_parts(target.into(), Rot::identity()), [800.0, 0.05], [4.0, 4e-4]).unwrap();
            world.body_mut(ball).unwrap().set_drive(Some(drive)).unwrap();
            world.step();
            lowest = lowest.min(seen_from_plate(&world, plate, ball).z);
        }
        println!("plate of {thickness} m: the centre came down to {lowest:.2e} m");
        assert!(lowest > 0.0, "plate of {thickness} m: the centre came down to {lowest} m");
    }
}

#[test]
fn a_fingertip_that_is_moved_at_1_m_per_s_takes_a_thin_plate_along() {
    for phase in 0..4 {
        let shot = Shot { thickness: 1e-3, spacing: 1e-3, free: true, radius: 8e-3, mass: 0.02, material: "fingertip_pulp" };
        let (mut world, plate, ball) = shoot(&shot, Vec3::zeros(), -Vec3::z(), 1e-3, 0.0);
        let start = *world.body(ball).unwrap().pose();
        world.remove_body(ball).unwrap();
        let skin = (surface(shapes::sample_sphere(8e-3, 600).unwrap(), 80), Material::preset("fingertip_pulp").unwrap());
        let tip = world.add_body(RigidBody::fixed("tip", start).unwrap(), Some(skin)).unwrap();
        for step in 1..=40 {
            let at = start.translation.vector - Vec3::z() * SPEED * 1e-3 * (Real::from(step) - 0.25 * Real::from(phase));
            world.body_mut(tip).unwrap().move_to(Pose::from_parts(at.into(), start.rotation)).unwrap();
            world.step();
            let center = seen_from_plate(&world, plate, tip);
            assert!(center.z > 0.0, "phase {phase}, step {step}: {center:?} from the plate");
        }
    }
}

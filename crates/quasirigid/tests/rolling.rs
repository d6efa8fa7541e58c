//! Rolling: a round body keeps its speed on a level plane, rolls down a slope and spins up as it slips by the laws of a rigid sphere.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const G: Real = 9.81;
const RADIUS: Real = 0.02;
const MASS: Real = 0.1;

fn scene(points: (usize, usize), material: &Material, slope: Real, dt: Real, turn: Vec3) -> (World, BodyHandle) {
    let ball_surface = Arc::new(Surface::build(shapes::sample_sphere(RADIUS, points.0).unwrap(), None).unwrap());
    let plane_surface = Arc::new(Surface::build(shapes::sample_half_space(0.6, points.1).unwrap(), None).unwrap());
    let gravity = Vec3::new(G * slope.sin(), 0.0, -G * slope.cos());
    let mut world = World::new(Parameters { dt, gravity, ..Parameters::default() }).unwrap();
    let plane = RigidBody::fixed("plane", Pose::identity()).unwrap();
    world.add_body(plane, Some((plane_surface, material.clone()))).unwrap();
    let mass = MassProperties::sphere(RADIUS, Amount::Mass(MASS)).unwrap();
    let at = Pose::from_parts(Vec3::new(-0.2, 0.0, RADIUS).into(), Rot::from_scaled_axis(turn));
    let ball = RigidBody::free("ball", mass, Motion::Inertial, at).unwrap();
    let ball = world.add_body(ball, Some((ball_surface, material.clone()))).unwrap();
    (world, ball)
}

fn elastic(name: &str) -> Material {
    Material::preset(name).unwrap().with_relaxation_time(0.0).unwrap()
}

fn run(world: &mut World, time: Real) {
    let steps = (time / world.parameters().dt).round() as usize;
    (0..steps).for_each(|_| drop(world.step()));
}

#[test]
fn look() {
    let turns = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.7, -0.2, 0.5), Vec3::new(-0.3, 1.4, 2.0)];
    for points in [(6_000, 20_000), (40_000, 20_000)] {
        for name in ["ecoflex", "rubber", "wood", "steel"] {
            for (k, turn) in turns.iter().enumerate() {
                let (mut world, ball) = scene(points, &elastic(name), 0.0, 1e-3, *turn);
                run(&mut world, 0.2);
                let z0 = world.body(ball).unwrap().center_of_mass();
                run(&mut world, 1.0);
                let wander = (world.body(ball).unwrap().center_of_mass() - z0).xy().norm();
                let speed = 0.2;
                world.body_mut(ball).unwrap().set_velocity(Vec3::new(speed, 0.0, 0.0), Vec3::new(0.0, speed / RADIUS, 0.0)).unwrap();
                run(&mut world, 0.1);
                let before = *world.body(ball).unwrap().linear_velocity();
                run(&mut world, 0.4);
                let after = *world.body(ball).unwrap().linear_velocity();
                let slope = (11.5 as Real).to_radians();
                let (mut world, ball) = scene(points, &elastic(name), slope, 1e-3, *turn);
                run(&mut world, 0.1);
                let start = *world.body(ball).unwrap().linear_velocity();
                run(&mut world, 0.3);
                let v = *world.body(ball).unwrap().linear_velocity();
                let truth = 5.0 / 7.0 * G * slope.sin() * 0.3;
                let mu = 0.1;
                let (mut world, ball) = scene(points, &elastic(name).with_friction(mu).unwrap(), 0.0, 1e-3, *turn);
                run(&mut world, 0.2);
                world.body_mut(ball).unwrap().set_velocity(Vec3::new(0.5, 0.0, 0.0), Vec3::zeros()).unwrap();
                run(&mut world, 0.02);
                let w0 = world.body(ball).unwrap().angular_velocity();
                run(&mut world, 0.1);
                let spin = (world.body(ball).unwrap().angular_velocity() - w0).y / 0.1;
                let spin_truth = 2.5 * mu * G / RADIUS;
                println!(
                    "{points:?} {name} turn {k}: wander {:.2} mm, speed left {:.4}, down {:+.2} %, slip spin {:+.2} %, contacts {}",
                    wander * 1e3,
                    after.x / before.x,
                    100.0 * ((v.x - start.x) / truth - 1.0),
                    100.0 * (spin / spin_truth - 1.0),
                    world.contacts().len()
                );
            }
        }
    }
}

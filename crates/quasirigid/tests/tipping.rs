//! Faces carry up to their edges: a block tips where its centre of mass leaves its base, at any sampling, and what stands on something narrower than the control points are
//! apart stands.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const G: Real = 9.81;

fn surface(points: PointSurface) -> Arc<Surface> {
    Arc::new(Surface::build(points, None).unwrap())
}

fn wood() -> Material {
    Material::preset("wood").unwrap().with_friction(1.5).unwrap()
}

/// A body of `size` (m) on a floor that is tilted by the angle of tangent `slope` towards +x: the floor lies flat, and gravity is tilted.
fn on_slope(points: PointSurface, size: Vec3, turn: Rot, height: Real, slope: Real) -> (World, BodyHandle) {
    let down = Vec3::new(slope, 0.0, -1.0).normalize() * G;
    let mut world = World::new(Parameters { gravity: down, ..Parameters::default() }).unwrap();
    let floor = surface(shapes::sample_half_space(0.3, 3_000).unwrap());
    world.add_body(RigidBody::fixed("floor", Pose::identity()).unwrap(), Some((floor, wood()))).unwrap();
    let mass = MassProperties::cuboid(size, Amount::Mass(0.1)).unwrap();
    let pose = Pose::from_parts(Vec3::new(0.0, 0.0, height).into(), turn);
    let body = RigidBody::free("body", mass, Motion::Inertial, pose).unwrap();
    let body = world.add_body(body, Some((surface(points), wood()))).unwrap();
    (world, body)
}

/// By how much a body turns within `steps`, rad.
fn tilt(world: &mut World, body: BodyHandle, steps: usize) -> Real {
    let before = world.body(body).unwrap().pose().rotation;
    (0..steps).for_each(|_| drop(world.step()));
    world.body(body).unwrap().pose().rotation.angle_to(&before)
}

/// A box of `size` as a mesh sampler makes it: points by chance on each face, none at the same distance from the edge.
fn scattered_box(size: Vec3, n: usize) -> PointSurface {
    let (points, normals, areas) = shapes::sample_box(size, n).unwrap().into_parts();
    let spacing = (areas.iter().sum::<Real>() / n as Real).sqrt();
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as Real / (1_u64 << 53) as Real - 0.5
    };
    let shaken = points.iter().zip(&normals).map(|(p, n)| {
        let shift = Vec3::new(random(), random(), random()) * (0.7 * spacing);
        let inside = |v: Real, half: Real| v.clamp(-half, half);
        let q = p + shift - n * n.dot(&shift);
        Vec3::new(inside(q.x, 0.5 * size.x), inside(q.y, 0.5 * size.y), inside(q.z, 0.5 * size.z))
    });
    PointSurface::new(shaken.collect(), normals, areas).unwrap()
}

#[test]
fn a_block_tips_where_its_centre_of_mass_leaves_its_base() {
    let size = Vec3::new(0.02, 0.03, 0.06);
    let upright = Rot::identity();
    let turned = Rot::from_axis_angle(&Vec3::z_axis(), std::f64::consts::FRAC_PI_2);
    let grid = |n| shapes::sample_box(Vec3::new(0.02, 0.03, 0.06), n).unwrap();
    for (name, turn, width, points) in [
        ("upright", upright, size.x, grid as fn(usize) -> PointSurface),
        ("turned by 90 degrees", turned, size.y, grid),
        ("of scattered points", upright, size.x, |n| scattered_box(Vec3::new(0.02, 0.03, 0.06), n)),
    ] {
        for count in [2_000, 4_000, 9_000] {
            let [stands, tips] = [0.99, 1.01].map(|share| {
                let (mut world, body) = on_slope(points(count), size, turn, 0.5 * size.z, share * width / size.z);
                tilt(&mut world, body, 350)
            });
            println!("block {name}, {count} points: turns by {stands:.5} rad at 0.99 w/h and by {tips:.5} rad at 1.01 w/h");
            assert!(stands < 2e-3, "block {name}, {count} points: turned by {stands} rad at 0.99 of the slope at which it tips");
            assert!(tips > 0.02, "block {name}, {count} points: turned by {tips} rad only at 1.01 of the slope at which it tips");
        }
    }
}

#[test]
fn a_card_stands_on_its_edge() {
    for (thickness, count) in [(5e-4, 12_000), (3e-4, 4_000), (2e-4, 12_000), (1e-4, 12_000), (5e-5, 4_000)] {
        let size = Vec3::new(thickness, 0.06, 0.06);
        let (mut world, body) = on_slope(shapes::sample_box(size, count).unwrap(), size, Rot::identity(), 0.03, 0.0);
        let tilted = tilt(&mut world, body, 400);
        let sunk = 0.03 - world.body(body).unwrap().pose().translation.z;
        println!("card of {thickness} m, {count} points: {} contacts, sunk by {sunk:.1e} m, turned by {tilted:.1e} rad", world.contacts().len());
        assert!(sunk.abs() < 2e-6 && tilted < 1e-4, "card of {thickness} m, {count} points: sunk by {sunk} m, turned by {tilted} rad");
    }
}

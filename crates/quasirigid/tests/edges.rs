//! Edges, corners, rims and thin plates: what is pressed on them rests, every contact belongs to one
//! of the faces that meet there, and what slides over them neither snags nor jumps.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{Pinch, PinchOptions};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const BALL: Real = 8e-3;
/// Half the edge of the box.
const HALF: Real = 0.02;

fn surface(points: PointSurface, leaves: usize) -> Arc<Surface> {
    Arc::new(Surface::build(points, Some(leaves)).unwrap())
}

fn weightless() -> World {
    World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap()
}

fn material(name: &str, mu: Real) -> Material {
    Material::preset(name).unwrap().with_friction(mu).unwrap()
}

fn ball(control_points: usize) -> Arc<Surface> {
    surface(shapes::sample_sphere(BALL, 8 * control_points).unwrap(), control_points)
}

/// Drift (m/s) and spin (rad/s) of a body over `steps` steps.
fn speeds(world: &mut World, body: BodyHandle, steps: usize) -> (Real, Real) {
    let before = *world.body(body).unwrap().pose();
    (0..steps).for_each(|_| drop(world.step()));
    let (after, time) = (world.body(body).unwrap().pose(), steps as Real * world.parameters().dt);
    ((after.translation.vector - before.translation.vector).norm() / time, after.rotation.angle_to(&before.rotation) / time)
}

#[test]
fn a_soft_ball_pressed_on_edges_corners_and_rims_rests_on_the_faces_that_meet_there() {
    let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
    let boxes = || shapes::sample_box(Vec3::repeat(2.0 * HALF), 4_800).unwrap();
    let plate = |thickness: Real| shapes::sample_box(Vec3::new(2.0 * HALF, 2.0 * HALF, thickness), 6_000).unwrap();
    // Name, object, where it is pressed, from which side, and the normals of the faces there.
    let cases = [
        ("edge of a box", boxes(), (x + z) * HALF, x + z, vec![x, z]),
        ("edge of a box, aslant", boxes(), (x + z) * HALF, x + 2.0 * z, vec![x, z]),
        ("corner of a box", boxes(), (x + y + z) * HALF, x + y + z, vec![x, y, z]),
        ("rim of a plate of 1 mm", plate(1e-3), x * HALF, x, vec![x]),
        ("rim of a plate of 0.5 mm", plate(0.5e-3), x * HALF, x, vec![x]),
        ("rim of a plate of 1 mm, aslant", plate(1e-3), x * HALF, x + z, vec![x, z]),
        ("rim of a cylinder", shapes::sample_cylinder(0.015, 0.03, 4_000).unwrap(), (x + z) * 0.015, x + z, vec![x, z]),
    ];
    for (name, object, at, out, faces) in cases {
        let out = out.normalize();
        for (mu, depth) in [(0.6, 1.5e-3), (0.6, 3e-3), (0.0, 3e-3)] {
            let what = format!("{name}, pressed by {depth} m, friction {mu}");
            let mut world = weightless();
            let leaves = object.len() / 8;
            let body = RigidBody::fixed("object", Pose::identity()).unwrap();
            world.add_body(body, Some((surface(object.clone(), leaves), material("wood", mu)))).unwrap();
            // A damped spring pulls the ball in, and keeps it from rolling off.
            let mass = MassProperties::sphere(BALL, Amount::Mass(0.02)).unwrap();
            let turn = Rot::from_scaled_axis(Vec3::new(0.3, 0.2, 0.1));
            let place = |above: Real| Pose::from_parts((at + out * (BALL + above)).into(), turn);
            let mut body = RigidBody::free("ball", mass, Motion::Inertial, place(2e-4)).unwrap();
            body.set_drive(Some(PoseDrive::new(place(-depth), [1e3, 0.05], [9.0, 4e-4]).unwrap())).unwrap();
            let pad = world.add_body(body, Some((ball(320), material("fingertip_pulp", mu)))).unwrap();
            (0..1000).for_each(|_| drop(world.step()));
            let force = world.contact_force_on(pad).unwrap();
            let (mut varies, mut turned): (Real, Real) = (0.0, 0.0);
            for _ in 0..50 {
                assert!(world.step().converged(), "{what}");
                varies = varies.max((world.contact_force_on(pad).unwrap() - force).norm());
                for (contact, f) in world.contacts().iter().zip(&world.contact_problem().reactions).filter(|(_, f)| f.x > 0.0) {
                    let normal: Vec3 = contact.frame.column(0).into();
                    // The side of the cylinder is round.
                    let radial = Vec3::new(contact.foot.x, contact.foot.y, 0.0).normalize();
                    let face = |n: &Vec3| normal.angle(if name == "rim of a cylinder" && *n == x { &radial } else { n });
                    let off = faces.iter().map(face).fold(Real::INFINITY, Real::min);
                    assert!(off < 0.02, "{what}: a contact with {} N along {normal:?}, {off} rad from the nearest face", f.x);
                    turned = turned.max(off);
                }
            }
            let (drift, spin) = speeds(&mut world, pad, 200);
            let (pressed, off) = (force.norm(), force.angle(&out).to_degrees());
            println!(
                "{what}: {pressed:.3} N, {off:.1} degrees off, varies by {varies:.1e} N, \
                 {drift:.1e} m/s, {spin:.1e} rad/s, normals {turned:.1e} rad off"
            );
            assert!(pressed > 0.05, "{what}: {pressed} N");
            assert!(varies < 1e-9 * pressed, "{what}: force varies by {varies:e} N of {pressed} N");
            assert!(drift < 1e-9 && spin < 1e-8, "{what}: {drift:e} m/s, {spin:e} rad/s");
        }
    }
}

#[test]
fn a_thin_plate_pinched_by_its_faces_is_held_and_its_sides_do_not_mix() {
    for thickness in [0.5e-3, 1e-3, 2e-3] {
        for spacing in [0.5 * thickness, thickness, 2.0 * thickness] {
            let spacing = Real::max(spacing, 0.4e-3);
            let what = format!("plate of {thickness} m, points {spacing} m apart");
            let mut options = PinchOptions::fingertips(0.6).unwrap();
            let points = (2.0 * 0.03 * 0.03 / (spacing * spacing)) as usize;
            (options.size, options.mass) = (Vec3::new(thickness, 0.03, 0.03), 0.02);
            (options.box_points, options.pad_points) = ((points, points / 8), (900, 120));
            let mut pinch = Pinch::new(&options).unwrap();
            pinch.squeeze(1.0).unwrap();
            pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
            pinch.run(4.0);
            let (drift, spin) = speeds(&mut pinch.world, pinch.object, 300);
            let fallen = -pinch.world.body(pinch.object).unwrap().pose().translation.z;
            println!("{what}: fell by {fallen:.1e} m, {drift:.1e} m/s, {spin:.1e} rad/s");
            assert!(fallen < 5e-4 && drift < 1e-9 && spin < 1e-8, "{what}: fell by {fallen} m, {drift:e} m/s, {spin:e} rad/s");
            for contact in pinch.world.contacts() {
                // Where the plate has the finer points, the pads' own normals are meant.
                if contact.body_b == pinch.object.slot() {
                    let plate = pinch.world.body(pinch.object).unwrap().pose();
                    let normal: Vec3 = plate.rotation.inverse() * Vec3::from(contact.frame.column(0));
                    let side = plate.inverse_transform_point(&contact.point.into()).x.signum();
                    assert!(normal.x * side > 0.9998, "{what}: normal {normal:?} at {:?}", contact.point);
                }
            }
        }
    }
}

#[test]
fn a_ball_that_slides_over_an_edge_neither_snags_nor_jumps_nor_gains_energy() {
    for (control_points, depth) in [(160, 1e-3), (640, 1e-3), (640, 2e-3)] {
        for (name, from, step, y) in
            [("off", 0.012, 1e-5, 3e-4), ("on", 0.029, -1e-5, 3e-4), ("off by the corner", 0.012, 1e-5, HALF - 1e-3)]
        {
            let what = format!("{control_points} control points, {depth} m deep, {name}");
            let mut world = weightless();
            let mass = MassProperties::cuboid(Vec3::repeat(2.0 * HALF), Amount::Mass(0.1)).unwrap();
            let mut body = RigidBody::free("box", mass, Motion::QuasiStatic, Pose::identity()).unwrap();
            body.set_drive(Some(PoseDrive::new(Pose::identity(), [1e8, 1e5], [0.0, 0.0]).unwrap())).unwrap();
            let skin = surface(shapes::sample_box(Vec3::repeat(2.0 * HALF), 4_800).unwrap(), 640);
            world.add_body(body, Some((skin, material("wood", 0.0)))).unwrap();
            let at = |x: Real| Pose::translation(x, y, HALF + BALL - depth);
            let body = RigidBody::fixed("ball", at(from)).unwrap();
            // Springs, of which the force and the energy on the flat are known.
            let pulp = material("fingertip_pulp", 0.0);
            let springs = pulp.gaussian().unwrap();
            let ComplianceModel::Gaussian { foundation_modulus: k, .. } = springs else { unreachable!() };
            let pad = world.add_body(body, Some((ball(control_points), pulp.with_model(springs).unwrap()))).unwrap();
            (0..300).for_each(|_| drop(world.step()));
            let mut last = world.contact_force_on(pad).unwrap();
            let (mut most, mut jump, mut work, mut share): (Real, Real, Real, Real) = (0.0, 0.0, 0.0, 0.0);
            for k in 1..=1700 {
                world.body_mut(pad).unwrap().move_to(at(from + step * Real::from(k))).unwrap();
                world.step();
                let force = world.contact_force_on(pad).unwrap();
                most = most.max(force.norm());
                jump = jump.max((force - last).norm());
                work -= force.x * step;
                share = world.contact_problem().reactions.iter().map(|f| f.x).fold(share, Real::max);
                last = force;
            }
            // On the flat: F = pi k R d^2 as springs give it, and energy F d/3.
            let flat = std::f64::consts::PI * k * BALL * depth * depth;
            println!(
                "{what}: at most {most:.3} N of {flat:.3} N on the flat, jumps {jump:.3} N, \
                 one point carries {share:.3} N, work {work:.1e} J"
            );
            assert!(most < 1.25 * flat, "{what}: {most} N, {flat} N on the flat");
            assert!(jump < 1.5 * share, "{what}: jumps by {jump} N, one control point carries {share} N");
            assert!(work.abs() < flat * depth / 3.0, "{what}: work {work:e} J, {:e} J is stored on the flat", flat * depth / 3.0);
        }
    }
}

#[test]
fn a_box_that_stands_on_a_box_with_its_edges_aligned_does_not_rock() {
    for name in ["wood", "rubber"] {
        let mut world = World::new(Parameters::default()).unwrap();
        let skin = surface(shapes::sample_box(Vec3::repeat(0.03), 2_400).unwrap(), 320);
        let pulp = Material::preset(name).unwrap();
        world.add_body(RigidBody::fixed("lower", Pose::identity()).unwrap(), Some((skin.clone(), pulp.clone()))).unwrap();
        let mass = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.05)).unwrap();
        let body = RigidBody::free("upper", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.0301)).unwrap();
        let upper = world.add_body(body, Some((skin, pulp))).unwrap();
        (0..300).for_each(|_| drop(world.step()));
        let (drift, spin) = speeds(&mut world, upper, 200);
        println!("{name}: {drift:.1e} m/s, {spin:.1e} rad/s");
        assert!(drift < 1e-9 && spin < 1e-8, "{name}: {drift:e} m/s, {spin:e} rad/s");
    }
}

//! Odd and deep situations: whatever is asked of it, a world stays finite and no call panics.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::gauss_seidel::Stop;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, StepReport, World};
use std::sync::Arc;

fn assert_finite(what: &str, world: &World, report: &StepReport) {
    for entry in world.bodies() {
        let mut finite = true;
        entry.body.state().for_each_number(|x| finite &= x.is_finite());
        assert!(finite, "{what}: {} at {} s", entry.body.name(), report.time);
    }
    for collider in world.colliders() {
        let side = world.side(collider).unwrap();
        let skin = &side.collider.skin;
        let mut numbers = skin.deformed_points().into_iter().chain(skin.displacement.iter().copied());
        assert!(numbers.all(|u| u.iter().all(|x| x.is_finite())), "{what}: surface of {} at {} s", side.body.body.name(), report.time);
    }
    assert!(world.contact_problem().reactions.iter().all(|f| f.iter().all(|x| x.is_finite())), "{what}: reactions at {} s", report.time);
    assert_ne!(report.stop, Stop::NonFinite, "{what} at {} s", report.time);
    assert!(report.quarantined.is_empty(), "{what}: {:?} quarantined at {} s", report.quarantined, report.time);
}

/// Repeatable noise in -1..1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> Real {
        // A linear congruential generator (Knuth's MMIX), upper bits.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as Real / (1u64 << 52) as Real - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}

fn options(half_space: bool) -> PinchOptions {
    let mut options = PinchOptions::fingertips(0.7).unwrap();
    (options.box_points, options.pad_points) = ((2_400, 320), (600, 80));
    if half_space {
        options.pad_material = options.pad_material.with_model(ComplianceModel::HalfSpace).unwrap();
    }
    options
}

#[test]
fn pads_that_move_at_random_for_1000_steps() {
    for (seed, half_space, motion) in [(1, false, Motion::Inertial), (2, true, Motion::Inertial), (3, false, Motion::QuasiStatic)] {
        let mut options = options(half_space);
        options.motion = motion;
        options.params.solver.max_sweeps = 200;
        let mut pinch = Pinch::new(&options).unwrap();
        let mut noise = Noise(seed);
        let (mut most, mut unconverged) = (0, 0);
        for _ in 0..1000 {
            for pad in 0..2 {
                let side = if pad == 0 { -1.0 } else { 1.0 };
                // Up to 4 mm inwards and 8 mm aside, jumping by up to a millimetre in a step: 1 m/s.
                let body = pinch.world.body_mut(pinch.pads[pad]).unwrap();
                let home = Vec3::new(side * (0.025 + 0.008 - 2e-3), 0.0, 0.0);
                let at = body.pose().translation.vector + noise.vector() * 1e-3;
                let at = home + (at - home).map(|x| x.clamp(-8e-3, 8e-3)).component_mul(&Vec3::new(0.25, 1.0, 1.0));
                let turn = Rot::from_scaled_axis(noise.vector() * 0.02) * body.pose().rotation;
                body.move_to(Pose::from_parts(at.into(), turn)).unwrap();
            }
            let report = pinch.world.step();
            most = most.max(report.contacts);
            unconverged += usize::from(!report.converged());
            assert_finite(&format!("seed {seed}"), &pinch.world, &report);
        }
        println!("seed {seed}: up to {most} contacts, {unconverged} steps at the cap of 200 sweeps");
        assert!(most > 5, "seed {seed}: up to {most} contacts");
        // 0, 0 and 3: a pad that jumps at 1 m/s over a body without inertia now and then wants more.
        assert!(unconverged < 10, "seed {seed}: {unconverged} of 1000 steps did not converge");
    }
}

#[test]
fn a_pad_placed_deep_in_a_box() {
    for depth in [2e-3, 4e-3, 8e-3, 0.02, 0.033] {
        for half_space in [false, true] {
            let mut pinch = Pinch::new(&options(half_space)).unwrap();
            let body = pinch.world.body_mut(pinch.pads[0]).unwrap();
            let mut pose = *body.pose();
            pose.translation.x += depth;
            body.set_pose(pose).unwrap();
            let mut fastest: Real = 0.0;
            for _ in 0..300 {
                let report = pinch.world.step();
                assert_finite(&format!("depth {depth} half-space {half_space}"), &pinch.world, &report);
                fastest = fastest.max(pinch.world.body(pinch.object).unwrap().linear_velocity().norm());
            }
            println!("depth {depth} half-space {half_space}: pushed out at up to {fastest:.3} m/s");
            // At the speed at which the contacts part; the box was seen to go up to a quarter faster.
            let speed = pinch.world.parameters().push_out_speed;
            assert!(
                fastest < 1.5 * speed,
                "depth {depth} half-space {half_space}: thrown out at {fastest} m/s, push_out_speed is {speed} m/s"
            );
        }
    }
}

#[test]
fn bodies_in_one_another() {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let cube = Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(0.03), 900).unwrap(), Some(120)).unwrap());
    for k in 0..4 {
        let mass = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.05)).unwrap();
        let turn = Rot::from_scaled_axis(Vec3::new(0.3, 0.7, 0.2) * k as Real);
        let body = RigidBody::free(
            format!("cube {k}"),
            mass,
            Motion::Inertial,
            Pose::from_parts(Vec3::new(2e-3 * k as Real, 0.0, 0.0).into(), turn),
        );
        world.add_body(body.unwrap(), Some((cube.clone(), Material::preset("silicone").unwrap()))).unwrap();
    }
    for _ in 0..200 {
        let report = world.step();
        assert_finite("cubes", &world, &report);
    }
    // The very same place and pose: nothing says which way is out.
    let mut world = World::new(Parameters::default()).unwrap();
    for k in 0..2 {
        let mass = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.05)).unwrap();
        let body = RigidBody::free(format!("twin {k}"), mass, Motion::Inertial, Pose::identity()).unwrap();
        world.add_body(body, Some((cube.clone(), Material::preset("steel").unwrap()))).unwrap();
    }
    for _ in 0..50 {
        let report = world.step();
        assert_finite("twins", &world, &report);
    }
}

fn ball_on_plate(mass: Real, material: &str, dt: Real, speed: Real) -> (World, BodyHandle) {
    let mut world = World::new(Parameters { dt, ..Parameters::default() }).unwrap();
    let plate = Surface::build(shapes::sample_box(Vec3::new(0.1, 0.1, 0.02), 2_400).unwrap(), Some(320)).unwrap();
    let plate_body = RigidBody::fixed("plate", Pose::translation(0.0, 0.0, -0.01)).unwrap();
    world.add_body(plate_body, Some((Arc::new(plate), Material::preset(material).unwrap()))).unwrap();
    let ball = Surface::build(shapes::sample_sphere(0.02, 900).unwrap(), Some(120)).unwrap();
    let mut body = RigidBody::free(
        "ball",
        MassProperties::sphere(0.02, Amount::Mass(mass)).unwrap(),
        Motion::Inertial,
        Pose::translation(0.0, 0.0, 0.0215),
    );
    body.as_mut().unwrap().set_velocity(Vec3::new(0.0, 0.0, -speed), Vec3::zeros()).unwrap();
    let ball = world.add_body(body.unwrap(), Some((Arc::new(ball), Material::preset(material).unwrap()))).unwrap();
    (world, ball)
}

#[test]
fn light_heavy_hard_soft_fast_and_slow_balls_stay_above_the_plate() {
    for mass in [1e-6, 0.03, 100.0] {
        for material in ["steel", "ecoflex"] {
            for (dt, speed) in [(1e-3, 0.0), (1e-3, 5.0), (1e-2, 3.0), (1e-5, 1.0)] {
                // The weight of 100 kg alone presses a foundation of Ecoflex by sqrt(2 m g / (pi k R)) = 40 mm, twice the radius.
                if mass > 1.0 && material == "ecoflex" {
                    continue;
                }
                let what = format!("{mass} kg of {material}, dt {dt} s, {speed} m/s");
                let (mut world, ball) = ball_on_plate(mass, material, dt, speed);
                for _ in 0..150 {
                    let report = world.step();
                    assert_finite(&what, &world, &report);
                }
                let z = world.body(ball).unwrap().pose().translation.z;
                assert!(z > 0.005, "{what}: at {z} m");
            }
        }
    }
}

#[test]
fn worlds_with_nothing_to_do() {
    let mut world = World::new(Parameters::default()).unwrap();
    let report = world.step();
    assert_finite("empty", &world, &report);
    assert!(report.converged() && report.contacts == 0);
    let mass = MassProperties::sphere(0.01, Amount::Mass(0.1)).unwrap();
    world.add_body(RigidBody::free("bare", mass, Motion::Inertial, Pose::identity()).unwrap(), None).unwrap();
    let report = (0..10).map(|_| world.step()).last().unwrap();
    assert_finite("without a skin", &world, &report);
    // Two fixed bodies in one another have nothing to solve.
    let mut world = World::new(Parameters::default()).unwrap();
    let cube = Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(0.03), 900).unwrap(), Some(120)).unwrap());
    for name in ["one", "other"] {
        world.add_body(RigidBody::fixed(name, Pose::identity()).unwrap(), Some((cube.clone(), Material::preset("wood").unwrap()))).unwrap();
    }
    assert_eq!(world.step().contacts, 0);
}

#[test]
fn the_coarsest_surfaces_that_there_are() {
    // Four points, one leaf; a tetrahedron on a plate.
    let corner = |x: Real, y: Real, z: Real| Vec3::new(x, y, z) * 0.01;
    let points = vec![corner(1.0, 1.0, 1.0), corner(-1.0, -1.0, 1.0), corner(-1.0, 1.0, -1.0), corner(1.0, -1.0, -1.0)];
    let normals = points.clone();
    let tetrahedron = PointSurface::from_points_and_normals(points, normals).unwrap();
    for leaves in [1, 2] {
        let surface = Arc::new(Surface::build(tetrahedron.clone(), Some(leaves)).unwrap());
        let mut world = World::new(Parameters::default()).unwrap();
        let plate = Surface::build(shapes::sample_half_space(0.1, 900).unwrap(), Some(100)).unwrap();
        world
            .add_body(RigidBody::fixed("plate", Pose::identity()).unwrap(), Some((Arc::new(plate), Material::preset("wood").unwrap())))
            .unwrap();
        let mass = MassProperties::sphere(0.01, Amount::Mass(0.02)).unwrap();
        let body = RigidBody::free("tetrahedron", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.011)).unwrap();
        world.add_body(body, Some((surface, Material::preset("rubber").unwrap()))).unwrap();
        for _ in 0..100 {
            let report = world.step();
            assert_finite(&format!("{leaves} leaves"), &world, &report);
        }
    }
}

#[test]
fn hands_that_are_told_nonsense_within_range() {
    let options = GraspOptions { object_points: (2_400, 320), pad_points: (450, 60), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    let mut noise = Noise(7);
    for k in 0..600 {
        // Targets anywhere, far beyond the limits too, and a base that jerks.
        for finger in 0..3 {
            let targets: Vec<Real> = (0..4).map(|_| 5.0 * noise.next()).collect();
            if k % 20 == 0 {
                scene.world.finger_mut(scene.hand, finger).unwrap().set_joint_targets(&targets).unwrap();
            }
        }
        let base = scene.world.hand(scene.hand).unwrap().base;
        let shift = Pose::from_parts((noise.vector() * 2e-3).into(), Rot::from_scaled_axis(noise.vector() * 0.02));
        scene.world.move_hand_to(scene.hand, base * shift).unwrap();
        let report = scene.world.step();
        assert_finite("hand", &scene.world, &report);
    }
}

#[test]
fn a_drive_that_pulls_an_object_through_the_fingers() {
    let mut pinch = Pinch::new(&options(false)).unwrap();
    pinch.squeeze(6.0).unwrap();
    let mut noise = Noise(11);
    for k in 0..300 {
        if k % 30 == 0 {
            let target = Pose::from_parts((noise.vector() * 0.05).into(), Rot::from_scaled_axis(noise.vector() * 3.0));
            let drive = PoseDrive::new(target, [1e5, 100.0], [50.0, 0.05]).unwrap();
            pinch.world.body_mut(pinch.object).unwrap().set_drive(Some(drive)).unwrap();
        }
        let report = pinch.world.step();
        assert_finite("driven box", &pinch.world, &report);
    }
}

//! Quarantine: a body that becomes non-finite is rolled back, quarantined and
//! reported once; the others go on. Handles outlive their bodies as errors.

use quasirigid::body::{Amount, BodyEntry, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::Material;
use quasirigid::error::Error;
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

fn all_is_finite(world: &World) -> bool {
    let of_body = |entry: &&BodyEntry| {
        let mut finite = entry.body.is_finite();
        entry.body.state().for_each_number(|x| finite &= x.is_finite());
        finite && entry.body.link_pose(entry.body.link_count() - 1).translation.vector.amax() < 1e3
    };
    let skins = world.colliders().into_iter().map(|collider| &world.collider(collider).unwrap().skin);
    let mut numbers = skins.flat_map(|skin| skin.deformed_points().into_iter().chain(skin.displacement.iter().copied()));
    world.bodies().iter().all(of_body) && numbers.all(|u| u.iter().all(|x| x.is_finite()))
}

fn ball(world: &mut World, name: &str, x: Real, y: Real, motion: Motion) -> BodyHandle {
    let surface = Arc::new(Surface::build(shapes::sample_sphere(0.02, 600).unwrap(), Some(80)).unwrap());
    let mass = MassProperties::sphere(0.02, Amount::Mass(0.05)).unwrap();
    let body = RigidBody::free(name, mass, motion, Pose::translation(x, y, 0.02)).unwrap();
    world.add_body(body, Some((surface, Material::preset("rubber").unwrap()))).unwrap()
}

fn table(world: &mut World) -> BodyHandle {
    let surface = Arc::new(Surface::build(shapes::sample_half_space(0.3, 2_500).unwrap(), Some(300)).unwrap());
    world.add_body(RigidBody::fixed("table", Pose::identity()).unwrap(), Some((surface, Material::preset("wood").unwrap()))).unwrap()
}

/// Three balls on a table, two of them touching; the last one is spoilt. It is reported
/// exactly once, stays where it was, and the rest is at rest as before.
fn spoilt(what: &str, motion: Motion, spoil: impl Fn(&mut RigidBody)) {
    let mut world = World::new(Parameters::default()).unwrap();
    table(&mut world);
    let still = ball(&mut world, "still", -0.08, 0.0, Motion::QuasiStatic);
    let neighbour = ball(&mut world, "neighbour", 0.0, 0.0, Motion::QuasiStatic);
    let bad = ball(&mut world, "bad", 0.0399, 0.0, motion);
    (0..200).for_each(|_| drop(world.step()));
    let place = |world: &World, h: BodyHandle| world.body(h).unwrap().pose().translation.vector;
    let before = [still, neighbour, bad].map(|h| place(&world, h));
    spoil(world.body_mut(bad).unwrap());
    let mut reported = Vec::new();
    for step in 0..50 {
        let report = world.step();
        reported.extend(report.quarantined.iter().map(|&h| (step, h)));
        assert!(all_is_finite(&world), "{what}: step {step}: not finite, or far out");
        assert!(report.residual.is_finite(), "{what}: step {step}: residual {}", report.residual);
    }
    assert_eq!(reported.iter().map(|r| r.1).collect::<Vec<_>>(), vec![bad], "{what}: {reported:?}");
    assert!(world.entry(bad).unwrap().quarantined, "{what}");
    // It may have moved, finitely, before it went.
    assert!((place(&world, bad) - before[2]).norm() < 1.0, "{what}: left at {:?}", place(&world, bad));
    let moved = (place(&world, still) - before[0]).norm();
    println!(
        "{what}: {reported:?}, the still ball moved {moved:.1e} m, its neighbour {:.1e} m",
        (place(&world, neighbour) - before[1]).norm()
    );
    assert!(moved < 1e-5, "{what}: the other ball moved by {moved:e} m");
    assert!(world.body_mut(bad).is_ok() && world.remove_body(bad).is_ok(), "{what}: it can be looked at and taken out");
    (0..20).for_each(|_| drop(world.step()));
    assert!(all_is_finite(&world), "{what}: after taking it out");
}

#[test]
fn a_body_under_an_absurd_force_is_quarantined_and_the_others_go_on() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        for force in [1e10, 1e12, 1e100, 1e200, 1e308] {
            spoilt(&format!("{motion:?} under {force:e} N"), motion, |body| {
                body.set_external_wrench(Vec3::new(force, 0.0, 0.0), Vec3::zeros()).unwrap();
            });
        }
        spoilt(&format!("{motion:?} twisted"), motion, |body| body.set_external_wrench(Vec3::zeros(), Vec3::repeat(1e305)).unwrap());
    }
}

#[test]
fn a_body_with_an_absurd_drive_or_velocity_is_quarantined() {
    for [k, c] in [[1e308, 0.0], [1e308, 1e308]] {
        spoilt(&format!("drive of {k:e}, {c:e}"), Motion::Inertial, |body| {
            let far = Pose::translation(1e10, 0.0, 0.0);
            body.set_drive(Some(PoseDrive::new(far, [k, k], [c, c]).unwrap())).unwrap();
        });
    }
    spoilt("velocity of 1e300", Motion::Inertial, |body| body.set_velocity(Vec3::new(0.0, 1e300, 0.0), Vec3::zeros()).unwrap());
    spoilt("spin of 1e300", Motion::Inertial, |body| body.set_velocity(Vec3::zeros(), Vec3::new(0.0, 1e300, 0.0)).unwrap());
}

#[test]
fn an_object_gone_bad_in_the_hand_leaves_a_hand_that_works() {
    let options = GraspOptions { object_points: (3_000, 400), pad_points: (600, 80), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    scene.world.body_mut(scene.object).unwrap().set_external_wrench(Vec3::new(0.0, 0.0, 1e307), Vec3::zeros()).unwrap();
    let mut reported = 0;
    scene.grip.open();
    for _ in 0..400 {
        let report = scene.step().unwrap();
        reported += report.quarantined.len();
        assert!(report.quarantined.iter().all(|h| *h == scene.object), "{:?}", report.quarantined);
        assert!(all_is_finite(&scene.world));
    }
    assert_eq!(reported, 1, "reported once");
    assert_eq!(scene.grip.state(), quasirigid::control::grip::GripState::Open);
}

#[test]
fn bodies_and_hands_can_be_taken_out_while_in_contact() {
    let options = GraspOptions { object_points: (3_000, 400), pad_points: (600, 80), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    let fingers: Vec<BodyHandle> = (0..3).map(|k| scene.world.finger_handle(scene.hand, k).unwrap()).collect();
    assert!(matches!(scene.world.remove_body(fingers[0]), Err(Error::InvalidHandle { .. })), "a finger goes with its hand");
    let support = scene.support.unwrap();
    scene.remove_support().unwrap();
    let of_support = |body: u32| body == support.slot();
    let left = scene.world.contacts();
    assert!(
        left.len() > 20 && !left.iter().any(|c| of_support(c.body_a) || of_support(c.body_b)),
        "contacts of the support alone are gone"
    );
    scene.run(0.2).unwrap();
    assert!(scene.world.contacts().len() > 20);
    let object = scene.object;
    scene.world.remove_body(object).unwrap();
    (0..100).for_each(|_| drop(scene.world.step()));
    assert!(all_is_finite(&scene.world) && scene.world.contacts().is_empty());
    // Another body takes the place of the one that went: the old handle must not reach it.
    let mass = MassProperties::cuboid(Vec3::repeat(0.06), Amount::Mass(0.2)).unwrap();
    let surface = Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(0.06), 2_400).unwrap(), Some(320)).unwrap());
    let body = RigidBody::free("another", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.03)).unwrap();
    let another = scene.world.add_body(body, Some((surface, Material::preset("wood").unwrap()))).unwrap();
    assert_ne!(object, another);
    (0..50).for_each(|_| drop(scene.world.step()));
    scene.world.remove_hand(scene.hand).unwrap();
    (0..50).for_each(|_| drop(scene.world.step()));
    assert!(all_is_finite(&scene.world));
    assert_eq!(scene.world.bodies().len(), 1);
    assert_eq!(scene.world.body(another).unwrap().name(), "another");

    let stale = |what: &str, result: quasirigid::Result<()>| match result {
        Err(Error::InvalidHandle { expected, got, hint, .. }) => {
            assert!(!expected.is_empty() && !got.is_empty() && !hint.is_empty(), "{what}: {expected} | {got} | {hint}");
        }
        other => panic!("{what}: {other:?}"),
    };
    let (hand, world) = (scene.hand, &mut scene.world);
    for gone in [object, support, fingers[1]] {
        stale("body", world.body(gone).map(drop));
        stale("body_mut", world.body_mut(gone).map(drop));
        stale("entry", world.entry(gone).map(drop));
        stale("dense", world.dense(gone).map(drop));
        stale("contact_force_on", world.contact_force_on(gone).map(drop));
        stale("remove_body", world.remove_body(gone));
    }
    stale("hand", world.hand(hand).map(drop));
    stale("finger", world.finger(hand, 0).map(drop));
    stale("finger_mut", world.finger_mut(hand, 0).map(drop));
    stale("finger_handle", world.finger_handle(hand, 0).map(drop));
    stale("move_hand_to", world.move_hand_to(hand, Pose::identity()));
    stale("remove_hand", world.remove_hand(hand));
    stale("grip", scene.grip.update(world));
    stale("a handle of another world", World::new(Parameters::default()).unwrap().body(another).map(drop));
}

#[test]
fn a_pad_taken_away_drops_what_it_held() {
    let mut options = PinchOptions::fingertips(0.8).unwrap();
    (options.box_points, options.pad_points) = ((3_000, 400), (600, 80));
    let mut pinch = Pinch::new(&options).unwrap();
    pinch.squeeze(4.0).unwrap();
    pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
    pinch.run(0.2);
    pinch.world.remove_body(pinch.pads[0]).unwrap();
    pinch.run(0.3);
    let height = pinch.world.body(pinch.object).unwrap().pose().translation.z;
    assert!(height < -0.1 && height.is_finite(), "the box is at {height} m");
    assert!(matches!(pinch.normal_forces(), Err(Error::InvalidHandle { .. })));
}

#[test]
fn a_hand_whose_fingers_were_quarantined_has_not_moved() {
    let mut scene =
        GraspScene::new(&GraspOptions { object_points: (1_500, 200), pad_points: (450, 60), ..GraspOptions::default() }).unwrap();
    scene.world.step();
    let base = scene.world.hand(scene.hand).unwrap().base;
    // A bad packet of a tracker.
    scene.world.move_hand_to(scene.hand, Pose::translation(150.0, 0.0, 0.0)).unwrap();
    assert_eq!(scene.world.step().quarantined.len(), 3);
    let hand = scene.world.hand(scene.hand).unwrap();
    assert_eq!(hand.base, base);
    (0..3).for_each(|k| assert_eq!(*scene.world.finger(scene.hand, k).unwrap().base_pose(), base));
}

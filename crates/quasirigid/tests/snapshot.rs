//! A world that is taken back to an earlier state, or copied, goes on bit by bit as it did; and copies never influence each other.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Friction, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{Parameters, Snapshot, World};
use std::sync::Arc;
use std::time::Instant;

/// What a step leaves: the hash of the state, and the forces.
fn seen(world: &World) -> (u64, Vec<[u64; 3]>) {
    let bits = |f: &Vec3| [f.x.to_bits(), f.y.to_bits(), f.z.to_bits()];
    (world.state_hash(), world.contact_problem().reactions.iter().map(bits).collect())
}

/// Runs `world` through `act` and a step, `steps` times from step `from` on.
fn run(world: &mut World, from: usize, steps: usize, act: &dyn Fn(&mut World, usize)) -> Vec<(u64, Vec<[u64; 3]>)> {
    let step = |step| {
        act(world, step);
        world.step();
        seen(world)
    };
    (from..from + steps).map(step).collect()
}

/// Takes a snapshot at each of `times` on the way; from each, the same world and a copy must go on for 120 steps as the first run did.
fn goes_on_as_it_did(what: &str, mut world: World, times: &[usize], act: impl Fn(&mut World, usize)) {
    const MORE: usize = 120;
    let mut snapshots = Vec::new();
    let mut first = Vec::new();
    for step in 0..times[times.len() - 1] + MORE {
        if times.contains(&step) {
            snapshots.push((step, world.snapshot()));
        }
        first.extend(run(&mut world, step, 1, &act));
    }
    assert!(first.iter().any(|(_, forces)| !forces.is_empty()), "{what}: nothing touches");
    for (step, snapshot) in snapshots.iter().rev() {
        world.restore(snapshot);
        let copy = World::from_snapshot(snapshot).unwrap();
        let read = Snapshot::from_bytes(&snapshot.to_bytes().unwrap()).unwrap();
        assert!(read == *snapshot, "{what}: of bytes at step {step}");
        let read = World::from_snapshot(&read).unwrap();
        let times = [&world, &copy, &read].map(|world| (seen(world), world.time().to_bits()));
        assert!(times[0] == times[1] && times[0] == times[2], "{what}: restored, copied and read at step {step}: {times:x?}");
        for (how, mut other) in [("copied", copy), ("read from bytes", read)] {
            for (k, found) in run(&mut other, *step, MORE, &act).into_iter().enumerate() {
                let expected = &first[step + k];
                assert!(found == *expected, "{what}: {how} at step {step}, {k} steps later: {:x}, not {:x}", found.0, expected.0);
            }
        }
        for (k, restored) in run(&mut world, *step, MORE, &act).into_iter().enumerate() {
            let expected = &first[step + k];
            assert!(restored == *expected, "{what}: restored at step {step}, {k} steps later: {:x}, not {:x}", restored.0, expected.0);
        }
    }
}

/// Pads that press, sway and let go again.
fn pinch(options: &PinchOptions) -> (World, impl Fn(&mut World, usize) + use<>) {
    let pinch = Pinch::new(options).unwrap();
    let pads = pinch.pads.map(|pad| pinch.world.entry(pad).unwrap().body.name().to_owned());
    let act = move |world: &mut World, step: usize| {
        if step == 150 {
            world.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
        }
        let t = step as Real * 1e-3;
        for handle in world.rigid_bodies() {
            let body = world.body_mut(handle).unwrap();
            let side = if body.name() == pads[0] { 1.0 } else { -1.0 };
            if pads.iter().any(|pad| pad == body.name()) {
                let inward = if step < 120 { side * 8e-6 } else { 0.0 };
                let sway = if step > 150 { 3e-5 * (30.0 * t).sin() } else { 0.0 };
                let turn = Rot::from_axis_angle(&Vec3::y_axis(), if step > 200 { 1e-3 } else { 0.0 });
                let moved =
                    Pose::from_parts((body.pose().translation.vector + Vec3::new(inward, sway, 0.0)).into(), turn * body.pose().rotation);
                body.move_to(moved).unwrap();
            }
        }
    };
    (pinch.world, act)
}

fn small() -> PinchOptions {
    PinchOptions { box_points: (4_800, 640), pad_points: (900, 120), ..PinchOptions::fingertips(0.6).unwrap() }
}

#[test]
fn a_pinch_of_local_pads_goes_on_as_it_did() {
    let (world, act) = pinch(&small());
    goes_on_as_it_did("local", world, &[0, 60, 140, 260], act);
}

#[test]
fn amid_steps_that_reuse_the_search_it_goes_on_as_it_did() {
    let options = PinchOptions { params: Parameters { collision_every: 4, ..Parameters::default() }, ..small() };
    let (world, act) = pinch(&options);
    goes_on_as_it_did("collision_every 4", world, &[61, 142, 263], act);
}

#[test]
fn half_spaces_whose_feet_are_displaced_go_on_as_they_did() {
    let mut options = small();
    options.pad_material = options.pad_material.with_model(ComplianceModel::HalfSpace).unwrap();
    options.box_material = Material::preset("rubber").unwrap().with_model(ComplianceModel::HalfSpace).unwrap();
    let (world, act) = pinch(&options);
    goes_on_as_it_did("half-space", world, &[70, 230], act);
}

#[test]
fn friction_that_falls_with_speed_and_has_a_direction_goes_on_as_it_did() {
    let mut options = small();
    let friction = Friction::coulomb(0.2).unwrap().with_kinetic(0.1, 2e-3).unwrap().with_anisotropy(Vec3::new(0.0, 1.0, 1.0), 1.7).unwrap();
    options.box_material = options.box_material.with_friction(friction).unwrap();
    let (world, act) = pinch(&options);
    goes_on_as_it_did("Stribeck and anisotropic", world, &[100, 200], act);
}

#[test]
fn bodies_that_were_removed_added_and_driven_are_as_they_were() {
    let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
    let mut world = World::new(Parameters::default()).unwrap();
    let rubber = Material::preset("rubber").unwrap();
    let plane = surface(shapes::sample_half_space(0.2, 900).unwrap(), 120);
    world.add_body(RigidBody::fixed("table", Pose::identity()).unwrap(), Some((plane, rubber.clone()))).unwrap();
    let size = Vec3::repeat(0.03);
    let cube = surface(shapes::sample_box(size, 1_200).unwrap(), 160);
    for k in 0..3 {
        let mass = MassProperties::cuboid(size, Amount::Mass(0.1)).unwrap();
        let pose = Pose::translation(0.002 * k as Real, 0.0, 0.0155 + 0.031 * k as Real);
        let body = RigidBody::free(format!("cube {k}"), mass, Motion::Inertial, pose).unwrap();
        world.add_body(body, Some((cube.clone(), rubber.clone()))).unwrap();
    }
    goes_on_as_it_did("removed and driven", world, &[40, 99, 101, 180], |world, step| {
        let named = |world: &World, name: &str| world.rigid_bodies().into_iter().find(|&body| world.body(body).unwrap().name() == name);
        if step == 100 {
            let lowest = named(world, "cube 0").unwrap();
            world.remove_body(lowest).unwrap();
        }
        if step == 150 {
            let drive = PoseDrive::new(Pose::translation(0.01, 0.0, 0.05), [200.0, 0.2], [5.0, 0.005]).unwrap();
            let highest = named(world, "cube 2").unwrap();
            world.body_mut(highest).unwrap().set_drive(Some(drive)).unwrap();
        }
    });
}

#[test]
fn a_held_box_branches_and_the_branches_do_not_meet() {
    let options = GraspOptions { object_points: (4_800, 640), pad_points: (900, 120), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    scene.remove_support().unwrap();
    scene.run(0.1).unwrap();
    let held = scene.world.snapshot();
    let mut dropped = World::from_snapshot(&held).unwrap();
    let (hand, object) = (dropped.own_hand(scene.hand).unwrap(), dropped.own_body(scene.object).unwrap());
    assert!(dropped.body(scene.object).is_err(), "a handle of the original names a body of the copy");
    dropped.remove_hand(hand).unwrap();
    let before = scene.world.state_hash();
    for _ in 0..100 {
        dropped.step();
    }
    assert!(dropped.body(object).unwrap().pose().translation.z < scene.world.body(scene.object).unwrap().pose().translation.z - 0.04);
    assert_eq!(scene.world.state_hash(), before, "the copy moved its original");
    let mut twin = World::from_snapshot(&held).unwrap();
    for step in 0..100 {
        scene.world.step();
        twin.step();
        assert_eq!(seen(&scene.world), seen(&twin), "step {step}");
    }
}

#[test]
fn handles_name_what_they_named_and_those_of_another_future_name_nothing() {
    let mut world = World::new(Parameters::default()).unwrap();
    let add = |world: &mut World, name: &str| world.add_body(RigidBody::fixed(name, Pose::identity()).unwrap(), None).unwrap();
    let (first, second) = (add(&mut world, "first"), add(&mut world, "second"));
    let snapshot = world.snapshot();
    world.remove_body(first).unwrap();
    let later = add(&mut world, "later");
    world.restore(&snapshot);
    assert_eq!((world.body(first).unwrap().name(), world.body(second).unwrap().name()), ("first", "second"));
    assert!(world.body(later).is_err(), "a body of another future is there");
    world.remove_body(first).unwrap();
    let other = add(&mut world, "other");
    assert_eq!(world.body(other).unwrap().name(), "other");
    assert!(world.body(later).is_err() && world.body(first).is_err(), "a handle of another future names another body");
}

#[test]
fn a_held_grasp_branches_a_thousand_times() {
    let options = GraspOptions { object_points: (9_000, 1_200), pad_points: (900, 120), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    scene.remove_support().unwrap();
    scene.run(0.05).unwrap();
    let time = |times: u32, work: &mut dyn FnMut()| {
        let start = Instant::now();
        (0..times).for_each(|_| work());
        start.elapsed() / times
    };
    let held = scene.world.snapshot();
    let mut world = World::from_snapshot(&held).unwrap();
    let take = time(100, &mut || drop(world.snapshot()));
    let restore = time(100, &mut || world.restore(&held));
    let hash = time(20, &mut || assert!(world.state_hash() > 0));
    let branch = time(1000, &mut || {
        let mut branch = World::from_snapshot(&held).unwrap();
        branch.step();
    });
    let bytes = held.to_bytes().unwrap();
    let read = time(1, &mut || drop(Snapshot::from_bytes(&bytes).unwrap()));
    let size = (held.memory(), bytes.len());
    println!(
        "{} contacts: take {take:?}, restore {restore:?}, branch and step {branch:?}, hash {hash:?}, read {read:?}; {size:?} bytes",
        world.contacts().len()
    );
    // Surfaces are shared: building them again, as reading does, takes far longer.
    assert!(5 * branch < read, "a branch takes {branch:?}, reading {read:?}");
    assert!(held.memory() < bytes.len(), "{size:?} bytes");
}

#[test]
fn what_decides_the_future_is_in_the_hash() {
    let mut world = World::new(Parameters::default()).unwrap();
    let mass = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.1)).unwrap();
    let body = RigidBody::free("cube", mass, Motion::Inertial, Pose::identity()).unwrap();
    let body = world.add_body(body, None).unwrap();
    let before = world.snapshot();
    let mut hashes = vec![("nothing", world.state_hash())];
    type Change = fn(&mut World, quasirigid::BodyHandle);
    let changes: [(&str, Change); 6] = [
        ("load", |world, body| world.body_mut(body).unwrap().set_external_wrench(Vec3::x(), Vec3::zeros()).unwrap()),
        ("drive", |world, body| {
            let drive = PoseDrive::new(Pose::identity(), [1.0, 1.0], [0.0, 0.0]).unwrap();
            world.body_mut(body).unwrap().set_drive(Some(drive)).unwrap();
        }),
        ("viscosity", |world, body| world.body_mut(body).unwrap().set_viscosity(1.0, 0.0).unwrap()),
        ("gravity", |world, _| world.set_gravity(Vec3::zeros()).unwrap()),
        ("velocity", |world, body| world.body_mut(body).unwrap().set_velocity(Vec3::x(), Vec3::zeros()).unwrap()),
        ("mass", |world, body| world.set_mass(body, MassProperties::sphere(0.01, Amount::Mass(0.2)).unwrap()).unwrap()),
    ];
    for (what, change) in changes {
        world.restore(&before);
        change(&mut world, body);
        hashes.push((what, world.state_hash()));
    }
    world.restore(&before);
    for (k, (what, hash)) in hashes.iter().enumerate() {
        assert!(hashes[..k].iter().all(|(_, other)| other != hash), "{what} is not in the hash");
    }
    assert_eq!(world.state_hash(), hashes[0].1);
    world.set_parameters(Parameters { threads: 2, ..world.parameters().clone() }).unwrap();
    assert_eq!(world.state_hash(), hashes[0].1, "the number of threads is in the hash");
}

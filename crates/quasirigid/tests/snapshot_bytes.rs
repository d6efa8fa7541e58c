//! Bytes of snapshots may come from anywhere: spoilt ones are refused, or make a world that can be stepped.

use ciborium::Value;
use proptest::prelude::*;
use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Friction, Material};
use quasirigid::math::{Pose, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{Error, Parameters, Snapshot, World};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// No case may take longer: a world that was spoilt into a heavy one is slow, not endless.
const LATE: Duration = Duration::from_secs(60);

/// Bytes of a hand that holds a box, and of a heap.
static SEEDS: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
    let options = GraspOptions { object_points: (600, 80), pad_points: (240, 30), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    scene.close(3.0).unwrap();
    scene.remove_support().unwrap();
    scene.run(0.01).unwrap();
    let base = scene.world.hand(scene.hand).unwrap().base;
    scene.world.move_hand_to(scene.hand, base).unwrap();
    assert!(scene.world.contacts().len() > 5, "{} contacts", scene.world.contacts().len());
    [scene.world, heap()].map(|world| world.snapshot().to_bytes().unwrap())
});

fn heap() -> World {
    let mut world = World::new(Parameters::default()).unwrap();
    let surface = |points| Arc::new(Surface::build(points, Some(30)).unwrap());
    let directed = Friction::coulomb(0.5).unwrap().with_kinetic(0.3, 1e-3).unwrap().with_anisotropy(Vec3::x(), 0.5).unwrap();
    let rubber = Material::preset("rubber").unwrap();
    let half_space = rubber.clone().with_model(ComplianceModel::HalfSpace).unwrap().with_friction(directed).unwrap();
    let floor = surface(shapes::sample_half_space(0.1, 240).unwrap());
    world.add_body(RigidBody::fixed("floor", Pose::identity()).unwrap(), Some((floor, half_space.clone()))).unwrap();
    let cube = surface(shapes::sample_box(Vec3::repeat(0.02), 240).unwrap());
    let mut bodies = Vec::new();
    for (k, material) in [&rubber, &half_space, &rubber, &rubber].into_iter().enumerate() {
        let mass = MassProperties::cuboid(Vec3::repeat(0.02), Amount::Mass(0.05)).unwrap();
        // The last two are in each other.
        let pose = Pose::translation(0.018 * k.min(2) as f64, 0.0, 0.0101 + 0.001 * k as f64);
        let body = RigidBody::free(format!("cube {k}"), mass, Motion::Inertial, pose).unwrap();
        bodies.push(world.add_body(body, Some((cube.clone(), material.clone()))).unwrap());
    }
    world.set_friction(bodies[0], bodies[1], Some(Friction::coulomb(0.2).unwrap())).unwrap();
    let drive = PoseDrive::new(Pose::translation(0.0, 0.0, 0.01), [50.0, 0.05], [1.0, 0.001]).unwrap();
    world.body_mut(bodies[0]).unwrap().set_drive(Some(drive)).unwrap();
    for _ in 0..15 {
        world.step();
    }
    assert!(world.contacts().len() > 20, "{} contacts", world.contacts().len());
    world
}

/// What can be changed in a tree of values.
fn leaves(value: &mut Value) -> usize {
    match value {
        Value::Array(items) => 1 + items.iter_mut().map(leaves).sum::<usize>(),
        Value::Map(fields) => 1 + fields.iter_mut().map(|(_, value)| leaves(value)).sum::<usize>(),
        _ => 1,
    }
}

/// Changes the value at a place of the tree, counted as [`leaves`] does.
fn change(value: &mut Value, place: &mut usize, how: u8, with: u64) -> bool {
    if *place == 0 {
        spoil(value, how, with);
        return true;
    }
    *place -= 1;
    match value {
        Value::Array(items) => items.iter_mut().any(|item| change(item, place, how, with)),
        Value::Map(fields) => fields.iter_mut().any(|(_, item)| change(item, place, how, with)),
        _ => false,
    }
}

fn spoil(value: &mut Value, how: u8, with: u64) {
    const WHOLE: [u64; 12] = [0, 1, 2, 3, 29, 30, 31, 79, 80, 1 << 20, u32::MAX as u64, u64::MAX];
    const REAL: [f64; 12] = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, 1e9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.5];
    match value {
        Value::Float(x) => {
            *x = if how.is_multiple_of(2) { REAL[with as usize % REAL.len()] } else { *x * f64::from_bits(with % (1 << 62)) }
        }
        Value::Integer(n) => *n = if how.is_multiple_of(3) { (with % 100).into() } else { WHOLE[with as usize % WHOLE.len()].into() },
        Value::Bool(b) => *b = !*b,
        Value::Array(items) if !items.is_empty() => {
            let at = with as usize % items.len();
            match how % 5 {
                0 => drop(items.remove(at)),
                1 => items.push(items[at].clone()),
                2 => items.truncate(at),
                3 => items.swap(0, at),
                _ => items.extend(items.clone()),
            }
        }
        Value::Map(fields) if !fields.is_empty() => drop(fields.remove(with as usize % fields.len())),
        Value::Null => *value = Value::Integer(0.into()),
        other => *other = Value::Null,
    }
}

/// Refused with a typed error, or a world that can be stepped, copied and written.
fn read(bytes: &[u8]) -> Result<(), Error> {
    let start = Instant::now();
    let snapshot = Snapshot::from_bytes(bytes)?;
    let mut world = World::from_snapshot(&snapshot)?;
    for _ in 0..6 {
        world.step();
    }
    world.state_hash();
    let again = world.snapshot().to_bytes().expect("what was read can be written");
    drop(Snapshot::from_bytes(&again));
    for body in world.rigid_bodies() {
        world.remove_body(body)?;
        world.step();
    }
    assert!(start.elapsed() < LATE, "took {:?}", start.elapsed());
    Ok(())
}

fn is_refused_or_steps(bytes: &[u8]) -> Result<(), TestCaseError> {
    match read(bytes) {
        Ok(()) | Err(Error::InvalidSnapshot { .. }) => Ok(()),
        Err(other) => Err(TestCaseError::fail(format!("{other:?}"))),
    }
}

#[test]
fn what_is_spoilt_can_be_read_before() {
    for seed in SEEDS.iter() {
        read(seed).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_spoilt_value_is_refused_or_makes_a_world_that_can_be_stepped(
        seed in 0usize..2, changes in prop::collection::vec((any::<u32>(), any::<u8>(), any::<u64>()), 1..3),
    ) {
        let bytes = &SEEDS[seed];
        let mut rest = &bytes[20..];
        let header: Value = ciborium::from_reader(&mut rest).unwrap();
        let mut record: Value = ciborium::from_reader(&mut rest).unwrap();
        // Points of surfaces are checked like those of users, and are most of the bytes: they are spoilt seldom.
        let Value::Map(fields) = &mut record else { unreachable!() };
        for (place, how, with) in changes {
            let field = if place % 20 == 0 { (place / 20 % 2) as usize } else { 2 };
            let (_, part) = &mut fields[field];
            let count = leaves(part);
            prop_assert!(change(part, &mut (place as usize % count), how, with));
        }
        let mut spoilt = bytes[..20].to_vec();
        ciborium::into_writer(&header, &mut spoilt).unwrap();
        ciborium::into_writer(&record, &mut spoilt).unwrap();
        is_refused_or_steps(&spoilt)?;
    }

    #[test]
    fn spoilt_bytes_are_refused_or_make_a_world_that_can_be_stepped(
        seed in 0usize..2, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
    ) {
        let mut spoilt = SEEDS[seed].clone();
        for (place, byte) in changes {
            let place = place.index(spoilt.len());
            spoilt[place] = byte;
        }
        if let Some(end) = cut {
            spoilt.truncate(end.index(spoilt.len()));
        }
        is_refused_or_steps(&spoilt)?;
    }
}

use super::hash::hash;
use super::walk::{Visit, walk};
use super::{Snapshot, bytes};
use crate::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use crate::collider::{ComplianceModel, Filter, Friction, Material};
use crate::collision::PairCache;
use crate::math::{Pose, Real, Vec3};
use crate::scenes::{GraspOptions, GraspScene};
use crate::surface::{ComplianceMatrix, Surface, shapes};
use crate::world::{BodyHandle, World};
use crate::{Error, Parameters};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

fn held() -> GraspScene {
    let options = GraspOptions { object_points: (1_500, 200), pad_points: (450, 60), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap(), "the hand did not close");
    scene.remove_support().unwrap();
    scene.run(0.05).unwrap();
    scene
}

type Drop = (&'static str, fn(&mut World));

fn each_skin(world: &mut World, which: usize) {
    world.objects.colliders.iter_mut().for_each(|(_, collider)| collider.skin.drop_scratch(which));
}

const SCRATCH: [Drop; 19] = [
    ("free motions", |world| world.workspace.free = Vec::new()),
    ("solver", |world| world.workspace.solver = Default::default()),
    ("constrained motion", |world| world.workspace.motion = Default::default()),
    ("reach of the bodies", |world| world.workspace.collision.drop_scratch(0)),
    ("bodies that are near", |world| world.workspace.collision.drop_scratch(1)),
    ("traversal", |world| world.workspace.collision.drop_scratch(2)),
    ("projection", |world| world.workspace.collision.drop_scratch(3)),
    ("penetrated pairs", |world| world.workspace.collision.drop_scratch(4)),
    ("rigid rows", |world| world.workspace.problem.drop_scratch(0)),
    ("rows being filled", |world| world.workspace.problem.drop_scratch(1)),
    ("rows that the operator holds", |world| world.workspace.problem.drop_scratch(2)),
    ("operator", |world| world.workspace.problem.drop_scratch(3)),
    ("free displacements", |world| world.workspace.problem.drop_scratch(4)),
    ("unknowns and reactions", |world| world.workspace.problem.drop_scratch(5)),
    ("status", |world| world.workspace.problem.drop_scratch(6)),
    ("leaves to refit", |world| each_skin(world, 0)),
    ("points of a leaf", |world| each_skin(world, 1)),
    ("nodes to refit", |world| each_skin(world, 2)),
    ("marks", |world| each_skin(world, 3)),
];

#[test]
fn each_scratch_dropped_in_the_middle_of_a_grasp_changes_no_bit() {
    let scene = held();
    let start = scene.world.snapshot();
    let push = |world: &mut World, object: BodyHandle, step: u32| {
        // The object is shaken, so that contacts come and go.
        let force = Vec3::new(0.0, 0.3 * (0.4 * Real::from(step)).sin(), 0.0);
        world.body_mut(object).unwrap().set_external_wrench(force, Vec3::zeros()).unwrap();
        world.step();
    };
    let run = |drop: fn(&mut World)| {
        let mut world = World::from_snapshot(&start).unwrap();
        let object = world.own_body(scene.object).unwrap();
        (0..24)
            .map(|step| {
                if step % 8 == 3 {
                    drop(&mut world);
                }
                push(&mut world, object, step);
                world.state_hash()
            })
            .collect::<Vec<_>>()
    };
    let expected = run(|_| {});
    assert!(scene.world.contacts().len() > 20);
    // What is no scratch makes a difference: the comparison can fail.
    assert_ne!(run(|world| world.workspace.collision.caches.iter_mut().for_each(PairCache::invalidate)), expected);
    for (name, drop) in SCRATCH {
        let found = run(drop);
        let differs = found.iter().zip(&expected).position(|(a, b)| a != b);
        assert!(differs.is_none(), "{name}: other bits from step {differs:?}");
    }
}

/// A world with something of everything that can be stored.
fn sample() -> World {
    let mut scene = held();
    let world = &mut scene.world;
    let rubber = Material::preset("rubber").unwrap();
    let surface = |size: Real| Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(size), 240).unwrap(), Some(30)).unwrap());
    let (plate, cube) = (Arc::new(Surface::build(shapes::sample_half_space(0.1, 240).unwrap(), Some(30)).unwrap()), surface(0.02));
    let at = |x: Real, z: Real| Pose::translation(x, 0.5, z);
    let directed = Friction::coulomb(0.5).unwrap().with_kinetic(0.3, 1e-3).and_then(|f| f.with_viscous(10.0)).unwrap();
    let directed = directed.with_anisotropy(Vec3::x(), 0.5).unwrap();
    let plate_material = rubber.clone().with_model(ComplianceModel::HalfSpace).and_then(|m| m.with_friction(directed)).unwrap();
    let mut named = plate_material.clone();
    named.name = "mat".into();
    world.add_body(RigidBody::fixed("plate", at(0.0, 0.0)).unwrap(), Some((plate, named))).unwrap();
    let matrix = nalgebra::DMatrix::from_fn(90, 90, |i, j| if i == j { 1e-5 } else { 0.0 });
    let matrix = ComplianceModel::Matrix(Arc::new(ComplianceMatrix::new(&matrix).unwrap()));
    let mut add = |name: &str, motion, x, material: &Material| {
        let mass = MassProperties::cuboid(Vec3::repeat(0.02), Amount::Mass(0.05)).unwrap();
        let body = RigidBody::free(name, mass, motion, at(x, 0.0101)).unwrap();
        world.add_body(body, Some((cube.clone(), material.clone()))).unwrap()
    };
    let one = add("matrix", Motion::Inertial, 0.0, &rubber.clone().with_model(matrix).unwrap());
    let two = add("quasi-static", Motion::QuasiStatic, 0.03, &rubber);
    let gone = add("gone", Motion::Inertial, -0.03, &rubber);
    let bad = add("bad", Motion::Inertial, 0.3, &rubber);
    let deep = add("deep", Motion::Inertial, 0.001, &rubber);
    world.remove_body(gone).unwrap();
    let filter = Filter { group: 2, mask: 0xffff };
    let second = world.add_collider(two, 0, cube.clone(), rubber.clone(), filter).unwrap();
    let spare = world.add_collider(two, 0, cube.clone(), rubber.clone(), filter).unwrap();
    let of_one = world.colliders_of(one).unwrap()[0];
    world.exclude_pair(second, of_one).unwrap();
    world.remove_collider(spare).unwrap();
    world.set_friction(one, "mat", Some(Friction::coulomb(0.4).unwrap())).unwrap();
    world.body_mut(two).unwrap().set_drive(Some(PoseDrive::new(at(0.03, 0.009), [100.0, 0.1], [1.0, 0.001]).unwrap())).unwrap();
    world.body_mut(bad).unwrap().set_velocity(Vec3::new(1e9, 0.0, 0.0), Vec3::zeros()).unwrap();
    let _ = deep;
    for _ in 0..12 {
        world.step();
    }
    let hand = scene.hand;
    let base = world.hand(hand).unwrap().base;
    world.move_hand_to(hand, base).unwrap();
    let plate = world.rigid_bodies().into_iter().find(|&body| world.body(body).unwrap().name() == "plate").unwrap();
    world.body_mut(plate).unwrap().move_to(at(0.0, 0.0)).unwrap();
    let solver = crate::gauss_seidel::SolverParameters { time_budget: Some(Duration::from_secs(1)), ..Default::default() };
    let params = Parameters { step_budget: Some(Duration::from_secs(1)), solver, ..world.parameters().clone() };
    world.set_parameters(params).unwrap();
    scene.world
}

/// Which fields there are, and what kind of numbers they hold.
#[derive(Default)]
struct Shape {
    fields: Vec<&'static str>,
    found: BTreeSet<String>,
}

impl Shape {
    fn note(&mut self, kind: &str) {
        self.found.insert(format!("{}: {kind}", self.fields.join(".")));
    }
}

impl Visit for Shape {
    fn real(&mut self, _x: Real) {
        self.note("real");
    }

    fn whole(&mut self, _n: u64) {
        self.note("whole");
    }

    fn text(&mut self, _text: &str) {
        self.note("text");
    }

    fn enter(&mut self, name: &'static str) {
        self.fields.push(name);
    }

    fn leave(&mut self) {
        self.fields.pop();
    }

    fn shape(&mut self, kind: &'static str, length: usize) {
        self.note(&format!("{kind} {length}"));
    }
}

#[test]
fn another_layout_has_another_number() {
    let snapshot = sample().snapshot();
    let mut shape = Shape::default();
    walk(&snapshot.record(), &mut shape);
    let fields: Vec<&String> = shape.found.iter().collect();
    let number = hash(&fields);
    if number != bytes::LAYOUT {
        fields.iter().for_each(|field| println!("{field}"));
    }
    assert_eq!(number, bytes::LAYOUT, "the layout of snapshots has changed: LAYOUT in world/snapshot/bytes.rs is to be {number:#018x} now");
}

#[test]
fn a_world_with_something_of_everything_comes_back_from_bytes_and_goes_on() {
    let mut world = sample();
    // A limit of time would make two runs differ.
    let params = world.parameters().clone();
    let solver = crate::gauss_seidel::SolverParameters { time_budget: None, ..params.solver.clone() };
    world.set_parameters(Parameters { step_budget: None, solver, ..params }).unwrap();
    let snapshot = world.snapshot();
    assert!(snapshot.objects.bodies.in_order().any(|entry| entry.quarantined), "nobody is quarantined");
    let bytes = snapshot.to_bytes().unwrap();
    let read = Snapshot::from_bytes(&bytes).unwrap();
    assert!(read == snapshot && read.content_hash() == snapshot.content_hash());
    assert!(read.to_bytes().unwrap() == bytes, "written again it is other bytes");
    let mut copy = World::from_snapshot(&read).unwrap();
    assert_eq!(copy.state_hash(), world.state_hash());
    let cubes = copy.objects.colliders.in_order().map(|collider| &collider.skin.surface).filter(|surface| surface.len() == 240);
    let cubes: Vec<_> = cubes.skip(1).collect();
    assert!(cubes.len() == 5 && cubes.iter().all(|cube| Arc::ptr_eq(cube, cubes[0])), "bodies of one surface do not share it");
    for step in 0..60 {
        world.step();
        copy.step();
        assert_eq!(copy.state_hash(), world.state_hash(), "step {step}");
    }
}

#[test]
fn snapshots_of_other_versions_and_other_files_are_refused_by_name() {
    let bytes = World::new(Parameters::default()).unwrap().snapshot().to_bytes().unwrap();
    let version = env!("CARGO_PKG_VERSION").as_bytes();
    let place = bytes.windows(version.len()).position(|window| window == version).unwrap();
    let mut other = bytes.clone();
    other[place] = b'9';
    let refused = |bytes: &[u8]| match Snapshot::from_bytes(bytes) {
        Err(Error::InvalidSnapshot { expected, got, .. }) => (expected, got),
        other => panic!("{other:?}"),
    };
    let (expected, got) = refused(&other);
    let name = String::from_utf8_lossy(&other[place..place + version.len()]).into_owned();
    assert!(got.contains(&name) && expected.contains(env!("CARGO_PKG_VERSION")), "{expected}; {got}");
    assert!(refused(b"PK\x03\x04").1.contains("others"));
    assert!(refused(&bytes[..bytes.len() - 1]).1.contains("too early"));
    assert!(refused(&[&bytes[..], b"x"].concat()).1.contains("1 bytes behind"));
}

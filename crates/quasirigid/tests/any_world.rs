//! The laws hold in any world: random bodies of random materials, thrown at each other and at the
//! ground, or put into one another. And whatever they do, a copy does the same.

use proptest::prelude::*;
use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Filter, Material};
use quasirigid::gauss_seidel::{SolverParameters, Stop};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, Snapshot, World};
use std::sync::Arc;

const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

#[derive(Debug, Clone)]
struct Thing {
    shape: usize,
    /// In units of [`SIZE`].
    size: [Real; 3],
    mass: Real,
    material: usize,
    half_space: bool,
    motion: Motion,
    /// Within the cell of its own.
    place: [Real; 3],
    turn: [Real; 3],
    velocity: [Real; 3],
}

const SIZE: Real = 0.02;

fn thing() -> impl Strategy<Value = Thing> {
    let motion = prop_oneof![3 => Just(Motion::Inertial), 1 => Just(Motion::QuasiStatic)];
    let unit = || prop::array::uniform3(-1.0..1.0f64);
    ((0usize..4, prop::array::uniform3(0.5..1.0f64), -3.0..0.0f64, 0usize..64, any::<bool>(), motion), (unit(), unit(), unit())).prop_map(
        |((shape, size, mass, material, half_space, motion), (place, turn, velocity))| {
            let mass = 10f64.powf(mass);
            Thing { shape, size, mass, material, half_space, motion, place, turn, velocity }
        },
    )
}

fn material(index: usize, half_space: bool) -> Material {
    let names: Vec<_> = Material::preset_names().collect();
    let material = Material::preset(names[index % names.len()]).unwrap();
    if half_space { material.with_model(ComplianceModel::HalfSpace).unwrap() } else { material }
}

fn shape_of(thing: &Thing) -> (PointSurface, MassProperties) {
    let (mass, [a, b, c]) = (Amount::Mass(thing.mass), thing.size.map(|s| s * SIZE));
    let n = 240;
    match thing.shape {
        0 => (shapes::sample_box(Vec3::new(a, b, c), n).unwrap(), MassProperties::cuboid(Vec3::new(a, b, c), mass).unwrap()),
        1 => (shapes::sample_sphere(0.5 * a, n).unwrap(), MassProperties::sphere(0.5 * a, mass).unwrap()),
        2 => (shapes::sample_capsule(0.4 * a, b, n).unwrap(), MassProperties::capsule(0.4 * a, b, mass).unwrap()),
        _ => (shapes::sample_cylinder(0.5 * a, b, n).unwrap(), MassProperties::cylinder(0.5 * a, b, mass).unwrap()),
    }
}

/// Bodies over the ground, each in a cell of edge `cell` (m).
fn make_world(things: &[Thing], ground: usize, dt: Real, cell: Real, threads: usize) -> (World, Vec<BodyHandle>) {
    let mut world = World::new(Parameters { dt, gravity: GRAVITY, threads, ..Parameters::default() }).unwrap();
    let floor = Surface::build(shapes::sample_half_space(0.2, 600).unwrap(), Some(80)).unwrap();
    world.add_body(RigidBody::fixed("ground", Pose::identity()).unwrap(), Some((Arc::new(floor), material(ground, false)))).unwrap();
    let bodies = things.iter().enumerate().map(|(k, thing)| {
        let (surface, mass) = shape_of(thing);
        let home = Vec3::new((k % 2) as Real, 0.0, (k / 2) as Real) * cell + Vec3::z() * (0.6 * cell);
        let at = home + Vec3::from(thing.place) * (0.5 * (cell - 2.0 * SIZE).max(0.0));
        let pose = Pose::from_parts(at.into(), Rot::from_scaled_axis(Vec3::from(thing.turn) * 3.0));
        let mut body = RigidBody::free(format!("thing {k}"), mass, thing.motion, pose).unwrap();
        // Mostly towards the ground and the middle.
        let velocity = Vec3::from(thing.velocity) + Vec3::new(0.5 - (k % 2) as Real, 0.0, -0.5);
        body.set_velocity(velocity, Vec3::zeros()).unwrap();
        world
            .add_body(body, Some((Arc::new(Surface::build(surface, Some(60)).unwrap()), material(thing.material, thing.half_space))))
            .unwrap()
    });
    let bodies = bodies.collect::<Vec<_>>();
    (world, bodies)
}

/// Kinetic energy, of what has inertia, and that of the weight, J.
fn energy(world: &World, bodies: &[BodyHandle], things: &[Thing]) -> Real {
    let of = |(&handle, thing): (&BodyHandle, &Thing)| {
        let body = world.body(handle).unwrap();
        let kinetic = if thing.motion == Motion::Inertial { body.kinetic_energy() } else { 0.0 };
        kinetic - thing.mass * GRAVITY.dot(&body.center_of_mass())
    };
    bodies.iter().zip(things).map(of).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn laws_hold_whatever_meets(
        things in prop::collection::vec(thing(), 1..5), ground in 0usize..64,
        dt in prop_oneof![Just(5e-4), Just(1e-3), Just(4e-3)], heaped in any::<bool>(),
    ) {
        let cell = if heaped { 0.01 } else { 0.05 };
        let (mut world, bodies) = make_world(&things, ground, dt, cell, 1);
        let (mut threaded, _) = make_world(&things, ground, dt, cell, 2);
        let start = energy(&world, &bodies, &things);
        let inertial: Vec<_> = bodies.iter().copied().zip(&things).filter(|(_, thing)| thing.motion == Motion::Inertial).collect();
        let mut most = start;
        for step in 0..40 {
            let before: Vec<_> = inertial.iter().map(|(handle, _)| world.body(*handle).unwrap().clone()).collect();
            let report = world.step();
            threaded.step();
            prop_assert_eq!(world.state_hash(), threaded.state_hash(), "step {}: other bits with two threads", step);
            prop_assert!(report.quarantined.is_empty() && report.stop != Stop::NonFinite, "step {step}: {report:?}");
            prop_assert!(!report.converged() || report.residual <= world.parameters().solver.tolerance);
            let problem = world.contact_problem();
            for (f, mu) in problem.reactions.iter().zip(&problem.mu) {
                prop_assert!(f.x >= 0.0 && f.y.hypot(f.z) <= mu * f.x * (1.0 + 1e-12), "step {step}: {f} with mu {mu}");
            }
            let forces = problem.reactions.iter().map(Vec3::norm).sum::<Real>();
            for ((handle, thing), before) in inertial.iter().zip(&before) {
                let body = world.body(*handle).unwrap();
                let gained = (body.linear_velocity() - before.linear_velocity()) * (thing.mass / dt);
                let off = (gained - GRAVITY * thing.mass - world.contact_force_on(*handle).unwrap()).norm();
                let largest = forces + thing.mass * (9.81 + before.linear_velocity().norm() / dt);
                prop_assert!(off <= 1e-12 * largest, "step {step}: forces are off by {off:e} of {largest:e} N");
            }
            most = most.max(energy(&world, &bodies, &things));
        }
        // Nothing drives them: where none was put into another, contact and steps take energy only.
        prop_assert!(heaped || most <= start, "energy grew by {:e} J to {most:e} J", most - start);
    }
}

/// How many random worlds are taken back: a few in every run of the tests, a thousand in `make fuzz`.
fn worlds_taken_back() -> u32 {
    std::env::var("QUASIRIGID_WORLDS").map_or(6, |count| count.parse().expect("QUASIRIGID_WORLDS is a number of worlds"))
}

/// A second surface on a body: on which, of what size, and whom it meets.
#[derive(Debug, Clone)]
struct Second {
    body: usize,
    size: Real,
    filter: Filter,
    /// Whether the first surface of the body does not meet the ground.
    excluded: bool,
    /// Whether it is taken off halfway.
    removed: bool,
}

fn second() -> impl Strategy<Value = Second> {
    let filter = prop_oneof![Just(Filter::default()), Just(Filter { group: 2, mask: 1 }), Just(Filter { group: 0, mask: u32::MAX })];
    (0usize..4, 0.5..1.5f64, filter, any::<bool>(), any::<bool>()).prop_map(|(body, size, filter, excluded, removed)| Second {
        body,
        size,
        filter,
        excluded,
        removed,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: worlds_taken_back(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_world_that_is_restored_or_read_from_bytes_goes_on_bit_by_bit(
        things in prop::collection::vec(thing(), 1..5), ground in 0usize..64,
        dt in prop_oneof![Just(5e-4), Just(1e-3), Just(4e-3)], heaped in any::<bool>(),
        collision_every in prop_oneof![Just(1u32), Just(4)], at in 0usize..60, removed in prop::option::of(0usize..4),
        bad in prop::option::weighted(0.2, 0usize..4),
        second in prop::option::of(second()),
    ) {
        const MORE: usize = 500;
        let cell = if heaped { 0.01 } else { 0.05 };
        let (mut world, bodies) = make_world(&things, ground, dt, cell, 1);
        // Few sweeps: a stiff heap at its cap would take minutes, and where a solve ends is the same every time.
        let solver = SolverParameters { max_sweeps: 60, ..world.parameters().solver.clone() };
        world.set_parameters(Parameters { collision_every, solver, ..world.parameters().clone() }).unwrap();
        if let Some(bad) = bad.and_then(|bad| bodies.get(bad)) {
            world.body_mut(*bad).unwrap().set_velocity(Vec3::new(1e9, 0.0, 0.0), Vec3::zeros()).unwrap();
        }
        if let Some(drive) = bodies.first() {
            let drive_to = PoseDrive::new(Pose::translation(0.0, 0.0, 0.02), [20.0, 0.02], [1.0, 0.001]).unwrap();
            world.body_mut(*drive).unwrap().set_drive(Some(drive_to)).unwrap();
        }
        let mut collider = None;
        if let Some((second, body)) = second.as_ref().and_then(|second| Some((second, *bodies.get(second.body)?))) {
            let surface = Arc::new(Surface::build(shapes::sample_sphere(0.5 * SIZE * second.size, 240).unwrap(), Some(60)).unwrap());
            let first = world.colliders_of(body).unwrap()[0];
            if second.excluded {
                let ground = world.colliders()[0];
                world.exclude_pair(first, ground).unwrap();
            }
            collider = Some((world.add_collider(body, 0, surface, material(ground, false), second.filter).unwrap(), second.removed));
        }
        for step in 0..at {
            if let (true, Some((collider, true))) = (step == at / 3, collider) {
                world.remove_collider(collider).unwrap();
            }
            if let (true, Some(gone)) = (step == at / 2, removed.and_then(|gone| bodies.get(gone))) {
                world.remove_body(*gone).unwrap();
            }
            world.step();
        }
        let snapshot = world.snapshot();
        let bytes = snapshot.to_bytes().unwrap();
        let read = Snapshot::from_bytes(&bytes).unwrap();
        prop_assert!(read == snapshot, "read from {} bytes it is another", bytes.len());
        // The copy has two threads.
        let mut copy = World::from_snapshot(&read).unwrap();
        copy.set_parameters(Parameters { threads: 2, ..copy.parameters().clone() }).unwrap();
        let mut hashes = vec![world.state_hash()];
        for _ in 0..MORE {
            world.step();
            hashes.push(world.state_hash());
        }
        world.restore(&snapshot);
        for (step, hash) in hashes.iter().enumerate() {
            prop_assert_eq!([world.state_hash(), copy.state_hash()], [*hash; 2], "other bits {} steps later", step);
            world.step();
            copy.step();
        }
    }
}

//! Collision: every control point that touches is found, once, from the finer side,
//! under a stable key; a small budget makes it coarser, and says so.

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::pair::Contact;
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::surface::implicit::{Cloud, project};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A soft body `a` placed at `pose` over a body `b` held at the origin by a stiff spring; no gravity.
fn pressed(
    a: PointSurface,
    leaves_a: usize,
    pose: Pose,
    b: PointSurface,
    leaves_b: usize,
    params: Parameters,
) -> (World, BodyHandle, BodyHandle) {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..params }).unwrap();
    let surface = |points, leaves| Arc::new(Surface::build(points, Some(leaves)).unwrap());
    let pulp = Material::preset("fingertip_pulp").unwrap();
    let pad = world.add_body(RigidBody::fixed("pad", pose).unwrap(), Some((surface(a, leaves_a), pulp))).unwrap();
    let mass = MassProperties::cuboid(Vec3::repeat(0.05), Amount::Mass(0.1)).unwrap();
    let mut body = RigidBody::free("object", mass, Motion::Inertial, Pose::identity()).unwrap();
    body.set_drive(Some(PoseDrive::new(Pose::identity(), [1e6, 1e3], [0.0, 0.0]).unwrap())).unwrap();
    let object = world.add_body(body, Some((surface(b, leaves_b), Material::preset("wood").unwrap()))).unwrap();
    (world, pad, object)
}

fn fingertip(n: usize) -> PointSurface {
    shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), n).unwrap()
}

/// The pad looks down on the face z = 0.025 of the box, `depth` into it.
fn pad_pose(depth: Real, x: Real) -> Pose {
    let down = Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    Pose::from_parts(Vec3::new(x, 1e-3, 0.025 + 0.007 - depth).into(), Rot::from_scaled_axis(Vec3::new(0.1, 0.05, 0.3)) * down)
}

/// Control points of `a` against all points of `b`, without trees: gap of each that lies over the surface and faces it.
fn brute_force(a: &Surface, pose_a: &Pose, b: &Surface, pose_b: &Pose) -> BTreeMap<u32, Real> {
    let pose = pose_b.inverse() * pose_a;
    let mut gaps = BTreeMap::new();
    for c in 0..a.control.len() {
        let x = pose.rotation * a.control.points[c] + pose.translation.vector;
        let normal = pose.rotation * a.control.normals[c];
        let everything = 0..b.len() as u32;
        let ranges = std::slice::from_ref(&everything);
        let cloud = Cloud { points: &b.points, normals: &b.normals, ranges, kernel: &b.kernel, facing: Some(&normal) };
        let Some(q) = project(&x, &cloud, 1e-12, 20) else { continue };
        let aside = b.points[q.nearest] - q.point;
        let aside = (aside - q.normal * q.normal.dot(&aside)).norm();
        if q.normal.dot(&normal) < 0.0 && aside < b.spacing {
            gaps.insert(c as u32, q.normal.dot(&(x - q.point)));
        }
    }
    gaps
}

#[test]
fn every_control_point_within_the_margin_is_found() {
    let margin = Parameters::default().contact_margin;
    let boxes = || shapes::sample_box(Vec3::repeat(0.05), 4_800).unwrap();
    let sphere = || shapes::sample_sphere(0.025, 3_000).unwrap();
    let mut total = 0;
    for (name, object, leaves) in [("box", boxes(), 640), ("ball", sphere(), 400)] {
        for depth in [-1.5e-4, 1e-4, 5e-4, 1e-3] {
            for (x, tilt) in [(0.0, 0.0), (3e-3, 0.4), (0.012, -0.3), (0.021, 0.6)] {
                let pose = Pose::from_parts(Vec3::zeros().into(), Rot::from_axis_angle(&Vec3::y_axis(), tilt)) * pad_pose(depth, x);
                let pose = if name == "ball" {
                    pad_pose(depth, 0.1 * x)
                } else if tilt == 0.0 {
                    pose
                } else {
                    pad_pose(depth, x)
                };
                let (mut world, pad, object) = pressed(fingertip(2_400), 320, pose, object.clone(), leaves, Parameters::default());
                let truth = {
                    let [a, b] = [pad, object].map(|h| world.skin(h).unwrap().unwrap().surface.clone());
                    brute_force(&a, &pose, &b, &Pose::identity())
                };
                world.step();
                let found: BTreeMap<u32, Real> = world.contacts().iter().map(|c| (c.control_point, c.gap)).collect();
                let what = format!("{name}, depth {depth} m, x {x} m");
                for (c, gap) in truth.iter().filter(|(_, gap)| **gap < margin - 1e-8 && **gap > -3e-3) {
                    let Some(got) = found.get(c) else { panic!("{what}: control point {c} with a gap of {gap:e} m was missed") };
                    assert!((got - gap).abs() < 1e-7, "{what}: control point {c} has a gap of {gap:e} m, found {got:e}");
                    total += 1;
                }
                for (c, gap) in &found {
                    assert!(*gap <= margin + 1e-12, "{what}: control point {c} with a gap of {gap:e} m is beyond the margin");
                }
            }
        }
    }
    println!("{total} contacts compared");
    assert!(total > 300, "{total} contacts compared");
}

#[test]
fn a_control_point_has_one_contact_and_a_pair_is_sampled_from_the_finer_side() {
    let options = GraspOptions { object_points: (6_000, 800), pad_points: (900, 120), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    let world = &scene.world;
    let keys: Vec<(u32, u32)> = world.contacts().iter().map(|c| (c.pair, c.control_point)).collect();
    assert!(keys.len() > 40, "{} contacts", keys.len());
    assert!(keys.windows(2).all(|w| w[0] < w[1]), "contacts are ordered by key and no key comes twice");
    let mut sides = BTreeMap::new();
    for contact in world.contacts() {
        let spacing = |body: u32| world.skin(world.handle_of(body as usize)).unwrap().unwrap().surface.control.spacing;
        assert!(spacing(contact.body_a) <= spacing(contact.body_b), "control points are those of the finer side");
        let pair = (contact.body_a.min(contact.body_b), contact.body_a.max(contact.body_b));
        assert_eq!(*sides.entry(pair).or_insert(contact.body_a), contact.body_a, "one side for each pair");
        let e = contact.frame;
        assert!((e.transpose() * e - quasirigid::math::Mat3::identity()).norm() < 1e-12, "frames are orthonormal");
    }
    assert_eq!(sides.len(), 4, "three fingertips and the support on the box: {sides:?}");
}

#[test]
fn keys_and_frames_stay_from_step_to_step() {
    let options = GraspOptions { object_points: (6_000, 800), pad_points: (900, 120), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap());
    scene.remove_support().unwrap();
    scene.run(1.0).unwrap();
    let keys = |scene: &GraspScene| scene.world.contacts().iter().map(|c: &Contact| (c.pair, c.control_point)).collect::<Vec<_>>();
    let before = (keys(&scene), scene.world.contacts().to_vec());
    for step in 0..50 {
        scene.step().unwrap();
        assert_eq!(keys(&scene), before.0, "step {step}: keys at rest");
        for (old, new) in before.1.iter().zip(scene.world.contacts()) {
            assert!((old.frame - new.frame).norm() < 1e-9, "step {step}: frames at rest turn by {:e}", (old.frame - new.frame).norm());
        }
    }
}

#[test]
fn a_small_budget_gives_fewer_contacts_that_press_as_hard_and_says_so() {
    for model in [ComplianceModel::Local, ComplianceModel::HalfSpace, ComplianceModel::Layer] {
        let force = |budget: usize| {
            let params = Parameters { traversal_budget: budget, ..Parameters::default() };
            let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..params }).unwrap();
            let pulp = Material::preset("fingertip_pulp").unwrap().with_model(model.clone()).unwrap();
            let pad = Arc::new(Surface::build(fingertip(2_400), Some(320)).unwrap());
            let pad = world.add_body(RigidBody::fixed("pad", pad_pose(1e-3, 0.0)).unwrap(), Some((pad, pulp))).unwrap();
            let surface = Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(0.05), 4_800).unwrap(), Some(640)).unwrap());
            let mass = MassProperties::cuboid(Vec3::repeat(0.05), Amount::Mass(0.1)).unwrap();
            let mut body = RigidBody::free("object", mass, Motion::Inertial, Pose::identity()).unwrap();
            body.set_drive(Some(PoseDrive::new(Pose::identity(), [1e6, 1e3], [0.0, 0.0]).unwrap())).unwrap();
            world.add_body(body, Some((surface, Material::preset("wood").unwrap()))).unwrap();
            let mut coarse = true;
            let mut report = world.step();
            for _ in 0..150 {
                report = world.step();
                coarse &= report.budget_exhausted;
            }
            assert!(report.converged(), "budget {budget}: {:?}", report.stop);
            (world.contact_force_on(pad).unwrap().z, report.contacts, coarse)
        };
        let fine = force(Parameters::default().traversal_budget);
        assert!(!fine.2, "the default budget is not coarse");
        let mut last = fine.1;
        for budget in [3_500, 3_000, 2_000, 1_000, 200] {
            let found = force(budget);
            println!("{model:?} budget {budget}: {found:?} against {fine:?}");
            assert!(found.2, "{model:?} budget {budget}: does not say that it is coarse");
            assert!(found.1 < fine.1, "{model:?} budget {budget}: {} contacts, {} fine", found.1, fine.1);
            last = last.min(found.1);
            // Its share in the contact is estimated from 32 samples of each node.
            let off = (found.0 / fine.0 - 1.0).abs();
            assert!(off < 0.25, "{model:?} budget {budget}: {} N against {} N, {:.0} % off", found.0, fine.0, off * 100.0);
        }
        assert!(last < fine.1, "no budget was small enough to be coarse");
    }
}

#[test]
fn a_box_is_held_however_small_the_budget() {
    for budget in [0, 200, 1_000, 6_000] {
        let mut options = PinchOptions::fingertips(0.7).unwrap();
        options.params.traversal_budget = budget;
        options.box_points = (4_800, 640);
        let mut pinch = Pinch::new(&options).unwrap();
        pinch.squeeze(4.0).unwrap();
        pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
        let reports: Vec<_> = (0..1000).map(|_| pinch.world.step()).collect();
        let at = pinch.world.body(pinch.object).unwrap().pose().translation.vector;
        let least = reports.iter().map(|report| report.contacts).min();
        println!("budget {budget}: at least {least:?} contacts, the box is at {at:?}");
        assert!(reports.iter().all(|report| report.budget_exhausted), "budget {budget}: does not say that it is coarse");
        assert!(at.norm() < 1e-3, "budget {budget}: the box is at {at:?}");
    }
    let params = Parameters { traversal_budget: 200, ..Parameters::default() };
    let options = GraspOptions { params, object_points: (6_000, 800), pad_points: (900, 120), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    let start = scene.world.body(scene.object).unwrap().pose().translation.z;
    assert!(scene.close(3.0).unwrap(), "the hand did not close");
    scene.remove_support().unwrap();
    scene.run(1.0).unwrap();
    let fallen = start - scene.world.body(scene.object).unwrap().pose().translation.z;
    assert!(fallen.abs() < 3e-3, "the grasped box fell by {fallen} m");
}

/// Contacts (key, gap) of 200 steps of a pad that dips, slides and turns on a box, off it in between.
fn contacts_of_a_dance(params: Parameters) -> Vec<Vec<((u32, u32), Real)>> {
    let boxes = shapes::sample_box(Vec3::repeat(0.05), 4_800).unwrap();
    let (mut world, pad, _) = pressed(fingertip(1_200), 160, pad_pose(1e-4, 0.0), boxes, 640, params);
    let step = |k: usize| {
        // Slow enough to reuse what is known for some steps.
        let t = k as Real * 1e-3;
        let mut pose = pad_pose(6e-4 * (15.0 * t).sin(), 8e-3 * (10.0 * t).sin());
        pose.rotation = Rot::from_axis_angle(&Vec3::z_axis(), 0.3 * (12.0 * t).sin()) * pose.rotation;
        world.body_mut(pad).unwrap().move_to(pose).unwrap();
        world.step();
        world.contacts().iter().map(|c| ((c.pair, c.control_point), c.gap)).collect()
    };
    (0..200).map(step).collect()
}

#[test]
fn what_is_remembered_of_the_last_traversal_changes_no_contact() {
    let params = |traversal_slack| Parameters { traversal_slack, projection_slack: 0.0, ..Parameters::default() };
    let always = contacts_of_a_dance(params(0.0));
    let sometimes = contacts_of_a_dance(params(Parameters::default().traversal_slack));
    let most = always.iter().map(Vec::len).max().unwrap_or(0);
    assert!(most > 10, "at most {most} contacts");
    for (step, (a, b)) in always.iter().zip(&sometimes).enumerate() {
        assert_eq!(a, b, "step {step}: other contacts");
    }
}

#[test]
fn what_is_remembered_of_the_last_projection_changes_gaps_by_less_than_a_nanometre() {
    let always = contacts_of_a_dance(Parameters { projection_slack: 0.0, ..Parameters::default() });
    let sometimes = contacts_of_a_dance(Parameters::default());
    let margin = Parameters::default().contact_margin;
    let mut worst: Real = 0.0;
    for (step, (a, b)) in always.iter().zip(&sometimes).enumerate() {
        let (a, b): (BTreeMap<_, _>, BTreeMap<_, _>) = (a.iter().copied().collect(), b.iter().copied().collect());
        for (one, other) in [(&a, &b), (&b, &a)] {
            for (key, gap) in one {
                match other.get(key) {
                    Some(found) => worst = worst.max((gap - found).abs()),
                    // At the rim of the margin a nanometre decides.
                    None => assert!((gap - margin).abs() < 1e-4, "step {step}: contact {key:?} with a gap of {gap:e} m is in one run only"),
                }
            }
        }
    }
    println!("gaps differ by up to {worst:.1e} m");
    assert!(worst < 1e-9, "gaps differ by up to {worst:e} m");
}

#[test]
fn a_larger_margin_holds_from_the_next_step_on() {
    // Control points that were found separated must be tested again when the margin grows, also where nothing moves.
    let wide = Parameters { contact_margin: 1.2e-3, ..Parameters::default() };
    let boxes = || shapes::sample_box(Vec3::repeat(0.05), 4_800).unwrap();
    let keys = |world: &World| world.contacts().iter().map(|c| c.control_point).collect::<Vec<_>>();
    for depth in [-1e-3, -5e-4, -3e-4, 1e-4] {
        let (mut truth, _, _) = pressed(fingertip(1_200), 160, pad_pose(depth, 0.0), boxes(), 640, wide.clone());
        let (mut world, _, _) = pressed(fingertip(1_200), 160, pad_pose(depth, 0.0), boxes(), 640, Parameters::default());
        (0..5).for_each(|_| drop((truth.step(), world.step())));
        let before = keys(&world).len();
        world.set_parameters(truth.parameters().clone()).unwrap();
        truth.step();
        world.step();
        assert!(
            keys(&truth).len() > before,
            "depth {depth} m: {} contacts with the large margin, {before} with the small one",
            keys(&truth).len()
        );
        assert_eq!(keys(&world), keys(&truth), "depth {depth} m: contacts after the margin was widened");
    }
}

#[test]
fn what_is_remembered_holds_without_a_margin_too() {
    // Nothing was found before the first step: bodies that lie on each other must be found even with no margin and no slack.
    let params = Parameters { contact_margin: 0.0, traversal_slack: 0.0, ..Parameters::default() };
    let boxes = shapes::sample_box(Vec3::repeat(0.05), 4_800).unwrap();
    let ball = shapes::sample_sphere(0.02, 1_200).unwrap().translated(Vec3::new(0.0, 0.0, 0.045 - 2e-4)).unwrap();
    let (mut world, _, _) = pressed(ball, 160, Pose::identity(), boxes, 200, params);
    world.step();
    assert!(!world.contacts().is_empty(), "a ball that dips into a box in the same frame touches it");
}

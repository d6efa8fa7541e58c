//! Changes between two steps: materials that change while they touch, bodies that are taken out, handles
//! of another world. What is not touched by a change goes on as if nothing had happened.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::scenes::{Pinch, PinchOptions};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

fn material(name: &str) -> Material {
    Material::preset(name).unwrap().with_friction(0.9).unwrap()
}

/// A box of some material, held with 3 N.
fn held(of: &Material) -> Pinch {
    let mut options = PinchOptions::fingertips(0.9).unwrap();
    (options.mass, options.motion, options.box_material) = (0.05, Motion::QuasiStatic, of.clone());
    (options.box_points, options.pad_points) = ((1_500, 200), (600, 80));
    let mut pinch = Pinch::new(&options).unwrap();
    pinch.squeeze(3.0).unwrap();
    pinch
}

fn force(pinch: &Pinch) -> Real {
    pinch.normal_forces().unwrap().iter().sum::<Real>() / 2.0
}

#[test]
fn a_material_that_forgets_sooner_presses_as_before() {
    let mut pinch = held(&material("wood"));
    let before = force(&pinch);
    let pulp = pinch.world.skin(pinch.pads[0]).unwrap().unwrap().material.clone();
    for tau in [0.0, 0.2, pulp.relaxation_time] {
        let material = pulp.clone().with_relaxation_time(tau).unwrap();
        pinch.pads.iter().for_each(|&pad| pinch.world.set_material(pad, &material).unwrap());
        for step in 0..5 {
            pinch.world.step();
            let now = force(&pinch);
            assert!((now - before).abs() < 1e-6 * before, "relaxation time {tau} s, step {step}: {now} N, {before} N before");
        }
    }
}

#[test]
fn an_object_whose_compliance_model_changes_is_held_as_still_as_before() {
    let local = material("silicone");
    let half_space = local.clone().with_model(ComplianceModel::HalfSpace).unwrap();
    for (first, second) in [(&half_space, &local), (&local, &half_space)] {
        let mut pinch = held(first);
        pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
        pinch.run(0.5);
        pinch.world.set_material(pinch.object, second).unwrap();
        pinch.run(0.5);
        let place = |pinch: &Pinch| pinch.world.body(pinch.object).unwrap().pose().translation.vector;
        let before = place(&pinch);
        pinch.run(0.1);
        let speed = (place(&pinch) - before).norm() / 0.1;
        println!("{:?} to {:?}: {speed:.1e} m/s", first.model, second.model);
        assert!(speed < 1e-8, "{:?} to {:?}: {speed:e} m/s", first.model, second.model);
    }
}

#[test]
fn an_object_that_becomes_soft_yields_and_one_that_becomes_hard_does_not() {
    let (steel, soft) = (material("steel"), material("ecoflex"));
    for (first, second) in [(&steel, &soft), (&soft, &steel)] {
        let mut pinch = held(first);
        pinch.world.set_material(pinch.object, second).unwrap();
        pinch.run(0.5);
        // The pads are where they were: one made so from the start, between pads that come to the same places.
        let mut made = held(second);
        let pads = pinch.pads.map(|pad| *pinch.world.body(pad).unwrap().pose());
        let starts = made.pads.map(|pad| *made.world.body(pad).unwrap().pose());
        for step in 1..=100 {
            for k in 0..2 {
                let pose = starts[k].lerp_slerp(&pads[k], step as Real / 100.0);
                made.world.body_mut(made.pads[k]).unwrap().move_to(pose).unwrap();
            }
            made.world.step();
        }
        made.run(0.5);
        let (changed, wanted) = (force(&pinch), force(&made));
        let deepest = |pinch: &Pinch| {
            let skin = pinch.world.skin(pinch.object).unwrap().unwrap();
            skin.displacement.iter().map(|u| u.norm()).fold(0.0, Real::max)
        };
        println!("{changed:.3} N against {wanted:.3} N, yields {:.1e} m against {:.1e} m", deepest(&pinch), deepest(&made));
        assert!((changed - wanted).abs() < 0.03 * wanted, "{changed} N against {wanted} N");
        assert!(
            (deepest(&pinch) - deepest(&made)).abs() < 0.1 * deepest(&made) + 1e-9,
            "{:e} m against {:e} m",
            deepest(&pinch),
            deepest(&made)
        );
    }
}

fn add(world: &mut World, points: PointSurface, mass: Option<Real>, at: Vec3) -> BodyHandle {
    let pose = Pose::translation(at.x, at.y, at.z);
    let surface = Arc::new(Surface::build(points, None).unwrap());
    let body = match mass {
        Some(mass) => {
            RigidBody::free("box", MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(mass)).unwrap(), Motion::Inertial, pose)
        }
        None => RigidBody::fixed("fixed", pose),
    };
    world.add_body(body.unwrap(), Some((surface, material("steel")))).unwrap()
}

#[test]
fn taking_out_a_body_that_touches_nothing_changes_no_bit_of_the_rest() {
    for settle in [1, 10] {
        let run = |remove: bool| {
            let mut world = World::new(Parameters::default()).unwrap();
            add(&mut world, shapes::sample_box(Vec3::new(0.06, 0.06, 0.01), 2_000).unwrap(), None, Vec3::new(0.0, 0.0, -0.005));
            let object = add(&mut world, shapes::sample_box(Vec3::repeat(0.03), 900).unwrap(), Some(0.1), Vec3::new(0.0, 0.0, 0.015));
            let far = add(&mut world, shapes::sample_sphere(0.01, 100).unwrap(), None, Vec3::x());
            (0..settle).for_each(|_| drop(world.step()));
            if remove {
                world.remove_body(far).unwrap();
            }
            (0..2).for_each(|_| drop(world.step()));
            world.body_mut(object).unwrap().set_velocity(Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.0, 20.0, 0.0)).unwrap();
            let steps = (0..6).map(|_| {
                let report = world.step();
                let w = &world.contact_problem().w;
                let blocks: Vec<_> = (0..report.contacts).map(|i| (w.block(i, i), w.block(i, 0))).collect();
                (report.contacts, report.ill_posed, world.contact_problem().reactions.clone(), blocks)
            });
            steps.collect::<Vec<_>>()
        };
        let (left, taken) = (run(false), run(true));
        for (step, (a, b)) in left.iter().zip(&taken).enumerate() {
            assert_eq!((a.0, a.1), (b.0, b.1), "after {settle} steps, step {step}: contacts and ill-posed ones");
            assert!(a.2 == b.2 && a.3 == b.3, "after {settle} steps, step {step}: other reactions, or another W");
        }
        assert!(left.iter().all(|step| step.1 == 0) && left[0].0 > 10, "{} contacts", left[0].0);
    }
}

#[test]
fn a_handle_of_another_world_is_refused() {
    let mut worlds = [(); 2].map(|()| World::new(Parameters::default()).unwrap());
    let [a, b] = worlds.each_mut().map(|world| add(world, shapes::sample_sphere(0.01, 100).unwrap(), None, Vec3::zeros()));
    let [first, second] = &mut worlds;
    assert_ne!(a, b);
    assert!(second.remove_body(a).is_err() && second.body(a).is_err() && second.body_mut(a).is_err());
    assert!(second.body(b).is_ok() && first.remove_body(a).is_ok());
    assert!(first.remove_body(a).unwrap_err().to_string().contains("removed"));
}

/// The rows of what was left when the body went were taken for those of a problem without contacts, which was filled for ever.
#[test]
fn a_step_without_contacts_ends_after_a_body_that_touched_is_taken_out() {
    let mut world = World::new(Parameters::default()).unwrap();
    add(&mut world, shapes::sample_box(Vec3::new(0.2, 0.2, 0.02), 2_000).unwrap(), None, Vec3::new(0.0, 0.0, -0.01));
    let cube = || shapes::sample_box(Vec3::repeat(0.03), 600).unwrap();
    let [stays, goes] = [-0.04, 0.04].map(|x| add(&mut world, cube(), Some(0.1), Vec3::new(x, 0.0, 0.015)));
    (0..50).for_each(|_| drop(world.step()));
    assert!(world.contacts().len() > 10, "{} contacts", world.contacts().len());
    world.remove_body(goes).unwrap();
    world.body_mut(stays).unwrap().set_pose(Pose::translation(0.0, 0.0, 0.5)).unwrap();
    let report = world.step();
    assert_eq!((report.contacts, report.ill_posed), (0, 0));
}

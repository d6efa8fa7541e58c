//! Bodies and what touches on them: colliders in stable slots, on any link, with
//! filters. What is not touched by a change goes on as if nothing had happened.

use proptest::prelude::*;
use quasirigid::body::{Amount, HandModel, MassProperties, Motion, RigidBody};
use quasirigid::collider::{Filter, Material};
use quasirigid::delassus::Delassus;
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::pair::Contact;
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, ColliderHandle, Parameters, World};
use std::sync::{Arc, LazyLock};

const RADIUS: Real = 0.01;
/// Height of the middle of a sphere whose control points reach into the plate that it lies on, m.
const LOW: Real = 0.95 * RADIUS;

fn build(points: PointSurface, control_points: usize) -> Arc<Surface> {
    Arc::new(Surface::build(points, Some(control_points)).unwrap())
}

/// A sphere whose centre is at `x` on the x axis of its body.
fn sphere_at(x: Real) -> PointSurface {
    shapes::sample_sphere(RADIUS, 360).unwrap().transformed(&Pose::translation(x, 0.0, 0.0)).unwrap()
}

static SPHERE: LazyLock<Arc<Surface>> = LazyLock::new(|| build(sphere_at(0.0), 60));
static PLATE: LazyLock<Arc<Surface>> = LazyLock::new(|| build(shapes::sample_half_space(0.08, 400).unwrap(), 40));

fn rubber() -> Material {
    Material::preset("rubber").unwrap()
}

fn world(gravity: Real) -> World {
    World::new(Parameters { gravity: Vec3::new(0.0, 0.0, -gravity), ..Parameters::default() }).unwrap()
}

fn plate(world: &mut World, at: Vec3) -> BodyHandle {
    world.add_body(RigidBody::fixed("plate", Pose::translation(at.x, at.y, at.z)).unwrap(), Some((PLATE.clone(), rubber()))).unwrap()
}

fn mass() -> MassProperties {
    MassProperties::sphere(RADIUS, Amount::Mass(0.1)).unwrap()
}

fn ball(world: &mut World, at: Vec3) -> BodyHandle {
    let body = RigidBody::free("ball", mass(), Motion::Inertial, Pose::translation(at.x, at.y, at.z)).unwrap();
    world.add_body(body, Some((SPHERE.clone(), rubber()))).unwrap()
}

fn run(world: &mut World, steps: usize) {
    (0..steps).for_each(|_| drop(world.step()));
}

/// What is known of the contacts of a body after a step, in bits.
fn contacts_of(world: &World, body: BodyHandle) -> Vec<(u32, [u64; 7])> {
    let problem = world.contact_problem();
    let mine =
        world.contacts().iter().zip(&problem.reactions).enumerate().filter(|(_, (c, _))| [c.body_a, c.body_b].contains(&body.slot()));
    mine.map(|(i, (c, f))| {
        let delta = problem.w.displacement(i) + problem.delta_free[i];
        (c.control_point, [c.point.x, c.gap, f.x, f.y, f.z, delta.x, delta.y].map(Real::to_bits))
    })
    .collect()
}

fn bits(world: &World, body: BodyHandle) -> Vec<u64> {
    let mut bits = Vec::new();
    world.entry(body).unwrap().body.state().for_each_number(|x| bits.push(x.to_bits()));
    for u in &world.skin(body).unwrap().unwrap().displacement {
        bits.extend(u.iter().map(|x| x.to_bits()));
    }
    bits
}

/// A ball that rolls on a plate and pushes another, beside what is removed: bodies in slots before, between and after them.
#[test]
fn removing_a_body_changes_not_one_bit_of_what_it_did_not_touch() {
    let scene = |touching: bool| {
        let mut world = world(9.81);
        let far = Vec3::new(1.0, 0.0, 0.0);
        let over = Vec3::z() * if touching { LOW } else { 0.2 };
        plate(&mut world, far);
        let first = ball(&mut world, far + over);
        plate(&mut world, Vec3::zeros());
        let rolling = ball(&mut world, Vec3::z() * LOW);
        let second = ball(&mut world, far + over + Vec3::x() * 0.03);
        let pushed = ball(&mut world, Vec3::new(0.0195, 0.0, LOW));
        world.body_mut(rolling).unwrap().set_velocity(Vec3::x() * 0.1, Vec3::zeros()).unwrap();
        run(&mut world, 20);
        (world, [first, second], [rolling, pushed])
    };
    for touching in [false, true] {
        let (mut kept, far, near_kept) = scene(touching);
        let (mut world, removed, near) = scene(touching);
        assert_eq!(!contacts_of(&kept, far[0]).is_empty(), touching, "the far balls touch");
        let own = |body: BodyHandle| if body == near[0] { near_kept[0] } else { near_kept[1] };
        for gone in removed {
            world.remove_body(gone).unwrap();
            let problem = world.contact_problem();
            assert!(world.contacts().iter().all(|c| c.body_a != gone.slot() && c.body_b != gone.slot()), "contacts of what is gone");
            assert_eq!(
                (problem.len(), problem.reactions.len(), problem.w.len()),
                (world.contacts().len(), world.contacts().len(), world.contacts().len())
            );
            assert!(problem.assembled().is_ok(), "W holds rows of contacts that are gone");
            for body in near {
                assert!(!contacts_of(&world, body).is_empty());
                assert_eq!(contacts_of(&world, body), contacts_of(&kept, own(body)), "contacts at once after the removal");
                assert_eq!(bits(&world, body), bits(&kept, own(body)));
            }
        }
        for step in 0..60 {
            run(&mut world, 1);
            run(&mut kept, 1);
            for body in near {
                if touching {
                    // The solver stops when all contacts are solved: with other contacts elsewhere, a sweep sooner or later.
                    let place = |world: &World, body| world.body(body).unwrap().pose().translation.vector;
                    let apart = (place(&world, body) - place(&kept, own(body))).norm();
                    assert!(apart < 1e-9, "step {step}: {apart:e} m apart");
                } else {
                    assert_eq!(contacts_of(&world, body), contacts_of(&kept, own(body)), "step {step}");
                    assert_eq!(bits(&world, body), bits(&kept, own(body)), "step {step}");
                }
            }
        }
    }
}

#[test]
fn a_body_with_two_colliders_stands_and_slides_as_with_one_that_is_their_union() {
    let run = |united: bool| {
        let mut world = world(9.81);
        plate(&mut world, Vec3::zeros());
        let inertia = MassProperties::cuboid(Vec3::new(0.06, 0.02, 0.02), Amount::Mass(0.1)).unwrap();
        let body = RigidBody::free("dumbbell", inertia, Motion::Inertial, Pose::translation(0.0, 0.0, RADIUS)).unwrap();
        let [left, right] = [sphere_at(-0.02), sphere_at(0.02)];
        let body = if united {
            let both = |of: fn(&PointSurface) -> &[Vec3]| [of(&left), of(&right)].concat();
            let areas = [left.areas(), right.areas()].concat();
            let union = PointSurface::new(both(PointSurface::points), both(PointSurface::normals), areas).unwrap();
            world.add_body(body, Some((build(union, 120), rubber()))).unwrap()
        } else {
            let body = world.add_body(body, None).unwrap();
            for side in [left, right] {
                world.add_collider(body, 0, build(side, 60), rubber(), Filter::default()).unwrap();
            }
            body
        };
        // Pushed off its middle: it slides and turns.
        let mut track = Vec::new();
        for step in 0..150 {
            let push = if step < 50 { Vec3::zeros() } else { Vec3::new(0.0, 1.5, 0.0) };
            world.body_mut(body).unwrap().set_external_wrench(push, Vec3::new(0.0, 0.0, 0.2 * push.y * RADIUS)).unwrap();
            world.step();
            let pose = *world.body(body).unwrap().pose();
            track.push((pose, world.contact_force_on(body).unwrap()));
        }
        track
    };
    let (one, two) = (run(true), run(false));
    let moved = (one[149].0.translation.vector - one[0].0.translation.vector).norm();
    assert!(moved > 5e-3, "moved by {moved} m");
    for (step, ((pose, force), (other, other_force))) in one.iter().zip(&two).enumerate() {
        let apart = (pose.translation.vector - other.translation.vector).norm() + 0.03 * pose.rotation.angle_to(&other.rotation);
        let force = (force - other_force).norm();
        // Contacts of the two patches are solved together in either case, by the same control points in another order.
        assert!(apart < 1e-7 && force < 1e-4, "step {step}: {apart:e} m, {force:e} N");
    }
}

#[test]
fn colliders_of_one_body_never_touch() {
    let mut world = world(0.0);
    let body = ball(&mut world, Vec3::zeros());
    world.add_collider(body, 0, build(sphere_at(0.5 * RADIUS), 60), rubber(), Filter { group: u32::MAX, mask: u32::MAX }).unwrap();
    let before = bits(&world, body);
    run(&mut world, 5);
    assert!(world.contacts().is_empty(), "{} contacts", world.contacts().len());
    assert_eq!(bits(&world, body), before);
}

#[test]
fn filters_keep_apart_whom_either_side_does_not_meet() {
    let filter = |group, mask| Filter { group, mask };
    let all = Filter::default();
    for (of_plate, of_ball, touch) in [
        (all, all, true),
        (filter(2, u32::MAX), all, true),
        (filter(2, u32::MAX), filter(1, 1), false),
        (filter(1, 1), filter(2, u32::MAX), false),
        (filter(2, 4), filter(4, 2), true),
        (filter(0, u32::MAX), all, false),
    ] {
        let mut world = world(9.81);
        let bodies = [plate(&mut world, Vec3::zeros()), ball(&mut world, Vec3::z() * LOW)];
        for (body, filter) in bodies.into_iter().zip([of_plate, of_ball]) {
            let collider = world.colliders_of(body).unwrap()[0];
            world.set_filter(collider, filter).unwrap();
            assert_eq!(world.collider(collider).unwrap().filter, filter);
        }
        world.step();
        assert_eq!(!world.contacts().is_empty(), touch, "{of_plate:?} and {of_ball:?}");
    }
}

/// Keeps two colliders apart, or (`false`) lets them touch again.
type Switch = fn(&mut World, [ColliderHandle; 2], bool);

/// Both ways to do it.
fn switches() -> [(&'static str, Switch); 2] {
    [
        ("pair", |world, [a, b], off| if off { world.exclude_pair(a, b).unwrap() } else { world.include_pair(b, a).unwrap() }),
        ("group", |world, [_, b], off| world.set_filter(b, Filter { group: if off { 2 } else { 1 }, mask: u32::from(!off) }).unwrap()),
    ]
}

#[test]
fn a_filter_that_comes_in_the_middle_of_a_contact_ends_it_and_one_that_goes_lets_it_come_back() {
    for (what, switch) in switches() {
        let mut world = world(9.81);
        let (plate, ball) = (plate(&mut world, Vec3::zeros()), ball(&mut world, Vec3::z() * LOW));
        run(&mut world, 200);
        let colliders = [plate, ball].map(|body| world.colliders_of(body).unwrap()[0]);
        let held = world.snapshot();
        let pressed = bits(&world, ball);

        // Set and taken back before a step it is nothing.
        switch(&mut world, colliders, true);
        switch(&mut world, colliders, false);
        run(&mut world, 3);
        let untouched = bits(&world, ball);
        world.restore(&held);
        run(&mut world, 3);
        assert_eq!(bits(&world, ball), untouched, "{what}");

        world.restore(&held);
        assert_eq!(bits(&world, ball), pressed);
        switch(&mut world, colliders, true);
        let report = world.step();
        assert_eq!((report.contacts, world.contacts().len()), (0, 0), "{what}");
        // It falls freely, through the plate, and its surface springs back.
        run(&mut world, 20);
        let velocity = world.body(ball).unwrap().linear_velocity().z;
        assert!((velocity + 9.81 * 0.021).abs() < 1e-3, "{what}: {velocity} m/s after 21 ms");
        let left = |world: &World| world.skin(ball).unwrap().unwrap().displacement.iter().map(|u| u.norm()).fold(0.0, Real::max);
        let relaxing = left(&world);
        run(&mut world, 100);
        assert!(left(&world) <= relaxing && left(&world) < 1e-9, "{what}: displaced by {:e} m, {relaxing:e} m before", left(&world));

        // A filter is state: a snapshot taken while it held holds it, too.
        let falling = world.snapshot();
        world.restore(&held);
        run(&mut world, 2);
        assert!(!world.contacts().is_empty(), "{what}: restored to before the filter");
        world.restore(&falling);
        world.body_mut(ball).unwrap().set_pose(Pose::translation(0.0, 0.0, LOW)).unwrap();
        assert_eq!(world.step().contacts, 0, "{what}: restored to after it");
        switch(&mut world, colliders, false);
        assert!(world.step().contacts > 0, "{what}: lets it come back");
    }
}

#[test]
fn a_collider_that_is_taken_off_leaves_the_others_of_its_body_as_they_were() {
    let mut world = world(9.81);
    let base = plate(&mut world, Vec3::zeros());
    let body = RigidBody::free("dumbbell", mass(), Motion::Inertial, Pose::translation(0.0, 0.0, LOW)).unwrap();
    let body = world.add_body(body, None).unwrap();
    let [left, right] = [-0.02, 0.02].map(|x| world.add_collider(body, 0, build(sphere_at(x), 60), rubber(), Filter::default()).unwrap());
    run(&mut world, 10);
    let on = |world: &World, collider: ColliderHandle| -> Vec<_> {
        let mine = world.contacts().iter().filter(|c| [c.collider_a, c.collider_b].contains(&collider.slot()));
        mine.map(|c| (c.control_point, c.gap.to_bits())).collect()
    };
    let before = on(&world, right);
    assert!(!before.is_empty() && !on(&world, left).is_empty());
    let displacement = world.collider(right).unwrap().skin.displacement.clone();
    world.remove_collider(left).unwrap();
    assert_eq!((on(&world, right), world.contacts().len()), (before.clone(), before.len()));
    assert_eq!(world.collider(right).unwrap().skin.displacement, displacement);
    // Where the plate was pressed by the one that is gone it is flat again at once, and where the other presses it is not.
    let dents = world.skin(base).unwrap().unwrap();
    let at = |side: Real| {
        dents.surface.control.points.iter().zip(&dents.displacement).filter(move |(p, _)| side * p.x > 0.01).map(|(_, u)| u.norm())
    };
    assert!(at(-1.0).all(|u| u == 0.0) && at(1.0).any(|u| u > 0.0), "dents {:e} and {:e} m", at(-1.0).sum::<Real>(), at(1.0).sum::<Real>());
    run(&mut world, 2);
    let contact = &world.contacts()[0];
    assert_eq!((contact.collider_a, contact.body_a, contact.link_a), (right.slot(), body.slot(), 0));
    world.remove_collider(right).unwrap();
    assert_eq!(world.step().contacts, 0);
    assert!(world.skin(body).unwrap().is_none() && world.colliders_of(body).unwrap().is_empty());
}

#[test]
fn what_comes_into_a_freed_slot_inherits_nothing() {
    let mut old = world(9.81);
    let base = plate(&mut old, Vec3::zeros());
    let first = ball(&mut old, Vec3::z() * LOW);
    run(&mut old, 50);
    old.set_friction(base, first, Some(quasirigid::collider::Friction::coulomb(0.0).unwrap())).unwrap();
    let colliders = [base, first].map(|body| old.colliders_of(body).unwrap()[0]);
    old.exclude_pair(colliders[0], colliders[1]).unwrap();
    old.remove_body(first).unwrap();
    let mut fresh = world(9.81);
    let fresh_base = plate(&mut fresh, Vec3::zeros());
    // Of the same shape, so that rows and reactions of the one would fit the other.
    let [second, fresh_second] = [&mut old, &mut fresh].map(|world| {
        let second = ball(world, Vec3::z() * LOW);
        world.body_mut(second).unwrap().set_velocity(Vec3::x() * 0.05, Vec3::zeros()).unwrap();
        second
    });
    assert_eq!((second.slot(), second == first), (first.slot(), false));
    assert_eq!((fresh.dense(fresh_second).unwrap(), old.dense(second).unwrap(), fresh_base.slot()), (1, 1, base.slot()));
    for step in 0..30 {
        run(&mut old, 1);
        run(&mut fresh, 1);
        assert!(!old.contacts().is_empty());
        assert_eq!(bits(&old, second), bits(&fresh, fresh_second), "step {step}");
    }
    let error = old.collider(colliders[1]).unwrap_err().to_string();
    assert!(error.contains("removed") && old.body(first).is_err() && old.set_filter(colliders[1], Filter::default()).is_err(), "{error}");
    assert!(old.exclude_pair(colliders[0], colliders[1]).is_err() && old.exclude_pair(colliders[0], colliders[0]).is_err());
}

#[test]
fn a_link_of_a_finger_carries_colliders_of_its_own() {
    let mut world = world(0.0);
    let pad = shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 240).unwrap();
    let hand = world.add_hand(&HandModel::three_finger().unwrap(), Pose::identity(), Motion::Inertial, &pad, Some(40), &rubber()).unwrap();
    let finger = world.finger_handle(hand, 1).unwrap();
    let links = world.entry(finger).unwrap().body.link_count();
    let refused = world.add_collider(finger, links, SPHERE.clone(), rubber(), Filter::default()).unwrap_err().to_string();
    assert!(refused.contains(&format!("a link below {links}")) && refused.contains(&format!("got {links}")), "{refused}");
    assert_eq!(world.colliders_of(finger).unwrap().len(), 1, "a refused collider leaves nothing behind");

    let knuckle = world.add_collider(finger, 1, SPHERE.clone(), rubber(), Filter::default()).unwrap();
    assert_eq!((world.body_of(knuckle).unwrap(), world.collider(knuckle).unwrap().link), (finger, 1));
    let at = world.side(knuckle).unwrap().pose().translation.vector;
    let struck = ball(&mut world, at + Vec3::new(0.0, 0.0, 1.9 * RADIUS));
    run(&mut world, 2);
    let contacts: Vec<&Contact> = world.contacts().iter().filter(|c| [c.body_a, c.body_b].contains(&struck.slot())).collect();
    assert!(!contacts.is_empty());
    for contact in contacts {
        let mine = [(contact.collider_a, contact.link_a, contact.body_a), (contact.collider_b, contact.link_b, contact.body_b)];
        assert!(mine.contains(&(knuckle.slot(), 1, finger.slot())), "{mine:?}");
    }
    // What touches link 1 loads the joints before it and none after.
    let torques = world.finger(hand, 1).unwrap().contact_torques().to_vec();
    assert!(torques[..2].iter().any(|t| t.abs() > 0.0) && torques[2..].iter().all(|t| *t == 0.0), "{torques:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]
    /// Bodies and colliders come and go between steps; every handle names what it was
    /// given for, or is refused, and every contact is of two that are there.
    #[test]
    fn handles_name_what_they_were_given_for_whatever_else_comes_and_goes(actions in prop::collection::vec((0..6u8, 0..100usize), 1..40)) {
        let mut world = world(9.81);
        plate(&mut world, Vec3::zeros());
        let mut bodies = Vec::<(BodyHandle, String)>::new();
        let mut colliders = Vec::<(ColliderHandle, BodyHandle)>::new();
        let (mut gone_bodies, mut gone_colliders) = (Vec::new(), Vec::new());
        for (k, (action, which)) in actions.into_iter().enumerate() {
            match action {
                0 => {
                    let pose = Pose::translation(0.015 * (which % 3) as Real, 0.015 * (which / 3 % 3) as Real, LOW);
                    let name = format!("body {k}");
                    let body = world.add_body(RigidBody::free(&name, mass(), Motion::QuasiStatic, pose).unwrap(), None).unwrap();
                    colliders.push((world.add_collider(body, 0, SPHERE.clone(), rubber(), Filter::default()).unwrap(), body));
                    bodies.push((body, name));
                }
                1 if !bodies.is_empty() => {
                    let body = bodies[which % bodies.len()].0;
                    colliders.push((world.add_collider(body, 0, SPHERE.clone(), rubber(), Filter::default()).unwrap(), body));
                }
                2 if !bodies.is_empty() => {
                    let (body, _) = bodies.remove(which % bodies.len());
                    world.remove_body(body).unwrap();
                    gone_colliders.extend(colliders.extract_if(.., |(_, of)| *of == body).map(|(collider, _)| collider));
                    gone_bodies.push(body);
                }
                3 if !colliders.is_empty() => {
                    let (collider, _) = colliders.remove(which % colliders.len());
                    world.remove_collider(collider).unwrap();
                    gone_colliders.push(collider);
                }
                4 if colliders.len() > 1 => {
                    let (a, b) = (colliders[which % colliders.len()].0, colliders[(which + 1) % colliders.len()].0);
                    if which % 2 == 0 { world.exclude_pair(a, b).unwrap() } else { world.include_pair(a, b).unwrap() }
                }
                _ => drop(world.step()),
            }
            for (place, (body, name)) in bodies.iter().enumerate() {
                prop_assert_eq!(world.body(*body).unwrap().name(), name);
                // The plate comes first.
                prop_assert_eq!((world.dense(*body).unwrap(), world.handle_of(place + 1)), (place + 1, *body));
            }
            prop_assert_eq!(world.bodies().len(), bodies.len() + 1);
            for (collider, body) in &colliders {
                prop_assert_eq!(world.body_of(*collider).unwrap(), *body);
            }
            prop_assert!(gone_bodies.iter().all(|body| world.entry(*body).is_err()));
            prop_assert!(gone_colliders.iter().all(|collider| world.collider(*collider).is_err()));
            let (there, all) = (world.colliders(), world.contacts());
            prop_assert_eq!(there.len(), colliders.len() + 1);
            prop_assert_eq!((all.len(), all.len()), (world.contact_problem().len(), world.contact_problem().reactions.len()));
            for contact in all {
                for (slot, body) in [(contact.collider_a, contact.body_a), (contact.collider_b, contact.body_b)] {
                    let collider = there.iter().find(|collider| collider.slot() == slot);
                    prop_assert_eq!(collider.map(|collider| world.body_of(*collider).unwrap().slot()), Some(body));
                }
            }
        }
        let report = world.step();
        prop_assert!(report.quarantined.is_empty() && report.residual.is_finite(), "{:?}", report);
    }
}

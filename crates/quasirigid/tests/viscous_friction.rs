//! Viscous friction: a drag in proportion to slip speed and contact area, while the contact slips.

use quasirigid::Parameters;
use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::{Friction, Material};
use quasirigid::delassus::ContactStatus;
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::scenes::Incline;
use quasirigid::surface::{Surface, shapes};
use std::sync::Arc;

const G: Real = 9.81;
const MU: Real = 0.3;
const AREA: Real = 0.04 * 0.04;

fn incline(film: Real, dt: Real, motion: Motion) -> Incline {
    let friction = Friction::coulomb(MU).unwrap().with_viscous(film).unwrap();
    let rubber = Material::preset("rubber").unwrap();
    let mut incline = Incline::new(Parameters { dt, ..Parameters::default() }, &rubber, friction, motion).unwrap();
    incline.run(0.1);
    incline
}

fn speed(incline: &Incline) -> Real {
    incline.world.body(incline.block).unwrap().linear_velocity().x
}

/// Speed of a block on an incline of `angle` when nothing changes any more: m g (sin - mu cos) = c A v.
fn terminal_velocity(film: Real, angle: Real) -> Real {
    0.1 * G * (angle.sin() - MU * angle.cos()) / (film * AREA)
}

#[test]
fn sliding_block_reaches_the_terminal_velocity() {
    let angle = 0.5_f64;
    for (film, dt) in [(2e3, 1e-3), (2e4, 1e-3), (2e4, 1e-2), (2e6, 1e-3)] {
        let mut incline = incline(film, dt, Motion::Inertial);
        incline.tilt(angle, 0.0).unwrap();
        // The time constant is m/(c A): 31 ms at most.
        incline.run(0.2);
        let unconverged = (0..20).filter(|_| !incline.world.step().converged()).count();
        let (v, truth) = (speed(&incline), terminal_velocity(film, angle));
        let area: Real = incline.world.contacts().iter().map(|contact| contact.area).sum();
        println!("c = {film:.0e} Pa s/m, dt {dt}: {v:.6} m/s against {truth:.6}; area {:.4} of the face's", area / AREA);
        assert_eq!(unconverged, 0, "c = {film:e}: steps that did not converge");
        assert!((v / truth - 1.0).abs() < 0.02, "c = {film:e}: {v} m/s against {truth}");
    }
}

#[test]
fn halving_the_spacing_changes_the_speed_by_less_than_three_percent() {
    let (film, angle) = (2e4, 0.5_f64);
    let speeds = [(3_000, 400), (12_000, 1_600)].map(|points| {
        let mut incline = incline(film, 1e-3, Motion::Inertial);
        let friction = Friction::coulomb(MU).unwrap().with_viscous(film).unwrap();
        let material = Material::preset("rubber").unwrap().with_friction(friction).unwrap();
        let size = Vec3::new(0.04, 0.04, 0.02);
        let mass = MassProperties::cuboid(size, Amount::Mass(0.1)).unwrap();
        let surface = Arc::new(Surface::build(shapes::sample_box(size, points.0).unwrap(), Some(points.1)).unwrap());
        incline.world.remove_body(incline.block).unwrap();
        let body = RigidBody::free("block", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.01)).unwrap();
        incline.block = incline.world.add_body(body, Some((surface, material))).unwrap();
        incline.run(0.1);
        incline.tilt(angle, 0.0).unwrap();
        incline.run(0.2);
        speed(&incline)
    });
    let change = speeds[1] / speeds[0] - 1.0;
    println!("{:.6} and {:.6} m/s: {:.2} %", speeds[0], speeds[1], 100.0 * change);
    assert!(change.abs() < 0.03, "{change}");
}

#[test]
fn a_block_that_sticks_feels_no_drag_and_does_not_creep() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        let mut with_film = incline(1e6, 1e-3, motion);
        let mut without = incline(0.0, 1e-3, motion);
        for incline in [&mut with_film, &mut without] {
            for k in 1..=200 {
                incline.tilt((0.99 * MU * k as Real / 200.0).atan(), 0.0).unwrap();
                incline.world.step();
            }
            incline.run(0.4);
        }
        let before = with_film.world.body(with_film.block).unwrap().pose().translation.vector;
        with_film.run(0.2);
        let moved = (with_film.world.body(with_film.block).unwrap().pose().translation.vector - before).norm() / 0.2;
        let where_is = |incline: &Incline| incline.world.body(incline.block).unwrap().pose().translation.x;
        println!("{motion:?}: {moved:.1e} m/s; {:e} m from where it stands without film", where_is(&with_film) - where_is(&without));
        assert!(moved < 1e-9, "{motion:?}: creeps at {moved:e} m/s");
        let problem = with_film.world.contact_problem();
        for (f, status) in problem.reactions.iter().zip(&problem.status).filter(|(_, status)| **status == ContactStatus::Stick) {
            assert!(f.y.hypot(f.z) <= MU * f.x * (1.0 + 1e-9), "{status:?} outside the cone: {f}");
        }
    }
}

#[test]
fn without_coulomb_friction_a_film_alone_drags() {
    let film = 2e4;
    let friction = Friction::coulomb(0.0).unwrap().with_viscous(film).unwrap();
    let rubber = Material::preset("rubber").unwrap();
    let mut incline = Incline::new(Parameters::default(), &rubber, friction, Motion::Inertial).unwrap();
    incline.run(0.1);
    incline.tilt(0.1, 0.0).unwrap();
    incline.run(0.2);
    let (v, truth) = (speed(&incline), 0.1 * G * 0.1_f64.sin() / (film * AREA));
    println!("{v:.6} m/s against {truth:.6}");
    assert!((v / truth - 1.0).abs() < 0.02, "{v} m/s against {truth}");
}

//! As layers of 0.06 MPa the fingertips of a pinch and of a hand are as soft as people's: 1 to 2 mm and 80 to 150 mm^2 at 2 N (E. R. Serina, C. D. Mote, D. Rempel,
//! J. Biomech. 30, 1997; E. R. Serina, E. Mockensturm, C. D. Mote, D. Rempel, J. Biomech. 31, 1998).

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::Arc;

/// Indentation (m) and area (m^2) of a fingertip pressed on a flat of steel by 2 N.
fn at_2_newton(pulp: &Material, semi_axes: Vec3, points: usize, control_points: usize) -> (Real, Real) {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let steel = Material::preset("steel").unwrap().with_friction(0.0).unwrap();
    let plate = Arc::new(Surface::build(shapes::sample_box(Vec3::new(0.05, 0.05, 0.01), 4_000).unwrap(), Some(500)).unwrap());
    let rest = Pose::translation(0.0, 0.0, -0.005);
    let mass = MassProperties::cuboid(Vec3::new(0.05, 0.05, 0.01), Amount::Mass(0.1)).unwrap();
    let mut body = RigidBody::free("plate", mass, Motion::Inertial, rest).unwrap();
    body.set_drive(Some(PoseDrive::new(rest, [1e7, 1e4], [0.0, 0.0]).unwrap())).unwrap();
    world.add_body(body, Some((plate, steel))).unwrap();
    let at = |depth: Real| {
        let down = Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
        Pose::from_parts(Vec3::new(0.0, 0.0, semi_axes.z - depth).into(), down)
    };
    let tip = Arc::new(Surface::build(shapes::sample_fingertip(semi_axes, points).unwrap(), Some(control_points)).unwrap());
    let pad = world.add_body(RigidBody::fixed("pad", at(0.0)).unwrap(), Some((tip, pulp.clone()))).unwrap();
    let (mut depth, mut last) = (0.0, 0.0);
    loop {
        depth += 1e-5;
        world.body_mut(pad).unwrap().move_to(at(depth)).unwrap();
        // Slowly against the relaxation.
        (0..4).for_each(|_| drop(world.step()));
        let force = world.contact_force_on(pad).unwrap().norm();
        if force >= 2.0 {
            let area =
                world.contacts().iter().zip(&world.contact_problem().reactions).filter(|(_, f)| f.x > 0.0).map(|(c, _)| c.area).sum();
            return (depth - 1e-5 * (force - 2.0) / (force - last), area);
        }
        last = force;
        assert!(depth < 5e-3, "{force} N at {depth} m");
    }
}

#[test]
fn fingertips_at_2_newton_are_indented_as_measured_on_people() {
    let pulp = Material::preset("fingertip_pulp").unwrap().with_relaxation_time(1e-3).unwrap().with_elasticity(0.06e6, 0.45, 4e-3).unwrap();
    // The pads of a pinch and of a hand.
    for (semi_axes, points, control_points) in [((0.012, 0.0085, 0.007), 1_200, 160), ((0.009, 0.009, 0.008), 1_200, 160)] {
        for model in [ComplianceModel::Local, ComplianceModel::Layer] {
            let material = pulp.clone().with_model(model.clone()).unwrap();
            let (depth, area) = at_2_newton(&material, Vec3::new(semi_axes.0, semi_axes.1, semi_axes.2), points, control_points);
            let what = format!("{model:?} {semi_axes:?}: {:.2} mm, {:.0} mm^2", 1e3 * depth, 1e6 * area);
            println!("{what}");
            assert!((1e-3..=2e-3).contains(&depth), "{what}");
            assert!((80e-6..=150e-6).contains(&area), "{what}");
        }
    }
}

//! Sampling: results do not depend on how finely a surface is sampled. F(d)
//! changes by less than 3 % when the spacing halves, and converges.
//!
//! The coarsest patches have a dozen closed contacts; with fewer the change is larger
//! (4 % from 18 to 70 contacts of an elongated pad, seen in a trial).

use quasirigid::body::{Amount, MassProperties, Motion, PoseDrive, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::Arc;

/// Force (N) with which a body of `material`, its lowest point at -`height`, answers when it is pressed by `depth` (m) into a stiff plate.
fn force(surface: PointSurface, control_points: usize, height: Real, depth: Real, material: &Material, turn: Rot) -> (Real, usize) {
    // The overlap is the load here, not a mistake to be pushed out slowly.
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), push_out_speed: Real::INFINITY, ..Parameters::default() }).unwrap();
    let plate = Surface::build(shapes::sample_half_space(0.06, 900).unwrap(), Some(100)).unwrap();
    // Nothing relaxes: the force of the first step is that of equilibrium.
    let at_once = |m: Material| m.with_relaxation_time(0.0).unwrap();
    let steel = at_once(Material::preset("steel").unwrap());
    // Off the symmetric position, so that no sampling is lucky.
    let pose = Pose::from_parts(Vec3::new(1.3e-4, -2.1e-4, height - depth).into(), turn);
    let soft = world
        .add_body(RigidBody::fixed("pad", pose).unwrap(), Some((surface_of(surface, control_points), at_once(material.clone()))))
        .unwrap();
    // Two fixed bodies do not meet: the plate is held by a spring that is compressed by a millionth of the depth.
    let mass = MassProperties::sphere(0.02, Amount::Mass(1.0)).unwrap();
    let mut body = RigidBody::free("plate", mass, Motion::Inertial, Pose::identity()).unwrap();
    body.set_drive(Some(PoseDrive::new(Pose::identity(), [1e10, 1e8], [0.0, 0.0]).unwrap())).unwrap();
    world.add_body(body, Some((Arc::new(plate), steel))).unwrap();
    let report = (0..3).map(|_| world.step()).last().unwrap();
    assert!(report.converged(), "{:?} after {} sweeps, residual {:e}", report.stop, report.sweeps, report.residual);
    let closed = world.contact_problem().reactions.iter().filter(|f| f.x > 0.0).count();
    (world.contact_force_on(soft).unwrap().z, closed)
}

fn surface_of(surface: PointSurface, control_points: usize) -> Arc<Surface> {
    Arc::new(Surface::build(surface, Some(control_points)).unwrap())
}

fn models() -> [(&'static str, Material); 3] {
    let pulp = Material::preset("fingertip_pulp").unwrap();
    let wide = ComplianceModel::Gaussian { foundation_modulus: 3.9e7, width: 1e-3, share: 0.7 };
    [
        ("layer", pulp.clone()),
        ("wide Gaussian", pulp.clone().with_model(wide).unwrap()),
        ("half-space", pulp.with_model(ComplianceModel::HalfSpace).unwrap()),
    ]
}

/// Checks F for samplings each with half the spacing of the one before.
fn check(what: &str, samplings: &[usize], force: impl Fn(usize) -> (Real, usize)) {
    let found: Vec<(Real, usize)> = samplings.iter().map(|&n| force(n)).collect();
    println!(
        "{what}: {:?} N with {:?} closed contacts",
        found.iter().map(|f| f.0).collect::<Vec<_>>(),
        found.iter().map(|f| f.1).collect::<Vec<_>>()
    );
    let changes: Vec<Real> = found.windows(2).map(|w| (w[1].0 / w[0].0 - 1.0).abs()).collect();
    for (change, n) in changes.iter().zip(&samplings[1..]) {
        assert!(*change < 0.03, "{what}: halving the spacing to {n} control points changes F by {:.2} %", change * 100.0);
    }
    let (first, last) = (changes[0], changes[changes.len() - 1]);
    assert!(last < first.max(0.005), "{what}: does not converge, changes {changes:?}");
}

#[test]
fn pressed_sphere_answers_the_same_at_any_spacing() {
    let radius = 0.01;
    for (name, material) in models() {
        for depth in [6e-4, 1.2e-3] {
            let turn = Rot::from_scaled_axis(Vec3::new(0.3, 0.2, 0.5));
            check(&format!("sphere, {name}, d = {depth} m"), &[600, 2_400, 9_600], |n| {
                force(shapes::sample_sphere(radius, 4 * n).unwrap(), n, radius, depth, &material, turn)
            });
        }
    }
}

#[test]
fn pressed_pad_answers_the_same_at_any_spacing() {
    let axes = Vec3::new(0.012, 0.0085, 0.007);
    let down = Rot::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    for (name, material) in models() {
        check(&format!("pad, {name}"), &[320, 1_280, 5_120], |n| {
            force(shapes::sample_fingertip(axes, 4 * n).unwrap(), n, axes.z, 1e-3, &material, down)
        });
    }
}

#[test]
fn point_spacing_alone_hardly_matters() {
    let radius = 0.01;
    for (name, material) in models() {
        let forces = [3, 6, 12]
            .map(|per_leaf| force(shapes::sample_sphere(radius, per_leaf * 800).unwrap(), 800, radius, 1e-3, &material, Rot::identity()).0);
        println!("{name}: {forces:?} N at 3, 6, 12 points per control point");
        for pair in forces.windows(2) {
            assert!((pair[1] / pair[0] - 1.0).abs() < 0.03, "{name}: {forces:?} N");
        }
    }
}

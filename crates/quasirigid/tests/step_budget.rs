//! Steps that have to end in time: what the solver leaves unfinished in one step it goes on with in the next. Nothing gains
//! energy, nothing held is dropped or creeps, and what comes to rest does so where it would have without a limit.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::gauss_seidel::Stop;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::scenes::grasp::{GraspOptions, GraspScene};
use quasirigid::surface::{Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;
use std::time::Duration;

const MASS: Real = 0.2;

/// A wooden box, let go a little tilted over a stand.
fn falling_box(params: Parameters, stand: &str, height: Real) -> (World, BodyHandle) {
    let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
    let material = |name| Material::preset(name).unwrap();
    let mut world = World::new(params).unwrap();
    let support = RigidBody::fixed("stand", Pose::translation(0.0, 0.0, -0.005)).unwrap();
    let top = shapes::sample_box(Vec3::new(0.03, 0.03, 0.01), 2_000).unwrap();
    world.add_body(support, Some((surface(top, 267), material(stand)))).unwrap();
    let size = Vec3::new(0.06, 0.06, 0.08);
    let mass = MassProperties::cuboid(size, Amount::Mass(MASS)).unwrap();
    let pose = Pose::from_parts(Vec3::new(0.0, 0.0, 0.04 + height).into(), Rot::from_euler_angles(0.01, 0.005, 0.0));
    let body = RigidBody::free("box", mass, Motion::Inertial, pose).unwrap();
    let object = world.add_body(body, Some((surface(shapes::sample_box(size, 12_000).unwrap(), 1_600), material("wood")))).unwrap();
    (world, object)
}

/// Energy of motion and height of the box, J. The little that it turns is left out: that only ever takes from it.
fn energy(body: &RigidBody) -> Real {
    MASS * (0.5 * body.linear_velocity().norm_squared() + 9.81 * body.pose().translation.z)
}

/// The box after 1.5 s, how many steps were cut short, and by how much its energy was above that of the start, J.
fn fallen(params: Parameters, stand: &str) -> (RigidBody, usize, Real) {
    let (mut world, object) = falling_box(params, stand, 1e-3);
    let start = energy(world.body(object).unwrap());
    let (mut cut, mut gained) = (0, 0.0 as Real);
    for _ in 0..1500 {
        let report = world.step();
        cut += usize::from(report.stop == Stop::SweepCap);
        gained = gained.max(energy(world.body(object).unwrap()) - start);
    }
    (world.body(object).unwrap().clone(), cut, gained)
}

fn apart(a: &Pose, b: &Pose) -> Real {
    (a.translation.vector - b.translation.vector).norm() + 0.05 * a.rotation.angle_to(&b.rotation)
}

fn sweeps(max_sweeps: u32) -> Parameters {
    let mut params = Parameters::default();
    params.solver.max_sweeps = max_sweeps;
    params
}

#[test]
fn a_box_set_down_under_a_limit_that_cuts_comes_to_rest_as_without() {
    for (stand, limit) in [("rubber", 20), ("silicone", 10)] {
        let (free, never, _) = fallen(Parameters::default(), stand);
        let (limited, cut, gained) = fallen(sweeps(limit), stand);
        let off = apart(free.pose(), limited.pose());
        let speed = limited.linear_velocity().norm();
        println!("{stand}: {cut} steps cut short, {off:.1e} m from where it rests without, {speed:.1e} m/s, {gained:.1e} J gained");
        assert_eq!(never, 0, "{stand}: cut without a limit");
        assert!(cut > 50, "{stand}: only {cut} steps were cut short");
        assert!(gained < 1e-6 * MASS, "{stand}: {gained:e} J gained");
        assert!(off < 1e-6, "{stand}: {off:e} m from where it rests without a limit");
        assert!(speed < 1e-9, "{stand}: {speed:e} m/s at rest");
    }
}

fn held() -> GraspScene {
    let options = GraspOptions { object_points: (12_000, 1_600), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    assert!(scene.close(3.0).unwrap(), "the hand did not close");
    scene.remove_support().unwrap();
    scene.run(0.3).unwrap();
    scene
}

/// Moves the hand up and down by 2 mm for half a second, then leaves it still for one. Returns the pose of the object at the end,
/// its speeds (m/s and rad/s) there, how far it moved in the last half second, and the steps that were cut short.
fn shaken(scene: &mut GraspScene) -> (Pose, [Real; 2], Real, usize) {
    let base = scene.world.hand(scene.hand).unwrap().base;
    let (mut cut, mut before) = (0, Pose::identity());
    for k in 1..=1500 {
        if k <= 500 {
            let height = 2e-3 * (k as Real * 4e-3 * std::f64::consts::PI).sin();
            scene.world.move_hand_to(scene.hand, Pose::translation(0.0, 0.0, height) * base).unwrap();
        }
        let report = scene.world.step();
        cut += usize::from(matches!(report.stop, Stop::SweepCap | Stop::TimeBudget));
        if k == 1000 {
            before = *scene.world.body(scene.object).unwrap().pose();
        }
    }
    let body = scene.world.body(scene.object).unwrap();
    (*body.pose(), [body.linear_velocity().norm(), body.angular_velocity().norm()], apart(&before, body.pose()), cut)
}

#[test]
fn a_held_object_that_is_shaken_under_a_limit_that_cuts_stays_held_and_does_not_creep_after() {
    let (free, ..) = shaken(&mut held());
    for limit in [4, 6] {
        let mut scene = held();
        scene.world.set_parameters(sweeps(limit)).unwrap();
        let (pose, speeds, drift, cut) = shaken(&mut scene);
        let off = apart(&free, &pose);
        println!(
            "{limit} sweeps: {cut} steps cut short, {off:.1e} m from where it is without, \
             {speeds:.1?} m/s and rad/s, {drift:.1e} m in half a second"
        );
        assert!(cut > 100, "{limit} sweeps: only {cut} steps were cut short");
        assert!(off < 2e-5, "{limit} sweeps: {off:e} m from where it is without a limit");
        assert!(speeds[0] < 1e-9 && speeds[1] < 1e-9 && drift < 0.5e-9, "{limit} sweeps: {speeds:?} m/s and rad/s, {drift:e} m");
    }
}

#[test]
fn a_step_without_any_time_left_says_so_and_what_rests_stays_at_rest() {
    let mut scene = held();
    scene.world.set_parameters(Parameters { step_budget: Some(Duration::from_nanos(1)), ..Parameters::default() }).unwrap();
    let before = *scene.world.body(scene.object).unwrap().pose();
    for _ in 0..1000 {
        let report = scene.world.step();
        assert!(report.sweeps <= 4, "{report:?}");
    }
    let drift = apart(&before, scene.world.body(scene.object).unwrap().pose());
    println!("no time left: {drift:.1e} m in 1 s");
    assert!(drift < 1e-9, "{drift:e} m in 1 s");
    // The hand moves off, which four sweeps are not enough for.
    let base = scene.world.hand(scene.hand).unwrap().base;
    scene.world.move_hand_to(scene.hand, Pose::translation(2e-4, 0.0, 1e-4) * base).unwrap();
    let report = scene.world.step();
    assert!(report.stop == Stop::TimeBudget && !report.converged() && report.residual > 1e-8, "{report:?}");
    let problem = scene.world.contact_problem();
    for (f, mu) in problem.reactions.iter().zip(&problem.mu) {
        assert!(f.x >= 0.0 && f.y.hypot(f.z) <= mu * f.x * (1.0 + 1e-12), "{f:?} outside its cone");
    }
}

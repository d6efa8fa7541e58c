//! Hold: an object inside the friction cone does not creep, ever. After settling it moves less than 1 nm/s and turns less than 10 nrad/s.

use quasirigid::body::{ComplianceModel, Motion};
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::scenes::{GraspOptions, GraspScene, Pinch, PinchOptions};
use quasirigid::{BodyHandle, Parameters, World};

const DRIFT: Real = 1e-9;
const SPIN: Real = 1e-8;

/// Speed (m/s) and spin (rad/s) between two poses `time` seconds apart.
fn speeds(before: &Pose, after: &Pose, time: Real) -> (Real, Real) {
    ((after.translation.vector - before.translation.vector).norm() / time, before.rotation.angle_to(&after.rotation) / time)
}

/// Steps for `time` seconds and returns the mean speed, the mean spin and the number of steps that did not converge.
fn drift(world: &mut World, object: BodyHandle, time: Real) -> (Real, Real, usize) {
    let before = *world.body(object).unwrap().pose();
    let steps = (time / world.parameters().dt).round() as usize;
    let unconverged = (0..steps).filter(|_| !world.step().converged()).count();
    let (speed, spin) = speeds(&before, world.body(object).unwrap().pose(), time);
    (speed, spin, unconverged)
}

fn pinched_box_does_not_creep(model: Option<ComplianceModel>, motion: Motion, dt: Real) {
    let mut options = PinchOptions::fingertips(0.6).unwrap();
    options.params = Parameters { dt, ..Parameters::default() };
    options.motion = motion;
    options.box_points = (4_800, 640);
    options.pad_points = (900, 120);
    if let Some(model) = model.clone() {
        options.pad_material = options.pad_material.with_model(model).unwrap();
    }
    let mut pinch = Pinch::new(&options).unwrap();
    // 2 mu N = 4.8 N against a weight of 1.96 N.
    pinch.squeeze(4.0).unwrap();
    pinch.set_gravity(Vec3::new(0.0, 0.0, -9.81)).unwrap();
    // With inertia the box swings about the line through the pads, on springs of patch torsion that damp it by the factor e in about a second.
    pinch.run(if motion == Motion::Inertial { 6.0 } else { 1.0 });
    let height = pinch.world.body(pinch.object).unwrap().pose().translation.z;
    let (speed, spin, unconverged) = drift(&mut pinch.world, pinch.object, 0.5);
    let what = format!("{model:?} {motion:?} dt {dt}");
    println!("{what}: {speed:.1e} m/s, {spin:.1e} rad/s, {} contacts", pinch.world.contacts().len());
    assert!(height > -5e-3, "{what}: the box fell to {height} m");
    assert!(pinch.world.contacts().len() > 10, "{what}: {} contacts", pinch.world.contacts().len());
    assert_eq!(unconverged, 0, "{what}: steps that did not converge");
    assert!(speed < DRIFT, "{what}: {speed:e} m/s");
    assert!(spin < SPIN, "{what}: {spin:e} rad/s");
}

#[test]
fn pinched_inertial_box_does_not_creep_with_local_compliance() {
    [1e-3, 1e-2].iter().for_each(|&dt| pinched_box_does_not_creep(None, Motion::Inertial, dt));
}

#[test]
fn pinched_quasi_static_box_does_not_creep_with_local_compliance() {
    [1e-3, 1e-2].iter().for_each(|&dt| pinched_box_does_not_creep(None, Motion::QuasiStatic, dt));
}

#[test]
fn pinched_inertial_box_does_not_creep_with_half_space_compliance() {
    [1e-3, 1e-2].iter().for_each(|&dt| pinched_box_does_not_creep(Some(ComplianceModel::HalfSpace), Motion::Inertial, dt));
}

#[test]
fn pinched_quasi_static_box_does_not_creep_with_half_space_compliance() {
    [1e-3, 1e-2].iter().for_each(|&dt| pinched_box_does_not_creep(Some(ComplianceModel::HalfSpace), Motion::QuasiStatic, dt));
}

/// Three fingers with 4 joints each hold the box without a support.
fn grasped_box_does_not_creep(half_space: bool, motion: Motion, dt: Real) {
    let mut options = GraspOptions {
        params: Parameters { dt, ..Parameters::default() },
        object_motion: motion,
        object_points: (6_000, 800),
        pad_points: (900, 120),
        ..GraspOptions::default()
    };
    if half_space {
        options.pad_material = options.pad_material.with_model(ComplianceModel::HalfSpace).unwrap();
    }
    let mut scene = GraspScene::new(&options).unwrap();
    let what = format!("half-space {half_space} {motion:?} dt {dt}");
    assert!(scene.close(3.0).unwrap(), "{what}: the hand did not close, state {:?}", scene.grip.state());
    scene.remove_support().unwrap();
    scene.run(1.5).unwrap();
    let height = scene.world.body(scene.object).unwrap().pose().translation.z;
    let (speed, spin, unconverged) = drift(&mut scene.world, scene.object, 0.5);
    println!("{what}: {speed:.1e} m/s, {spin:.1e} rad/s, {} contacts", scene.world.contacts().len());
    assert!((height - 0.03).abs() < 5e-3, "{what}: the box is at {height} m");
    assert_eq!(unconverged, 0, "{what}: steps that did not converge");
    assert!(speed < DRIFT, "{what}: {speed:e} m/s");
    assert!(spin < SPIN, "{what}: {spin:e} rad/s");
}

#[test]
fn grasped_inertial_box_does_not_creep() {
    grasped_box_does_not_creep(false, Motion::Inertial, 1e-3);
    grasped_box_does_not_creep(false, Motion::Inertial, 1e-2);
}

#[test]
fn grasped_quasi_static_box_does_not_creep() {
    grasped_box_does_not_creep(false, Motion::QuasiStatic, 1e-3);
}

#[test]
fn grasped_box_does_not_creep_between_half_space_pads() {
    grasped_box_does_not_creep(true, Motion::Inertial, 1e-3);
}

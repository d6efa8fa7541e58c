//! Hold: an object inside the friction cone does not creep, ever. After settling it moves less than 1 nm/s and turns less
//! than 10 nrad/s; and what is turned about by the hand that holds it is afterwards where it was in the hand.

use quasirigid::body::{Motion, RigidBody};
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::{Pose, Real, Rot, Vec3};
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
    // With inertia the box swings about the line through the pads, on springs of
    // patch torsion that damp it by the factor e in about a second.
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

/// Friction at which not even the rim of a patch slips: what slips there under a load that changes does not come back, which is no creep.
const STICKY: Real = 12.0;
/// Where the palm is that turns the pads of a pinch, m: a lever like that of a hand.
const PALM: Vec3 = Vec3::new(0.0, 0.02, 0.085);

/// From 0 to 1 in `steps` steps, at rest at both ends.
fn smooth(step: usize, steps: usize) -> Real {
    let s = step as Real / steps as Real;
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

/// Turns the pads together about an axis through the palm, from one angle to another at this mean speed (rad/s), and lets the box settle.
fn turn(pinch: &mut Pinch, rest: &[Pose; 2], from: Real, to: Real, speed: Real, settle: Real) -> Pose {
    let about = |angle: Real| {
        let palm = Pose::translation(PALM.x, PALM.y, PALM.z);
        palm * Pose::rotation(Vec3::new(0.9, 0.3, 0.316_227_766) * angle) * palm.inverse()
    };
    let steps = ((to - from).abs() / speed / pinch.world.parameters().dt).round() as usize;
    for step in 1..=steps {
        let target = about(from + (to - from) * smooth(step, steps));
        for (pad, rest) in pinch.pads.into_iter().zip(rest) {
            pinch.world.body_mut(pad).unwrap().move_to(target * rest).unwrap();
        }
        pinch.world.step();
    }
    pinch.run(settle);
    about(to).inverse() * pinch.world.body(pinch.object).unwrap().pose()
}

/// Distance (m) and angle (rad) between two poses in the hand.
fn apart(a: &Pose, b: &Pose) -> (Real, Real) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

fn turned_box_stays_in_the_hand(motion: Motion, dt: Real, speed: Real, gravity: Real) {
    let what = format!("{motion:?}, dt {dt}, {speed} rad/s, gravity {gravity}");
    let mut options = PinchOptions::fingertips(STICKY).unwrap();
    options.params = Parameters { dt, ..Parameters::default() };
    options.motion = motion;
    (options.mass, options.box_points, options.pad_points) = (0.05, (1_500, 200), (600, 80));
    let mut pinch = Pinch::new(&options).unwrap();
    // The air that a quasi-static body moves in is as thick as syrup by default, and would make the rims slip.
    if motion == Motion::QuasiStatic {
        pinch.world.body_mut(pinch.object).unwrap().set_viscosity(0.2, 1e-4).unwrap();
    }
    pinch.squeeze(4.0).unwrap();
    pinch.set_gravity(Vec3::new(0.0, 0.0, -gravity)).unwrap();
    let settle = if motion == Motion::Inertial { 0.8 } else { 0.3 };
    pinch.run(3.0 * settle);
    let rest = pinch.pads.map(|pad| *pinch.world.body(pad).unwrap().pose());
    let before = *pinch.world.body(pinch.object).unwrap().pose();
    let quarter = std::f64::consts::FRAC_PI_2;
    let there = turn(&mut pinch, &rest, 0.0, quarter, speed, settle);
    let back = turn(&mut pinch, &rest, quarter, 0.0, speed, settle);
    let ((away, away_angle), (left, left_angle)) = (apart(&before, &there), apart(&before, &back));
    println!("{what}: {away:.1e} m and {away_angle:.1e} rad after a quarter turn, {left:.1e} m and {left_angle:.1e} rad when back");
    // Where gravity pulls another way the box sags another way; when it is back it is where it was.
    assert!(gravity > 0.0 || away < 1e-9 && away_angle < 1e-7, "{what}: {away:e} m and {away_angle:e} rad off after a quarter turn");
    assert!(left < 1e-9 && left_angle < 1e-7, "{what}: {left:e} m and {left_angle:e} rad off when back");
}

#[test]
fn a_box_that_is_turned_about_by_its_pads_is_afterwards_where_it_was_between_them() {
    let fast = std::f64::consts::PI;
    turned_box_stays_in_the_hand(Motion::Inertial, 2e-3, 1.0, 0.0);
    turned_box_stays_in_the_hand(Motion::Inertial, 1e-3, fast, 9.81);
    turned_box_stays_in_the_hand(Motion::QuasiStatic, 1e-3, fast, 0.0);
}

#[test]
fn a_box_that_is_turned_about_by_a_hand_is_afterwards_where_it_was_in_it() {
    for (speed, dt) in [(1.0, 2e-3), (2.0, 1e-3)] {
        let mut options = GraspOptions { object_points: (3_000, 400), pad_points: (600, 80), mass: 0.01, ..GraspOptions::default() };
        options.params = Parameters { dt, ..Parameters::default() };
        options.object_material = options.object_material.with_friction(STICKY).unwrap();
        options.pad_material = options.pad_material.with_friction(STICKY).unwrap();
        let mut scene = GraspScene::new(&options).unwrap();
        assert!(scene.close(3.0).unwrap());
        scene.grip.hold();
        scene.remove_support().unwrap();
        scene.world.set_gravity(Vec3::zeros()).unwrap();
        scene.run(0.5).unwrap();
        let start = scene.world.hand(scene.hand).unwrap().base;
        let in_hand =
            |scene: &GraspScene| scene.world.hand(scene.hand).unwrap().base.inverse() * scene.world.body(scene.object).unwrap().pose();
        let before = in_hand(&scene);
        let quarter = std::f64::consts::FRAC_PI_2;
        let steps = (quarter / speed / dt).round() as usize;
        for (from, to) in [(0.0, quarter), (quarter, 0.0)] {
            for step in 1..=steps {
                let angle = from + (to - from) * smooth(step, steps);
                let turned = Pose::from_parts(start.translation, Rot::from_scaled_axis(Vec3::x() * angle) * start.rotation);
                scene.world.move_hand_to(scene.hand, turned).unwrap();
                scene.step().unwrap();
            }
            scene.run(0.3).unwrap();
            let (off, angle) = apart(&before, &in_hand(&scene));
            println!("{speed} rad/s, dt {dt}, to {to:.2} rad: {off:.1e} m, {angle:.1e} rad");
            assert!(off < 1e-9 && angle < 1e-7, "{speed} rad/s, dt {dt}, to {to:.2} rad: {off:e} m, {angle:e} rad");
        }
    }
}

#[test]
fn two_boxes_that_are_turned_about_side_by_side_stay_together() {
    let mut options = PinchOptions::fingertips(STICKY).unwrap();
    (options.size, options.box_points, options.pad_points) = (Vec3::new(0.02, 0.02, 0.02), (400, 50), (600, 80));
    (options.mass, options.motion) = (0.03, Motion::QuasiStatic);
    // The second box is a copy of the first beside it; the pads move out to make room.
    let mut pinch = Pinch::new(&options).unwrap();
    let first = pinch.object;
    let skin = pinch
        .world
        .skin(first)
        .unwrap()
        .map(|skin| (skin.surface.clone(), Material::preset("rubber").unwrap().with_friction(0.9).unwrap()));
    let mass = *pinch.world.body(first).unwrap().mass_properties();
    let body = RigidBody::free("second", mass, Motion::QuasiStatic, Pose::translation(0.02, 0.0, 0.0)).unwrap();
    let second = pinch.world.add_body(body, skin).unwrap();
    let pad = pinch.world.body_mut(pinch.pads[1]).unwrap();
    let aside = Pose::translation(0.02, 0.0, 0.0) * *pad.pose();
    pad.set_pose(aside).unwrap();
    // In air as thick as syrup, the default, the rims between the boxes would open and slip.
    for body in [first, second] {
        pinch.world.body_mut(body).unwrap().set_viscosity(0.2, 1e-4).unwrap();
    }
    pinch.squeeze(4.0).unwrap();
    pinch.run(0.9);
    let rest = pinch.pads.map(|pad| *pinch.world.body(pad).unwrap().pose());
    let between = |pinch: &Pinch| pinch.world.body(first).unwrap().pose().inverse() * pinch.world.body(second).unwrap().pose();
    let (before, before_hand) = (between(&pinch), *pinch.world.body(first).unwrap().pose());
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut worst: Real = 0.0;
    for (from, to) in [(0.0, quarter), (quarter, 0.0)] {
        let in_hand = turn(&mut pinch, &rest, from, to, 2.0, 0.3);
        let ((off, angle), (off_hand, _)) = (apart(&before, &between(&pinch)), apart(&before_hand, &in_hand));
        println!("to {to:.2} rad: {off:.1e} m and {angle:.1e} rad between the boxes, {off_hand:.1e} m in the hand");
        worst = worst.max(off).max(off_hand);
    }
    assert!(worst < 1e-9, "{worst:e} m");
}

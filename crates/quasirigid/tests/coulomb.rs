//! Coulomb: sticking up to mu N, sliding beyond, against the direction of motion. Within 1 %, directions within 1 degree.

use quasirigid::body::Motion;
use quasirigid::collider::Material;
use quasirigid::delassus::ContactStatus;
use quasirigid::math::{Real, Vec3};
use quasirigid::scenes::{Incline, Pinch, PinchOptions};
use quasirigid::{Parameters, World};

const MU: Real = 0.5;

fn pinch(motion: Motion, half_space: bool) -> Pinch {
    let mut options = PinchOptions::fingertips(MU).unwrap();
    options.motion = motion;
    options.box_points = (4_800, 640);
    options.pad_points = (900, 120);
    if half_space {
        options.pad_material = options.pad_material.with_model(quasirigid::collider::ComplianceModel::HalfSpace).unwrap();
    }
    let mut pinch = Pinch::new(&options).unwrap();
    pinch.squeeze(3.0).unwrap();
    pinch
}

fn all_slip(world: &World) -> bool {
    let problem = world.contact_problem();
    let mut closed = problem.status.iter().filter(|s| **s != ContactStatus::Open).peekable();
    closed.peek().is_some() && closed.all(|s| *s == ContactStatus::Slip)
}

fn pull(pinch: &mut Pinch, force: Vec3) {
    pinch.world.body_mut(pinch.object).unwrap().set_external_wrench(force, Vec3::zeros()).unwrap();
}

/// Ramps the load at 1 N/s up to `most`; returns the load and the sum of the two normal forces when every contact slips.
fn load_at_slip(pinch: &mut Pinch, direction: Vec3, from: Real, most: Real) -> Option<(Real, Real)> {
    let mut load = from;
    while load < most {
        load += 1.0 * pinch.world.parameters().dt;
        pull(pinch, direction * load);
        pinch.world.step();
        if all_slip(&pinch.world) {
            return Some((load, pinch.normal_forces().unwrap().iter().sum()));
        }
    }
    None
}

#[test]
fn pinched_block_slips_at_two_mu_n_along_the_load() {
    let (inertial, quasi_static) = (Motion::Inertial, Motion::QuasiStatic);
    for (motion, half_space, angles) in [
        (inertial, false, &[0.0_f64, 37.0, 90.0, 200.0, 305.0][..]),
        (quasi_static, false, &[64.0, 270.0]),
        (quasi_static, true, &[0.0, 140.0]),
    ] {
        for &angle in angles {
            let mut pinch = pinch(motion, half_space);
            let (sin, cos) = angle.to_radians().sin_cos();
            let direction = Vec3::new(0.0, cos, sin);
            let expected = MU * pinch.normal_forces().unwrap().iter().sum::<Real>();
            // Up to 90 % at once, the rest slowly enough for the soft pads to follow.
            for share in 1..=90 {
                pull(&mut pinch, direction * (0.01 * share as Real * expected));
                pinch.world.step();
            }
            pinch.run(0.2);
            let what = format!("{motion:?} half-space {half_space} at {angle} degrees");
            let found = load_at_slip(&mut pinch, direction, 0.9 * expected, 1.1 * expected);
            let Some((load, normal)) = found else { panic!("{what}: no slip up to 1.1 x 2 mu N") };
            let ratio = load / (MU * normal);
            let before = pinch.world.body(pinch.object).unwrap().pose().translation.vector;
            pull(&mut pinch, direction * (1.05 * load));
            pinch.run(0.1);
            let slid = pinch.world.body(pinch.object).unwrap().pose().translation.vector - before;
            let off = slid.angle(&direction).to_degrees();
            println!("{what}: slips at {ratio:.4} x 2 mu N, {off:.3} degrees off, slid {:.3} mm", slid.norm() * 1e3);
            assert!((ratio - 1.0).abs() < 0.01, "{what}: slips at {ratio} x 2 mu N");
            assert!(slid.norm() > 1e-4, "{what}: slid {:e} m", slid.norm());
            assert!(off < 1.0, "{what}: slides {off} degrees off the load");
        }
    }
}

#[test]
fn pinched_block_holds_one_percent_below_two_mu_n() {
    for angle in [0.0_f64, 120.0] {
        let mut pinch = pinch(Motion::Inertial, false);
        let direction = Vec3::new(0.0, angle.to_radians().cos(), angle.to_radians().sin());
        let expected = MU * pinch.normal_forces().unwrap().iter().sum::<Real>();
        for k in 1..=500 {
            pull(&mut pinch, direction * (0.99 * expected * k as Real / 500.0));
            pinch.world.step();
        }
        // Slow swings about the line through the pads die out first.
        pinch.run(6.0);
        let before = pinch.world.body(pinch.object).unwrap().pose().translation.vector;
        pinch.run(0.3);
        let speed = (pinch.world.body(pinch.object).unwrap().pose().translation.vector - before).norm() / 0.3;
        println!("{angle} degrees: {speed:.1e} m/s at 0.99 x 2 mu N");
        assert!(speed < 1e-9, "{angle} degrees: creeps at {speed:e} m/s");
    }
}

/// Tilts within 0.2 s to `tangent` of the angle and returns the displacement of the block in the second half of a further 0.4 s.
fn displacement_on_incline(motion: Motion, mu: Real, tangent: Real, heading: Real) -> Vec3 {
    let rubber = Material::preset("rubber").unwrap();
    let params = Parameters { dt: 2e-3, ..Parameters::default() };
    let mut incline = Incline::new(params, &rubber, mu, motion).unwrap();
    incline.run(0.1);
    for k in 1..=100 {
        incline.tilt((tangent * k as Real / 100.0).atan(), heading).unwrap();
        incline.world.step();
    }
    incline.run(0.2);
    let before = incline.world.body(incline.block).unwrap().pose().translation.vector;
    incline.run(0.2);
    incline.world.body(incline.block).unwrap().pose().translation.vector - before
}

#[test]
fn block_on_incline_sticks_below_the_friction_angle_and_slides_downhill_above() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        for (mu, heading) in [(0.5, 0.0_f64), (0.5, 31.0), (0.3, 215.0), (0.8, 340.0)] {
            let what = format!("{motion:?} mu {mu} heading {heading} degrees");
            let heading = heading.to_radians();
            let downhill = Vec3::new(heading.cos(), heading.sin(), 0.0);
            let stuck = displacement_on_incline(motion, mu, 0.99 * mu, heading).norm() / 0.2;
            let slid = displacement_on_incline(motion, mu, 1.01 * mu, heading);
            let off = slid.angle(&downhill).to_degrees();
            println!("{what}: {stuck:.1e} m/s at 0.99, {:.1e} m/s at 1.01, {off:.3} degrees off", slid.norm() / 0.2);
            assert!(stuck < 1e-9, "{what}: creeps at {stuck:e} m/s below the friction angle");
            assert!(slid.norm() / 0.2 > 1e-4, "{what}: {:e} m/s above the friction angle", slid.norm() / 0.2);
            assert!(off < 1.0, "{what}: slides {off} degrees off");
        }
    }
}

#[test]
fn sliding_block_accelerates_by_what_friction_leaves() {
    // a = g (sin - mu cos), Newton and Coulomb.
    let (mu, angle) = (0.4, 0.6_f64);
    let rubber = Material::preset("rubber").unwrap();
    let mut incline = Incline::new(Parameters::default(), &rubber, mu, Motion::Inertial).unwrap();
    incline.run(0.1);
    incline.tilt(angle, 0.0).unwrap();
    incline.run(0.1);
    let v0 = incline.world.body(incline.block).unwrap().linear_velocity().x;
    incline.run(0.05);
    let acceleration = (incline.world.body(incline.block).unwrap().linear_velocity().x - v0) / 0.05;
    let truth = 9.81 * (angle.sin() - mu * angle.cos());
    println!("{acceleration} m/s^2 against {truth}");
    assert!((acceleration / truth - 1.0).abs() < 0.01, "{acceleration} m/s^2 against {truth}");
}

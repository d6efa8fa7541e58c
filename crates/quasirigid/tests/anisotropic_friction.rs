//! Anisotropic friction: the ellipse of slip thresholds, and slip along its normal.

use quasirigid::Parameters;
use quasirigid::body::Motion;
use quasirigid::collider::{Friction, FrictionRule, Material};
use quasirigid::math::{Real, Rot, Vec3};
use quasirigid::scenes::Incline;

const MU_1: Real = 0.6;
const MU_2: Real = 0.3;
const G: Real = 9.81;

/// A block whose friction on the plane is `MU_1` along x and `MU_2` across, in the frame of the plane; at rest on level ground.
fn incline(motion: Motion) -> Incline {
    let rubber = Material::preset("rubber").unwrap();
    let params = Parameters { dt: 2e-3, ..Parameters::default() };
    let mut incline = Incline::new(params, &rubber, 0.9, motion).unwrap();
    let friction = Friction::coulomb(MU_1).unwrap().with_anisotropy(Vec3::x(), MU_2 / MU_1).unwrap();
    incline.world.set_friction(incline.plane, incline.block, Some(friction)).unwrap();
    incline.run(0.1);
    incline
}

fn position(incline: &Incline) -> Vec3 {
    incline.world.body(incline.block).unwrap().pose().translation.vector
}

/// Tangent of the incline at which `t` downhill is on the ellipse: 1 = (t_1/mu_1)^2 + (t_2/mu_2)^2.
fn threshold(heading: Real) -> Real {
    1.0 / (heading.cos() / MU_1).hypot(heading.sin() / MU_2)
}

#[test]
fn block_slips_where_the_load_leaves_the_ellipse() {
    for motion in [Motion::Inertial, Motion::QuasiStatic] {
        for heading in [0.0_f64, 35.0, 90.0, 200.0, 270.0] {
            let heading = heading.to_radians();
            let [stuck, slid] = [0.99, 1.01].map(|share| {
                let mut incline = incline(motion);
                for k in 1..=100 {
                    incline.tilt((share * threshold(heading) * k as Real / 100.0).atan(), heading).unwrap();
                    incline.world.step();
                }
                incline.run(0.2);
                let before = position(&incline);
                incline.run(0.2);
                (position(&incline) - before).norm() / 0.2
            });
            let what = format!("{motion:?} towards {:.0} degrees, threshold {:.3}", heading.to_degrees(), threshold(heading));
            println!("{what}: {stuck:.1e} m/s at 0.99, {slid:.1e} m/s at 1.01");
            assert!(stuck < 1e-9, "{what}: creeps at {stuck:e} m/s");
            assert!(slid > 1e-4, "{what}: {slid:e} m/s");
        }
    }
}

#[test]
fn slip_leaves_along_the_normal_of_the_ellipse() {
    // Without inertia, just above the threshold: friction is the load, a point of the
    // ellipse, and slip is along its normal there, (f_1/mu_1^2, f_2/mu_2^2).
    for heading in [20.0_f64, 50.0, 75.0, 160.0] {
        let heading = heading.to_radians();
        let mut incline = incline(Motion::QuasiStatic);
        incline.tilt((1.001 * threshold(heading)).atan(), heading).unwrap();
        incline.run(0.5);
        let before = position(&incline);
        incline.run(0.2);
        let slid = position(&incline) - before;
        let normal = Vec3::new(heading.cos() / (MU_1 * MU_1), heading.sin() / (MU_2 * MU_2), 0.0);
        let off = slid.angle(&normal).to_degrees();
        let from_load = slid.angle(&Vec3::new(heading.cos(), heading.sin(), 0.0)).to_degrees();
        println!("towards {:.0} degrees: {off:.3} degrees off the normal, {from_load:.1} off the load", heading.to_degrees());
        assert!(slid.norm() > 1e-6, "slid {:e} m", slid.norm());
        assert!(off < 1.0, "towards {} degrees: {off} degrees off", heading.to_degrees());
    }
}

#[test]
fn sliding_block_feels_the_force_of_its_direction() {
    // Thrown at an angle, a block feels f = -N (mu_1^2 v_1, mu_2^2 v_2) / |(mu_1
    // v_1, mu_2 v_2)|: the point of the ellipse whose normal is v.
    for angle in [0.0_f64, 40.0, 90.0, 235.0] {
        let angle = angle.to_radians();
        let mut incline = incline(Motion::Inertial);
        let v = Vec3::new(angle.cos(), angle.sin(), 0.0);
        incline.world.body_mut(incline.block).unwrap().set_velocity(v * 0.5, Vec3::zeros()).unwrap();
        incline.run(0.02);
        let velocity = |incline: &Incline| *incline.world.body(incline.block).unwrap().linear_velocity();
        // The step is implicit: the force is that of the velocity at its end.
        let mut worst: Real = 0.0;
        for _ in 0..20 {
            let before = velocity(&incline);
            incline.world.step();
            let v = velocity(&incline);
            let got = (v - before) / incline.world.parameters().dt;
            let (a, b) = (MU_1 * v.x, MU_2 * v.y);
            let truth = -G * Vec3::new(MU_1 * a, MU_2 * b, 0.0) / a.hypot(b);
            worst = worst.max((Vec3::new(got.x, got.y, 0.0) - truth).norm() / truth.norm());
        }
        println!("thrown at {:.0} degrees: off by {:.2} % at most", angle.to_degrees(), 100.0 * worst);
        assert!(worst < 0.01, "thrown at {} degrees: off by {worst}", angle.to_degrees());
    }
}

#[test]
fn the_direction_turns_with_its_body() {
    // The block carries the direction; turned by 90 degrees about z, the easy direction is x.
    let rubber = Material::preset("rubber").unwrap();
    let friction = Friction::coulomb(MU_1).unwrap().with_anisotropy(Vec3::x(), MU_2 / MU_1).unwrap();
    for (degrees, holds) in [(0.0_f64, true), (90.0, false)] {
        let mut incline = Incline::new(Parameters::default(), &rubber, 0.9, Motion::Inertial).unwrap();
        incline.world.set_friction(incline.block, incline.plane, Some(friction)).unwrap();
        let mut pose = *incline.world.body(incline.block).unwrap().pose();
        pose.rotation = Rot::from_axis_angle(&Vec3::z_axis(), degrees.to_radians());
        incline.world.body_mut(incline.block).unwrap().set_pose(pose).unwrap();
        incline.run(0.1);
        incline.tilt(0.45_f64.atan(), 0.0).unwrap();
        incline.run(0.2);
        let before = position(&incline);
        incline.run(0.1);
        let speed = (position(&incline) - before).norm() / 0.1;
        println!("turned by {degrees} degrees: {speed:.1e} m/s");
        assert!(if holds { speed < 1e-4 } else { speed > 0.1 }, "turned by {degrees} degrees: {speed:e} m/s");
    }
}

#[test]
fn materials_and_rule_decide_where_the_table_is_silent() {
    let rubber = Material::preset("rubber").unwrap();
    let slides = |incline: &mut Incline, tangent: Real| {
        incline.tilt(tangent.atan(), 0.0).unwrap();
        incline.run(0.1);
        let before = position(incline);
        incline.run(0.1);
        (position(incline) - before).norm() > 1e-3
    };
    // 0.9 along the direction of both, 0.09 across; both along x.
    let anisotropic = Friction::coulomb(0.9).unwrap().with_anisotropy(Vec3::x(), 0.1).unwrap();
    for (rule, mu) in [(FrictionRule::GeometricMean, 0.9), (FrictionRule::Product, 0.81), (FrictionRule::Minimum, 0.9)] {
        for (share, expected) in [(0.97, false), (1.03, true)] {
            let params = Parameters { friction_rule: rule, ..Parameters::default() };
            let mut incline = Incline::new(params, &rubber, anisotropic, Motion::Inertial).unwrap();
            incline.run(0.1);
            assert_eq!(slides(&mut incline, share * mu), expected, "{rule:?} at {share} x {mu}");
        }
    }
    // The table holds from the next step on, bodies before materials, and what is taken back is combined again.
    let low = Some(Friction::coulomb(0.2).unwrap());
    let high = Some(Friction::coulomb(0.8).unwrap());
    for (by_material, by_body, expected) in [(None, None, false), (low, None, true), (low, high, false), (high, low, true)] {
        for take_back in [false, true] {
            let mut incline = Incline::new(Parameters::default(), &rubber, 0.5, Motion::Inertial).unwrap();
            incline.run(0.1);
            incline.world.set_friction("rubber", &rubber, by_material).unwrap();
            incline.world.set_friction(incline.block, incline.plane, by_body).unwrap();
            if take_back {
                incline.world.set_friction("rubber", "rubber", None).unwrap();
                incline.world.set_friction(incline.plane, incline.block, None).unwrap();
            }
            let what = format!("materials {by_material:?}, bodies {by_body:?}, taken back {take_back}");
            assert_eq!(slides(&mut incline, 0.4), expected && !take_back, "{what}");
        }
    }
}

#[test]
fn entries_about_what_is_not_there_are_refused() {
    let rubber = Material::preset("rubber").unwrap();
    let Incline { mut world, plane, block } = Incline::new(Parameters::default(), &rubber, 0.5, Motion::Inertial).unwrap();
    assert!(world.set_friction(block, block, None).is_err());
    assert!(world.set_friction(block, plane, Some(Friction::from(-0.1))).is_err());
    let unknown = world.set_friction(block, "rubbr", Some(Friction::from(0.1))).unwrap_err().to_string();
    assert!(unknown.contains("'rubbr'") && unknown.contains("rubber"), "{unknown}");
    let later = Material { name: "one that comes later".into(), ..Material::preset("rubber").unwrap() };
    assert!(world.set_friction(block, "one that comes later", None).is_err());
    assert!(world.set_friction(block, &later, Some(Friction::from(0.1))).is_ok());
    assert!(world.set_friction(block, "one that comes later", None).is_ok());
    world.remove_body(block).unwrap();
    assert!(world.set_friction(block, "rubber", None).is_err());
}

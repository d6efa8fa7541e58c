//! Static and kinetic friction: slip begins at mu_s, goes on at mu_k, and a stuck contact stays where it is.

use quasirigid::body::{Motion, PoseDrive};
use quasirigid::collider::{Friction, Material};
use quasirigid::math::{Pose, Real, Vec3, Vec6};
use quasirigid::scenes::{Incline, Pinch, PinchOptions};
use quasirigid::{BodyHandle, Parameters, World};

const G: Real = 9.81;

fn friction(static_coefficient: Real, kinetic: Real, stribeck_velocity: Real) -> Friction {
    Friction::coulomb(static_coefficient).unwrap().with_kinetic(kinetic, stribeck_velocity).unwrap()
}

fn incline(dt: Real, friction: Friction, motion: Motion) -> Incline {
    let rubber = Material::preset("rubber").unwrap();
    let mut incline = Incline::new(Parameters { dt, ..Parameters::default() }, &rubber, friction, motion).unwrap();
    incline.run(0.1);
    incline
}

fn x_of(world: &World, body: BodyHandle) -> Real {
    world.body(body).unwrap().pose().translation.x
}

#[test]
fn block_on_incline_sticks_up_to_the_static_coefficient_without_creep() {
    let law = friction(0.5, 0.3, 1e-3);
    for (tangent, slides) in [(0.495, false), (0.505, true)] {
        let mut incline = incline(1e-3, law, Motion::Inertial);
        for k in 1..=200 {
            incline.tilt((tangent * k as Real / 200.0_f64).atan(), 0.0).unwrap();
            incline.world.step();
        }
        incline.run(0.4);
        let before = x_of(&incline.world, incline.block);
        incline.run(0.2);
        let speed = (x_of(&incline.world, incline.block) - before) / 0.2;
        println!("tan {tangent}: {speed:.1e} m/s");
        assert!(if slides { speed > 0.1 } else { speed.abs() < 1e-9 }, "tan {tangent}: {speed:e} m/s");
    }
}

#[test]
fn once_it_slides_it_accelerates_by_what_kinetic_friction_leaves() {
    // Above the static angle it starts by itself; between the two angles it must be pushed, and then slides on: a = g (sin - mu_k cos).
    for (tangent, push) in [(0.55_f64, 0.0), (0.4, 0.05)] {
        let mut incline = incline(1e-3, friction(0.5, 0.3, 1e-3), Motion::Inertial);
        let angle = tangent.atan();
        incline.tilt(angle, 0.0).unwrap();
        if push > 0.0 {
            incline.run(0.1);
            let block = incline.world.body_mut(incline.block).unwrap();
            block.set_velocity(Vec3::new(push, 0.0, 0.0), Vec3::zeros()).unwrap();
        }
        incline.run(0.1);
        let speed = |incline: &Incline| incline.world.body(incline.block).unwrap().linear_velocity().x;
        let v0 = speed(&incline);
        incline.run(0.05);
        let acceleration = (speed(&incline) - v0) / 0.05;
        let truth = G * (angle.sin() - 0.3 * angle.cos());
        println!("tan {tangent}, pushed at {push} m/s: {acceleration:.4} m/s^2 against {truth:.4}");
        assert!((acceleration / truth - 1.0).abs() < 0.01, "tan {tangent}: {acceleration} m/s^2 against {truth}");
    }
}

#[test]
fn coefficient_follows_the_stribeck_curve() {
    // Without inertia the block slides at v = (m g sin - mu(v) m g cos)/b, the root of a scalar equation.
    let (law, angle, viscosity) = (friction(0.5, 0.3, 3e-2), 0.35_f64, 5.0);
    for force in [0.25, 0.3, 0.6] {
        let mut incline = incline(1e-3, law, Motion::QuasiStatic);
        incline.world.body_mut(incline.block).unwrap().set_viscosity(viscosity, 0.01).unwrap();
        incline.tilt(angle, 0.0).unwrap();
        let normal = 0.1 * G * angle.cos();
        // Pulled away first, then with `force` beyond what kinetic friction holds.
        let pull = |incline: &mut Incline, f: Real| {
            let block = incline.world.body_mut(incline.block).unwrap();
            block.set_external_wrench(Vec3::new(f - 0.1 * G * angle.sin(), 0.0, 0.0), Vec3::zeros()).unwrap();
        };
        pull(&mut incline, 0.5 * normal + 1.0);
        incline.run(0.02);
        let total = 0.3 * normal + force;
        pull(&mut incline, total);
        incline.run(0.05);
        let before = x_of(&incline.world, incline.block);
        incline.run(0.02);
        let speed = (x_of(&incline.world, incline.block) - before) / 0.02;
        // From the fast side: the equation has a second root in the falling part of the curve, which is not stable.
        let mut root = total / viscosity;
        for _ in 0..200 {
            root = (total - law.coefficient(root) * normal) / viscosity;
        }
        println!("{force} N beyond kinetic friction: {speed:.5} m/s against {root:.5}");
        assert!((speed / root - 1.0).abs() < 0.01, "{force} N: {speed} m/s against {root}");
    }
}

#[test]
fn block_on_a_pulled_spring_sticks_and_slips_as_the_textbook_says() {
    // Block of mass m on a spring of stiffness k whose end moves at V; y: stretch beyond mu_k N / k, v: speed of the block, w =
    // sqrt(k/m). It sticks until y = y_0 = (mu_s - mu_k) N / k. Then dy/dt = V - v and dv/dt = w^2 y, so v = V (1 - cos wt) + w y_0
    // sin wt, which is zero again at wt = 2 (pi - atan(w y_0 / V)), with y = -y_0. Each cycle therefore lasts 2 y_0 / V + 2 (pi -
    // atan(w y_0 / V)) / w. The stretch is largest and smallest where v = V, in between: y = +-sqrt(y_0^2 + (V/w)^2). That is the
    // limit of a small Stribeck velocity: with a larger one the block is longer under way to kinetic friction, while the spring is
    // pulled on. With a smaller one than that the surface is too soft: where mu'(v) p exceeds k tau, its damping, the lightly loaded
    // side of the block runs away on its own and takes the rest along too early.
    let (mu_s, mu_k, m, k, pull) = (0.6, 0.3, 0.1, 40.0_f64, 0.03);
    let dt = 4e-4;
    let hard = Material::preset("rubber").unwrap().with_elasticity(4e7, 0.45, 5e-3).unwrap();
    let law = friction(mu_s, mu_k, 1e-4);
    let mut incline = Incline::new(Parameters { dt, ..Parameters::default() }, &hard, law, Motion::Inertial).unwrap();
    incline.run(0.1);
    let start = *incline.world.body(incline.block).unwrap().pose();
    let mut stretch = Vec::new();
    for step in 0..(2.3 / dt) as usize {
        let end = start.translation.vector + Vec3::x() * (pull * step as Real * dt);
        let mut drive = PoseDrive::new(Pose::from_parts(end.into(), start.rotation), [k, 0.0], [0.0, 0.0]).unwrap();
        drive.target_velocity = Vec6::new(pull, 0.0, 0.0, 0.0, 0.0, 0.0);
        incline.world.body_mut(incline.block).unwrap().set_drive(Some(drive)).unwrap();
        incline.world.step();
        stretch.push(pull * (step + 1) as Real * dt - x_of(&incline.world, incline.block) + start.translation.x);
    }
    let normal = m * G;
    // Peaks of the spring force: the moments of slip. The first one starts from rest, the others from the end of a slip.
    let is_peak = |i: &usize| {
        let around = i.saturating_sub(100)..(i + 100).min(stretch.len());
        stretch[around].iter().all(|y| *y <= stretch[*i]) && stretch[*i] > 0.0
    };
    let peaks: Vec<usize> = (100..stretch.len() - 100).filter(is_peak).collect();
    assert!(peaks.len() >= 3, "{} slips", peaks.len());
    let (w, y0) = ((k / m).sqrt(), (mu_s - mu_k) * normal / k);
    let slip_time = 2.0 * (std::f64::consts::PI - (w * y0 / pull).atan()) / w;
    let y_peak = y0.hypot(pull / w);
    let period = 2.0 * y0 / pull + slip_time;
    for pair in peaks.windows(2) {
        let lowest = stretch[pair[0]..pair[1]].iter().copied().fold(Real::INFINITY, Real::min);
        let (peak, drop, time) = (k * stretch[pair[0]], k * (stretch[pair[0]] - lowest), (pair[1] - pair[0]) as Real * dt);
        let (peak_truth, drop_truth) = (mu_k * normal + k * y_peak, 2.0 * k * y_peak);
        println!("largest force {peak:.4} N ({peak_truth:.4}), drops by {drop:.4} N ({drop_truth:.4}), period {time:.4} s ({period:.4})");
        assert!((peak / peak_truth - 1.0).abs() < 0.01, "largest force {peak} N against {peak_truth} N");
        assert!((drop / drop_truth - 1.0).abs() < 0.01, "drops by {drop} N against {drop_truth} N");
        assert!((time / period - 1.0).abs() < 0.01, "period {time} s against {period} s");
    }
}

#[test]
fn pinched_box_with_static_above_kinetic_friction_does_not_creep() {
    for (motion, dt) in [(Motion::Inertial, 1e-3), (Motion::Inertial, 1e-2), (Motion::QuasiStatic, 1e-3), (Motion::QuasiStatic, 1e-2)] {
        let mut options = PinchOptions::fingertips(0.6).unwrap();
        options.motion = motion;
        options.params.dt = dt;
        options.box_points = (4_800, 640);
        options.pad_points = (900, 120);
        options.pad_material = options.pad_material.with_friction(friction(0.6, 0.2, 1e-3)).unwrap();
        options.box_material = options.box_material.with_friction(friction(0.6, 0.2, 1e-3)).unwrap();
        let mut pinch = Pinch::new(&options).unwrap();
        // 2 mu_s N = 3.6 N against a weight of 1.96 N; 2 mu_k N = 1.2 N would not hold it.
        pinch.squeeze(3.0).unwrap();
        let steps = (0.5 / dt) as usize;
        for k in 1..=steps {
            pinch.set_gravity(Vec3::new(0.0, 0.0, -G * k as Real / steps as Real)).unwrap();
            pinch.world.step();
        }
        pinch.run(if motion == Motion::Inertial { 6.0 } else { 1.0 });
        let before = *pinch.world.body(pinch.object).unwrap().pose();
        pinch.run(0.5);
        let after = pinch.world.body(pinch.object).unwrap().pose();
        let speed = (after.translation.vector - before.translation.vector).norm() / 0.5;
        let spin = before.rotation.angle_to(&after.rotation) / 0.5;
        println!("{motion:?} dt {dt}: {speed:.1e} m/s, {spin:.1e} rad/s at a height of {:.2e} m", after.translation.z);
        assert!(after.translation.z > -5e-3, "{motion:?} dt {dt}: the box fell to {} m", after.translation.z);
        assert!(speed < 1e-9, "{motion:?} dt {dt}: {speed:e} m/s");
        assert!(spin < 1e-8, "{motion:?} dt {dt}: {spin:e} rad/s");
    }
}

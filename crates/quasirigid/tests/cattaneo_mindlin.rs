//! Cattaneo and Mindlin: a pressed ball is pushed sideways. Stick radius and
//! tangential force within 5 %; loading, unloading and reloading close a loop.

#[path = "common/closed_forms.rs"]
mod closed_forms;

use closed_forms::{DEPTH, Elastic, Hertz, RIGID, indentation, spacing};
use quasirigid::delassus::ContactStatus;
use quasirigid::math::{Real, Vec3};
use quasirigid::scenes::Indentation;

const MU: Real = 0.5;

/// Alike, or incompressible on rigid: normal and tangential displacement are then not coupled, as the closed forms suppose.
const PAIRS: [(&str, [Elastic; 2]); 3] = [
    ("incompressible ball on rigid flat", [(1e6, 0.5), RIGID]),
    ("rigid ball on incompressible flat", [RIGID, (1e6, 0.5)]),
    ("alike", [(1e6, 0.3), (1e6, 0.3)]),
];

/// Direction of the push: along no row of any sampling.
const PUSH: [Real; 2] = [0.8, 0.6];

fn push(scene: &mut Indentation, x: Real) -> Real {
    let report = scene.move_to(DEPTH, PUSH.map(|c| c * x), 0.0).unwrap();
    assert!(report.converged(), "{:?} after {} sweeps, residual {:e}", report.stop, report.sweeps, report.residual);
    let f = scene.force().unwrap();
    -(f.x * PUSH[0] + f.y * PUSH[1])
}

fn pressed(pair: [Elastic; 2], n: usize) -> Indentation {
    let mut scene = indentation(pair, MU, n, true);
    push(&mut scene, 0.0);
    push(&mut scene, 0.0);
    scene
}

/// T/(mu P) after a first push by x, in units of the shift `full` at which all slips (Johnson, eq. 7.42).
fn loading(x: Real) -> Real {
    1.0 - (1.0 - x).max(0.0).powf(1.5)
}

/// T/(mu P) at x after a turn at `top` (Johnson, eq. 7.48, and by Masing's rule its mirror image for the way back up).
fn after_turn(x: Real, top: Real) -> Real {
    top.signum() * (loading(top.abs()) - 2.0 * loading(0.5 * (top - x).abs()))
}

/// Shift at which all slips, m: 3 mu P / (2 k_t).
fn full_slip(hertz: &Hertz) -> Real {
    1.5 * MU * hertz.p / hertz.k_t
}

#[test]
fn tangential_force_follows_the_loop_and_closes_it() {
    let top = 0.9;
    for (name, pair) in PAIRS {
        let hertz = Hertz::new(DEPTH, pair);
        let mut scene = pressed(pair, 400);
        let (full, scale) = (full_slip(&hertz), MU * hertz.p);
        let (mut worst, mut first_top, mut last) = ([0.0; 3], 0.0, 0.0);
        for k in 1..=90 {
            // Up in 18 steps, down in 36, up in 36.
            let (leg, x) = match k {
                1..=18 => (0, k as Real / 20.0),
                19..=54 => (1, (36 - k) as Real / 20.0),
                _ => (2, (k - 72) as Real / 20.0),
            };
            last = push(&mut scene, x * full) / scale;
            let truth = [loading(x), after_turn(x, top), after_turn(x, -top)][leg];
            worst[leg] = Real::max(worst[leg], (last - truth).abs());
            if k == 18 {
                first_top = last;
            }
            assert!((last - truth).abs() < 0.05, "{name}, leg {leg}, x = {x}: T/(mu P) = {last}, closed form {truth}");
            if leg == 0 {
                assert!((last / truth - 1.0).abs() < 0.05, "{name}, x = {x}: T/(mu P) = {last}, closed form {truth}");
            }
        }
        let [up, down, again] = worst.map(|w| 100.0 * w);
        println!(
            "{name}: T off by at most {up:.2} % of mu P loading, {down:.2} % unloading, {again:.2} % reloading; loop open by {:.1e}",
            last - first_top
        );
        assert!((last - first_top).abs() < 1e-3, "{name}: the loop ends {:e} of mu P off where it began", last - first_top);
    }
}

#[test]
fn full_slip_is_at_mu_times_the_normal_force() {
    let (name, pair) = PAIRS[0];
    let hertz = Hertz::new(DEPTH, pair);
    let mut scene = pressed(pair, 200);
    let mut ratio = 0.0;
    for k in 1..=12 {
        ratio = push(&mut scene, 0.1 * k as Real * full_slip(&hertz)) / (MU * scene.force().unwrap().z);
    }
    println!("{name}: T/(mu P) = {ratio:.6} in full slip");
    assert!((ratio - 1.0).abs() < 1e-3, "{name}: T/(mu P) = {ratio} in full slip");
    let slips = |(f, s): (&Vec3, &ContactStatus)| f.x == 0.0 || *s == ContactStatus::Slip;
    let problem = scene.world.contact_problem();
    assert!(problem.reactions.iter().zip(&problem.status).all(slips), "{name}: something sticks");
}

#[test]
fn stick_zone_is_a_disc_of_the_right_radius() {
    for (name, pair) in PAIRS {
        let hertz = Hertz::new(DEPTH, pair);
        let mut scene = pressed(pair, 800);
        for k in 1..=12 {
            let x = 0.075 * k as Real;
            push(&mut scene, x * full_slip(&hertz));
            // c = a (1 - T/(mu P))^(1/3) (Johnson, eq. 7.40).
            let truth = (1.0 - loading(x)).cbrt();
            let problem = scene.world.contact_problem();
            let (mut stuck, mut centre, mut farthest): (Real, Vec3, Real) = (0.0, Vec3::zeros(), 0.0);
            for ((contact, f), status) in scene.world.contacts().iter().zip(&problem.reactions).zip(&problem.status) {
                if f.x > 0.0 && *status == ContactStatus::Stick {
                    (stuck, centre) = (stuck + contact.area, centre + contact.point * contact.area);
                    farthest = farthest.max(contact.point.x.hypot(contact.point.y));
                }
            }
            let c = (stuck / std::f64::consts::PI).sqrt() / hertz.a;
            let centre = (centre / stuck).xy().norm() / hertz.a;
            println!(
                "{name}, x = {x:.3}: stick radius {c:.3} a, closed form {truth:.3} a; farthest {:.3} a, centre off by {centre:.3} a",
                farthest / hertz.a
            );
            assert!((c - truth).abs() < 0.05, "{name}, x = {x}: stick radius {c} a, closed form {truth} a");
            assert!(
                (farthest / hertz.a - truth).abs() < 2.0 * spacing(&scene) / hertz.a,
                "{name}, x = {x}: something sticks at {} a",
                farthest / hertz.a
            );
            assert!(centre < spacing(&scene) / hertz.a, "{name}, x = {x}: stick zone off its place by {centre} a");
        }
    }
}

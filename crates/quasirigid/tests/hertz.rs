//! Hertz: a sphere on a flat, half-space model. Force within 2 %, contact radius
//! within one control spacing, pressure within 5 % of its peak.

#[path = "common/closed_forms.rs"]
mod closed_forms;

use closed_forms::{DEPTH, Elastic, Hertz, RIGID, indentation, spacing};
use quasirigid::math::Real;
use quasirigid::scenes::Indentation;
use std::f64::consts::PI;

/// Soft on rigid either way round, twice the same, and two that differ in everything.
const PAIRS: [(&str, [Elastic; 2]); 4] = [
    ("soft ball on rigid flat", [(1e6, 0.5), RIGID]),
    ("rigid ball on soft flat", [RIGID, (1e6, 0.3)]),
    ("alike", [(1e6, 0.3), (1e6, 0.3)]),
    ("unlike", [(3e6, 0.1), (1e6, 0.45)]),
];

/// Presses to `depth`, off the middle and turned, so that no sampling is lucky. Returns where the middle of the contact is.
fn press(scene: &mut Indentation, depth: Real) -> [Real; 2] {
    let place = [2.3e-4, -1.7e-4];
    // A step sees the geometry of its start: the last one stays where it is.
    scene.move_to(0.5 * depth, place, 0.4).unwrap();
    scene.move_to(depth, place, 0.4).unwrap();
    let report = scene.move_to(depth, place, 0.4).unwrap();
    assert!(report.converged(), "{:?} after {} sweeps, residual {:e}", report.stop, report.sweeps, report.residual);
    place
}

#[test]
fn force_is_that_of_hertz_at_any_depth_for_any_pair() {
    for (name, pair) in PAIRS {
        for fine_ball in [true, false] {
            let mut scene = indentation(pair, 0.0, 400, fine_ball);
            for share in [0.25, 0.5, 0.75, 1.0, 1.25] {
                let depth = share * DEPTH;
                press(&mut scene, depth);
                let error = scene.force().unwrap().z / Hertz::new(depth, pair).p - 1.0;
                println!("{name}, fine ball {fine_ball}, d = {depth:.2e} m: force off by {:.2} %", error * 100.0);
                assert!(error.abs() < 0.02, "{name}, fine ball {fine_ball}, d = {depth} m: force off by {:.2} %", error * 100.0);
            }
        }
    }
}

#[test]
fn contact_radius_is_that_of_hertz_within_one_spacing() {
    for (name, pair) in PAIRS {
        let mut scene = indentation(pair, 0.0, 400, true);
        for share in [0.5, 1.0, 1.25] {
            let middle = press(&mut scene, share * DEPTH);
            let truth = Hertz::new(share * DEPTH, pair).a;
            let (mut area, mut farthest): (Real, Real) = (0.0, 0.0);
            for (contact, _) in scene.world.contacts().iter().zip(&scene.world.contact_problem().reactions).filter(|(_, f)| f.x > 0.0) {
                area += contact.area;
                farthest = farthest.max((contact.point.x - middle[0]).hypot(contact.point.y - middle[1]));
            }
            let s = spacing(&scene);
            for (how, radius) in [("by area", (area / PI).sqrt()), ("farthest", farthest)] {
                println!("{name}: radius {how} {:.3} mm, Hertz {:.3} mm, spacing {:.3} mm", 1e3 * radius, 1e3 * truth, 1e3 * s);
                assert!((radius - truth).abs() < s, "{name}: radius {how} {radius} m, Hertz {truth} m, spacing {s} m");
            }
        }
    }
}

#[test]
fn pressure_profile_is_that_of_hertz() {
    for (name, pair) in PAIRS {
        let mut scene = indentation(pair, 0.0, 800, true);
        let middle = press(&mut scene, DEPTH);
        let hertz = Hertz::new(DEPTH, pair);
        // Rings as wide as two spacings, over which force and area are summed; in the
        // last the border of the contact cuts through control points.
        let width = 2.0 * spacing(&scene);
        let mut rings = vec![(0.0, 0.0); (1.2 * hertz.a / width) as usize + 1];
        let (mut worst, mut at): (Real, Real) = (0.0, 0.0);
        for (contact, f) in scene.world.contacts().iter().zip(&scene.world.contact_problem().reactions) {
            let r = (contact.point.x - middle[0]).hypot(contact.point.y - middle[1]);
            if let Some((force, area)) = rings.get_mut((r / width) as usize) {
                (*force, *area) = (*force + f.x, *area + contact.area);
            }
            let off = (f.x / contact.area - hertz.pressure(r)).abs() / hertz.p0;
            if r < 0.9 * hertz.a && off > worst {
                (worst, at) = (off, r / hertz.a);
            }
        }
        println!("{name}: single control points within 0.9 a off by at most {:.2} % of p0, at {at:.2} a", worst * 100.0);
        assert!(worst < 0.05, "{name}: pressure off by {:.2} % of p0 at {at:.2} a", worst * 100.0);
        for (k, (force, area)) in rings.iter().enumerate() {
            // The force, not the pressure, is compared: areas of whole control points do not fill a ring exactly.
            let (from, to) = (k as Real * width, (k as Real + 1.0) * width);
            let truth = hertz.ring_pressure(from, to);
            let error = (force / area - truth) / hertz.p0;
            println!("{name}: ring to {:.2} a: {:.3} of p0, Hertz {:.3}", to / hertz.a, force / area / hertz.p0, truth / hertz.p0);
            assert!(error.abs() < 0.05, "{name}: ring to {:.2} a off by {:.2} % of p0", to / hertz.a, error * 100.0);
        }
    }
}

#[test]
fn force_converges_as_the_sampling_is_refined() {
    for (name, pair) in PAIRS {
        let found: Vec<Real> = [100, 400, 1600]
            .map(|n| {
                let mut scene = indentation(pair, 0.0, n, true);
                press(&mut scene, DEPTH);
                scene.force().unwrap().z / Hertz::new(DEPTH, pair).p
            })
            .to_vec();
        println!("{name}: force over Hertz {found:.4?}, spacing halved twice");
        for two in found.windows(2) {
            assert!((two[1] / two[0] - 1.0).abs() < 0.03, "{name}: halving the spacing takes F/Hertz from {} to {}", two[0], two[1]);
        }
        assert!((found[2] - 1.0).abs() < 0.005, "{name}: F/Hertz {found:?} does not converge to 1");
    }
}

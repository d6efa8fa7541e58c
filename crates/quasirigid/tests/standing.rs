//! A box that stands on a support smaller than its face rests: contacts at the support's
//! edge stay on its top, from step to step what was predicted comes true.

use quasirigid::delassus::Delassus;
use quasirigid::math::Vec3;
use quasirigid::scenes::{GraspOptions, GraspScene};

#[test]
fn a_squeezed_box_on_a_small_support_does_not_rock_and_gaps_come_out_as_predicted() {
    // A tall box with much friction: where the side of the support could be taken for its top it rocked by 50 mrad/s for ever.
    let options = GraspOptions { size: Vec3::new(0.06, 0.06, 0.08), ..GraspOptions::default() };
    let mut scene = GraspScene::new(&options).unwrap();
    scene.run(0.5).unwrap();
    let mut predicted: Vec<(u32, u32, f64)> = Vec::new();
    let (mut worst_gap, mut worst_spin): (f64, f64) = (0.0, 0.0);
    for _ in 0..10 {
        scene.step().unwrap();
        let problem = scene.world.contact_problem();
        let mut w = problem.assembled().unwrap();
        w.set_reactions(&problem.reactions);
        for contact in scene.world.contacts() {
            if let Some((_, _, gap)) = predicted.iter().find(|(pair, point, _)| (*pair, *point) == (contact.pair, contact.control_point)) {
                worst_gap = worst_gap.max((contact.gap - gap).abs());
            }
        }
        predicted.clear();
        for (i, contact) in scene.world.contacts().iter().enumerate().filter(|(i, _)| problem.reactions[*i].x > 0.0) {
            predicted.push((contact.pair, contact.control_point, w.displacement(i).x + problem.delta_free[i].x));
        }
        worst_spin = worst_spin.max(scene.world.body(scene.object).unwrap().angular_velocity().norm());
    }
    assert!(!predicted.is_empty());
    assert!(worst_gap < 1e-12, "a gap came out {worst_gap:e} m from what was predicted");
    assert!(worst_spin < 1e-5, "the box turns with {worst_spin:e} rad/s");
}

#[test]
fn normals_of_a_pressed_pad_turn_to_face_the_plate() {
    let mut scene = GraspScene::new(&GraspOptions::default()).unwrap();
    assert!(scene.close(3.0).unwrap());
    let thumb = scene.world.hand(scene.hand).unwrap().fingers[0];
    let side = scene.world.side(scene.world.colliders_of(thumb).unwrap()[0]).unwrap();
    let skin = &side.collider.skin;
    let turn = side.pose().rotation;
    let (deformed, rest) = (skin.deformed_normals(), &skin.surface.normals);
    let points = skin.deformed_points();
    // The thumb presses on the box's face x = -30 mm, whose outward normal is -x: the pad's flattened part looks along +x.
    let pressed: Vec<usize> =
        (0..skin.surface.len()).filter(|&k| (turn * points[k] + side.pose().translation.vector).x > -0.03 - 2e-5).collect();
    assert!(pressed.len() > 50, "only {} points touch", pressed.len());
    let mean_angle =
        |normals: &[Vec3]| pressed.iter().map(|&k| (turn * normals[k]).angle(&Vec3::x()).to_degrees()).sum::<f64>() / pressed.len() as f64;
    let (before, after) = (mean_angle(rest), mean_angle(&deformed));
    assert!(after < 0.35 * before && after < 6.0, "mean angle to the plate {before:.1} degrees at rest, {after:.1} deformed");
}

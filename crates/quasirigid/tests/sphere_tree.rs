//! Sphere trees: leaves cover the surface without holes, at rest and deformed;
//! control areas add up; the number of leaves is the one asked for.

use proptest::prelude::*;
use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::{Material, Skin, Sphere};
use quasirigid::math::{Pose, Real, Vec3};
use quasirigid::surface::search::neighbours::NeighbourGrid;
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{Parameters, World};
use std::sync::Arc;

/// Neighbours of a point between which there must be no hole.
const CLOSE: usize = 6;

/// How far the worst point, or midpoint of close neighbours, sticks out of all leaf spheres, m; negative when all are inside.
fn worst_outside(surface: &Surface, points: &[Vec3], spheres: &[Sphere]) -> Real {
    let leaves: Vec<Sphere> = surface.tree.leaves.iter().map(|&n| spheres[n as usize]).collect();
    let outside = |x: &Vec3| leaves.iter().map(|s| (x - s.center).norm() - s.radius).fold(Real::INFINITY, Real::min);
    let grid = NeighbourGrid::build(points, 2.0 * surface.spacing);
    let mut found = Vec::new();
    let mut worst = Real::NEG_INFINITY;
    for p in points {
        worst = worst.max(outside(p));
        grid.k_nearest(p, CLOSE + 1, &mut found);
        for &(k, _) in &found {
            worst = worst.max(outside(&((p + points[k as usize]) * 0.5)));
        }
    }
    worst
}

/// Every inner sphere holds all the points below it.
fn assert_ancestors_hold_their_points(what: &str, surface: &Surface, points: &[Vec3], spheres: &[Sphere]) {
    for (node, sphere) in surface.tree.nodes.iter().zip(spheres) {
        for k in node.points() {
            let out = (points[k] - sphere.center).norm() - sphere.radius;
            assert!(out <= 1e-12, "{what}: a point sticks out of its sphere of level {} by {out:e} m", node.level);
        }
    }
}

fn rest_spheres(surface: &Surface) -> Vec<Sphere> {
    surface.tree.nodes.iter().map(|n| Sphere { center: n.center, radius: n.radius }).collect()
}

fn shapes() -> Vec<(&'static str, PointSurface, usize)> {
    vec![
        ("box", shapes::sample_box(Vec3::new(0.06, 0.04, 0.05), 2_400).unwrap(), 320),
        ("thin plate", shapes::sample_box(Vec3::new(0.06, 0.06, 0.002), 1_500).unwrap(), 211),
        ("sphere", shapes::sample_sphere(0.02, 1_500).unwrap(), 200),
        ("capsule", shapes::sample_capsule(0.01, 0.04, 1_500).unwrap(), 97),
        ("cylinder", shapes::sample_cylinder(0.02, 0.04, 1_500).unwrap(), 150),
        ("fingertip", shapes::sample_fingertip(Vec3::new(0.012, 0.0085, 0.007), 2_400).unwrap(), 320),
        ("one leaf", shapes::sample_sphere(0.02, 60).unwrap(), 1),
        ("two points a leaf", shapes::sample_sphere(0.02, 60).unwrap(), 30),
    ]
}

#[test]
fn leaves_cover_every_shape_without_holes() {
    for (name, points, leaves) in shapes() {
        let area = points.total_area();
        let surface = Surface::build(points, Some(leaves)).unwrap();
        assert_eq!(surface.tree.leaves.len(), leaves, "{name}: leaves");
        assert_eq!(surface.control.len(), leaves, "{name}: control points");
        let sum: Real = surface.control.areas.iter().sum();
        assert!((sum / area - 1.0).abs() < 1e-12, "{name}: control areas add up to {sum} m^2 of {area}");
        let spheres = rest_spheres(&surface);
        let worst = worst_outside(&surface, &surface.points, &spheres);
        println!("{name}: worst point or midpoint {:.3} spacings outside", worst / surface.spacing);
        assert!(worst <= 1e-12, "{name}: a hole, {worst:e} m deep");
        assert_ancestors_hold_their_points(name, &surface, &surface.points, &spheres);
    }
}

#[test]
fn leaves_of_about_seven_points_when_no_number_is_given() {
    let surface = Surface::build(shapes::sample_box(Vec3::repeat(0.06), 36_000).unwrap(), None).unwrap();
    assert_eq!(surface.tree.leaves.len(), 4_800, "the paper's box");
}

#[test]
fn deformed_leaves_cover_the_deformed_surface_at_every_refit_level() {
    for refit_level in [0, 3, 6, 30] {
        for (name, points, leaves) in shapes() {
            let params = Parameters { refit_level, ..Parameters::default() };
            let surface = Arc::new(Surface::build(points, Some(leaves)).unwrap());
            let mut skin = Skin::new(surface.clone(), Material::preset("fingertip_pulp").unwrap()).unwrap();
            // A dent of 1 mm with a bump aside, then a smaller one elsewhere, then none: spheres follow each time.
            for (round, depth) in [1e-3, 4e-4, 0.0].into_iter().enumerate() {
                skin.clear_displacement();
                let home = surface.control.points[(round * leaves / 2).min(leaves - 1)];
                for c in 0..leaves {
                    let r2 = (surface.control.points[c] - home).norm_squared() / (5e-3 * 5e-3);
                    let u = -surface.control.normals[c] * depth * (-r2).exp() + surface.control.tangents[c] * 0.2 * depth * (-r2).exp();
                    if u.norm() > 1e-9 {
                        skin.add_displacement(c as u32, &u);
                    }
                }
                skin.deform(params.deformation_threshold);
                skin.refit(params.refit_level);
                let deformed = skin.deformed_points();
                let what = format!("{name}, refit to level {refit_level}, dent of {depth} m");
                let moved = deformed.iter().zip(&surface.points).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max);
                assert!(moved >= 0.4 * depth, "{what}: points moved by {moved} m only");
                if depth == 0.0 {
                    assert!(moved <= params.deformation_threshold, "{what}: not back at rest by {moved:e} m");
                }
                let worst = worst_outside(&surface, &deformed, &skin.spheres);
                assert!(worst <= 1e-12, "{what}: a hole, {worst:e} m deep");
                assert_ancestors_hold_their_points(&what, &surface, &deformed, &skin.spheres);
            }
        }
    }
}

#[test]
fn a_pressed_pad_stays_covered() {
    let mut world = World::new(Parameters { gravity: Vec3::new(0.0, 0.0, -9.81), ..Parameters::default() }).unwrap();
    let plate = Surface::build(shapes::sample_half_space(0.06, 900).unwrap(), Some(100)).unwrap();
    world
        .add_body(RigidBody::fixed("plate", Pose::identity()).unwrap(), Some((Arc::new(plate), Material::preset("steel").unwrap())))
        .unwrap();
    let ball = Arc::new(Surface::build(shapes::sample_sphere(0.01, 1_200).unwrap(), Some(160)).unwrap());
    let mass = MassProperties::sphere(0.01, Amount::Mass(0.2)).unwrap();
    let body = RigidBody::free("ball", mass, Motion::QuasiStatic, Pose::translation(0.0, 0.0, 0.01)).unwrap();
    let ball_handle = world.add_body(body, Some((ball.clone(), Material::preset("fingertip_pulp").unwrap()))).unwrap();
    (0..200).for_each(|_| drop(world.step()));
    let mut skin = world.skin(ball_handle).unwrap().unwrap().clone();
    skin.refit(world.parameters().refit_level);
    let deformed = skin.deformed_points();
    let moved = deformed.iter().zip(&ball.points).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max);
    let worst = worst_outside(&ball, &deformed, &skin.spheres);
    println!("points moved by up to {moved:.2e} m, worst {worst:.1e} m outside");
    assert!(moved > 2e-4, "points moved by {moved} m only");
    assert!(worst <= 1e-12, "a hole, {worst:e} m deep");
    assert_ancestors_hold_their_points("ball", &ball, &deformed, &skin.spheres);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// A lumpy closed cloud with uneven spacing: normals and areas estimated.
    #[test]
    fn random_clouds_are_covered(
        directions in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 80..400),
        bumps in prop::array::uniform4(-0.3..0.3f64),
        leaf_share in 2usize..12,
    ) {
        let points: Vec<Vec3> = directions
            .iter()
            .map(|d| Vec3::from(*d))
            .filter(|d| d.norm() > 0.1)
            .map(|d| {
                let d = d.normalize();
                d * (0.02 * (1.0 + bumps[0] * d.x + bumps[1] * d.y * d.z + bumps[2] * d.z * d.z + bumps[3] * d.x * d.y))
            })
            .collect();
        let leaves = (points.len() / leaf_share).max(1);
        let cloud = PointSurface::from_points(points).unwrap();
        let area = cloud.total_area();
        let surface = Surface::build(cloud, Some(leaves)).unwrap();
        prop_assert_eq!(surface.tree.leaves.len(), leaves);
        let sum: Real = surface.control.areas.iter().sum();
        prop_assert!((sum / area - 1.0).abs() < 1e-12, "control areas add up to {} m^2 of {}", sum, area);
        let spheres = rest_spheres(&surface);
        let worst = worst_outside(&surface, &surface.points, &spheres);
        prop_assert!(worst <= 1e-12, "a hole, {:e} m deep", worst);
        assert_ancestors_hold_their_points("cloud", &surface, &surface.points, &spheres);
    }
}

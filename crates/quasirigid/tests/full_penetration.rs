//! Full penetration: bodies that were put into each other by half or more, one inside the other, or on the same centre come
//! apart the shortest way, no faster than smaller overlaps do; and the report names the pair until they have.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

#[derive(Clone, Copy, Debug)]
enum Shape {
    Ball(Real),
    Box(Real),
    Capsule(Real),
    /// With bumps and dents, as scans have them.
    Lumpy(Real),
}

/// Distance of the surface of a lumpy body from its centre along the unit vector `u`, m.
fn lumpy_radius(size: Real, u: &Vec3) -> Real {
    size * (1.0 + 0.5 * u.x * u.y + 0.25 * u.z.powi(3))
}

impl Shape {
    fn surface(self) -> Arc<Surface> {
        let n = 600;
        let points = match self {
            Self::Ball(radius) => shapes::sample_sphere(radius, n).unwrap(),
            Self::Box(edge) => shapes::sample_box(Vec3::repeat(edge), n).unwrap(),
            Self::Capsule(radius) => shapes::sample_capsule(radius, 2.5 * radius, n).unwrap(),
            Self::Lumpy(size) => {
                let unit = shapes::sample_sphere(1.0, n).unwrap();
                let points: Vec<Vec3> = unit.points().iter().map(|u| u * lumpy_radius(size, u)).collect();
                // The gradient of |x| - radius(x/|x|).
                let height = |x: Vec3| x.norm() - lumpy_radius(size, &x.normalize());
                let step = 1e-6 * size;
                let slope = |x: &Vec3, axis: usize| height(x + Vec3::ith(axis, step)) - height(x - Vec3::ith(axis, step));
                let normals = points.iter().map(|x| Vec3::from_fn(|axis, _| slope(x, axis)).normalize()).collect();
                PointSurface::from_points_and_normals(points, normals).unwrap()
            }
        };
        Arc::new(Surface::build(points, Some(80)).unwrap())
    }

    /// Half of its thickness, m.
    fn half(self) -> Real {
        match self {
            Self::Ball(half) | Self::Capsule(half) | Self::Lumpy(half) => half,
            Self::Box(edge) => 0.5 * edge,
        }
    }
}

/// Two bodies of 0.1 kg without gravity, the second with its middle at `offset`.
fn world(shapes: [Shape; 2], offset: Vec3, turn: Rot, material: &str) -> (World, [BodyHandle; 2]) {
    let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
    let poses = [Pose::identity(), Pose::from_parts(offset.into(), turn)];
    let handles = [0, 1].map(|i| {
        let mass = MassProperties::sphere(shapes[i].half(), Amount::Mass(0.1)).unwrap();
        let body = RigidBody::free("body", mass, Motion::Inertial, poses[i]).unwrap();
        world.add_body(body, Some((shapes[i].surface(), Material::preset(material).unwrap()))).unwrap()
    });
    (world, handles)
}

fn apart(world: &World, [a, b]: [BodyHandle; 2]) -> Vec3 {
    world.body(b).unwrap().pose().translation.vector - world.body(a).unwrap().pose().translation.vector
}

/// Steps until nothing of one is in the other. Returns how far they have moved
/// against each other, m, and whether the pair was ever reported.
fn come_apart(world: &mut World, pair: [BodyHandle; 2], depth: Real, what: &str) -> (Vec3, bool) {
    let start = apart(world, pair);
    let speed = world.parameters().push_out_speed;
    let (mut fastest, mut reported): (Real, bool) = (0.0, false);
    // Twice the time that the push-out speed needs for the depth.
    let most = (2.0 * depth / speed / world.parameters().dt) as u32 + 200;
    for step in 0..most {
        let report = world.step();
        assert!(report.converged(), "{what}: step {step}: {:?}", report.stop);
        reported |= !report.penetrated.is_empty();
        assert!(report.penetrated.iter().all(|&(a, b)| [a, b] == pair), "{what}: {:?}", report.penetrated);
        fastest = fastest.max(pair.map(|body| world.body(body).unwrap().linear_velocity().norm()).into_iter().fold(0.0, Real::max));
        // Seen after the first step: the first one looks for a way out point by point, and may find none.
        assert!(
            step < 3 || report.contacts > 0 || !report.penetrated.is_empty() || (apart(world, pair) - start).norm() > 0.0,
            "{what}: silent"
        );
        if step > 3 && report.penetrated.is_empty() && report.contacts == 0 {
            let momentum: Vec3 = pair.iter().map(|body| world.body(*body).unwrap().linear_velocity() * 0.1).sum();
            assert!(momentum.norm() < 1e-9, "{what}: momentum {:e} N s out of nothing", momentum.norm());
            assert!(fastest < 1.5 * speed, "{what}: thrown apart at {fastest} m/s");
            return (apart(world, pair) - start, reported);
        }
    }
    panic!("{what}: still {:?} apart after {most} steps", apart(world, pair));
}

#[test]
fn bodies_that_overlap_by_half_or_more_come_apart_the_shorter_way() {
    let pairs = [
        [Shape::Box(0.04), Shape::Box(0.04)],
        [Shape::Box(0.04), Shape::Box(0.02)],
        [Shape::Ball(0.02), Shape::Ball(0.02)],
        [Shape::Ball(0.02), Shape::Ball(0.008)],
        [Shape::Capsule(0.012), Shape::Capsule(0.012)],
        [Shape::Box(0.04), Shape::Capsule(0.012)],
        [Shape::Box(0.04), Shape::Ball(0.02)],
        [Shape::Lumpy(0.02), Shape::Lumpy(0.02)],
        [Shape::Lumpy(0.02), Shape::Box(0.02)],
    ];
    let mut reported = 0;
    for pair in pairs {
        let reach = pair[0].half() + pair[1].half();
        // From an overlap of half of the smaller one to nearly the same centre.
        for share in [1.0 - pair[1].half() / reach, 0.5, 0.25, 0.05] {
            let what = format!("{pair:?}, {share:.2} of the way");
            let offset = Vec3::new(share * reach, 5e-4, -3e-4);
            let (mut world, handles) = world(pair, offset, Rot::identity(), "wood");
            let (moved, seen) = come_apart(&mut world, handles, reach, &what);
            reported += usize::from(seen);
            // Along x lies the shorter way; lumpy ones may know another, and close to the same centre all are about as long.
            let needed = reach - offset.x;
            let lumpy = pair.iter().any(|shape| matches!(shape, Shape::Lumpy(_)));
            println!("{what}: moved {moved:?} for an overlap of {needed:.4} m, reported: {seen}");
            assert!(moved.norm() < 1.3 * needed + 2e-3, "{what}: moved {moved:?} for an overlap of {needed} m");
            assert!(lumpy || share < 0.1 || moved.x > 0.85 * needed, "{what}: moved {moved:?} for an overlap of {needed} m");
        }
    }
    assert!(reported > 18, "reported {reported} times");
}

#[test]
fn bodies_with_one_centre_are_reported_and_come_apart_by_a_way_that_is_always_the_same() {
    for pair in [
        [Shape::Box(0.04), Shape::Box(0.04)],
        [Shape::Box(0.02), Shape::Box(0.05)],
        [Shape::Ball(0.02), Shape::Ball(0.02)],
        [Shape::Ball(0.005), Shape::Ball(0.02)],
        [Shape::Capsule(0.012), Shape::Capsule(0.012)],
        [Shape::Lumpy(0.02), Shape::Lumpy(0.02)],
    ] {
        let what = format!("{pair:?}");
        let reach = pair[0].half() + pair[1].half();
        let ways = [0, 1].map(|_| {
            let (mut world, handles) = world(pair, Vec3::zeros(), Rot::identity(), "wood");
            let (moved, seen) = come_apart(&mut world, handles, reach, &what);
            assert!(seen, "{what}: not reported");
            assert!(moved.norm() < 1.4 * reach, "{what}: moved {moved:?}, {reach} m were needed");
            moved
        });
        assert_eq!(ways[0], ways[1], "{what}");
    }
}

#[test]
fn turned_bodies_of_all_materials_come_apart_too() {
    let mut state = 7u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as Real / (1u64 << 52) as Real - 1.0
    };
    let shapes = [Shape::Box(0.03), Shape::Ball(0.012), Shape::Capsule(0.01), Shape::Lumpy(0.02)];
    for case in 0..24 {
        let pair = [shapes[case % 4], shapes[(case / 4) % 4]];
        let material = ["wood", "rubber", "fingertip_pulp", "steel"][case % 3 + case % 2];
        let offset = Vec3::from_fn(|_, _| 6e-3 * next());
        let turn = Rot::from_scaled_axis(Vec3::from_fn(|_, _| 3.0 * next()));
        let what = format!("case {case}: {pair:?} of {material} at {offset:?}");
        let (mut world, handles) = world(pair, offset, turn, material);
        let (moved, _) = come_apart(&mut world, handles, 2.5 * (pair[0].half() + pair[1].half()), &what);
        assert!(moved.norm() < 2.0 * (pair[0].half() + pair[1].half()), "{what}: moved {moved:?}");
    }
}

#[test]
fn what_only_touches_is_never_called_penetrated() {
    // A ball that rests on a box, and one that hovers inside a ring of boxes.
    let (mut world, [ball, _]) = world([Shape::Ball(0.02), Shape::Box(0.04)], Vec3::new(0.0, 0.0, -0.0401), Rot::identity(), "rubber");
    world.body_mut(ball).unwrap().set_external_wrench(Vec3::new(0.0, 0.0, -3.0), Vec3::zeros()).unwrap();
    for step in 0..400 {
        let report = world.step();
        assert!(report.penetrated.is_empty(), "step {step}: {:?}", report.penetrated);
    }
}

//! Faces carry up to their edges: a block tips where its centre of mass leaves its base, at any sampling, and what stands on something
//! narrower than the control points are
//! apart stands.

use quasirigid::body::{Amount, MassProperties, Motion, RigidBody};
use quasirigid::collider::Material;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::{PointSurface, Surface, shapes};
use quasirigid::{BodyHandle, Parameters, World};
use std::sync::Arc;

const G: Real = 9.81;

fn surface(points: PointSurface) -> Arc<Surface> {
    Arc::new(Surface::build(points, None).unwrap())
}

fn wood() -> Material {
    Material::preset("wood").unwrap().with_friction(1.5).unwrap()
}

/// A body on a floor that is tilted by the angle of tangent `slope` towards +x: the floor lies flat, and gravity is tilted.
fn on_slope(points: PointSurface, mass: MassProperties, turn: Rot, height: Real, slope: Real) -> (World, BodyHandle) {
    let down = Vec3::new(slope, 0.0, -1.0).normalize() * G;
    let mut world = World::new(Parameters { gravity: down, ..Parameters::default() }).unwrap();
    let floor = surface(shapes::sample_half_space(0.3, 3_000).unwrap());
    world.add_body(RigidBody::fixed("floor", Pose::identity()).unwrap(), Some((floor, wood()))).unwrap();
    let pose = Pose::from_parts(Vec3::new(0.0, 0.0, height).into(), turn);
    let body = RigidBody::free("body", mass, Motion::Inertial, pose).unwrap();
    let body = world.add_body(body, Some((surface(points), wood()))).unwrap();
    (world, body)
}

/// By how much a body turns within `steps`, rad.
fn tilt(world: &mut World, body: BodyHandle, steps: usize) -> Real {
    let before = world.body(body).unwrap().pose().rotation;
    (0..steps).for_each(|_| drop(world.step()));
    world.body(body).unwrap().pose().rotation.angle_to(&before)
}

/// Numbers by chance between -0.5 and 0.5.
fn random(mut state: u64) -> impl FnMut() -> Real {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as Real / (1_u64 << 53) as Real - 0.5
    }
}

/// A box of `size` as a mesh sampler makes it: points by chance on each face, none at the same distance from the edge.
fn scattered_box(size: Vec3, n: usize) -> PointSurface {
    let (points, normals, areas) = shapes::sample_box(size, n).unwrap().into_parts();
    let spacing = (areas.iter().sum::<Real>() / n as Real).sqrt();
    let mut random = random(7);
    let shaken = points.iter().zip(&normals).map(|(p, n)| {
        let shift = Vec3::new(random(), random(), random()) * (0.7 * spacing);
        let inside = |v: Real, half: Real| v.clamp(-half, half);
        let q = p + shift - n * n.dot(&shift);
        Vec3::new(inside(q.x, 0.5 * size.x), inside(q.y, 0.5 * size.y), inside(q.z, 0.5 * size.z))
    });
    PointSurface::new(shaken.collect(), normals, areas).unwrap()
}

#[test]
fn a_block_tips_where_its_centre_of_mass_leaves_its_base() {
    let size = Vec3::new(0.02, 0.03, 0.06);
    let upright = Rot::identity();
    let turned = Rot::from_axis_angle(&Vec3::z_axis(), std::f64::consts::FRAC_PI_2);
    let grid = |n| shapes::sample_box(Vec3::new(0.02, 0.03, 0.06), n).unwrap();
    for (name, turn, width, points) in [
        ("upright", upright, size.x, grid as fn(usize) -> PointSurface),
        ("turned by 90 degrees", turned, size.y, grid),
        ("of scattered points", upright, size.x, |n| scattered_box(Vec3::new(0.02, 0.03, 0.06), n)),
    ] {
        for count in [2_000, 4_000, 9_000] {
            let mass = MassProperties::cuboid(size, Amount::Mass(0.1)).unwrap();
            let [stands, tips] = [0.99, 1.01].map(|share| {
                let (mut world, body) = on_slope(points(count), mass, turn, 0.5 * size.z, share * width / size.z);
                tilt(&mut world, body, 350)
            });
            println!("block {name}, {count} points: turns by {stands:.5} rad at 0.99 w/h and by {tips:.5} rad at 1.01 w/h");
            assert!(stands < 2e-3, "block {name}, {count} points: turned by {stands} rad at 0.99 of the slope at which it tips");
            assert!(tips > 0.02, "block {name}, {count} points: turned by {tips} rad only at 1.01 of the slope at which it tips");
        }
    }
}

/// How a body of `density` (kg/m^3) stands after 400 steps on a flat floor: contacts, sinking (m), rotation (rad).
fn stand(points: PointSurface, mass: MassProperties, height: Real) -> (usize, Real, Real) {
    let (mut world, body) = on_slope(points, mass, Rot::identity(), height, 0.0);
    let tilted = tilt(&mut world, body, 400);
    let sunk = height - world.body(body).unwrap().pose().translation.z;
    (world.contacts().iter().filter(|contact| contact.gap < 1e-6).count(), sunk, tilted)
}

#[test]
fn a_card_stands_on_its_edge() {
    let paper = 700.0;
    for (thickness, count) in [(5e-4, 12_000), (3e-4, 4_000), (2e-4, 12_000), (1e-4, 12_000), (5e-5, 4_000)] {
        let size = Vec3::new(thickness, 0.06, 0.06);
        let grid = shapes::sample_box(size, count).unwrap();
        let card = format!("card of {thickness} m, {count} points");
        // Points by chance on the whole surface, as on a mesh: few of them on the edges.
        for (name, points) in [("in rows", grid), ("by chance", random_box(size, count))] {
            let unresolved = Surface::build(points.clone(), None).unwrap().unresolved;
            let mass = MassProperties::cuboid(size, Amount::Density(paper)).unwrap();
            let (contacts, sunk, tilted) = stand(points, mass, 0.03);
            println!(
                "{card} {name}: {contacts} contacts, {unresolved} points unresolved, sunk by {sunk:.1e} m, turned by {tilted:.1e} rad"
            );
            let stands = sunk.abs() < 2e-6 && tilted < 0.1 * thickness / size.z;
            assert!(stands || unresolved > 0, "{card} {name}: sunk by {sunk} m, turned by {tilted} rad, and nothing said");
            assert!(stands || name == "by chance", "{card} {name}: sunk by {sunk} m, turned by {tilted} rad");
        }
    }
}

/// Points by chance on a box, each with the same area.
fn random_box(size: Vec3, n: usize) -> PointSurface {
    let mut random = random(11);
    let areas = [size.y * size.z, size.z * size.x, size.x * size.y];
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for _ in 0..n {
        let mut pick = (random() + 0.5) * areas.iter().sum::<Real>();
        let axis = (0..2).find(|&axis| {
            pick -= areas[axis];
            pick < 0.0
        });
        let axis = axis.unwrap_or(2);
        let sign = if random() < 0.0 { -1.0 } else { 1.0 };
        let mut point = Vec3::new(random() * size.x, random() * size.y, random() * size.z);
        point[axis] = 0.5 * sign * size[axis];
        let mut normal = Vec3::zeros();
        normal[axis] = sign;
        points.push(point);
        normals.push(normal);
    }
    PointSurface::new(points, normals, vec![2.0 * areas.iter().sum::<Real>() / n as Real; n]).unwrap()
}

/// A cup upside down: its rim, an annulus of `radius` and `wall` (m), in the plane z = 0, walls of `height` above it, closed at the top.
fn cup(radius: Real, wall: Real, height: Real, spacing: Real) -> PointSurface {
    let (mut points, mut normals, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let tau = 2.0 * std::f64::consts::PI;
    let mut ring = |r: Real, z: Real, area: Real, phase: Real, normal: &dyn Fn(Vec3) -> Vec3| {
        let count = (tau * r / spacing).round().max(3.0);
        for i in 0..count as usize {
            let (sin, cos) = (tau * (i as Real + phase) / count).sin_cos();
            points.push(Vec3::new(r * cos, r * sin, z));
            normals.push(normal(Vec3::new(cos, sin, 0.0)));
            areas.push(area / count);
        }
    };
    ring(radius - 0.5 * wall, 0.0, tau * (radius - 0.5 * wall) * wall, 0.0, &|_| -Vec3::z());
    for (r, side, top) in [(radius, 1.0, height), (radius - wall, -1.0, height - wall)] {
        let rows = (top / spacing).round();
        for k in 0..rows as usize {
            ring(r, top * (k as Real + 0.5) / rows, tau * r * top / rows, 0.3 * k as Real, &|out| out * side);
        }
        let rings = (r / spacing).round();
        for k in 0..rings as usize {
            let middle = r * (k as Real + 0.5) / rings;
            ring(middle, top, tau * middle * r / rings, 0.3 * k as Real, &|_| Vec3::z() * side);
        }
    }
    PointSurface::new(points, normals, areas).unwrap()
}

#[test]
fn a_cup_stands_on_its_rim_and_tips_over_it() {
    let (radius, height) = (0.03, 0.06);
    for (wall, spacing) in [(1e-3, 1.5e-3), (3e-4, 1.5e-3), (3e-4, 2.5e-3)] {
        let mass = || MassProperties::cuboid(Vec3::new(0.05, 0.05, height), Amount::Mass(0.05)).unwrap();
        // About the middle of the mass, which is that of the cup's height.
        let points = || cup(radius, wall, height, spacing).translated(Vec3::new(0.0, 0.0, -0.5 * height)).unwrap();
        let (contacts, sunk, tilted) = stand(points(), mass(), 0.5 * height);
        let limit = 2.0 * radius / height;
        let [stands, tips] = [0.98, 1.01].map(|share| {
            let (mut world, body) = on_slope(points(), mass(), Rot::identity(), 0.5 * height, share * limit);
            tilt(&mut world, body, 350)
        });
        println!(
            "cup of {wall} m, points {spacing} m apart: {contacts} contacts, sunk by {sunk:.1e} m, turned by {tilted:.1e} rad; \
             {stands:.1e} rad at 0.98 of the slope at which it tips, {tips:.1e} rad at 1.01"
        );
        assert!(sunk.abs() < 2e-6 && tilted < 1e-5, "cup of {wall} m: sunk by {sunk} m, turned by {tilted} rad");
        assert!(stands < 5e-3 && tips > 0.02, "cup of {wall} m: turned by {stands} rad at 0.98 of the slope, {tips} rad at 1.01");
    }
}

/// A blade: a wedge of full angle `angle` (rad), its edge along y in the plane z = 0, `height` (m) high and `length` long, closed at
/// the top.
fn blade(angle: Real, height: Real, length: Real, spacing: Real) -> PointSurface {
    let (mut points, mut normals, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let (sin, cos) = (0.5 * angle).sin_cos();
    let mut face = |corner: Vec3, u: Vec3, normal: Vec3| {
        let (across, along) = ((u.norm() / spacing).ceil(), (length / spacing).ceil());
        for i in 0..across as usize {
            for j in 0..along as usize {
                points.push(corner + u * ((i as Real + 0.5) / across) + Vec3::y() * (length * ((j as Real + 0.5) / along - 0.5)));
                normals.push(normal);
                areas.push(u.norm() * length / (across * along));
            }
        }
    };
    let flank = height / cos;
    for side in [1.0, -1.0] {
        face(Vec3::zeros(), Vec3::new(side * sin, 0.0, cos) * flank, Vec3::new(side * cos, 0.0, -sin));
    }
    let half = height * sin / cos;
    face(Vec3::new(-half, 0.0, height), Vec3::new(2.0 * half, 0.0, 0.0), Vec3::z());
    PointSurface::new(points, normals, areas).unwrap()
}

#[test]
fn a_blade_comes_to_rest_on_its_edge() {
    for angle in [20.0_f64, 30.0, 60.0, 90.0] {
        let mass = MassProperties::cuboid(Vec3::new(0.01, 0.04, 0.02), Amount::Mass(0.02)).unwrap();
        let (mut world, body) = on_slope(blade(angle.to_radians(), 0.02, 0.04, 1e-3), mass, Rot::identity(), 0.0, 0.0);
        (0..60).for_each(|_| drop(world.step()));
        let sunk = -world.body(body).unwrap().pose().translation.z;
        println!("blade of {angle} degrees: {} contacts, sunk by {sunk:.1e} m", world.contacts().len());
        assert!(sunk.abs() < 2e-5, "blade of {angle} degrees: sunk by {sunk} m");
    }
}

#[test]
fn a_face_that_no_control_point_stands_on_is_reported() {
    let size = Vec3::new(1e-3, 0.06, 0.06);
    for (control_points, resolved) in [(2, false), (400, true)] {
        let surface = Surface::build(shapes::sample_box(size, 3_000).unwrap(), Some(control_points)).unwrap();
        println!("{control_points} control points: {} points unresolved", surface.unresolved);
        assert_eq!(surface.unresolved == 0, resolved, "{control_points} control points: {} points unresolved", surface.unresolved);
    }
}

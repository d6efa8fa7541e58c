//! Laws of the smooth surface: plane, sphere and box are reproduced as closely as the spacing allows.

#![expect(clippy::single_range_in_vec_init, reason = "one range of candidates is meant")]

use quasirigid::math::{Real, Vec3};
use quasirigid::surface::PointSurface;
use quasirigid::surface::implicit::{Cloud, Kernel, Projection, project};
use quasirigid::surface::shapes::{sample_box, sample_half_space, sample_sphere};

const MAX_ITERATIONS: u32 = 30;

fn project_on(surface: &PointSurface, x: &Vec3, facing: Option<&Vec3>) -> Option<Projection> {
    let kernel = Kernel::for_spacing(surface.spacing()).unwrap();
    let tolerance = 1e-9 * surface.spacing();
    let all = [0..surface.len() as u32];
    let cloud = Cloud { points: surface.points(), normals: surface.normals(), ranges: &all, kernel: &kernel, facing };
    project(x, &cloud, tolerance, MAX_ITERATIONS)
}

#[test]
fn a_plane_is_exact_up_to_its_border() {
    for n in [400, 950] {
        let surface = sample_half_space(0.1, n).unwrap();
        let s = surface.spacing();
        let mut worst = 0.0 as Real;
        for i in 0..2000 {
            let (u, v) = ((i as Real * 0.618_033_988_749_895).fract() - 0.5, (i as Real * 0.754_877_666_246_693).fract() - 0.5);
            let x = Vec3::new(0.1 * u, 0.1 * v, s * (i % 7 - 3) as Real);
            let p = project_on(&surface, &x, None).unwrap();
            worst = worst.max((p.point - Vec3::new(x.x, x.y, 0.0)).norm() / s).max((p.normal - Vec3::z()).norm());
        }
        println!("plane of {n} points: worst error {worst:.1e} spacings");
        assert!(worst < 1e-12, "plane of {n} points: worst error {worst:.1e} spacings");
    }
}

#[test]
fn a_sphere_is_met_to_second_order_in_the_spacing_or_better() {
    let radius = 0.03;
    let mut errors = Vec::new();
    for n in [600, 2400, 9600] {
        let surface = sample_sphere(radius, n).unwrap();
        let s = surface.spacing();
        let (mut off, mut lateral, mut angle) = (0.0 as Real, 0.0 as Real, 0.0 as Real);
        for (i, direction) in sample_sphere(1.0, 1500).unwrap().normals().iter().enumerate() {
            let x = direction * (radius + s * ((i % 5) as Real - 2.0));
            let p = project_on(&surface, &x, None).unwrap();
            assert!(p.iterations < MAX_ITERATIONS);
            off = off.max((p.point.norm() - radius).abs());
            lateral = lateral.max((p.point.normalize() - direction).norm() * radius);
            angle = angle.max(p.normal.angle(direction));
        }
        println!(
            "R = {:.1} spacings: off the sphere by {:.1e} spacings, sideways {:.1e}, normal {angle:.1e} rad",
            radius / s,
            off / s,
            lateral / s
        );
        errors.push((s, off));
    }
    let (coarse, fine) = (errors[0], errors[2]);
    let order = (coarse.1 / fine.1).ln() / (coarse.0 / fine.0).ln();
    println!("order of convergence {order:.2}");
    assert!(order >= 2.0, "order of convergence {order:.2}");
    for (s, off) in errors {
        assert!(off < 1e-3 * s, "off the sphere by {:.1e} spacings", off / s);
    }
}

#[test]
fn a_box_face_stays_flat_up_to_one_spacing_from_its_edge_and_no_normal_flips() {
    let half = Vec3::new(0.03, 0.02, 0.04);
    for n in [1500, 5000] {
        let surface = sample_box(2.0 * half, n).unwrap();
        let s = surface.spacing();
        let (mut worst, mut angle) = (0.0 as Real, 0.0 as Real);
        let mut checked = 0;
        for face in 0..6 {
            let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut normal = Vec3::zeros();
            normal[axis] = sign;
            let (reach_u, reach_v) = (half[u] - s, half[v] - s);
            for i in 0..60 {
                for j in 0..60 {
                    // A grid that includes the lines one spacing from the edges, from half a spacing inside to half outside.
                    let mut on_face = Vec3::zeros();
                    on_face[axis] = sign * half[axis];
                    on_face[u] = reach_u * (i as Real / 29.5 - 1.0);
                    on_face[v] = reach_v * (j as Real / 29.5 - 1.0);
                    let x = on_face + normal * (s * 0.25 * ((i + j) % 5 - 2) as Real);
                    let p = project_on(&surface, &x, Some(&-normal)).unwrap();
                    worst = worst.max((p.point - on_face).norm() / s);
                    angle = angle.max(p.normal.angle(&normal));
                    checked += 1;
                }
            }
        }
        println!("box of {n} points, {checked} positions: off the face by {worst:.1e} spacings, normal by {angle:.1e} rad");
        assert!(worst < 0.01, "off the face by {worst:.1e} spacings");
        assert!(angle < 1e-6, "normal off by {angle:.1e} rad");
    }
}

#[test]
fn around_a_box_every_projection_lies_on_the_box_and_looks_outward() {
    // Outside, beyond edges and corners too, without a facing direction: the nearest face wins, and none flips.
    let half = Vec3::new(0.03, 0.02, 0.04);
    let surface = sample_box(2.0 * half, 5000).unwrap();
    let s = surface.spacing();
    for direction in sample_sphere(1.0, 3000).unwrap().normals() {
        let on_box = direction * half.component_div(&direction.abs()).min();
        for height in [-0.3, 0.3, 1.0] {
            let x = on_box + direction * (height * s);
            let p = project_on(&surface, &x, None).unwrap();
            assert!(p.normal.amax() > 1.0 - 1e-9, "normal {:?} belongs to no face", p.normal);
            let along = p.normal.dot(&p.point) - p.normal.abs().dot(&half);
            assert!(along.abs() < 1e-6 * s, "{:e} spacings off the face with normal {:?}", along / s, p.normal);
        }
    }
}

#[test]
fn facing_keeps_to_the_side_that_looks_at_the_query() {
    // A plate thinner than the spacing: the far side is nearer than the next points of the near side.
    let surface = sample_box(Vec3::new(0.05, 0.05, 0.0005), 2000).unwrap();
    let s = surface.spacing();
    for i in 0..500 {
        let (u, v) = ((i as Real * 0.618_033_988_749_895).fract() - 0.5, (i as Real * 0.754_877_666_246_693).fract() - 0.5);
        let x = Vec3::new(0.04 * u, 0.04 * v, 0.00025 - s * (i % 4) as Real * 0.5);
        let p = project_on(&surface, &x, Some(&-Vec3::z())).unwrap();
        assert!((p.point - Vec3::new(x.x, x.y, 0.00025)).norm() < 1e-9 && p.normal.z > 0.999_999, "{p:?} from {x:?}");
    }
}

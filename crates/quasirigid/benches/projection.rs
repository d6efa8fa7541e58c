//! Cost of one projection, for leaves of about 80 candidates in several index ranges.

use criterion::{Criterion, criterion_group, criterion_main};
use quasirigid::math::{Real, Vec3};
use quasirigid::surface::implicit::{Cloud, Kernel, project};
use quasirigid::surface::shapes::sample_sphere;
use std::hint::black_box;

fn projection(c: &mut Criterion) {
    let (radius, patch) = (1.0, 80);
    let (points, normals, areas) = sample_sphere(radius, 2400).unwrap().into_parts();
    let s = (areas[0] as Real).sqrt();
    // Patches around several centres, each stored as contiguous ranges, as leaves of a sphere tree are.
    let centres: Vec<Vec3> = sample_sphere(radius, 50).unwrap().points().to_vec();
    let mut leaves = Vec::new();
    for centre in &centres {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&i, &j| (points[i] - centre).norm().total_cmp(&(points[j] - centre).norm()));
        order.truncate(patch);
        let (p, n): (Vec<Vec3>, Vec<Vec3>) = order.iter().map(|&i| (points[i], normals[i])).unzip();
        leaves.push((p, n));
    }
    let ranges: Vec<_> = (0..16u32).map(|r| r * 5..(r + 1) * 5).collect();
    let kernel = Kernel::for_spacing(s).unwrap();
    for height in [0.1, 1.0, 2.0] {
        let mut at = 0;
        c.bench_function(&format!("project, 80 candidates in 16 ranges, {height} spacings above"), |b| {
            b.iter(|| {
                at = (at + 1) % centres.len();
                let (p, n) = &leaves[at];
                let x = centres[at] * (1.0 + height * s);
                let facing = -centres[at];
                let cloud = Cloud { points: p, normals: n, ranges: &ranges, kernel: &kernel, facing: Some(&facing) };
                black_box(project(black_box(&x), &cloud, 1e-6 * s, 10))
            });
        });
    }
}

criterion_group!(benches, projection);
criterion_main!(benches);

//! From an array of points to a surface ready for contact: with normals and areas, with normals, and bare; one thread and two.

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use quasirigid::surface::{PointSurface, Surface, shapes::sample_sphere};
use std::hint::black_box;

const COUNT: usize = 100_000;

fn build(c: &mut Criterion) {
    let (points, normals, areas) = sample_sphere(0.05, COUNT).expect("a sphere").into_parts();
    let mut group = c.benchmark_group(format!("build {COUNT} points"));
    group.sample_size(10);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let mut with = |name: &str, make: &(dyn Fn() -> PointSurface + Sync)| {
            group.bench_function(BenchmarkId::new(name, format!("{threads} threads")), |b| {
                let once = |()| pool.install(|| black_box(Surface::build(make(), None).expect("a surface")));
                b.iter_batched(|| (), once, BatchSize::PerIteration);
            });
        };
        with("normals and areas", &|| PointSurface::new(points.clone(), normals.clone(), areas.clone()).expect("points"));
        with("normals", &|| PointSurface::from_points_and_normals(points.clone(), normals.clone()).expect("points"));
        with("bare", &|| PointSurface::from_points(points.clone()).expect("points"));
    }
    group.finish();
}

criterion_group!(benches, build);
criterion_main!(benches);

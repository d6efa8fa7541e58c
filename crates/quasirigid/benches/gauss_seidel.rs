//! 164 contacts in three patches, a free box between three fingers of four joints: one warm sweep, a warm step and a cold solve.

#[path = "../tests/common/problems.rs"]
mod problems;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use problems::{Pad, Problem, SOFT, grasp};
use quasirigid::gauss_seidel::{Scratch, SolverParameters, Stop, solve};
use quasirigid::math::Vec3;
use std::hint::black_box;

fn bench(c: &mut Criterion) {
    let pads = [("local", SOFT), ("half_space", Pad::HalfSpace { young: 2e5, poisson: 0.45 })];
    for (name, pad) in pads {
        let mut problem = grasp([55, 55, 54], pad, 1e-3, 1e-4);
        let solved = problem.solve(&SolverParameters::default());
        assert_eq!(solved.report.stop, Stop::Converged);
        println!("{name}: {} contacts, {:?}", solved.f.len(), solved.report);

        let (mut status, mut scratch) = (solved.status.clone(), Scratch::default());
        let mut run = |problem: &mut Problem, f: &mut [Vec3], parameters: &SolverParameters| {
            black_box(solve(&mut problem.w, &problem.delta_free, &problem.mu, f, &mut status, parameters, &mut scratch))
        };
        // A tolerance that no residual meets: sweeps and nothing else, 8 plain ones a call.
        let sweeps_only = SolverParameters { tolerance: 1e-300, max_sweeps: 8, ..Default::default() };
        let start = || solved.f.clone();
        c.bench_function(&format!("{name}/8 sweeps"), |b| {
            b.iter_batched_ref(start, |f| run(&mut problem, f, &sweeps_only), BatchSize::SmallInput);
        });
        c.bench_function(&format!("{name}/step at rest"), |b| {
            b.iter_batched_ref(start, |f| run(&mut problem, f, &SolverParameters::default()), BatchSize::SmallInput);
        });
        c.bench_function(&format!("{name}/cold"), |b| {
            b.iter_batched_ref(
                || vec![Vec3::zeros(); solved.f.len()],
                |f| run(&mut problem, f, &SolverParameters::default()),
                BatchSize::SmallInput,
            );
        });
        // The next step of a moving grasp: one micrometre deeper, one sideways.
        for delta in &mut problem.delta_free {
            *delta += Vec3::new(-1e-6, 1e-6, 0.0);
        }
        c.bench_function(&format!("{name}/step in motion"), |b| {
            b.iter_batched_ref(start, |f| run(&mut problem, f, &SolverParameters::default()), BatchSize::SmallInput);
        });
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);

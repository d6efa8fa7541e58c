//! The whole step of the paper's grasp at three squeezes, with about 56, 105 and 164 contacts: the paper's three phases.
//!
//! The box weighs 20 g, so that the lightest squeeze carries it too: the number of contacts comes from the
//! squeeze. The support is gone, the box hangs in the hand by friction alone, gravity is on. Around
//! criterion's figure of a step at rest the times of the stages are printed, median over [`STEPS`] steps:
//! before it at rest, after it while the hand is shaken, when the solver has more to do.

use criterion::{Criterion, criterion_group, criterion_main};
use quasirigid::StepReport;
use quasirigid::math::{Pose, Real};
use quasirigid::scenes::{GraspOptions, GraspScene};
use quasirigid::world::report::STAGES;
use std::hint::black_box;
use std::time::Duration;

/// Squeeze of the thumb (N), and the contacts that the paper reports for the phase.
const PHASES: [(Real, usize); 3] = [(0.3, 56), (1.65, 105), (5.2, 164)];
/// Mass of the box, kg.
const MASS: Real = 0.02;
/// Steps that the printed medians are taken over.
const STEPS: usize = 2_000;
/// Shake of the hand: amplitude (m) and frequency (Hz), along y, across the closing direction.
const SHAKE: (Real, Real) = (1e-3, 3.0);

fn bench(c: &mut Criterion) {
    for (squeeze, paper) in PHASES {
        let options = GraspOptions { squeeze, mass: MASS, ..GraspOptions::default() };
        let mut scene = GraspScene::new(&options).expect("the scene of the benchmark");
        assert!(scene.close(5.0).expect("the hand closes"), "the hand did not settle at {squeeze} N");
        scene.remove_support().expect("the support is there");
        scene.run(0.5).expect("the box hangs");
        let at_rest = reports(&mut scene, |_, _| ());
        let contacts = at_rest[STEPS / 2].contacts;
        println!("\n{squeeze} N: {contacts} contacts (the paper: {paper})");
        print_times("at rest", &at_rest);
        let name = format!("step at rest, {contacts} contacts");
        c.bench_function(&name, |b| b.iter(|| black_box(scene.step().expect("the hand is there"))));
        let in_motion = reports(&mut scene, shake);
        print_times("in motion", &in_motion);
    }
}

/// `STEPS` steps, each after `act` with the number of the step.
fn reports(scene: &mut GraspScene, act: impl Fn(&mut GraspScene, usize)) -> Vec<StepReport> {
    let step = |k| {
        act(scene, k);
        scene.step().expect("the hand is there")
    };
    (0..STEPS).map(step).collect()
}

/// Moves the base of the hand along its sine; the last step brings it back to where it was.
fn shake(scene: &mut GraspScene, k: usize) {
    let dt = scene.world.parameters().dt;
    let at = |k: usize| SHAKE.0 * (std::f64::consts::TAU * SHAKE.1 * (k as Real) * dt).sin();
    let base = scene.world.hand(scene.hand).expect("the hand is there").base;
    let target = Pose::translation(0.0, at(k + 1) - at(k), 0.0) * base;
    scene.world.move_hand_to(scene.hand, target).expect("a finite pose");
}

fn print_times(what: &str, reports: &[StepReport]) {
    let stage = |index: usize| quantile(reports, 0.5, |r| r.times.stages()[index]);
    let part = |pick: fn(&StepReport) -> Duration| quantile(reports, 0.5, pick);
    let sweeps = quantile(reports, 0.5, |r| r.sweeps);
    let most = quantile(reports, 1.0, |r| r.sweeps);
    let missed = reports.iter().filter(|r| !r.converged()).count();
    println!(
        "  {what}: median {:?}, p99 {:?}; {sweeps} sweeps, {most} at most; {missed} of {STEPS} steps unconverged",
        part(|r| r.times.total()),
        quantile(reports, 0.99, |r| r.times.total()),
    );
    for (index, name) in STAGES.iter().enumerate() {
        println!("    {name:19} {:?}", stage(index));
    }
    println!(
        "    parts: traversal {:?}, interpenetration {:?}, hierarchy update {:?}, w_rigid {:?}, w_deform {:?}",
        part(|r| r.times.traverse),
        part(|r| r.times.interpenetration),
        part(|r| r.times.hierarchy_update),
        part(|r| r.times.w_rigid),
        part(|r| r.times.w_deform),
    );
}

/// The value that a share `q` of the reports stays at or below.
fn quantile<T: Ord>(reports: &[StepReport], q: Real, pick: impl Fn(&StepReport) -> T) -> T {
    let mut values: Vec<T> = reports.iter().map(pick).collect();
    values.sort_unstable();
    let last = values.len() - 1;
    values.swap_remove((last as Real * q).round() as usize)
}

criterion_group!(benches, bench);
criterion_main!(benches);

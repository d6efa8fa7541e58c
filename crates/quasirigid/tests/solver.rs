//! The solver against closed forms and its own promises, on problems built by hand.

#[path = "common/problems.rs"]
mod problems;

use problems::{DT, Pad, Problem, SOFT, Solution, free_body_rows, grasp, incline, support};
use quasirigid::delassus::{Assembled, ContactStatus, Delassus, MatrixFree, NO_BODY, natural_map_residual};
use quasirigid::gauss_seidel::{Scratch, SolverParameters, Stop, check_problem, solve};
use quasirigid::math::{Mat3, Mat3x6, Real, Vec3, contact_frame};
use std::time::Duration;

/// The residual once more, from the assembled matrix: nothing of the solver's own bookkeeping.
fn independent_residual(problem: &Problem, f: &[Vec3]) -> Real {
    let mut w = Assembled::from_matrix_free(&problem.w).unwrap();
    w.set_reactions(f);
    let delta: Vec<Vec3> = (0..f.len()).map(|i| w.displacement(i) + problem.delta_free[i]).collect();
    let rho: Vec<Real> = (0..f.len()).map(|i| w.diagonal_block(i).rho()).collect();
    natural_map_residual(&delta, f, &problem.mu, &rho)
}

fn assert_converged(problem: &Problem, solution: &Solution) {
    let report = solution.report;
    assert!(report.stop.converged() && report.residual <= 1e-8, "{report:?}");
    let independent = independent_residual(problem, &solution.f);
    assert!(independent <= 1.01e-8, "reported {:e}, found {independent:e}", report.residual);
}

/// Within one step four corners, each with a tenth of the block's own
/// compliance, deflect by 1/40 of what the block would: force in series.
const SHARE: Real = 1.0 / (1.0 + 0.1 / 4.0);

#[test]
fn block_on_an_incline_sticks_below_and_slips_above_the_friction_angle() {
    let (mass, mu) = (2.0, 0.5);
    let weight = mass * 9.81;
    let critical: Real = Real::atan(mu);
    for (angle, expected) in [(0.999 * critical, ContactStatus::Stick), (1.001 * critical, ContactStatus::Slip)] {
        let mut problem = incline(mass, angle, mu);
        let solution = problem.solve(&SolverParameters::default());
        assert_converged(&problem, &solution);
        assert!(solution.status.iter().all(|s| *s == expected), "{:?} at {angle}", solution.status);
        let total: Vec3 = solution.f.iter().sum();
        let normal = SHARE * weight * angle.cos();
        let friction = if expected == ContactStatus::Stick { SHARE * weight * angle.sin() } else { mu * normal };
        assert!((total - Vec3::new(normal, -friction, 0.0)).norm() < 1e-6 * weight, "{total} for {normal} and {friction}");
    }
}

#[test]
fn sliding_block_accelerates_as_coulomb_says() {
    let (angle, mu) = (0.7, 0.4);
    let mut problem = incline(1.0, angle, mu);
    let solution = problem.solve(&SolverParameters { tolerance: 1e-12, ..Default::default() });
    problem.w.set_reactions(&solution.f);
    let slip = (problem.w.displacement(0) + problem.delta_free[0]).y;
    // The relative displacement has the deflection of the corner in it.
    let deflection = 0.1 * DT * DT * solution.f[0].y;
    let expected = 9.81 * (angle.sin() - mu * SHARE * angle.cos()) * DT * DT;
    assert!((slip - deflection - expected).abs() < 1e-9 * expected, "{} against {expected}", slip - deflection);
}

/// A block between two pads, pulled down with `load`: held up to `2 mu N`.
fn pinched(squeeze: Real, load: Real, mu: Real) -> Problem {
    let mass = 0.2;
    let inertia = Vec3::repeat(1e-4);
    let mut problem = Problem { w: MatrixFree::new(), delta_free: Vec::new(), mu: vec![mu; 2] };
    problem.w.clear(1);
    let compliance = 1e-4;
    for (i, side) in [1.0, -1.0].into_iter().enumerate() {
        // Normal from pad to block, tangent1 up.
        let e = contact_frame(&Vec3::new(-side, 0.0, 0.0), &Vec3::z());
        let rows = free_body_rows(mass, &inertia, &Vec3::new(side * 0.02, 0.0, 0.0), &e, 1.0);
        problem.w.push_contact(0, &rows, NO_BODY, &Mat3x6::zeros(), &Mat3::identity());
        problem.w.push_isotropic(i, compliance);
        problem.delta_free.push(Vec3::new(-squeeze * compliance, -load / mass * DT * DT, 0.0));
    }
    problem.w.finish().unwrap();
    problem
}

#[test]
fn pinched_block_slips_at_twice_mu_n() {
    let (squeeze, mu) = (5.0, 0.6);
    let limit = 2.0 * mu * squeeze;
    for (load, expected) in [(0.999 * limit, ContactStatus::Stick), (1.001 * limit, ContactStatus::Slip)] {
        let mut problem = pinched(squeeze, load, mu);
        let solution = problem.solve(&SolverParameters::default());
        assert_converged(&problem, &solution);
        for (f, status) in solution.f.iter().zip(&solution.status) {
            assert!((f.x - squeeze).abs() < 1e-6 * squeeze, "squeeze {}", f.x);
            // Implicit: over the step the pads' tangential compliance takes its part of the load before the block moves.
            assert!(*status == expected || (expected == ContactStatus::Slip && f.y < mu * f.x * 1.001), "{status:?} at load {load}");
        }
    }
}

#[test]
fn soft_grasps_converge_from_cold() {
    let half_space = Pad::HalfSpace { young: 2e5, poisson: 0.45 };
    let ill_conditioned = Pad::Local { modulus: 3e7, sigma: 3e-3, beta: 0.99 };
    let stiff = Pad::Local { modulus: 1e9, sigma: 3e-3, beta: 0.7 };
    for (name, pad, sink, limit) in [
        ("local", SOFT, 1e-4, 25),
        ("local, sliding", SOFT, 1e-3, 25),
        ("stiff pad", stiff, 1e-4, 50),
        ("nearly pure Gaussian", ill_conditioned, 3e-4, 120),
        ("half-space", half_space, 1e-4, 50),
        ("half-space, sliding", half_space, 1e-3, 50),
    ] {
        let mut problem = grasp([55, 55, 54], pad, 1e-3, sink);
        let solution = problem.solve(&SolverParameters::default());
        println!("{name}: {:?}", solution.report);
        assert_converged(&problem, &solution);
        assert!(solution.report.sweeps <= limit, "{name}: {} sweeps", solution.report.sweeps);
    }
}

/// 100 supports under a rigid box that has 6 coordinates: reactions that differ in 294 ways move nothing but the supports themselves.
#[test]
fn hyperstatic_supports_converge() {
    for softness in [1e-1, 1e-2, 1e-3, 1e-4] {
        for push in [0.0, 0.3, 0.45, 0.6] {
            let mut problem = support(10, softness, push, 0.5);
            let solution = problem.solve(&SolverParameters::default());
            println!("softness {softness:e}, push {push}: {:?}", solution.report);
            assert_converged(&problem, &solution);
        }
    }
}

#[test]
fn hyperstatic_box_stands_evenly_on_equal_supports() {
    let mut problem = support(10, 1e-3, 0.0, 0.5);
    let solution = problem.solve(&SolverParameters { tolerance: 1e-11, ..Default::default() });
    assert!(solution.report.stop.converged(), "{:?}", solution.report);
    let share = 9.81 / (1.0 + 1e-3 / 100.0) / 100.0;
    for f in &solution.f {
        assert!((f - Vec3::new(share, 0.0, 0.0)).norm() < 1e-6 * share, "{f} for {share}");
    }
}

#[test]
fn sweeps_never_exceed_the_cap() {
    let mut problem = support(10, 1e-3, 0.45, 0.5);
    for max_sweeps in [1, 2, 39, 40, 41, 42, 43, 44, 50, 60] {
        let solution = problem.solve(&SolverParameters { max_sweeps, ..Default::default() });
        let report = solution.report;
        assert_eq!((report.sweeps, report.stop), (max_sweeps, Stop::SweepCap), "{report:?}");
        let independent = independent_residual(&problem, &solution.f);
        assert!((independent / report.residual - 1.0).abs() < 1e-6, "{independent:e} against {report:?}");
        for f in &solution.f {
            assert!(f.y.hypot(f.z) <= 0.5 * f.x * (1.0 + 1e-14), "{f} is outside its cone, cap {max_sweeps}");
        }
    }
    let late = problem.solve(&SolverParameters { time_budget: Some(Duration::from_micros(300)), ..Default::default() });
    assert!(late.report.stop == Stop::TimeBudget || late.report.stop.converged(), "{:?}", late.report);
}

/// A rigid block in a rigid gap that is too narrow: no forces help, however
/// large. They must not count as a solution because they are large.
#[test]
fn problem_without_solution_is_not_called_converged() {
    let d = Mat3::identity() * 1e-5;
    let squeezed = Vec3::new(-1e-4, 0.0, 0.0);
    // The same displacement opens one contact and closes the other.
    let opposed = Mat3::from_diagonal(&Vec3::new(-1e-5, 1e-5, 1e-5));
    let mut w = Assembled::from_dense(2, &[d, opposed, opposed, d]).unwrap();
    for mu in [0.0, 0.5] {
        let (mut f, mut status) = (vec![Vec3::zeros(); 2], vec![ContactStatus::Open; 2]);
        let report = solve(&mut w, &[squeezed; 2], &[mu; 2], &mut f, &mut status, &SolverParameters::default(), &mut Scratch::default());
        println!("{report:?} {f:?}");
        assert!(!report.stop.converged(), "{report:?} with {f:?}");
    }
}

#[test]
fn same_problem_same_bits() {
    let solve_once = || support(8, 1e-2, 0.45, 0.5).solve(&SolverParameters::default());
    let (one, two) = (solve_once(), solve_once());
    assert_eq!((one.report, one.f), (two.report, two.f));
}

#[test]
fn assembled_and_matrix_free_give_the_same_reactions() {
    let mut problem = grasp([12, 10, 11], SOFT, 3e-4, 1e-4);
    let parameters = SolverParameters { tolerance: 1e-12, ..Default::default() };
    let free = problem.solve(&parameters);
    let mut w = Assembled::from_matrix_free(&problem.w).unwrap();
    let (mut f, mut status) = (vec![Vec3::zeros(); 33], vec![ContactStatus::Open; 33]);
    let report = solve(&mut w, &problem.delta_free, &problem.mu, &mut f, &mut status, &parameters, &mut Scratch::default());
    assert!(report.stop.converged() && free.report.stop.converged());
    let difference: Real = f.iter().zip(&free.f).map(|(a, b)| (a - b).norm()).sum();
    assert!(difference < 1e-9, "{difference:e} N");
    assert_eq!(status, free.status);
}

#[test]
fn warm_start_from_the_solution_takes_few_sweeps_and_is_improved_a_hundredfold() {
    let mut problem = grasp([55, 55, 54], SOFT, 1e-3, 1e-4);
    let solution = problem.solve(&SolverParameters::default());
    let first = solution.report.residual;
    let again = problem.solve_from(solution.f, &SolverParameters::default());
    assert!(again.report.stop.converged() && again.report.sweeps <= 12, "{} sweeps", again.report.sweeps);
    // Otherwise a held object would creep by the tolerance.
    assert!(again.report.residual < 0.02 * first, "{:e} after {first:e}", again.report.residual);
    let third = problem.solve_from(again.f, &SolverParameters { tolerance: 1e-6, ..Default::default() });
    assert!(third.report.sweeps <= 12, "{} sweeps", third.report.sweeps);
}

#[test]
fn sweep_cap_and_time_budget_are_reported_as_such() {
    let mut problem = grasp([55, 55, 54], SOFT, 1e-3, 1e-4);
    let capped = problem.solve(&SolverParameters { max_sweeps: 3, ..Default::default() });
    assert_eq!((capped.report.sweeps, capped.report.stop), (3, Stop::SweepCap));
    assert!(!capped.report.stop.converged() && capped.report.residual > 1e-8);
    let honest = independent_residual(&problem, &capped.f);
    assert!((honest / capped.report.residual - 1.0).abs() < 1e-6, "{honest:e} against {:e}", capped.report.residual);
    let late = problem.solve(&SolverParameters { time_budget: Some(Duration::ZERO), ..Default::default() });
    // Four sweeps are done whatever the time: with fewer a held object creeps.
    assert_eq!((late.report.sweeps, late.report.stop), (4, Stop::TimeBudget));
    let enough = problem.solve(&SolverParameters { time_budget: Some(Duration::from_secs(60)), min_sweeps: 40, ..Default::default() });
    assert!(enough.report.sweeps >= 40 && enough.report.stop.converged());
}

#[test]
fn reactions_stay_in_their_cones_even_when_stopped_early() {
    for max_sweeps in 1..30 {
        let mut problem = grasp([20, 20, 20], SOFT, 5e-4, 1e-3);
        let solution = problem.solve(&SolverParameters { max_sweeps, ..Default::default() });
        for (f, mu) in solution.f.iter().zip(&problem.mu) {
            assert!(f.x >= 0.0 && f.y.hypot(f.z) <= mu * f.x * (1.0 + 1e-14), "{f} after {max_sweeps} sweeps");
        }
    }
}

#[test]
fn non_finite_numbers_end_in_no_force_and_say_so() {
    let mut problem = grasp([5, 5, 5], SOFT, 3e-4, 1e-4);
    problem.delta_free[7].y = Real::NAN;
    assert!(check_problem(15, &problem.delta_free, &problem.mu).is_err());
    let solution = problem.solve(&SolverParameters::default());
    assert_eq!(solution.report.stop, Stop::NonFinite);
    assert!(solution.f.iter().all(|f| *f == Vec3::zeros()));
    // A bad warm start is no reason to fail.
    problem.delta_free[7].y = 0.0;
    let solution = problem.solve_from(vec![Vec3::repeat(Real::NAN); 15], &SolverParameters::default());
    assert_converged(&problem, &solution);
}

#[test]
fn apart_bodies_feel_nothing() {
    let mut problem = support(3, 0.1, 0.0, 0.5);
    problem.delta_free.fill(Vec3::new(1e-3, 1e-3, 0.0));
    let solution = problem.solve_from(vec![Vec3::new(1.0, 0.0, 0.0); 9], &SolverParameters::default());
    assert!(solution.report.stop.converged() && solution.report.residual == 0.0);
    assert!(solution.f.iter().all(|f| *f == Vec3::zeros()) && solution.status.iter().all(|s| *s == ContactStatus::Open));
}

//! A user's own compliance matrix: one that equals a built-in model gives what the model
//! gives, on either side of a pair; and it holds, repeats and allocates as they do.

#[path = "common/matrices.rs"]
mod matrices;

use matrices::as_matrix;
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::gauss_seidel::SolverParameters;
use quasirigid::math::{Real, Vec3};
use quasirigid::scenes::{Indentation, IndentationOptions};
use quasirigid::{BodyHandle, Parameters, World};
use std::collections::BTreeMap;

/// A ball on a flat, the given side with twice the control points of the other and so the one that carries the contacts.
fn options([ball, flat]: [Material; 2], fine_ball: bool) -> IndentationOptions {
    let params = Parameters { solver: SolverParameters { tolerance: 1e-13, ..SolverParameters::default() }, ..Parameters::default() };
    let (ball_control_points, flat_control_points) = if fine_ball { (200, 100) } else { (100, 200) };
    IndentationOptions { params, radius: 0.05, reach: 5e-3, ball_control_points, flat_control_points, ball, flat }
}

/// A soft material; its surface relaxes in `tau` s.
fn soft(model: ComplianceModel, tau: Real) -> Material {
    let soft = Material {
        name: "soft".into(),
        density: 1000.0,
        friction: 0.4.into(),
        young_modulus: 1e6,
        poisson_ratio: 0.3,
        layer_thickness: 5e-3,
        relaxation_time: tau,
        model,
    };
    soft.checked().unwrap()
}

fn local() -> ComplianceModel {
    ComplianceModel::gaussian(1e6, 0.3, 5e-3).unwrap()
}

/// The same options with both models written down as matrices.
fn with_matrices(options: &IndentationOptions) -> IndentationOptions {
    let scene = Indentation::new(options).unwrap();
    let material = |old: &Material, body: BodyHandle| old.clone().with_model(as_matrix(&scene.world, body)).unwrap();
    IndentationOptions { ball: material(&options.ball, scene.ball), flat: material(&options.flat, scene.flat), ..options.clone() }
}

/// Pressure and friction stress of every contact that carries load, Pa, by control point.
fn pressures(world: &World) -> BTreeMap<u32, Vec3> {
    let all = world.contacts().iter().zip(&world.contact_problem().reactions);
    all.filter(|(_, f)| f.x > 0.0).map(|(contact, f)| (contact.control_point, f / contact.area)).collect()
}

/// Presses, pushes aside, twists and lets go half of it; returns the largest
/// difference of a pressure in any step, over the peak of that step.
fn worst_difference(options: &IndentationOptions) -> Real {
    let mut scenes = [Indentation::new(options).unwrap(), Indentation::new(&with_matrices(options)).unwrap()];
    let path = |k: usize| {
        let t = (k as Real / 20.0).min(1.0);
        let (depth, aside) = (2e-4 * t, 4e-5 * ((k as Real - 20.0) / 20.0).clamp(0.0, 1.0));
        (depth, [aside, -0.5 * aside], 300.0 * aside)
    };
    let (mut worst, mut loaded): (Real, usize) = (0.0, 0);
    for k in 0..60 {
        let (depth, shift, twist) = path(k);
        let reports = scenes.each_mut().map(|scene| scene.move_to(depth, shift, twist).unwrap());
        assert!(reports.iter().all(|report| report.converged()), "step {k}: {reports:?}");
        let [model, matrix] = scenes.each_ref().map(|scene| pressures(&scene.world));
        let peak = model.values().map(Vec3::norm).fold(0.0, Real::max);
        let of = |all: &BTreeMap<u32, Vec3>, c: &u32| all.get(c).copied().unwrap_or_default();
        let off = model.keys().chain(matrix.keys()).map(|c| (of(&model, c) - of(&matrix, c)).norm()).fold(0.0, Real::max);
        worst = worst.max(off / peak.max(1.0));
        loaded = model.len();
    }
    assert!(loaded > 40, "{loaded} loaded contacts");
    worst
}

#[test]
fn a_matrix_equal_to_the_local_model_gives_its_pressures_on_either_side_with_and_without_damping() {
    for fine_ball in [true, false] {
        for tau in [0.0, 5e-3] {
            let worst = worst_difference(&options([soft(local(), tau), soft(local(), tau)], fine_ball));
            println!("fine ball {fine_ball}, tau {tau} s: pressures differ by {worst:.1e} of the peak");
            assert!(worst < 1e-10, "fine ball {fine_ball}, tau {tau} s: pressures differ by {worst:e} of the peak");
        }
    }
}

#[test]
fn a_matrix_of_independent_springs_gives_their_pressures() {
    let springs = ComplianceModel::Gaussian { foundation_modulus: 1e9, width: 1e-3, share: 0.0 };
    for fine_ball in [true, false] {
        let worst = worst_difference(&options([soft(springs.clone(), 1e-3), soft(springs.clone(), 1e-3)], fine_ball));
        println!("fine ball {fine_ball}: pressures differ by {worst:.1e} of the peak");
        assert!(worst < 1e-10, "fine ball {fine_ball}: pressures differ by {worst:e} of the peak");
    }
}

#[test]
fn a_matrix_equal_to_the_half_space_gives_its_pressures() {
    let hard = Material::preset("steel").unwrap();
    for fine_ball in [true, false] {
        let half_space = soft(ComplianceModel::HalfSpace, 0.0);
        // The soft side carries the control points: on the other one a half-space is not interpolated, a matrix is.
        let pair = if fine_ball { [half_space, hard.clone()] } else { [hard.clone(), half_space] };
        let worst = worst_difference(&options(pair, fine_ball));
        println!("fine ball {fine_ball}: pressures differ by {worst:.1e} of the peak");
        assert!(worst < 1e-10, "fine ball {fine_ball}: pressures differ by {worst:e} of the peak");
    }
}

//! Compliance of a surface between its control points: the displacement of point `i` under a force at point `j` (design 3.3).
//!
//! Three models (local, half-space, layer) and a user's own matrix. All are symmetric positive semidefinite, constant
//! in the body's frame, and hold the *static* compliance `K^-1` (m/N). Damping proportional to stiffness, `D = tau
//! K`, makes the compliance over one step `C = (K + D/dt)^-1 = K^-1 (1 - alpha)` with `alpha = tau/(tau + dt)`, and
//! the elastic displacement that would be left without force `u_free = alpha u_previous`.

mod axial;
mod bonded_layer;
mod greens_function;
mod influence;
mod local;
pub mod matrix;

pub use axial::AxialCompliance;
pub use greens_function::{GreensFunction, Loaded};
pub use local::LocalCompliance;
pub use matrix::ComplianceMatrix;

use crate::math::Real;
use crate::surface::control_points::ControlPoints;
use nalgebra::DMatrix;
use std::sync::Arc;

/// Compliance between the control points of one surface, made from its material.
#[derive(Debug, Clone)]
pub enum Compliance {
    /// Normal and tangential displacements that know nothing of each other: two numbers for each pair of control points.
    Local(Arc<LocalCompliance>),
    /// The surface Green's function of an elastic half-space, or of a layer on a rigid backing.
    GreensFunction(GreensFunction),
    /// A matrix that the user supplied.
    Matrix(Arc<ComplianceMatrix>),
}

impl Compliance {
    /// Displacement of the surface under a uniform pressure of 1 Pa on a patch of `area` (m^2), m/Pa. A figure to compare surfaces by.
    pub fn patch_compliance(&self, control: &ControlPoints, area: Real) -> Real {
        match self {
            Self::Local(local) => local.patch_compliance(control, area),
            Self::GreensFunction(greens_function) => greens_function.patch_compliance(area),
            Self::Matrix(matrix) => matrix.patch_compliance(control, area),
        }
    }

    /// The whole static compliance as a matrix (3n x 3n, m/N), ordered as
    /// [`ComplianceMatrix`] has it: to look at, or to change and bring back.
    pub fn assembled(&self, control: &ControlPoints) -> DMatrix<Real> {
        let n = control.len();
        let block = |i: usize, j: usize| match self {
            Self::Local(local) => local.block(control, i, j),
            Self::GreensFunction(greens_function) => greens_function.block(control, i, j),
            Self::Matrix(matrix) => *matrix.block(i, j),
        };
        let mut assembled = DMatrix::zeros(3 * n, 3 * n);
        for j in 0..n {
            for i in 0..n {
                assembled.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block(i, j));
            }
        }
        assembled
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    /// A flat square grid of control points, spacing s.
    fn plate(count: usize, s: Real) -> ControlPoints {
        let mut control = ControlPoints { spacing: s, ..Default::default() };
        for i in 0..count {
            for j in 0..count {
                control.points.push(Vec3::new(i as Real * s, j as Real * s, 0.0));
                control.normals.push(Vec3::z());
                control.tangents.push(Vec3::x());
                control.areas.push(s * s);
            }
        }
        control.inverse_distances = crate::surface::control_points::inverse_distances(&control.points, &control.normals, &control.areas, s);
        control
    }

    #[test]
    fn local_model_gives_p_over_k_under_uniform_pressure_for_any_sampling_and_width() {
        let (k, p) = (2e7, 1e4);
        for (count, s) in [(21, 1e-3), (11, 2e-3), (41, 0.5e-3)] {
            for sigma in [0.2e-3, 1e-3, 2.5e-3] {
                let control = plate(count, s);
                let local = LocalCompliance::gaussian(&control, k, sigma, 0.7);
                let middle = (count / 2) * count + count / 2;
                let u: Real = (0..control.len()).map(|j| local.value(middle, j).normal * p * s * s).sum();
                assert!((u * k / p - 1.0).abs() < 0.01, "u k / p = {} at spacing {s} and sigma {sigma}", u * k / p);
            }
        }
    }

    #[test]
    fn local_model_is_positive_definite_and_symmetric() {
        let control = plate(9, 1e-3);
        let local = LocalCompliance::gaussian(&control, 2e7, 2e-3, 0.7);
        let n = control.len();
        let g = nalgebra::DMatrix::from_fn(n, n, |i, j| local.value(i, j).normal);
        assert!((&g - g.transpose()).norm() < 1e-15 * g.norm());
        let smallest = g.symmetric_eigenvalues().min();
        assert!(smallest > 0.0, "smallest eigenvalue {smallest}");
    }

    #[test]
    fn half_space_model_is_positive_definite_and_reciprocal() {
        let control = plate(7, 1e-3);
        let half_space = GreensFunction::half_space(1e6, 0.3);
        let c = Compliance::GreensFunction(half_space).assembled(&control);
        assert!((&c - c.transpose()).norm() < 1e-14 * c.norm());
        let smallest = c.symmetric_eigenvalues().min();
        assert!(smallest > 0.0, "smallest eigenvalue {smallest}");
    }

    #[test]
    fn half_space_and_layer_stay_positive_definite_on_uneven_and_bent_surfaces() {
        use crate::surface::{PointSurface, Surface, shapes};
        // Random points: no sampling is worse.
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as Real / (1_u64 << 53) as Real
        };
        let scattered: Vec<Vec3> = (0..1200).map(|_| Vec3::new(0.01 * random(), 0.01 * random(), 0.0)).collect();
        // Graded: twice as close on one side as on the other.
        let graded = |x: Real| 0.01 * ((2.0_f64).powf(x) - 1.0);
        let graded: Vec<Vec3> = (0..1200).map(|_| Vec3::new(graded(random()), graded(random()), 0.0)).collect();
        let flat = |points: Vec<Vec3>| {
            let normals = vec![Vec3::z(); points.len()];
            PointSurface::from_points_and_normals(points, normals).unwrap()
        };
        let cases = [
            ("random", flat(scattered)),
            ("graded", flat(graded)),
            ("sphere", shapes::sample_sphere(0.01, 1200).unwrap()),
            ("box", shapes::sample_box(Vec3::new(0.02, 0.01, 0.004), 1200).unwrap()),
        ];
        for (name, surface) in cases {
            let control = Surface::build(surface, Some(200)).unwrap().control;
            let check = |model: String, greens_function: GreensFunction| {
                let c = Compliance::GreensFunction(greens_function).assembled(&control);
                assert!((&c - c.transpose()).norm() < 1e-14 * c.norm(), "{name}, {model}");
                let share = c.symmetric_eigenvalues().min() / (c.trace() / c.nrows() as Real);
                println!("{name}, {model}: smallest eigenvalue {share:.3} of the mean diagonal");
                assert!(share > 0.0, "{name}, {model}: smallest eigenvalue {share:e} of the mean diagonal");
            };
            for nu in [0.0, 0.3, 0.45, 0.49, 0.499] {
                check(format!("half-space, nu {nu}"), GreensFunction::half_space(1e6, nu));
                // Thickness from ten spacings to a third of one.
                for spacings in [10.0, 3.0, 1.4, 1.0, 0.67, 0.33] {
                    check(format!("layer of {spacings} spacings, nu {nu}"), GreensFunction::layer(1e6, nu, spacings * control.spacing));
                    // Without the coupling: over all directions, as it is used.
                    let local = Compliance::Local(Arc::new(LocalCompliance::layer(&control, 1e6, nu, spacings * control.spacing)));
                    let c = local.assembled(&control);
                    assert!((&c - c.transpose()).norm() < 1e-14 * c.norm(), "{name}, local layer of {spacings} spacings, nu {nu}");
                    let share = c.symmetric_eigenvalues().min() / (c.trace() / c.nrows() as Real);
                    println!("{name}, local layer of {spacings} spacings, nu {nu}: smallest eigenvalue {share:.3} of the mean diagonal");
                    assert!(
                        share > 0.0,
                        "{name}, local layer of {spacings} spacings, nu {nu}: smallest eigenvalue {share:e} of the mean diagonal"
                    );
                }
            }
        }
    }

    #[test]
    fn half_space_model_gives_the_mean_sinking_of_a_uniformly_loaded_square() {
        // Johnson, eq. 3.25 ff.: centre of a uniformly loaded square of side b: u = 1.122 (1 - nu^2) p b / E.
        let (e, nu, p, s, count) = (1e6, 0.3, 1e3, 0.25e-3, 41);
        let control = plate(count, s);
        let half_space = GreensFunction::half_space(e, nu);
        let middle = (count / 2) * count + count / 2;
        let u: Real = (0..control.len()).map(|j| half_space.block(&control, middle, j)[(2, 2)] * p * s * s).sum();
        let truth = 1.1222 * (1.0 - nu * nu) * p * (count as Real * s) / e;
        assert!((u / truth - 1.0).abs() < 0.01, "u / truth = {}", u / truth);
    }
}

//! Compliance of a surface between its control points: the displacement of point `i` under a force at point `j` (design 3.3).
//!
//! Three models (local, half-space, layer) and a user's own matrix. All are symmetric positive semidefinite, constant
//! in the body's frame, and hold the *static* compliance `K^-1` (m/N). Damping proportional to stiffness, `D = tau
//! K`, makes the compliance over one step `C = (K + D/dt)^-1 = K^-1 (1 - alpha)` with `alpha = tau/(tau + dt)`, and
//! the elastic displacement that would be left without force `u_free = alpha u_previous`.

mod bonded_layer;
mod greens_function;
mod influence;
pub mod matrix;

pub use greens_function::{GreensFunction, Loaded};
pub use matrix::ComplianceMatrix;

use crate::math::{Mat3, Real};
use crate::surface::control_points::ControlPoints;
use crate::surface::search::neighbours::NeighbourGrid;
use crate::surface::surface_model::Rows;
use nalgebra::DMatrix;
use std::sync::Arc;

/// The Gaussian of the local model is cut here, in widths sigma: exp(-6.25) = 0.002 of its peak. What is cut off stays well
/// below the local share on the diagonal, so the operator stays positive definite.
const GAUSSIAN_CUT: Real = 2.5;

/// Compliance between the control points of one surface, made from its material.
#[derive(Debug, Clone)]
pub enum Compliance {
    /// The paper's model: a Gaussian of influence and a local share; isotropic, so one number for each pair.
    Local(Arc<LocalCompliance>),
    /// The surface Green's function of an elastic half-space, or of a layer on a rigid backing.
    GreensFunction(GreensFunction),
    /// A matrix that the user supplied.
    Matrix(Arc<ComplianceMatrix>),
}

/// Local model: `u_i = sum_j G_ij f_j`, the same in all directions.
#[derive(Debug, Clone)]
pub struct LocalCompliance {
    /// For each control point those that reach it, itself among them.
    pub neighbours: Rows,
    /// `G_ij`, m/N, for each entry.
    pub values: Vec<Real>,
    /// `(1 - beta) / k`, m^3/N.
    local_share: Real,
}

impl Compliance {
    /// Displacement of the surface under a uniform pressure of 1 Pa on a patch of `area` (m^2), m/Pa. A figure to compare surfaces by.
    pub fn patch_compliance(&self, control: &ControlPoints, area: Real) -> Real {
        match self {
            // A row sums to 1/k, whatever the patch.
            Self::Local(local) => {
                local.neighbours.range(0).map(|e| local.values[e] * control.areas[local.neighbours.index[e] as usize]).sum()
            }
            Self::GreensFunction(greens_function) => greens_function.patch_compliance(area),
            Self::Matrix(matrix) => matrix.patch_compliance(control, area),
        }
    }

    /// The whole static compliance as a matrix (3n x 3n, m/N), ordered as
    /// [`ComplianceMatrix`] has it: to look at, or to change and bring back.
    pub fn assembled(&self, control: &ControlPoints) -> DMatrix<Real> {
        let n = control.len();
        let block = |i: usize, j: usize| match self {
            Self::Local(local) => Mat3::identity() * local.value(i, j),
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

impl LocalCompliance {
    /// Builds the table.
    ///
    /// With foundation modulus `k` (N/m^3), width `sigma` (m) and share `beta` of the Gaussian (design 3.3):
    ///
    /// ```text
    /// G_ij = (1 - beta) delta_ij / (k A_i) + beta g_ij / (k sqrt(S_i S_j))
    /// g_ij = exp(-|p_i - p_j|^2 / sigma^2) ((1 + n_i . n_j) / 2)^2       S_i = sum_j g_ij A_j
    /// ```
    ///
    /// `S` is the discrete form of `pi sigma^2`: with it a uniform pressure p gives p/k whatever the sampling, also where the surface ends
    /// and where control points are sparser than sigma. The factor of the normals uncouples the two sides of a thin plate.
    /// Gaussian, Schur product and congruence each keep the matrix positive semidefinite.
    pub fn build(control: &ControlPoints, foundation_modulus: Real, width: Real, share: Real) -> Self {
        let (k, sigma, beta) = (foundation_modulus, width, share);
        let reach = GAUSSIAN_CUT * sigma;
        let grid = NeighbourGrid::build(&control.points, reach.max(control.spacing));
        let mut neighbours = Rows::default();
        let mut values = Vec::new();
        let mut row: Vec<(u32, Real)> = Vec::new();
        for (i, p) in control.points.iter().enumerate() {
            row.clear();
            row.push((i as u32, 1.0));
            if beta > 0.0 {
                grid.for_each_within(p, reach, |j, distance2| {
                    let facing = 0.5 * (1.0 + control.normals[i].dot(&control.normals[j as usize]));
                    if j as usize != i && facing > 0.0 {
                        row.push((j, (-distance2 / (sigma * sigma)).exp() * facing * facing));
                    }
                });
            }
            row.sort_unstable_by_key(|entry| entry.0);
            neighbours.push_row(row.iter().map(|entry| entry.0));
            values.extend(row.iter().map(|entry| entry.1));
        }
        let sums: Vec<Real> = (0..control.len())
            .map(|i| neighbours.range(i).map(|e| values[e] * control.areas[neighbours.index[e] as usize]).sum())
            .collect();
        for i in 0..control.len() {
            for e in neighbours.range(i) {
                let j = neighbours.index[e] as usize;
                let local = if i == j { (1.0 - beta) / (k * control.areas[i]) } else { 0.0 };
                values[e] = local + beta * values[e] / (k * (sums[i] * sums[j]).sqrt());
            }
        }
        Self { neighbours, values, local_share: (1.0 - beta) / k }
    }

    /// What the diagonal changes by when contact `i` stands for `area` instead of its control point's own area (a traversal stopped early):
    /// the local share is that of the larger area, the Gaussian already sums over it.
    pub fn change_for_area(&self, control: &ControlPoints, i: usize, area: Real) -> Real {
        if area == control.areas[i] { 0.0 } else { self.local_share * (1.0 / area - 1.0 / control.areas[i]) }
    }

    /// `G_ij`, m/N; 0 where `j` does not reach `i`.
    pub fn value(&self, i: usize, j: usize) -> Real {
        let range = self.neighbours.range(i);
        self.neighbours.index[range.clone()].binary_search(&(j as u32)).map_or(0.0, |e| self.values[range.start + e])
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
                let local = LocalCompliance::build(&control, k, sigma, 0.7);
                let middle = (count / 2) * count + count / 2;
                let u: Real = (0..control.len()).map(|j| local.value(middle, j) * p * s * s).sum();
                assert!((u * k / p - 1.0).abs() < 0.01, "u k / p = {} at spacing {s} and sigma {sigma}", u * k / p);
            }
        }
    }

    #[test]
    fn local_model_is_positive_definite_and_symmetric() {
        let control = plate(9, 1e-3);
        let local = LocalCompliance::build(&control, 2e7, 2e-3, 0.7);
        let n = control.len();
        let g = nalgebra::DMatrix::from_fn(n, n, |i, j| local.value(i, j));
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

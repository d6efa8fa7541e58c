//! The local model: normal and tangential displacements that know nothing of each other, so that two numbers say what one control
//! point does to another. They are tabulated when the surface gets its material.
//!
//! Either the paper's Gaussian, the same in all directions, or a bonded elastic layer of which only the coupling of the two is left out, as
//! Goodman (1962) did for rolling bodies: what a tangential load does to the normal displacement, and the reverse.

use super::{AxialCompliance, GreensFunction, Loaded};
use crate::math::{Mat3, Real};
use crate::surface::control_points::ControlPoints;
use crate::surface::rows::Rows;
use crate::surface::search::neighbours::NeighbourGrid;

/// The Gaussian is cut here, in widths sigma: exp(-6.25) = 0.002 of its peak. What is cut off stays well
/// below the local share on the diagonal, so the operator stays positive definite.
const GAUSSIAN_CUT: Real = 2.5;

/// The layer is cut here, in thicknesses: displacements are below 0.5 % of those at a tenth of a thickness, and
/// patches of which more than the rims are farther apart are three times as wide as the layer is thick.
const LAYER_CUT: Real = 2.5;

/// ... or here, in control spacings: patches of more than a thousand contacts are farther apart.
const LAYER_CUT_SPACINGS: Real = 18.0;

/// Local model: `u_i = sum_j G_ij f_j`.
#[derive(Debug, Clone)]
pub struct LocalCompliance {
    /// For each control point those that reach it, itself among them.
    pub neighbours: Rows,
    /// `G_ij`, m/N, for each entry.
    pub values: Vec<AxialCompliance>,
    own: Own,
}

/// What a control point does to itself, as a function of the area that it stands for.
#[derive(Debug, Clone)]
enum Own {
    /// `(1 - beta) / k`, m^3/N, over the area.
    Spring(Real),
    Layer(GreensFunction),
}

impl LocalCompliance {
    /// The paper's model.
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
    pub fn gaussian(control: &ControlPoints, foundation_modulus: Real, width: Real, share: Real) -> Self {
        let (k, sigma, beta) = (foundation_modulus, width, share);
        let reach = if beta > 0.0 { Self::gaussian_reach(sigma) } else { 0.0 };
        let (neighbours, mut values) = table(control, reach, |i, j, distance2| {
            let facing = 0.5 * (1.0 + control.normals[i].dot(&control.normals[j]));
            let value = if i == j { 1.0 } else { (-distance2 / (sigma * sigma)).exp() * facing * facing };
            (value > 0.0).then(|| AxialCompliance::isotropic(value))
        });
        let sums: Vec<Real> = (0..control.len())
            .map(|i| neighbours.range(i).map(|e| values[e].normal * control.areas[neighbours.index[e] as usize]).sum())
            .collect();
        for i in 0..control.len() {
            for e in neighbours.range(i) {
                let j = neighbours.index[e] as usize;
                let local = if i == j { (1.0 - beta) / (k * control.areas[i]) } else { 0.0 };
                values[e] = AxialCompliance::isotropic(local + beta * values[e].normal / (k * (sums[i] * sums[j]).sqrt()));
            }
        }
        Self { neighbours, values, own: Own::Spring((1.0 - beta) / k) }
    }

    /// A bonded elastic layer of this `thickness` (m) without its coupling: [`GreensFunction::uncoupled`].
    pub fn layer(control: &ControlPoints, young_modulus: Real, poisson_ratio: Real, thickness: Real) -> Self {
        let layer = GreensFunction::layer(young_modulus, poisson_ratio, thickness);
        let reach = Self::layer_reach(control, thickness);
        let at = |i: usize| Loaded { point: control.points[i], normal: control.normals[i], area: control.areas[i] };
        let (neighbours, values) = table(control, reach, |i, j, _| {
            if i == j { Some(layer.own(control.areas[i], control.inverse_distances[i])) } else { layer.uncoupled(&at(i), &at(j)) }
        });
        Self { neighbours, values, own: Own::Layer(layer) }
    }

    /// Distance beyond which the Gaussian of this `width` is cut, m.
    pub(crate) fn gaussian_reach(width: Real) -> Real {
        GAUSSIAN_CUT * width
    }

    /// Distance beyond which a layer of this `thickness` (m) is cut, m.
    pub(crate) fn layer_reach(control: &ControlPoints, thickness: Real) -> Real {
        (LAYER_CUT * thickness).min(LAYER_CUT_SPACINGS * control.spacing)
    }

    /// What the diagonal changes by when contact `i` stands for `area` (m^2) instead of its control point's own area (a traversal stopped
    /// early): the share of its neighbours already sums over it.
    pub fn change_for_area(&self, control: &ControlPoints, i: usize, area: Real) -> AxialCompliance {
        let before = control.areas[i];
        match &self.own {
            Own::Spring(share) => AxialCompliance::isotropic(share * (1.0 / area - 1.0 / before)),
            Own::Layer(layer) => {
                let m = control.inverse_distances[i];
                layer.own(area, m * (before / area).sqrt()) - layer.own(before, m)
            }
        }
    }

    /// How far a patch of `area` (m^2) sinks in under a uniform pressure, m/Pa.
    pub fn patch_compliance(&self, control: &ControlPoints, area: Real) -> Real {
        match &self.own {
            // A row sums to 1/k, whatever the patch.
            Own::Spring(_) => {
                self.neighbours.range(0).map(|e| self.values[e].normal * control.areas[self.neighbours.index[e] as usize]).sum()
            }
            Own::Layer(layer) => layer.patch_compliance(area),
        }
    }

    /// `G_ij`, m/N; 0 where `j` does not reach `i`.
    pub fn value(&self, i: usize, j: usize) -> AxialCompliance {
        let range = self.neighbours.range(i);
        let found = self.neighbours.index[range.clone()].binary_search(&(j as u32));
        found.map_or_else(|_| AxialCompliance::default(), |e| self.values[range.start + e])
    }

    /// Whether all values are the same along the normals and across them; then the block is that number times the identity, whatever the
    /// normals.
    pub fn is_isotropic(&self) -> bool {
        matches!(self.own, Own::Spring(_))
    }

    /// `G_ij` as a block, body axes, m/N.
    pub fn block(&self, control: &ControlPoints, i: usize, j: usize) -> Mat3 {
        let value = self.value(i, j);
        if self.is_isotropic() { Mat3::identity() * value.normal } else { value.block(&control.normals[i], &control.normals[j]) }
    }
}

/// Rows of all pairs of control points within `reach` (m); `value` of a pair and the square of its distance, where it has one.
fn table(
    control: &ControlPoints,
    reach: Real,
    value: impl Fn(usize, usize, Real) -> Option<AxialCompliance>,
) -> (Rows, Vec<AxialCompliance>) {
    let grid = NeighbourGrid::build(&control.points, reach.max(control.spacing));
    let (mut neighbours, mut values) = (Rows::default(), Vec::new());
    let mut row: Vec<(u32, AxialCompliance)> = Vec::new();
    for (i, p) in control.points.iter().enumerate() {
        row.clear();
        row.extend(value(i, i, 0.0).map(|own| (i as u32, own)));
        if reach > 0.0 {
            grid.for_each_within(p, reach, |j, distance2| {
                if j as usize != i {
                    row.extend(value(i, j as usize, distance2).map(|entry| (j, entry)));
                }
            });
        }
        row.sort_unstable_by_key(|entry| entry.0);
        neighbours.push_row(row.iter().map(|entry| entry.0));
        values.extend(row.iter().map(|entry| entry.1));
    }
    (neighbours, values)
}

//! Control points: one for each leaf of the sphere tree, its centre projected on the surface. They carry the compliance.

use crate::math::{Real, Vec3, any_perpendicular};
use crate::surface::kernel::Kernel;
use crate::surface::moving_least_squares::project;
use crate::surface::sphere_tree::SphereTree;
use rayon::prelude::*;
use std::ops::Range;

/// Most control points that one surface point is interpolated from.
pub const MAX_WEIGHTS: usize = 16;

/// Control points of one surface, in its body's frame. Index = leaf index.
#[derive(Debug, Clone, Default)]
pub struct ControlPoints {
    /// Positions on the undeformed surface, m.
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// A unit tangent of each, fixed in the body: contact frames follow it.
    pub tangents: Vec<Vec3>,
    /// Area `A_c` that each stands for, m^2: the areas of its leaf's points, so that they add up to the surface's area.
    pub areas: Vec<Real>,
    /// Mean spacing, sqrt(total area / count), m: the bandwidth of the interpolation of eq. 8.
    pub spacing: Real,
}

/// Weights of one interpolation (eq. 8): `u(x) = sum w_k u_k`, the weights adding up to 1.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// Number of entries in use.
    pub len: usize,
    /// Control points.
    pub index: [u32; MAX_WEIGHTS],
    /// Their weights.
    pub weight: [Real; MAX_WEIGHTS],
}

impl Weights {
    /// No control point at all: of a surface that does not yield.
    pub fn none() -> Self {
        Self { len: 0, index: [0; MAX_WEIGHTS], weight: [0.0; MAX_WEIGHTS] }
    }

    /// All weight on one control point.
    pub fn single(control_point: u32) -> Self {
        let mut weights = Self { len: 1, index: [0; MAX_WEIGHTS], weight: [0.0; MAX_WEIGHTS] };
        (weights.index[0], weights.weight[0]) = (control_point, 1.0);
        weights
    }

    /// (control point, weight) pairs.
    pub fn iter(&self) -> impl Iterator<Item = (usize, Real)> + '_ {
        (0..self.len).map(|k| (self.index[k] as usize, self.weight[k]))
    }

    fn insert(&mut self, index: u32, weight: Real) {
        let mut slot = self.len;
        if self.len == MAX_WEIGHTS {
            let smallest = (0..MAX_WEIGHTS).min_by(|&a, &b| self.weight[a].total_cmp(&self.weight[b])).unwrap_or(0);
            if self.weight[smallest] >= weight {
                return;
            }
            slot = smallest;
        } else {
            self.len += 1;
        }
        (self.index[slot], self.weight[slot]) = (index, weight);
    }
}

impl ControlPoints {
    /// Projects every leaf's centre on the surface. `points` and `normals` are in tree order; `border` yields the point ranges
    /// of a leaf and its neighbours.
    pub(crate) fn build(
        tree: &SphereTree,
        points: &[Vec3],
        normals: &[Vec3],
        kernel: &Kernel,
        border: impl Fn(usize, &mut Vec<Range<u32>>) + Sync,
    ) -> Self {
        let on_surface = |ranges: &mut Vec<Range<u32>>, leaf: usize| {
            let node = tree.leaf(leaf);
            ranges.clear();
            border(leaf, ranges);
            let nearest = node
                .points()
                .min_by(|&a, &b| (points[a] - node.center).norm_squared().total_cmp(&(points[b] - node.center).norm_squared()))
                .unwrap_or(node.first_point as usize);
            // Only points that look the way of this leaf may decide where its surface is: the other side of a thin plate is near, too.
            let facing = -normals[nearest];
            project(&node.center, points, normals, ranges, kernel, Some(&facing), 1e-12, 20)
                .map_or((points[nearest], normals[nearest]), |p| (p.point, p.normal))
        };
        let found: Vec<(Vec3, Vec3)> = (0..tree.leaves.len()).into_par_iter().map_init(Vec::new, on_surface).collect();
        let mut control = Self::default();
        for (leaf, (point, normal)) in found.into_iter().enumerate() {
            control.points.push(point);
            control.normals.push(normal);
            control.tangents.push(any_perpendicular(&normal));
            control.areas.push(tree.leaf(leaf).area);
        }
        control.spacing = (control.areas.iter().sum::<Real>() / control.areas.len() as Real).sqrt();
        control
    }

    /// Number of control points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Gaussian weights of the control points around `x`, out of `candidates`; all on `home` when none is near.
    ///
    /// `theta(r) = exp(-r^2/h^2) - exp(-4)`, cut at `r = 2 h` with `h` 0.8 control spacings (eq. 8; about 8 control points), times the agreement of the normals,
    /// so that a face does not pull at the face around the edge.
    pub fn weights(&self, x: &Vec3, normal: &Vec3, home: u32, candidates: &[u32]) -> Weights {
        let h2 = 0.64 * self.spacing * self.spacing;
        let floor = (-4.0_f64).exp();
        let mut weights = Weights { len: 0, index: [0; MAX_WEIGHTS], weight: [0.0; MAX_WEIGHTS] };
        for &c in std::iter::once(&home).chain(candidates) {
            let r2 = (self.points[c as usize] - x).norm_squared();
            let agreement = 2.0 * normal.dot(&self.normals[c as usize]) - 1.0;
            if r2 < 4.0 * h2 && agreement > 0.0 {
                weights.insert(c, ((-r2 / h2).exp() - floor) * agreement * agreement);
            }
        }
        let total: Real = weights.weight[..weights.len].iter().sum();
        if total <= 1e-9 {
            return Weights::single(home);
        }
        weights.weight[..weights.len].iter_mut().for_each(|w| *w /= total);
        weights
    }
}

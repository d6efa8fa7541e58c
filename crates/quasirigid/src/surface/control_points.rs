//! Control points: one for each leaf of the sphere tree, its centre projected on the surface, or on the edge that it reaches. They
//! carry the compliance.

use crate::interrupt::Interrupt;
use crate::math::{Real, Vec3, any_perpendicular};
use crate::surface::edges::{Place, Samples, choose_sides, place, share_areas};
use crate::surface::implicit::kernel::{Kernel, exp_minus};
use crate::surface::implicit::{Cloud, project};
use crate::surface::rows::Rows;
use crate::surface::search::lane::{LANES, Lane};
use crate::surface::search::neighbours::NeighbourGrid;
use crate::surface::sphere_tree::SphereTree;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::ops::Range;

/// Most control points that one surface point is interpolated from.
pub const MAX_WEIGHTS: usize = 16;

/// How near to the surface control points are placed, over the bandwidth of its weights.
const ON_SURFACE: Real = 1e-8;

/// Width of the window of [`inverse_distances`], control spacings, and where it is cut, widths.
/// Narrower leaves a lattice's own ripple in it, wider asks for patches of more control points: with
/// 2, a Hertz contact of 50 control points is within 1 %, one of 160 within 0.2 %.
const OWN_WINDOW: Real = 2.0;
const OWN_WINDOW_CUT: Real = 3.0;
/// Lattice sum without window less that with it, spacing 1: 3.90026 - 3.84209.
const OWN_WINDOW_BIAS: Real = 0.05817;
/// Share of the window that must be covered.
const LEAST_COVER: Real = 0.85;
/// Own term of a regular grid over that of a disc of the same area (square 1.1002, hexagonal 1.1061), and the bounds
/// within which uneven points may take it: below them the compliance could lose its positive definiteness.
const GRID_OVER_DISC: Real = 1.1;
const LEAST_OVER_DISC: Real = 1.0;
pub(super) const MOST_OVER_DISC: Real = 1.6;
/// Distance over the sum of the radii of the discs that two points stand for, below which their Green's function does not grow any more.
pub(super) const CLOSEST_OVER_RADII: Real = 0.7;

/// Control points of one surface, in its body's frame. Index = leaf index.
#[derive(Debug, Clone, Default)]
pub struct ControlPoints {
    /// Positions on the undeformed surface, m.
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// A unit tangent of each, fixed in the body: contact frames follow it.
    pub tangents: Vec<Vec3>,
    /// Area `A_c` that each stands for, m^2: the areas of its leaf's points, shared with neighbours where it stands on an edge.
    /// They add up to the surface's area.
    pub areas: Vec<Real>,
    /// Mean of `1/r` over the area of each, as seen from its control point, 1/m: what a half-space's
    /// singular Green's function weighs its own load by, see [`inverse_distances`].
    pub inverse_distances: Vec<Real>,
    /// Mean spacing, sqrt(total area / count), m: the bandwidth of the interpolation of eq. 8.
    pub spacing: Real,
}

/// Weights of one interpolation (eq. 8): `u(x) = sum w_k u_k`, the weights adding up to 1.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "Vec<(u32, Real)>", into = "Vec<(u32, Real)>")]
pub struct Weights {
    /// Number of entries in use.
    pub len: usize,
    /// Control points.
    pub index: [u32; MAX_WEIGHTS],
    /// Their weights.
    pub weight: [Real; MAX_WEIGHTS],
}

impl From<Weights> for Vec<(u32, Real)> {
    fn from(weights: Weights) -> Self {
        weights.iter().map(|(control_point, weight)| (control_point as u32, weight)).collect()
    }
}

impl TryFrom<Vec<(u32, Real)>> for Weights {
    type Error = String;

    fn try_from(entries: Vec<(u32, Real)>) -> Result<Self, String> {
        if entries.len() > MAX_WEIGHTS {
            return Err(format!("{} weights, more than {MAX_WEIGHTS}", entries.len()));
        }
        let mut weights = Self { len: entries.len(), ..Self::none() };
        for (k, (control_point, weight)) in entries.into_iter().enumerate() {
            (weights.index[k], weights.weight[k]) = (control_point, weight);
        }
        Ok(weights)
    }
}

impl Weights {
    /// No control point at all: of a surface that does not deform.
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
    /// Projects every leaf's centre on the surface, and moves those that reach a convex edge onto it. `samples` are in tree order;
    /// `border` yields the point ranges
    /// of a leaf and its neighbours, which `neighbours` has.
    pub(crate) fn build(
        tree: &SphereTree,
        samples: Samples,
        kernel: &Kernel,
        neighbours: &Rows,
        border: impl Fn(usize, &mut Vec<Range<u32>>) + Sync,
        interrupt: &Interrupt,
    ) -> Self {
        let Samples { points, normals, .. } = samples;
        let tolerance = ON_SURFACE * kernel.bandwidth();
        let on_surface = |ranges: &mut Vec<Range<u32>>, leaf: usize| {
            let node = tree.leaf(leaf);
            if interrupt.raised() {
                return (node.center, node.mean_normal, Place::Middle);
            }
            ranges.clear();
            border(leaf, ranges);
            let nearest = node
                .points()
                .min_by(|&a, &b| (points[a] - node.center).norm_squared().total_cmp(&(points[b] - node.center).norm_squared()))
                .unwrap_or(node.first_point as usize);
            // Only points whose normals are like those of this leaf decide where its
            // surface is: the other side of a thin plate is near, too.
            let facing = -normals[nearest];
            let (middle, normal) = project(&node.center, &Cloud { points, normals, ranges, kernel, facing: Some(&facing) }, tolerance, 20)
                .map_or((points[nearest], normals[nearest]), |p| (p.point, p.normal));
            (middle, normal, place(samples, node.points(), &middle, &normal, ranges))
        };
        let found: Vec<(Vec3, Vec3, Place)> = (0..tree.leaves.len()).into_par_iter().map_init(Vec::new, on_surface).collect();
        let mut control = Self::default();
        let mut places = Vec::with_capacity(found.len());
        for (middle, normal, place) in found {
            control.points.push(middle);
            control.normals.push(normal);
            places.push(place);
        }
        choose_sides(&control.points, &control.normals, &mut places);
        for (leaf, place) in places.iter().enumerate() {
            if let Place::Edge(point, normal) = place {
                (control.points[leaf], control.normals[leaf]) = (*point, *normal);
            }
        }
        control.tangents = control.normals.iter().map(any_perpendicular).collect();
        let moved: Vec<bool> = places.iter().map(|place| *place != Place::Middle).collect();
        control.areas = share_areas(tree, &control.points, &control.normals, &moved, neighbours);
        control.spacing = (control.areas.iter().sum::<Real>() / control.areas.len() as Real).sqrt();
        control.inverse_distances = inverse_distances(&control.points, &control.normals, &control.areas, control.spacing);
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
    /// `theta(r) = exp(-r^2/h^2) - exp(-4)`, cut at `r = 2 h` with `h` 0.8 control spacings (eq. 8; about 8 control
    /// points), times the agreement of the normals, so that the faces on two sides of an edge do not displace each other.
    pub fn weights(&self, x: &Vec3, normal: &Vec3, home: u32, candidates: &[u32]) -> Weights {
        let h2 = 0.64 * self.spacing * self.spacing;
        let floor = Lane::splat((-4.0_f64).exp());
        let mut weights = Weights { len: 0, index: [0; MAX_WEIGHTS], weight: [0.0; MAX_WEIGHTS] };
        // Those that have weight wait until there are four: exponentials come by fours.
        let (mut waiting, mut q, mut factor, mut index) = (0, [4.0; LANES], [0.0; LANES], [0; LANES]);
        let mut flush = |waiting: usize, q: [Real; LANES], factor: [Real; LANES], index: &[u32; LANES]| {
            let weight = ((exp_minus(Lane(q)) - floor) * Lane(factor)).0;
            (0..waiting).for_each(|k| weights.insert(index[k], weight[k]));
        };
        for &c in std::iter::once(&home).chain(candidates) {
            let r2 = (self.points[c as usize] - x).norm_squared();
            let agreement = 2.0 * normal.dot(&self.normals[c as usize]) - 1.0;
            if r2 < 4.0 * h2 && agreement > 0.0 {
                (q[waiting], factor[waiting], index[waiting]) = (r2 / h2, agreement * agreement, c);
                waiting += 1;
                if waiting == LANES {
                    flush(waiting, q, factor, &index);
                    waiting = 0;
                }
            }
        }
        flush(waiting, q, factor, &index);
        let total: Real = weights.weight[..weights.len].iter().sum();
        if total <= 1e-9 {
            return Weights::single(home);
        }
        weights.weight[..weights.len].iter_mut().for_each(|w| *w /= total);
        weights
    }
}

/// Mean of `1/r` over the area of each control point, as seen from it, 1/m.
///
/// The displacement of a half-space under a pressure is its integral against `1/r`. Summed over points, `f_j / r_ij`, it
/// is wrong near `i`: by what the neighbours' areas are larger than points, and by how unevenly they lie. The own term
/// takes that error on itself (a quadrature corrected locally), so that with areas A and a window `w(r) = exp(-r^2/s^2)`
/// a uniform pressure sinks in uniformly:
///
/// ```text
/// m_i A_i = integral w(r)/r dA - sum_(j != i) A_j w(r_ij) / r_ij + b sqrt(A_i),      integral w(r)/r dA = pi^(3/2) s
/// ```
///
/// b is what the curvature of the window costs on a square grid, so that there m_i is that of the infinite
/// lattice: 1.10 times the `2/a` of a disc of the same area. Where the window is not covered, at the border of
/// an open surface or at an edge, there is nothing to sum over and that value is taken.
pub(crate) fn inverse_distances(points: &[Vec3], normals: &[Vec3], areas: &[Real], spacing: Real) -> Vec<Real> {
    let s = OWN_WINDOW * spacing;
    let grid = NeighbourGrid::build(points, OWN_WINDOW_CUT * s);
    let radius = |i: usize| (areas[i] / PI).sqrt();
    let own = |near: &mut Vec<(u32, Real)>, i: usize| {
        near.clear();
        grid.for_each_within(&points[i], OWN_WINDOW_CUT * s, |j, distance2| {
            if j as usize != i && normals[i].dot(&normals[j as usize]) > 0.5 {
                near.push((j, distance2));
            }
        });
        let (mut sum, mut covered) = (0.0, areas[i]);
        for some in near.chunks(LANES) {
            let mut q = Lane::ZERO;
            some.iter().enumerate().for_each(|(lane, (_, distance2))| q.0[lane] = distance2 / (s * s));
            for ((j, distance2), window) in some.iter().zip(exp_minus(q).0) {
                let weight = areas[*j as usize] * window;
                // As near as the Green's function lets them come.
                sum += weight / distance2.sqrt().max(CLOSEST_OVER_RADII * (radius(i) + radius(*j as usize)));
                covered += weight;
            }
        }
        let disc = 2.0 / radius(i);
        if covered < LEAST_COVER * PI * s * s {
            return GRID_OVER_DISC * disc;
        }
        ((PI.powf(1.5) * s - sum) / areas[i] + OWN_WINDOW_BIAS / areas[i].sqrt()).clamp(LEAST_OVER_DISC * disc, MOST_OVER_DISC * disc)
    };
    (0..points.len()).into_par_iter().with_min_len(256).map_init(Vec::new, own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_term_of_a_square_grid_is_that_of_the_lattice_sum() {
        // The sum of 1/r over a square lattice of unit spacing without the origin, less the integral, is -3.9002649 (zeta regularisation).
        let side = 21;
        let place = |k: usize| Vec3::new((k % side) as Real, (k / side) as Real, 0.0);
        let points: Vec<Vec3> = (0..side * side).map(place).collect();
        let own = inverse_distances(&points, &vec![Vec3::z(); points.len()], &vec![1.0; points.len()], 1.0);
        let middle = own[side * side / 2];
        assert!((middle / 3.900_264_9 - 1.0).abs() < 1e-3, "own term {middle}");
        assert!((own[0] / (GRID_OVER_DISC * 2.0 * PI.sqrt()) - 1.0).abs() < 1e-12, "own term in the corner {}", own[0]);
    }
}

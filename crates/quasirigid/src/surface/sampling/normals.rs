//! Normals of bare points: the flattest direction of each neighbourhood, then one consistent orientation per connected part.
//!
//! After Hoppe, DeRose, Duchamp, McDonald, Stuetzle, *Surface reconstruction from unorganized points* (1992): the orientation
//! spreads along a minimum spanning tree of the neighbour graph, so that it crosses the safest edges. Two things differ:
//! - whether a neighbour is flipped is judged, as in Xie, Wang, Hua, Qin, Kaufman, *Piecewise C1 continuous surface reconstruction of
//!   noisy point clouds* (2003), against the normal *reflected* at the plane halfway between both points. On an arc that is exactly
//!   the neighbour's normal, across a box edge too, where the plain product of two perpendicular normals says nothing;
//! - an edge that leaves along a normal instead of along the surface costs more: it may cross a thin wall or noise.

use crate::error::Result;
use crate::interrupt::Interrupt;
use crate::math::{Mat3, Real, Vec3};
use crate::surface::implicit::eigenvector::smallest_eigenvector;
use crate::surface::search::nearest::{Nearest, SortedPoints};
use crate::surface::search::neighbours::NeighbourGrid;
use crate::threads::in_parallel;
use rayon::prelude::*;

/// Neighbours in the plane fit and in the graph.
const NORMAL_NEIGHBOURS: usize = 12;
/// Neighbours used where the nearest are on one line or in one place.
const WIDE_NEIGHBOURS: usize = 96;
/// An edge that costs less than this is safe to cross: normals within a few degrees of what they should be, along the surface.
const SAFE: Real = 0.05;
/// A part is closed if its area vectors add up to less than this share of its area,
/// and enclose more than this share of what a ball of its size does.
const CLOSED: Real = 0.1;
const ENCLOSES: Real = 0.01;
/// Steps of the cost of the other edges.
const COST_STEPS: Real = 4096.0;

/// Unit normals of `points` (m): outward for a closed surface. An open one has its normals up where it is highest (largest z).
/// Cost is O(n log n) at worst; the fits use all threads, the result does not depend on their number.
///
/// # Errors
/// [`crate::Error::InvalidValue`] if the system has no threads to give.
pub fn estimate_normals(points: &[Vec3]) -> Result<Vec<Vec3>> {
    in_parallel(|| {
        let sorted = SortedPoints::new(points, NORMAL_NEIGHBOURS);
        let never = &Interrupt::default();
        sorted.hand_back(&normals_among(&sorted.points, &sorted.nearest(NORMAL_NEIGHBOURS, never), never))
    })
}

/// [`estimate_normals`] of points whose neighbours (at best [`NORMAL_NEIGHBOURS`] of each, or more) are known.
pub(crate) fn normals_among(points: &[Vec3], nearest: &Nearest, interrupt: &Interrupt) -> Vec<Vec3> {
    let k = nearest.k.min(NORMAL_NEIGHBOURS);
    if k == 0 {
        return vec![Vec3::z(); points.len()];
    }
    let wide = std::sync::OnceLock::new();
    let fit = |i: usize| {
        if interrupt.raised() {
            return Vec3::z();
        }
        let near = nearest.of(i)[..k].iter().map(|&j| points[j as usize]);
        smallest_eigenvector(&scatter(&points[i], near)).unwrap_or_else(|| {
            let grid = wide.get_or_init(|| NeighbourGrid::build_auto(points));
            let mut near = Vec::new();
            grid.k_nearest(&points[i], WIDE_NEIGHBOURS, &mut near);
            smallest_eigenvector(&scatter(&points[i], near.iter().map(|n| points[n.0 as usize]))).unwrap_or(Vec3::z())
        })
    };
    let mut normals: Vec<Vec3> = (0..points.len()).into_par_iter().with_min_len(1024).map(fit).collect();
    if !interrupt.raised() {
        orient(points, &mut normals, nearest);
    }
    normals
}

/// Scatter about their mean of a point and its neighbours, over the square of the largest distance.
pub(crate) fn scatter(p: &Vec3, neighbours: impl Iterator<Item = Vec3> + Clone) -> Mat3 {
    let reach = neighbours.clone().map(|q| (q - p).amax()).fold(0.0, Real::max);
    if reach == 0.0 {
        return Mat3::zeros();
    }
    let (mut count, mut sum, mut moment) = (1.0, Vec3::zeros(), Mat3::zeros());
    for q in neighbours {
        let d = (q - p) / reach;
        count += 1.0;
        sum += d;
        moment += d * d.transpose();
    }
    moment - sum * sum.transpose() / count
}

/// The normal that `p`'s normal suggests for a neighbour in direction `d` (unit).
fn reflected(normal: &Vec3, d: &Vec3) -> Vec3 {
    normal - d * (2.0 * d.dot(normal))
}

/// An edge of the neighbour graph as orientation sees it: what it costs to cross (0 to 1), and whether the two normals disagree.
fn edge(points: &[Vec3], normals: &[Vec3], i: usize, j: usize) -> (Real, bool) {
    let d = (points[j] - points[i]).try_normalize(0.0).unwrap_or(Vec3::zeros());
    let agreement = reflected(&normals[i], &d).dot(&normals[j]);
    let leaving = 0.5 * (d.dot(&normals[i]).abs() + d.dot(&normals[j]).abs());
    (0.5 * (1.0 - agreement.abs() + leaving), agreement < 0.0)
}

/// Flips normals so that neighbours agree, and those of closed parts look out.
pub(crate) fn orient(points: &[Vec3], normals: &mut [Vec3], nearest: &Nearest) {
    let (n, k) = (points.len(), nearest.k.min(NORMAL_NEIGHBOURS));
    let mut parts = Parts::new(n);
    // Of edges that cost next to nothing it does not matter which are crossed: no need to
    // sort them. On a well sampled surface nearly all are of this kind.
    let known: &[Vec3] = normals;
    let find_safe = |i: usize| {
        let (mut safe, mut flips) = (0_u16, 0_u16);
        for (bit, &j) in nearest.of(i)[..k].iter().enumerate() {
            let (cost, flip) = edge(points, known, i, j as usize);
            safe |= u16::from(cost < SAFE) << bit;
            flips |= u16::from(flip) << bit;
        }
        (safe, flips)
    };
    let safe: Vec<(u16, u16)> = (0..n).into_par_iter().with_min_len(1024).map(find_safe).collect();
    for (i, &(safe, flips)) in safe.iter().enumerate() {
        for (bit, &j) in nearest.of(i)[..k].iter().enumerate().filter(|(bit, _)| safe >> bit & 1 == 1) {
            parts.join(i, j as usize, flips >> bit & 1 == 1);
        }
    }
    drop(safe);
    for (i, j, flip) in remaining_edges(points, normals, k, nearest, &parts.roots()) {
        parts.join(i as usize, j as usize, flip);
    }
    let roots = parts.roots();
    let closed = looks_inward(points, normals, nearest, &roots);
    // Of an open part the highest point decides, whose normal points up; among equally high ones the most level.
    let mut highest: Vec<u32> = (0..n as u32).collect();
    for (i, &(root, _)) in roots.iter().enumerate() {
        let top = &mut highest[root as usize];
        let (a, b) = (*top as usize, i);
        if points[b].z.total_cmp(&points[a].z).then(normals[b].z.abs().total_cmp(&normals[a].z.abs())).is_gt() {
            *top = i as u32;
        }
    }
    let looks_down = |top: usize| (normals[top].z < 0.0) != roots[top].1;
    let turned: Vec<bool> = highest.iter().zip(&closed).map(|(&top, inward)| inward.unwrap_or_else(|| looks_down(top as usize))).collect();
    for (normal, &(root, flip)) in normals.iter_mut().zip(&roots) {
        if flip != turned[root as usize] {
            *normal = -*normal;
        }
    }
}

/// For the root of every closed part, whether its normals look inward as they are
/// flipped against the root: all of its points decide together.
///
/// Of a closed surface the area vectors `a n` add up to zero, and `sum a n . (p - c)`
/// is three times the volume inside (divergence theorem), whatever `c`.
fn looks_inward(points: &[Vec3], normals: &[Vec3], nearest: &Nearest, roots: &[(u32, bool)]) -> Vec<Option<bool>> {
    #[derive(Clone, Copy, Default)]
    struct Sums {
        area: Real,
        vector: Vec3,
        volume: Real,
        lever: Real,
    }
    let mut parts = vec![Sums::default(); points.len()];
    for (i, &(root, flip)) in roots.iter().enumerate() {
        let area = nearest.of(i).last().map_or(0.0, |&far| (points[far as usize] - points[i]).norm_squared());
        let (vector, arm) = (normals[i] * if flip { -area } else { area }, points[i] - points[root as usize]);
        let part = &mut parts[root as usize];
        part.area += area;
        part.vector += vector;
        part.volume += vector.dot(&arm);
        part.lever += area * arm.norm();
    }
    let verdict = |part: &Sums| {
        let closed = part.vector.norm() < CLOSED * part.area && part.volume.abs() > ENCLOSES * part.lever;
        closed.then_some(part.volume < 0.0)
    };
    parts.iter().map(verdict).collect()
}

/// Of the pairs of neighbours whose normals must agree, because both lie in one
/// smooth piece of the surface: how many do not, and how many there are.
pub(crate) fn disagreements(points: &[Vec3], normals: &[Vec3], nearest: &Nearest) -> (usize, usize) {
    let k = nearest.k.min(NORMAL_NEIGHBOURS);
    let of_point = |i: usize| {
        let near = nearest.of(i)[..k].iter().map(|&j| edge(points, normals, i, j as usize));
        near.filter(|&(cost, _)| cost < SAFE).fold((0, 0), |(off, all), (_, flip)| (off + usize::from(flip), all + 1))
    };
    let add = |a: (usize, usize), b: (usize, usize)| (a.0 + b.0, a.1 + b.1);
    (0..points.len()).into_par_iter().with_min_len(1024).map(of_point).reduce(|| (0, 0), add)
}

/// Edges between different parts, the safest first: (i, j, whether the normals
/// disagree). In that order a union-find makes a minimum spanning tree (Kruskal).
fn remaining_edges(points: &[Vec3], normals: &[Vec3], k: usize, nearest: &Nearest, roots: &[(u32, bool)]) -> Vec<(u32, u32, bool)> {
    let of_point = |i: usize| {
        let elsewhere = nearest.of(i)[..k].iter().map(|&j| j as usize).filter(move |&j| roots[i].0 != roots[j].0);
        elsewhere.map(move |j| {
            let (cost, flip) = edge(points, normals, i, j);
            ((cost * COST_STEPS) as u16, i as u32, j as u32, flip)
        })
    };
    let mut edges: Vec<(u16, u32, u32, bool)> = (0..points.len()).into_par_iter().flat_map_iter(of_point).collect();
    edges.par_sort_unstable();
    edges.into_iter().map(|(_, i, j, flip)| (i, j, flip)).collect()
}

/// Union-find of points that are joined, with what takes one normal to the other: same side or flipped.
pub(crate) struct Parts {
    parent: Vec<(u32, bool)>,
}

impl Parts {
    pub fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).map(|i| (i, false)).collect() }
    }

    /// Root of `i`, and whether `i` is flipped against it. Halves the path.
    fn root(&mut self, mut i: usize) -> (usize, bool) {
        let mut flip = false;
        loop {
            let (above, flip_above) = self.parent[i];
            if above as usize == i {
                return (i, flip);
            }
            let (top, flip_top) = self.parent[above as usize];
            // The root is never flipped against itself.
            self.parent[i] = (top, flip_above != flip_top);
            (i, flip) = (top as usize, flip != (flip_above != flip_top));
        }
    }

    pub fn join(&mut self, i: usize, j: usize, flip: bool) {
        let ((a, flip_a), (b, flip_b)) = (self.root(i), self.root(j));
        self.parent[a.max(b)] = (a.min(b) as u32, a != b && (flip_a != flip_b) != flip);
    }

    /// Root of every point, and whether it is flipped against it.
    pub fn roots(&mut self) -> Vec<(u32, bool)> {
        (0..self.parent.len()).map(|i| self.root(i)).map(|(root, flip)| (root as u32, flip)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::{sample_box, sample_capsule, sample_half_space, sample_sphere};
    use nalgebra::UnitQuaternion;
    use std::f64::consts::TAU;

    /// Share of normals on the outer side, and the worst angle to the exact normal in degrees.
    fn compare(points: &[Vec3], exact: &[Vec3]) -> (Real, Real) {
        let normals = estimate_normals(points).unwrap();
        let outward = normals.iter().zip(exact).filter(|(a, b)| a.dot(b) > 0.0).count();
        let worst = normals.iter().zip(exact).map(|(a, b)| a.angle(b).to_degrees()).fold(0.0, Real::max);
        (outward as Real / points.len() as Real, worst)
    }

    #[test]
    fn closed_surfaces_come_out_outward() {
        let mut cases = Vec::new();
        for (name, surface, bound) in [
            ("sphere", sample_sphere(0.03, 3000).unwrap(), 2.0),
            ("capsule", sample_capsule(0.01, 0.1, 3000).unwrap(), 10.0),
            // The fit rounds edges and corners off: 45 degrees at an edge, 55 at a corner.
            ("box", sample_box(Vec3::new(0.06, 0.06, 0.06), 3600).unwrap(), 60.0),
            ("thin plate", sample_box(Vec3::new(0.1, 0.1, 0.008), 3600).unwrap(), 60.0),
        ] {
            let (points, normals, _) = surface.into_parts();
            cases.push((name, points, normals, bound));
        }
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for i in 0..4000 {
            // A torus with its axis along x, so that the highest point is on the outer rim and the hole is seen from the side.
            let (u, v) = (TAU * ((i as Real + 0.5) / 4000.0), TAU * (i as Real * 0.618_033_988_749_895).fract());
            let n = Vec3::new(v.sin(), v.cos() * u.cos(), v.cos() * u.sin());
            points.push(Vec3::new(0.0, 0.05 * u.cos(), 0.05 * u.sin()) + n * 0.02);
            normals.push(n);
        }
        cases.push(("torus", points, normals, 4.0));
        let (mut points, mut normals, _) = sample_sphere(0.02, 1500).unwrap().into_parts();
        points.extend_from_within(..);
        normals.extend_from_within(..);
        points[1500..].iter_mut().for_each(|p| *p += Vec3::new(0.05, 0.01, -0.02));
        cases.push(("two separate spheres", points, normals, 3.0));
        for (name, points, exact, bound) in cases {
            for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(0.3, 1.1, -2.0)] {
                let points: Vec<Vec3> = points.iter().map(|p| turn * p).collect();
                let exact: Vec<Vec3> = exact.iter().map(|n| turn * n).collect();
                let (outward, worst) = compare(&points, &exact);
                println!("{name}: {:.2} % outward, worst angle {worst:.2} degrees", 100.0 * outward);
                assert!(outward >= 0.999 && worst < bound, "{name}: {:.2} % outward, worst angle {worst:.2} degrees", 100.0 * outward);
            }
        }
    }

    #[test]
    fn an_open_patch_points_up() {
        let surface = sample_half_space(0.1, 500).unwrap();
        assert_eq!(compare(surface.points(), surface.normals()).0, 1.0);
    }

    #[test]
    fn odd_sets_still_give_unit_normals() {
        for points in [vec![], vec![Vec3::zeros()], vec![Vec3::repeat(1.0); 40], (0..40).map(|i| Vec3::repeat(i as Real)).collect()] {
            assert!(estimate_normals(&points).unwrap().iter().all(|n| (n.norm() - 1.0).abs() < 1e-12));
        }
    }
}

//! The winding number field of a cloud of points with area vectors, its gradient and its adjoint, by a tree.
//!
//! Barill, Dickson, Schmidt, Levin, Jacobson, *Fast winding numbers for soups and
//! clouds* (2018), eq. 4: points `p_j` (m) that stand for the area vectors
//! `m_j` (m^2, along the outward normal) wind round a place `x` (m)
//!
//! ```text
//! w(x) = sum_j  m_j . (p_j - x) / (4 pi |p_j - x|^3)
//! ```
//!
//! times: once inside a closed surface, not at all outside, half on it. What is far away is summed node by node,
//! as one area vector at the middle of the node (their expansion of order zero). Within `width` the distance
//! counts as `width`: points are sparse at that scale, and a single one must not decide.

use crate::math::{Real, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Points of a leaf.
const LEAF: usize = 12;
/// A node is far when it is this many of its radii away (Barill et al. take 2).
const OPENING: Real = 2.0;

/// A tree over points that are sorted so that near points are near in memory.
pub(crate) struct WindingTree<'a> {
    points: &'a [Vec3],
    /// In pre-order: a node, what is below its first child, what is below its second.
    nodes: Vec<Node>,
}

struct Node {
    center: Vec3,
    radius: Real,
    /// Range of points.
    first: u32,
    end: u32,
    /// The node that follows when all below this one is passed over.
    next: u32,
}

impl<'a> WindingTree<'a> {
    /// `points` in m, fewer than 2^32.
    pub fn new(points: &'a [Vec3]) -> Self {
        let mut tree = Self { points, nodes: Vec::with_capacity(4 * points.len() / LEAF + 1) };
        if !points.is_empty() {
            tree.add(0, points.len());
        }
        tree
    }

    fn add(&mut self, first: usize, end: usize) {
        let own = &self.points[first..end];
        let center = own.iter().sum::<Vec3>() / own.len() as Real;
        let radius = own.iter().map(|p| (p - center).norm()).fold(0.0, Real::max);
        let place = self.nodes.len();
        self.nodes.push(Node { center, radius, first: first as u32, end: end as u32, next: 0 });
        if own.len() > LEAF {
            let middle = first + own.len() / 2;
            self.add(first, middle);
            self.add(middle, end);
        }
        self.nodes[place].next = self.nodes.len() as u32;
    }

    fn is_leaf(&self, place: usize) -> bool {
        self.nodes[place].next as usize == place + 1
    }

    /// Sums of values over the points of each node.
    fn sums<S: Copy + std::ops::Add<Output = S> + std::iter::Sum<S>>(&self, values: &[S]) -> Vec<S> {
        let mut sums: Vec<Option<S>> = vec![None; self.nodes.len()];
        for place in (0..self.nodes.len()).rev() {
            let node = &self.nodes[place];
            let second = if self.is_leaf(place) { place } else { self.nodes[place + 1].next as usize };
            sums[place] = match (self.is_leaf(place), sums.get(place + 1).copied().flatten(), sums[second]) {
                (false, Some(a), Some(b)) => Some(a + b),
                _ => Some(values[node.first as usize..node.end as usize].iter().copied().sum()),
            };
        }
        sums.into_iter().flatten().collect()
    }

    /// Calls `add(value, from x to the source)` for every point that is near `x` and every node that is far.
    #[inline]
    fn for_each_source<S: Copy>(&self, x: &Vec3, values: &[S], sums: &[S], mut add: impl FnMut(S, Vec3)) {
        let mut place = 0;
        while place < self.nodes.len() {
            let node = &self.nodes[place];
            let d = node.center - x;
            if d.norm_squared() > (OPENING * node.radius).powi(2) {
                add(sums[place], d);
            } else if self.is_leaf(place) {
                let own = node.first as usize..node.end as usize;
                for (value, point) in values[own.clone()].iter().zip(&self.points[own]) {
                    add(*value, point - x);
                }
            } else {
                place += 1;
                continue;
            }
            place = node.next as usize;
        }
    }

    /// Winding number at the points numbered `at`, and its gradient turned round (1/m), which looks out of the surface: `-grad w`.
    ///
    /// With `d = p_j - x`, `r = |d|`: `-grad w = sum_j (m_j / r^3 - 3 (m_j . d) d / r^5) / (4 pi)`;
    /// within `width` the second term is left out.
    pub fn field(&self, vectors: &[Vec3], width: Real, at: &[u32]) -> Vec<(Real, Vec3)> {
        let sums = self.sums(vectors);
        let one = |&i: &u32| {
            let (mut w, mut out) = (0.0, Vec3::zeros());
            self.for_each_source(&self.points[i as usize], vectors, &sums, |m, d| {
                let r2 = d.norm_squared();
                let (r, along) = (r2.sqrt().max(width), m.dot(&d));
                let r3 = r * r * r;
                w += along / r3;
                out += m / r3;
                if r2 >= width * width {
                    out -= d * (3.0 * along / (r3 * r2));
                }
            });
            (w / (4.0 * PI), out / (4.0 * PI))
        };
        at.par_iter().with_min_len(64).map(one).collect()
    }

    /// Winding number at every point.
    pub fn at_points(&self, vectors: &[Vec3], width: Real) -> Vec<Real> {
        let sums = self.sums(vectors);
        let one = |x: &Vec3| {
            let mut w = 0.0;
            self.for_each_source(x, vectors, &sums, |m, d| {
                let r = d.norm().max(width);
                w += m.dot(&d) / (r * r * r);
            });
            w / (4.0 * PI)
        };
        self.points.par_iter().with_min_len(64).map(one).collect()
    }

    /// The adjoint of [`Self::at_points`]: for every point `j` the sum over points `i` of `s_i (p_j - p_i) / (4 pi |p_j - p_i|^3)`.
    pub fn adjoint(&self, scalars: &[Real], width: Real) -> Vec<Vec3> {
        let sums = self.sums(scalars);
        let one = |x: &Vec3| {
            let mut sum = Vec3::zeros();
            self.for_each_source(x, scalars, &sums, |s, d| {
                let r = d.norm().max(width);
                sum -= d * (s / (r * r * r));
            });
            sum / (4.0 * PI)
        };
        self.points.par_iter().with_min_len(64).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::search::nearest::SortedPoints;
    use crate::surface::shapes::{sample_box, sample_sphere};

    #[test]
    fn a_closed_surface_winds_half_round_its_points_and_the_gradient_looks_out() {
        for (name, surface) in
            [("ball", sample_sphere(0.03, 3000).unwrap()), ("box", sample_box(Vec3::new(0.06, 0.05, 0.08), 3000).unwrap())]
        {
            let sorted = SortedPoints::new(surface.points(), 16);
            let normals = sorted.pick(surface.normals());
            let vectors: Vec<Vec3> = normals.iter().zip(sorted.pick(surface.areas())).map(|(n, a)| n * a).collect();
            let all: Vec<u32> = (0..3000).collect();
            let field = WindingTree::new(&sorted.points).field(&vectors, surface.spacing(), &all);
            let off = field.iter().map(|(w, _)| (w - 0.5).abs()).sum::<Real>() / 3000.0;
            let out = field.iter().zip(&normals).filter(|((_, g), n)| g.dot(n) > 0.0).count();
            assert!(off < 0.05 && out == 3000, "{name}: winding number off 1/2 by {off:.4} on average, gradient outward at {out} of 3000");
        }
    }

    #[test]
    fn the_adjoint_is_the_adjoint() {
        // As many points as a leaf has: nothing is far, so that the tree rounds nothing.
        let surface = sample_sphere(0.03, LEAF).unwrap();
        let sorted = SortedPoints::new(surface.points(), 4);
        let tree = WindingTree::new(&sorted.points);
        let vectors = sorted.pick(surface.normals());
        let scalars: Vec<Real> = (0..LEAF).map(|i| (i as Real * 0.7).sin() + 0.3).collect();
        let there: Real = tree.at_points(&vectors, 0.001).iter().zip(&scalars).map(|(w, s)| w * s).sum();
        let back: Real = tree.adjoint(&scalars, 0.001).iter().zip(&vectors).map(|(a, m)| a.dot(m)).sum();
        assert!((there / back - 1.0).abs() < 1e-12, "{there} one way, {back} the other");
    }
}

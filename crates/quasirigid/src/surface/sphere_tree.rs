//! Binary tree of bounding spheres over the points of a surface (design 3.2; the paper's section 3.3, after Klein and Zachmann).
//!
//! Built top-down with a quota: a node that owes `m` leaves hands `m/2` of them, and points in the same ratio, to each side of a
//! cut across its longest axis. So the tree has exactly the number of leaves asked for, and leaves of nearly equal area. Near
//! the leaves a node whose normals disagree is cut between the normals instead: a leaf never bends around a sharp edge while
//! another cut is possible. At an edge the smaller side gets a leaf for every control spacing of its length at least, so that an edge
//! or a rim that is narrower than that has control points all along.
//!
//! Nodes are stored breadth-first (a parent before its children), so that a bottom-up pass is a loop from the end. Points are
//! re-ordered so that every node owns a contiguous range: a leaf's points are a slice.

use crate::interrupt::Interrupt;
use crate::math::{Mat3, Real, Vec3};
use crate::surface::implicit::eigenvector::smallest_eigenvector;
use rayon::prelude::*;

/// Below this many leaves a node may be cut by normals instead of positions.
const NORMAL_CUT_LEAVES: usize = 32;

/// A node is cut by normals when the mean of its unit normals is shorter than this (about 30 degrees of spread each way).
const NORMAL_CUT_LENGTH: Real = 0.9;

/// ... or when one of them makes more than this cosine with their mean: a narrow face of which the node has few points.
const NORMAL_CUT_OUTLIER: Real = 0.6;

/// An edge parts two groups of unit normals that leave a gap of this width between them, 30 degrees: those of a round surface leave none.
const EDGE_GAP: Real = 0.5;

/// Vectors that a principal axis is found from, at least, where there are as many.
const AXIS_SAMPLE: usize = 4096;

/// One node, undeformed. The spheres that follow deformation are in [`crate::collider::Skin`].
#[derive(Debug, Clone)]
pub struct Node {
    /// Centre of the sphere, body frame, m.
    pub center: Vec3,
    /// Radius of the sphere, m: covers the points below and half the way to their neighbours.
    pub radius: Real,
    /// Index of the two children, or `None` for a leaf.
    pub children: Option<[u32; 2]>,
    /// Range of points, in tree order.
    pub first_point: u32,
    /// Number of points.
    pub point_count: u32,
    /// Range of leaves, in leaf order.
    pub first_leaf: u32,
    /// Number of leaves; 1 at a leaf.
    pub leaf_count: u32,
    /// Parent's index; the root is its own parent.
    pub parent: u32,
    /// Depth: 0 at the root.
    pub level: u32,
    /// Area of the points below, m^2.
    pub area: Real,
    /// Area-weighted mean of the unit normals below, not normalised: its length says how flat the node is.
    pub mean_normal: Vec3,
}

impl Node {
    /// The points as a range of tree order.
    pub fn points(&self) -> std::ops::Range<usize> {
        self.first_point as usize..(self.first_point + self.point_count) as usize
    }
}

/// The tree. Leaf `i` of the surface is `nodes[leaves[i]]`.
#[derive(Debug, Clone)]
pub struct SphereTree {
    /// Breadth-first: parents before children.
    pub nodes: Vec<Node>,
    /// Node index of every leaf, in leaf order: the order of the point ranges.
    pub leaves: Vec<u32>,
}

impl SphereTree {
    /// Builds the tree with exactly `leaf_count` leaves, and returns it with the tree order: `order[k]` is the caller's index
    /// of the `k`-th point. `gaps[i]` is half the distance from point `i` to the farthest of its close neighbours, m.
    ///
    /// `leaf_count` must be between 1 and the number of points; the caller checks.
    /// Once `interrupt` is raised it ends, with a tree that must not be used.
    pub(crate) fn build(
        points: &[Vec3],
        normals: &[Vec3],
        areas: &[Real],
        gaps: &[Real],
        leaf_count: usize,
        interrupt: &Interrupt,
    ) -> (Self, Vec<u32>) {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut nodes = vec![Node::unplaced(0, points.len(), 0, leaf_count, 0, 0)];
        // Breadth-first, a level at a time: its nodes own disjoint ranges of the points, in order, and are cut side by side.
        let mut level = 0..1;
        while !level.is_empty() && !interrupt.raised() {
            let (mut rest, mut taken, mut work) = (order.as_mut_slice(), 0, Vec::new());
            for index in level.clone().filter(|&index| nodes[index].leaf_count > 1) {
                let range = nodes[index].points();
                let (own, after) = std::mem::take(&mut rest).split_at_mut(range.start - taken).1.split_at_mut(range.len());
                (rest, taken) = (after, range.end);
                work.push((index, own));
            }
            let quota = |index: usize| nodes[index].leaf_count as usize;
            let cuts: Vec<_> = work.into_par_iter().map(|(index, own)| (index, cut(points, normals, areas, own, quota(index)))).collect();
            level = level.end..level.end + 2 * cuts.len();
            for (index, (left_points, left_leaves)) in cuts {
                let (below, quota) = (nodes[index].points(), nodes[index].leaf_count as usize);
                let (depth, first_leaf, child) = (nodes[index].level + 1, nodes[index].first_leaf as usize, nodes.len() as u32);
                nodes[index].children = Some([child, child + 1]);
                nodes.push(Node::unplaced(below.start, left_points, first_leaf, left_leaves, index as u32, depth));
                let (start, count) = (below.start + left_points, below.len() - left_points);
                nodes.push(Node::unplaced(start, count, first_leaf + left_leaves, quota - left_leaves, index as u32, depth));
            }
        }
        // Sums from the leaves up; the radius needs every point again: bounding the
        // points themselves is tighter than bounding the children's spheres.
        nodes.par_iter_mut().with_min_len(64).filter(|node| node.children.is_none()).for_each(|node| {
            for &i in &order[node.points()] {
                let (i, area) = (i as usize, areas[i as usize]);
                node.area += area;
                node.center += points[i] * area;
                node.mean_normal += normals[i] * area;
            }
        });
        for index in (0..nodes.len()).rev() {
            if let Some([l, r]) = nodes[index].children {
                let (left, right) = (&nodes[l as usize], &nodes[r as usize]);
                let sums = (left.area + right.area, left.center + right.center, left.mean_normal + right.mean_normal);
                (nodes[index].area, nodes[index].center, nodes[index].mean_normal) = sums;
            }
        }
        nodes.par_iter_mut().with_min_len(64).for_each(|node| {
            let center = node.center / node.area;
            let reach = |&i: &u32| (points[i as usize] - center).norm() + gaps[i as usize];
            node.radius = order[node.points()].iter().map(reach).fold(0.0, Real::max);
            (node.center, node.mean_normal) = (center, node.mean_normal / node.area);
        });
        let mut leaves = vec![0; leaf_count];
        for (index, node) in nodes.iter().enumerate().filter(|(_, node)| node.children.is_none()) {
            leaves[node.first_leaf as usize] = index as u32;
        }
        (Self { nodes, leaves }, order)
    }

    /// The node of a leaf.
    pub fn leaf(&self, leaf: usize) -> &Node {
        &self.nodes[self.leaves[leaf] as usize]
    }
}

impl Node {
    fn unplaced(first_point: usize, point_count: usize, first_leaf: usize, leaf_count: usize, parent: u32, level: u32) -> Self {
        Self {
            center: Vec3::zeros(),
            radius: 0.0,
            children: None,
            first_point: first_point as u32,
            point_count: point_count as u32,
            first_leaf: first_leaf as u32,
            leaf_count: leaf_count as u32,
            parent,
            level,
            area: 0.0,
            mean_normal: Vec3::zeros(),
        }
    }
}

/// Re-orders `order` so that its first part belongs to the left child; returns (points, leaves) of the left child.
fn cut(points: &[Vec3], normals: &[Vec3], areas: &[Real], order: &mut [u32], quota: usize) -> (usize, usize) {
    let count = order.len();
    if quota <= NORMAL_CUT_LEAVES
        && let Some((left_points, is_edge)) = cut_by_normals(normals, order)
    {
        let (first, second) = order.split_at(left_points);
        let left_leaves = if !is_edge {
            (quota * left_points).div_ceil(count)
        } else if first.len() < second.len() {
            leaves_along(points, areas, first, order, quota)
        } else {
            quota - leaves_along(points, areas, second, order, quota).min(quota)
        };
        let left_leaves = left_leaves.clamp(1, quota - 1);
        // Each side needs at least one point for each leaf it owes.
        if left_points >= left_leaves && count - left_points >= quota - left_leaves {
            return (left_points, left_leaves);
        }
    }
    let left_leaves = quota / 2;
    let left_points = (count * left_leaves / quota).clamp(left_leaves, count - (quota - left_leaves));
    let axis = principal_axis(points, order);
    let key = |&i: &u32| axis.dot(&points[i as usize]);
    order.select_nth_unstable_by(left_points, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    (left_points, left_leaves)
}

/// Leaves for `part` of a node's points (`all`), which owes `quota`: in proportion to its points, or one for each spacing of the node's
/// leaves along its length where those are more. Half of
/// the node's at most, and a point for each.
fn leaves_along(points: &[Vec3], areas: &[Real], part: &[u32], all: &[u32], quota: usize) -> usize {
    let in_proportion = (quota * part.len()).div_ceil(all.len());
    let axis = principal_axis(points, part);
    let key = |&i: &u32| axis.dot(&points[i as usize]);
    let (low, high) = part.iter().map(key).fold((Real::INFINITY, Real::NEG_INFINITY), |(low, high), k| (low.min(k), high.max(k)));
    let spacing = (all.iter().map(|&i| areas[i as usize]).sum::<Real>() / quota as Real).sqrt();
    let along = ((high - low) / spacing).ceil() as usize;
    in_proportion.max(along.min(quota / 2).min(part.len()))
}

/// Splits a bent set between its two groups of normals, and says whether an edge parts the two; `None` if it is not bent.
fn cut_by_normals(normals: &[Vec3], order: &mut [u32]) -> Option<(usize, bool)> {
    let mean = order.iter().map(|&i| normals[i as usize]).sum::<Vec3>() / order.len() as Real;
    let length = mean.norm();
    if length >= NORMAL_CUT_LENGTH && order.iter().all(|&i| normals[i as usize].dot(&mean) >= NORMAL_CUT_OUTLIER * length) {
        return None;
    }
    let axis = principal_axis(normals, order);
    let key = |i: u32| axis.dot(&normals[i as usize]);
    let (low, high) = order.iter().fold((Real::INFINITY, Real::NEG_INFINITY), |(l, h), &i| (l.min(key(i)), h.max(key(i))));
    let middle = 0.5 * (low + high);
    order.sort_unstable_by(|&a, &b| (key(a) > middle).cmp(&(key(b) > middle)).then(a.cmp(&b)));
    let left = order.iter().filter(|&&i| key(i) <= middle).count();
    let below = order[..left].iter().map(|&i| key(i)).fold(Real::NEG_INFINITY, Real::max);
    let above = order[left..].iter().map(|&i| key(i)).fold(Real::INFINITY, Real::min);
    (left > 0 && left < order.len()).then_some((left, above - below > EDGE_GAP))
}

/// The direction in which the chosen vectors spread most, about: they are cut along it, for which a few thousand of them suffice.
fn principal_axis(vectors: &[Vec3], order: &[u32]) -> Vec3 {
    let step = order.len().div_ceil(AXIS_SAMPLE);
    let first = vectors[order[0] as usize];
    let (mut count, mut sum, mut scatter) = (0.0, Vec3::zeros(), Mat3::zeros());
    for &i in order.iter().step_by(step) {
        let d = vectors[i as usize] - first;
        (count, sum, scatter) = (count + 1.0, sum + d, scatter + d * d.transpose());
    }
    scatter -= sum * sum.transpose() / count;
    // The largest eigenvalue of the scatter is the smallest of what is missing to its trace. Where two are equal, either of them will do.
    smallest_eigenvector(&(Mat3::from_diagonal_element(scatter.trace()) - scatter)).unwrap_or_else(|| {
        let eigen = scatter.symmetric_eigen();
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
    })
}

/// The smallest sphere around two spheres: (centre, radius).
pub fn sphere_around(c1: &Vec3, r1: Real, c2: &Vec3, r2: Real) -> (Vec3, Real) {
    let between = c2 - c1;
    let distance = between.norm();
    if distance + r2 <= r1 {
        return (*c1, r1);
    }
    if distance + r1 <= r2 {
        return (*c2, r2);
    }
    let radius = 0.5 * (distance + r1 + r2);
    (c1 + between * ((radius - r1) / distance), radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spiral(n: usize) -> (Vec<Vec3>, Vec<Real>) {
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let points = (0..n)
            .map(|i| {
                let z = 1.0 - (2 * i + 1) as Real / n as Real;
                let r = (1.0 - z * z).sqrt();
                Vec3::new(r * (golden * i as Real).cos(), r * (golden * i as Real).sin(), z)
            })
            .collect();
        (points, vec![4.0 * std::f64::consts::PI / n as Real; n])
    }

    #[test]
    fn tree_has_the_wanted_leaves_of_even_area_and_parents_own_their_children() {
        let (points, areas) = spiral(2400);
        let gaps = vec![0.05; 2400];
        let (tree, order) = SphereTree::build(&points, &points, &areas, &gaps, 320, &Interrupt::default());
        assert_eq!(tree.leaves.len(), 320);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(k, &i)| k as u32 == i), "order is a permutation");
        for (index, node) in tree.nodes.iter().enumerate() {
            let Some(children) = node.children else {
                assert!((6..=9).contains(&node.point_count), "leaf of {} points", node.point_count);
                continue;
            };
            let below: u32 = children.iter().map(|&c| tree.nodes[c as usize].point_count).sum();
            assert_eq!(below, node.point_count);
            assert!(children.iter().all(|&c| tree.nodes[c as usize].parent == index as u32 && c as usize > index));
        }
        assert!((tree.nodes[0].area - areas.iter().sum::<Real>()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn sphere_around_two_spheres_holds_both(
            c1 in prop::array::uniform3(-1.0..1.0f64), c2 in prop::array::uniform3(-1.0..1.0f64), r1 in 0.0..1.0f64,
            r2 in 0.0..1.0f64,
        ) {
            let (c1, c2) = (Vec3::from(c1), Vec3::from(c2));
            let (c, r) = sphere_around(&c1, r1, &c2, r2);
            prop_assert!((c - c1).norm() + r1 <= r + 1e-12);
            prop_assert!((c - c2).norm() + r2 <= r + 1e-12);
            prop_assert!(r <= 0.5 * ((c1 - c2).norm() + r1 + r2).max(2.0 * r1.max(r2)) + 1e-12);
        }
    }
}

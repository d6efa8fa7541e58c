//! What a spent budget leaves in the queue of a traversal: fewer, larger contacts, each at the place
//! of its node that comes nearest (time-critical collision, after Klein and Zachmann).
//!
//! The traversal stops at a quarter of its budget. Of every node of `a` that is left one leaf is found with the rest: that
//! which lies lowest over the place on `b` nearest to the middle of the node. Its control point stands for the node. If
//! there are too many nodes to do so for each, those deepest in the tree are replaced by their parents.

use super::cache::Coupled;
use super::deep_overlap::nearest;
use crate::math::{Real, Vec3};
use crate::surface::Surface;
use crate::surface::implicit::FACING_COSINE;
use crate::surface::sphere_tree::Node;

/// Sphere tests that finding one such leaf takes, about: two searches for a nearest point, and once down a tree.
const TESTS: usize = 120;

/// Sphere tests that a pair may spend however small the budget, see [`crate::Parameters::traversal_budget`].
pub(super) const LEAST: usize = 2_000;

/// Samples of a node from which its share in a contact is estimated.
const SAMPLES: u32 = 32;

/// Two trees, `a` seen in the frame of `b`.
pub(super) struct Trees<'a, F: Fn(&Vec3) -> Vec3, G: Fn(&Vec3) -> Vec3> {
    pub surface_a: &'a Surface,
    pub surface_b: &'a Surface,
    /// A point of `a`.
    pub point: F,
    /// A direction of `a`.
    pub direction: G,
}

impl<F: Fn(&Vec3) -> Vec3, G: Fn(&Vec3) -> Vec3> Trees<'_, F, G> {
    fn node_a(&self, index: u32) -> &Node {
        &self.surface_a.tree.nodes[index as usize]
    }

    /// The leaf below a node that comes nearest to `b`, and the leaf of `b` that it meets, as nodes; `None` if nothing of `b` faces it.
    fn meeting(&self, stack: &mut Vec<u32>, node_a: u32) -> Option<(u32, u32)> {
        let (normals, nodes) = (&self.surface_b.normals, &self.surface_a.tree.nodes);
        let (_, below, _) = nearest(stack, self.surface_b, &(self.point)(&nodes[node_a as usize].center), Real::INFINITY, |_| true)?;
        let height = |index: u32| normals[below].dot(&(self.point)(&nodes[index as usize].center));
        let mut leaf = node_a;
        while let Some([left, right]) = nodes[leaf as usize].children {
            leaf = if height(left) <= height(right) { left } else { right };
        }
        let control_point = nodes[leaf as usize].first_leaf as usize;
        let x = (self.point)(&self.surface_a.control.points[control_point]);
        let normal = (self.direction)(&self.surface_a.control.normals[control_point]);
        nearest(stack, self.surface_b, &x, Real::INFINITY, |n| n.dot(&normal) < FACING_COSINE).map(|(node_b, ..)| (leaf, node_b))
    }

    /// Couples what is left in the `queue` at the cost of `tests` more sphere tests, in
    /// place of what is already `coupled` below the same nodes of `a`.
    pub(super) fn couple_queued(&self, stack: &mut Vec<u32>, queue: &mut [(u32, u32)], coupled: &mut Vec<Coupled>, tests: usize) {
        let most = (tests / TESTS).max(1);
        loop {
            queue.sort_unstable();
            let nodes = queue.chunk_by(|p, q| p.0 == q.0).count();
            let deepest = queue.iter().map(|&(a, _)| self.node_a(a).level).max().unwrap_or(0);
            if nodes <= most || deepest == 0 {
                break;
            }
            for pair in queue.iter_mut().filter(|pair| self.node_a(pair.0).level == deepest) {
                pair.0 = self.node_a(pair.0).parent;
            }
        }
        // The upper of two nodes stands for the lower, so that no area counts twice.
        for i in 0..queue.len() {
            if let Some(upper) = self.upper(queue[i].0, queue) {
                queue[i].0 = upper;
            }
        }
        queue.sort_unstable();
        coupled.retain(|c| self.upper(c.node_a, queue).is_none() && queue.binary_search_by_key(&c.node_a, |pair| pair.0).is_err());
        for group in queue.chunk_by(|p, q| p.0 == q.0) {
            let node_a = group[0].0;
            if let Some((leaf, node_b)) = self.meeting(stack, node_a) {
                coupled.push(Coupled { control_point: self.node_a(leaf).first_leaf, node_a, node_b });
            }
        }
    }

    /// The uppermost ancestor of a node that is in the queue.
    fn upper(&self, mut index: u32, queue: &[(u32, u32)]) -> Option<u32> {
        let mut found = None;
        while index != 0 {
            index = self.node_a(index).parent;
            if queue.iter().any(|pair| pair.0 == index) {
                found = Some(index);
            }
        }
        found
    }
}

/// Area of a node that is in contact where its control point is, m^2: the share of its leaves whose control points lie on or under the
/// plane through the foot, at least the control point's own. `height`: of a control point at rest over that plane, m.
pub(super) fn area_in_contact(surface: &Surface, node: &Node, control_point: usize, margin: Real, height: impl Fn(&Vec3) -> Real) -> Real {
    let count = node.leaf_count.min(SAMPLES);
    let leaf = |k: u32| (node.first_leaf + (2 * k + 1) * node.leaf_count / (2 * count)) as usize;
    let under = (0..count).filter(|&k| height(&surface.control.points[leaf(k)]) <= margin).count();
    (node.area * under as Real / Real::from(count)).max(surface.control.areas[control_point])
}

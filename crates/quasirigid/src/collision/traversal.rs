//! Two sphere trees against each other, breadth-first, within a budget of sphere tests.
//!
//! Breadth-first, so that a traversal that runs out of budget has gone equally deep everywhere: what is left in the queue is coupled at the
//! level reached, inner nodes standing for what lies below them (time-critical collision, Klein and Zachmann).

use super::Pair;
use crate::body::BodyEntry;
use crate::math::{Mat3, Pose, Real, Vec3};
use crate::params::Parameters;

/// A node of `a` and a node of `b` that overlap; both leaves unless the budget ran out.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coupled {
    pub pair: u32,
    /// Control point of `a`: the leaf's, or the representative of an inner node.
    pub control_point: u32,
    pub node_a: u32,
    pub node_b: u32,
}

#[derive(Debug, Default)]
pub(super) struct Traversal {
    pub coupled: Vec<Coupled>,
    pub coarse: bool,
    tests: usize,
    queue: Vec<(u32, u32)>,
}

impl Traversal {
    pub fn clear(&mut self) {
        self.coupled.clear();
        self.coarse = false;
        self.tests = 0;
    }
}

/// Adds the coupled nodes of one pair, ordered by control point.
pub(super) fn traverse(out: &mut Traversal, index: usize, pair: &Pair, bodies: &[BodyEntry], reach: &[Real], params: &Parameters) {
    let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
    let (Some(skin_a), Some(skin_b)) = (entry_a.active_skin(), entry_b.active_skin()) else { return };
    let (tree_a, tree_b) = (&skin_a.surface.tree, &skin_b.surface.tree);
    let pose_ba: Pose = entry_b.body.link_pose(entry_b.skin_link).inverse() * entry_a.body.link_pose(entry_a.skin_link);
    let (turn, shift): (Mat3, Vec3) = (pose_ba.rotation.to_rotation_matrix().into_inner(), pose_ba.translation.vector);
    let margin = params.contact_margin + reach[pair.a as usize] + reach[pair.b as usize];

    let first = out.coupled.len();
    out.queue.clear();
    out.queue.push((0, 0));
    let mut next = 0;
    while next < out.queue.len() {
        let (na, nb) = out.queue[next];
        next += 1;
        if out.tests >= params.traversal_budget {
            // No budget left even for the test: couple what is queued, as it is.
            couple(out, index, tree_a.nodes[na as usize].representative, na, nb);
            out.coarse |= tree_a.nodes[na as usize].children.is_some() || tree_b.nodes[nb as usize].children.is_some();
            continue;
        }
        out.tests += 1;
        let (sphere_a, sphere_b) = (&skin_a.spheres[na as usize], &skin_b.spheres[nb as usize]);
        let center_a = turn * sphere_a.center + shift;
        let touching = sphere_a.radius + sphere_b.radius + margin;
        if (center_a - sphere_b.center).norm_squared() > touching * touching {
            continue;
        }
        let (node_a, node_b) = (&tree_a.nodes[na as usize], &tree_b.nodes[nb as usize]);
        match (node_a.children, node_b.children) {
            (None, None) => couple(out, index, node_a.first_leaf, na, nb),
            (Some([l, r]), other) if other.is_none() || sphere_a.radius >= sphere_b.radius => {
                out.queue.push((l, nb));
                out.queue.push((r, nb));
            }
            (_, Some([l, r])) => {
                out.queue.push((na, l));
                out.queue.push((na, r));
            }
            (Some(_), None) => {} // covered by the guard above
        }
    }
    out.coupled[first..].sort_unstable_by_key(|c| (c.control_point, c.node_a, c.node_b));
}

fn couple(out: &mut Traversal, pair: usize, control_point: u32, node_a: u32, node_b: u32) {
    out.coupled.push(Coupled { pair: pair as u32, control_point, node_a, node_b });
}

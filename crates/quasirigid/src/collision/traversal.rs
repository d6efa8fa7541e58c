//! Two sphere trees against each other, breadth-first, within a budget of sphere tests.
//!
//! Breadth-first, so that a traversal that runs out of budget has gone equally deep everywhere: [`super::coarse`] couples what is then left in the queue.

use super::coarse::{LEAST, Trees};
use super::{Pair, deep};
use crate::body::{BodyEntry, Skin, Sphere};
use crate::math::{Mat3, Pose, Real, Rot, Vec3};
use crate::params::Parameters;
use nalgebra::Point3;
use std::time::{Duration, Instant};

/// A node of `a` and a leaf of `b` that overlap.
#[derive(Debug, Clone, Copy)]
pub struct Coupled {
    /// Control point of `a`: the leaf's, or the one that stands for an inner node.
    pub control_point: u32,
    /// Node of `a`: a leaf unless the budget ran out.
    pub node_a: u32,
    /// Leaf of `b`, as a node.
    pub node_b: u32,
}

/// The coupled nodes of a pair, and how far the two may move before they have to be found again (temporal coherence, which the paper proposes in section 4).
#[derive(Debug, Clone)]
pub struct Coupling {
    /// Ordered by control point.
    pub coupled: Vec<Coupled>,
    /// Margin by which the spheres were inflated, m; negative: nothing found yet.
    margin: Real,
    /// Whether control points were seen inside the other body, deeper than contact goes: those that the trees do not reach are then looked for, too.
    pub(super) deep: bool,
    /// Whether they were looked for since the nodes were found.
    searched: bool,
    /// When they were found.
    found: Moment,
    /// Rotation of `a` against `b` when control points that nothing faced were last looked at anew because of it.
    faced: Rot,
    /// Since when, and for how far a motion (m), no control point has a chance to become a contact.
    quiet: Option<(Moment, Real)>,
}

/// Pose of `a` in the frame of `b`, and how far the two surfaces had deformed (m), at some time.
#[derive(Debug, Clone, Copy)]
struct Moment {
    pose_ba: Pose,
    travel: Real,
}

impl Moment {
    /// Of the step under way.
    fn now(a: u32, b: u32, bodies: &[BodyEntry]) -> Self {
        let (a, b) = (&bodies[a as usize], &bodies[b as usize]);
        let travel = |entry: &BodyEntry| entry.skin.as_ref().map_or(0.0, |skin| skin.travel);
        let pose_ba = b.body.link_pose(b.skin_link).inverse() * a.body.link_pose(a.skin_link);
        Self { pose_ba, travel: travel(a) + travel(b) }
    }

    /// How far any point of `a`, within the sphere `root` of its frame, has moved against `b` since `old` at most, m.
    fn moved_since(&self, old: &Self, root: &Sphere) -> Real {
        let center = Point3::from(root.center);
        (self.pose_ba * center - old.pose_ba * center).norm()
            + old.pose_ba.rotation.angle_to(&self.pose_ba.rotation) * root.radius
            + (self.travel - old.travel)
    }
}

impl Coupling {
    /// Whether no control point can have become a contact, though the free motion may take the two nearer to each other by `approach`, m.
    pub(super) fn is_quiet(&mut self, a: u32, b: u32, bodies: &[BodyEntry], approach: Real) -> bool {
        let (Some((since, reach)), Some(skin_a)) = (&self.quiet, bodies[a as usize].active_skin()) else { return false };
        let quiet = Moment::now(a, b, bodies).moved_since(since, &skin_a.bounding_sphere()) + approach <= *reach;
        if !quiet {
            self.quiet = None;
        }
        quiet
    }

    /// From now on, and until the two have moved by `reach` (m) or are coupled anew, no control point can become a contact.
    pub(super) fn be_quiet(&mut self, reach: Real, a: u32, b: u32, bodies: &[BodyEntry]) {
        self.quiet = Some((Moment::now(a, b, bodies), reach));
    }

    /// Whether the last look found that no control point can become a contact.
    pub(super) fn sees_nothing(&self) -> bool {
        self.quiet.is_some()
    }
}

/// Coupled nodes are kept until the bodies have moved by this many spacings of the coarser control points, if that is more than [`Parameters::traversal_slack`]:
/// beside spheres of that size the few nodes more that are found are no work.
const SLACK_SPACINGS: Real = 0.1;

/// Turned by more than this against each other, other points of two surfaces may face each other, rad.
const TURNED: Real = 0.02;

impl Default for Coupling {
    /// Nothing found yet.
    fn default() -> Self {
        let found = Moment { pose_ba: Pose::identity(), travel: 0.0 };
        Self { coupled: Vec::new(), margin: -1.0, deep: false, searched: false, found, faced: Rot::identity(), quiet: None }
    }
}

#[derive(Debug, Default)]
pub(super) struct Traversal {
    pub coarse: bool,
    /// Sphere tests that each pair may spend.
    share: usize,
    /// Time in which spheres were refitted.
    pub refit_time: Duration,
    queue: Vec<(u32, u32)>,
    stack: Vec<u32>,
}

impl Traversal {
    /// Starts a step in which `pairs` may have to be traversed.
    pub fn start(&mut self, pairs: usize, budget: usize) {
        (self.coarse, self.refit_time) = (false, Duration::ZERO);
        self.share = (budget / pairs.max(1)).max(LEAST);
    }
}

/// Finds the coupled nodes of one pair, among spheres that are refitted first, unless those found before still hold: while the two have moved less than the slack they were inflated by,
/// whatever overlaps now is among them.
pub(super) fn traverse(out: &mut Traversal, pair: &mut Pair, bodies: &mut [BodyEntry], reach: &[Real], params: &Parameters) {
    let Some(root_a) = bodies[pair.a as usize].active_skin().map(Skin::bounding_sphere) else { return };
    let now = Moment::now(pair.a, pair.b, bodies);
    let needed = params.contact_margin + reach[pair.a as usize] + reach[pair.b as usize];
    let coupling = &mut pair.coupling;
    let moved = now.moved_since(&coupling.found, &root_a);
    let turned = coupling.faced.angle_to(&now.pose_ba.rotation) > TURNED;
    if turned {
        (coupling.faced, coupling.quiet) = (now.pose_ba.rotation, None);
        for c in &coupling.coupled {
            pair.remembered[c.control_point as usize].turned();
        }
    }
    if needed + moved <= coupling.margin && (coupling.searched || !coupling.deep) {
        return;
    }
    let start = Instant::now();
    for body in [pair.a, pair.b] {
        if let Some(skin) = &mut bodies[body as usize].skin {
            skin.refit(params);
        }
    }
    out.refit_time += start.elapsed();
    let (Some(skin_a), Some(skin_b)) = (bodies[pair.a as usize].active_skin(), bodies[pair.b as usize].active_skin()) else { return };
    let slack = params.traversal_slack.max(SLACK_SPACINGS * skin_a.surface.control.spacing.max(skin_b.surface.control.spacing));
    (coupling.margin, coupling.searched, coupling.found, coupling.quiet) = (needed + slack, coupling.deep, now, None);
    couple(out, pair, skin_a, skin_b);
    for group in pair.coupling.coupled.chunk_by(|c, d| c.control_point == d.control_point) {
        // FNV-1a over the leaves; 0 stands for none.
        let leaves = group.iter().fold(0x811c_9dc5, |hash: u32, c| (hash ^ c.node_b).wrapping_mul(0x0100_0193));
        pair.remembered[group[0].control_point as usize].coupled_anew(leaves.max(1));
    }
}

/// Finds the coupled nodes anew.
fn couple(out: &mut Traversal, pair: &mut Pair, skin_a: &Skin, skin_b: &Skin) {
    let (tree_a, tree_b) = (&skin_a.surface.tree, &skin_b.surface.tree);
    let coupling = &mut pair.coupling;
    let (pose_ba, margin) = (coupling.found.pose_ba, coupling.margin);
    let (turn, shift): (Mat3, Vec3) = (pose_ba.rotation.to_rotation_matrix().into_inner(), pose_ba.translation.vector);
    coupling.coupled.clear();
    let out_coupled = &mut coupling.coupled;
    let (mut coarse, mut tests) = (false, 0);
    let mut apart = Real::INFINITY;
    out.queue.clear();
    out.queue.push((0, 0));
    let mut next = 0;
    while next < out.queue.len() {
        let (na, nb) = out.queue[next];
        next += 1;
        if 4 * tests >= out.share {
            coarse = true;
            next -= 1;
            break;
        }
        tests += 1;
        let (sphere_a, sphere_b) = (&skin_a.spheres[na as usize], &skin_b.spheres[nb as usize]);
        let center_a = turn * sphere_a.center + shift;
        let touching = sphere_a.radius + sphere_b.radius + margin;
        let distance2 = (center_a - sphere_b.center).norm_squared();
        if distance2 > touching * touching {
            apart = apart.min(distance2.sqrt() - touching);
            continue;
        }
        let (node_a, node_b) = (&tree_a.nodes[na as usize], &tree_b.nodes[nb as usize]);
        match (node_a.children, node_b.children) {
            (None, None) => out_coupled.push(Coupled { control_point: node_a.first_leaf, node_a: na, node_b: nb }),
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
    if coarse {
        out.queue.drain(..next);
        let trees = Trees {
            surface_a: &skin_a.surface,
            surface_b: &skin_b.surface,
            point: |p: &Vec3| turn * p + shift,
            direction: |n: &Vec3| turn * n,
        };
        trees.couple_queued(&mut out.stack, &mut out.queue, out_coupled, out.share - tests);
    }
    out_coupled.sort_unstable_by_key(|c| (c.control_point, c.node_a, c.node_b));
    if coarse {
        // What a spent budget left coarse is looked at again in the next step.
        coupling.margin = -1.0;
        out.coarse = true;
        return;
    }
    let control = &skin_a.surface.control;
    let place = |c: usize| (turn * (control.points[c] + pair.side_a.displacement[c]) + shift, turn * control.normals[c]);
    if out_coupled.is_empty() && !coupling.deep {
        // Near, and no surface near the other: apart, or one inside the other.
        coupling.deep = deep::depth_inside(&mut out.stack, &skin_b.surface, &place(0).0).is_some();
        coupling.searched = coupling.deep;
        if !coupling.deep {
            // Nothing can overlap before they are nearer by what parts the nearest two spheres that were looked at.
            coupling.margin += apart;
        }
    }
    if coupling.deep {
        coupling.deep = deep::couple_swallowed(&mut out.stack, &mut coupling.coupled, &tree_a.leaves, &skin_b.surface, place);
    }
}

//! Control points of coupled leaves, projected on the other surface (design 3.2, points 3 to 5).

use super::{Contact, Coupled, Pair};
use crate::body::{BodyEntry, Skin};
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Pose, Real, Vec3, contact_frame};
use crate::params::Parameters;
use crate::surface::Weights;
use crate::surface::kernel::Kernel;
use crate::surface::moving_least_squares::{FACES, project};
use nalgebra::Point3;
use rayon::prelude::*;
use std::ops::Range;

/// A projection farther from the nearest sample than this many leaf gaps (half the distance to a close neighbour) has left the border of its leaf.
const BORDER_GAPS: Real = 1.5;

/// Most steps of a projection; two or three are usual.
const MOST_PROJECTIONS: u32 = 10;

/// Control points of one chunk of parallel work.
const CHUNK: usize = 32;

/// One control point with a coupled leaf: its pair, and the range of its coupled nodes there.
type Group = (u32, Range<u32>);

/// What a control point remembers of its last projection (temporal coherence, which the paper proposes in section 4). All in the frame of `b`.
#[derive(Debug, Clone)]
pub struct Remembered {
    /// Where the control point was projected from.
    x: Vec3,
    /// How far it may go from there before it has to be looked at again, m; negative: nothing known.
    holds_for: Real,
    /// What was found there.
    surface: Seen,
}

/// The other surface as a control point sees it.
// A box around the larger variant would be an allocation in the step.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone)]
enum Seen {
    /// Too far, or no projection within the border.
    Nothing,
    /// Foot, outward normal, and the control points that the foot is interpolated from.
    Foot { foot: Vec3, normal: Vec3, weights: Weights },
}

impl Default for Remembered {
    fn default() -> Self {
        Self { x: Vec3::zeros(), holds_for: -1.0, surface: Seen::Nothing }
    }
}

#[derive(Debug, Default)]
pub(super) struct Scratch {
    groups: Vec<Group>,
    found: Vec<Found>,
}

/// Outcome of one control point: its contact, and what it learnt if it had to look.
#[derive(Debug, Clone, Default)]
struct Found {
    contact: Option<Contact>,
    learnt: Option<Remembered>,
}

/// Every control point with a coupled leaf is projected once, from the leaf that holds the nearest point that faces it.
pub(super) fn project_control_points(
    scratch: &mut Scratch,
    pairs: &mut [Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    params: &Parameters,
    contacts: &mut Vec<Contact>,
) {
    scratch.groups.clear();
    for (index, pair) in pairs.iter().enumerate().filter(|(_, pair)| pair.near) {
        let coupled = &pair.coupling.coupled;
        let mut first = 0;
        for end in 1..=coupled.len() {
            if end == coupled.len() || coupled[end].control_point != coupled[first].control_point {
                scratch.groups.push((index as u32, first as u32..end as u32));
                first = end;
            }
        }
    }
    scratch.found.clear();
    scratch.found.resize(scratch.groups.len(), Found::default());
    let known: &[Pair] = pairs;
    let work = |(groups, found): (&[Group], &mut [Found])| {
        let mut view: Option<View> = None;
        for ((index, group), slot) in groups.iter().zip(found) {
            if view.as_ref().is_none_or(|view| view.index != *index) {
                view = View::of(*index, known, bodies, free, params);
            }
            if let Some(view) = &view {
                *slot = view.look(&view.pair.coupling.coupled[group.start as usize..group.end as usize]);
            }
        }
    };
    if params.threads > 1 {
        scratch.groups.par_chunks(CHUNK).zip(scratch.found.par_chunks_mut(CHUNK)).for_each(work);
    } else {
        work((&scratch.groups, &mut scratch.found));
    }
    contacts.clear();
    for ((index, group), found) in scratch.groups.iter().zip(&mut scratch.found) {
        let pair = &mut pairs[*index as usize];
        if let Some(learnt) = found.learnt.take() {
            let control_point = pair.coupling.coupled[group.start as usize].control_point;
            pair.remembered[control_point as usize] = learnt;
        }
        contacts.extend(found.contact.take());
    }
}

/// One pair, with what all its control points need.
struct View<'a> {
    index: u32,
    pair: &'a Pair,
    a: &'a BodyEntry,
    b: &'a BodyEntry,
    skin_a: &'a Skin,
    skin_b: &'a Skin,
    free_a: &'a FreeMotion,
    free_b: &'a FreeMotion,
    pose_a: Pose,
    pose_b: Pose,
    turn_ba: Mat3,
    shift_ba: Vec3,
    params: &'a Parameters,
}

impl<'a> View<'a> {
    fn of(index: u32, pairs: &'a [Pair], bodies: &'a [BodyEntry], free: &'a [FreeMotion], params: &'a Parameters) -> Option<Self> {
        let pair = &pairs[index as usize];
        let (a, b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        let (pose_a, pose_b) = (a.body.link_pose(a.skin_link), b.body.link_pose(b.skin_link));
        let pose_ba: Pose = pose_b.inverse() * pose_a;
        Some(Self {
            index,
            pair,
            a,
            b,
            skin_a: a.active_skin()?,
            skin_b: b.active_skin()?,
            free_a: &free[pair.a as usize],
            free_b: &free[pair.b as usize],
            pose_a,
            pose_b,
            turn_ba: pose_ba.rotation.to_rotation_matrix().into_inner(),
            shift_ba: pose_ba.translation.vector,
            params,
        })
    }

    /// Looks where the control point of a group is now.
    fn look(&self, coupled: &[Coupled]) -> Found {
        let control_point = coupled[0].control_point as usize;
        let control = &self.skin_a.surface.control;
        // The control point where the last step left it, in the frame of b.
        let x = self.turn_ba * (control.points[control_point] + self.pair.side_a.displacement[control_point]) + self.shift_ba;
        let point = (self.pose_b * Point3::from(x)).coords;
        let approach = self.a.free_displacement(self.free_a, &point) - self.b.free_displacement(self.free_b, &point);

        let known = &self.pair.remembered[control_point];
        let moved = (x - known.x).norm();
        let mut learnt = None;
        if moved + if matches!(known.surface, Seen::Nothing) { approach.norm() } else { 0.0 } > known.holds_for {
            learnt = Some(self.project(&x, control_point, &approach, coupled));
        }
        let Seen::Foot { foot, normal, weights } = &learnt.as_ref().unwrap_or(known).surface else {
            return Found { contact: None, learnt };
        };
        let u_b = self.pair.displacement_of_b(control_point, weights);
        let gap = normal.dot(&(x - foot - u_b));
        let world_normal = self.pose_b * normal;
        // Enters if it touches now or would after the free motion: nothing fast slips through a step.
        if gap + world_normal.dot(&approach).min(0.0) > self.params.contact_margin {
            return Found { contact: None, learnt };
        }
        let frame: Mat3 = contact_frame(&world_normal, &(self.pose_a * control.tangents[control_point]));
        let area = coupled.iter().map(|c| self.skin_a.surface.tree.nodes[c.node_a as usize].area).fold(0.0, Real::max);
        let contact = Contact {
            pair: self.index,
            body_a: self.pair.a,
            body_b: self.pair.b,
            control_point: control_point as u32,
            point,
            frame,
            gap,
            area,
            foot: *foot,
            weights_b: *weights,
            projected: learnt.is_some(),
        };
        Found { contact: Some(contact), learnt }
    }

    /// Projects `x` on `b`.
    fn project(&self, x: &Vec3, control_point: usize, approach: &Vec3, coupled: &[Coupled]) -> Remembered {
        let nothing = |holds_for: Real| Remembered { x: *x, holds_for, surface: Seen::Nothing };
        let (params, surface) = (self.params, &self.skin_b.surface);
        let normal_a = self.turn_ba * self.skin_a.surface.control.normals[control_point];
        let Some((node_b, nearest)) = nearest_node(coupled, self.skin_b, x, &normal_a) else { return nothing(-1.0) };
        let leaf_b = surface.tree.nodes[node_b as usize].representative as usize;
        let border = Border::of(self.skin_b, node_b, x);
        // The plane of the nearest point is off by far less than a leaf gap: most control points can be told to be apart without a projection.
        let plane_gap = surface.normals[nearest].dot(&(x - surface.points[nearest] - self.pair.side_b.displacement[leaf_b]));
        let clear = plane_gap - params.contact_margin - border.gap;
        if clear > approach.norm() {
            return nothing(clear.min(params.traversal_slack));
        }
        let found = project(
            x,
            &surface.points,
            &surface.normals,
            border.ranges(),
            &border.kernel,
            Some(&normal_a),
            params.projection_tolerance,
            MOST_PROJECTIONS,
        );
        let Some(q) = found else { return nothing(-1.0) };
        // Artefacts of high curvature: a surface that does not face the control point, or a foot beyond the border of the leaf.
        let aside = surface.points[q.nearest] - q.point;
        let aside = aside - q.normal * q.normal.dot(&aside);
        if q.normal.dot(&normal_a) >= FACES || aside.norm() > BORDER_GAPS * border.gap {
            return nothing(-1.0);
        }
        // Deep under a face that looks the other way, yet outside: the far side of something thin that a fast body is about to meet on its near side.
        if q.normal.dot(&(q.point - x)) > surface.spacing && is_outside(coupled, self.skin_b, x) {
            return nothing(-1.0);
        }
        let weights = surface.control_weights(&q.point, &q.normal, leaf_b);
        let surface = Seen::Foot { foot: q.point, normal: q.normal, weights };
        Remembered { x: *x, holds_for: params.projection_slack, surface }
    }
}

/// Of the coupled nodes, the one with the point nearest to `x` among those that face the control point. Of the leaves that claim a control point the
/// nearest keeps it; looking at points alone finds it without projecting on each.
fn nearest_node(coupled: &[Coupled], skin_b: &Skin, x: &Vec3, normal_a: &Vec3) -> Option<(u32, usize)> {
    let surface = &skin_b.surface;
    let mut best: Option<(Real, u32, usize)> = None;
    for c in coupled {
        let node = &surface.tree.nodes[c.node_b as usize];
        // No point of the node is nearer than its sphere.
        let clear = (node.center - x).norm() - node.radius;
        if clear > 0.0 && best.is_some_and(|(least, ..)| clear * clear > least) {
            continue;
        }
        let mut look = |k: usize| {
            let distance2 = (surface.points[k] - x).norm_squared();
            if best.is_none_or(|(least, ..)| distance2 < least) && surface.normals[k].dot(normal_a) < FACES {
                best = Some((distance2, c.node_b, k));
            }
        };
        if node.children.is_none() {
            node.points().for_each(look);
        } else {
            (0..node.sample_len()).map(|k| node.sample(k)).for_each(&mut look);
        }
    }
    best.map(|(_, node, point)| (node, point))
}

/// Whether `x` lies outside, as the nearest point of all coupled nodes sees it, facing or not.
fn is_outside(coupled: &[Coupled], skin_b: &Skin, x: &Vec3) -> bool {
    let surface = &skin_b.surface;
    let points = coupled.iter().flat_map(|c| {
        let node = &surface.tree.nodes[c.node_b as usize];
        let count = if node.children.is_none() { node.point_count as usize } else { node.sample_len() };
        (0..count).map(move |k| if node.children.is_none() { node.first_point as usize + k } else { node.sample(k) })
    });
    let distance2 = |k: &usize| (surface.points[*k] - x).norm_squared();
    let nearest = points.min_by(|i, j| distance2(i).total_cmp(&distance2(j)));
    nearest.is_some_and(|k| surface.normals[k].dot(&(x - surface.points[k])) > 0.0)
}

/// Points that decide where the surface is: those of the coupled leaf and of its border; of an inner node its sample.
struct Border {
    count: usize,
    list: [Range<u32>; Border::MOST],
    kernel: Kernel,
    gap: Real,
}

impl Border {
    const MOST: usize = 64;

    fn of(skin: &Skin, index: u32, x: &Vec3) -> Self {
        let surface = &skin.surface;
        let node = &surface.tree.nodes[index as usize];
        let mut border = Self { count: 0, list: [const { 0..0 }; Self::MOST], kernel: surface.kernel, gap: 0.0 };
        if node.children.is_none() {
            let leaf = node.first_leaf as usize;
            border.gap = surface.leaf_gaps[leaf];
            border.push(node.first_point..node.first_point + node.point_count);
            for &other in surface.leaf_neighbours.row(leaf) {
                let other = surface.tree.leaf(other as usize);
                let reach = other.radius + surface.kernel.cutoff();
                if (other.center - x).norm_squared() < reach * reach {
                    border.push(other.first_point..other.first_point + other.point_count);
                }
            }
        } else {
            let spacing = (node.area / node.sample_len() as Real).sqrt();
            // A node of points has a positive area: the kernel of the leaves is never the one used.
            (border.kernel, border.gap) = (Kernel::for_spacing(spacing).unwrap_or(surface.kernel), spacing);
            for k in 0..node.sample_len() {
                let point = node.sample(k) as u32;
                border.push(point..point + 1);
            }
        }
        border
    }

    fn push(&mut self, range: Range<u32>) {
        if self.count < Self::MOST {
            self.list[self.count] = range;
            self.count += 1;
        }
    }

    fn ranges(&self) -> &[Range<u32>] {
        &self.list[..self.count]
    }
}

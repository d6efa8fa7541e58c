//! Control points of coupled leaves, projected on the other surface (design 3.2, points 3 to 5).

use super::coarse::area_in_contact;
use super::nearest_point::{Border, SAME_FACE, faces_meet, height_over_nearest, is_outside, nearest_node};
use super::{Contact, Coupled, Pair};
use crate::body::{BodyEntry, Skin};
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Pose, Real, Vec3, contact_frame};
use crate::params::Parameters;
use crate::surface::Weights;
use crate::surface::moving_least_squares::{Cloud, FACES, project};
use rayon::prelude::*;
use std::ops::Range;

/// A projection farther from the nearest sample than this many leaf gaps (half the distance to a close neighbour) has left the border of its leaf.
const BORDER_GAPS: Real = 1.5;

/// A control point that lies this many leaf gaps under the other surface lies deeper than contact goes.
const DEEP: Real = 1.0;

/// A control point that nothing faces, or whose projection had to be rejected, is looked at again once it has moved by this many spacings of the other surface; one where
/// faces meet once its place at rest has. No projection is kept for longer.
const SLACK: Real = 0.05;

/// [`Parameters::projection_slack`] is meant for this radius of curvature, m.
const SLACK_RADIUS: Real = 1e-3;

/// Most steps of a projection; two or three are usual.
const MOST_PROJECTIONS: u32 = 10;

/// Projections of one chunk of parallel work.
const CHUNK: usize = 8;

/// What a control point remembers of its last projection (temporal coherence, which the paper proposes in section 4). All in the frame of `b`.
#[derive(Debug, Clone)]
pub struct Remembered {
    /// Where the control point was projected from.
    x: Vec3,
    /// How far it may go from there before it has to be looked at again, m.
    holds_for: Real,
    /// What was found there.
    surface: Seen,
    /// Where it was at rest, without elastic displacement, if faces of the other surface meet near it: that decides which of them it belongs to.
    at_edge: Option<Vec3>,
    /// Whether it lies inside the other body by more than contact does, see [`super::deep`].
    deep: bool,
    /// Stands for the coupled leaves of the other surface.
    leaves: u32,
}

impl Remembered {
    /// `leaves` stands for the leaves that the control point is coupled with from now on. What was not there to be seen may be there now if they are others.
    pub(super) fn coupled_anew(&mut self, leaves: u32) {
        if leaves != self.leaves {
            self.turned();
        }
        self.leaves = leaves;
    }

    /// The bodies have turned against each other: other points may face it, and what was not there to be seen may be there now.
    pub(super) fn turned(&mut self) {
        if !matches!(self.surface, Seen::Foot { .. }) {
            *self = Self { leaves: self.leaves, ..Self::default() };
        }
    }
}

/// The other surface as a control point sees it.
// A box around the larger variant would be an allocation in the step.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone)]
enum Seen {
    /// Nothing that faces it, or no projection within the border.
    Nothing,
    /// Too far: nothing to find until control point and free motion together have gone as far as it holds.
    Apart,
    /// Foot, outward normal, and the control points that the foot is interpolated from.
    Foot { foot: Vec3, normal: Vec3, weights: Weights },
}

impl Default for Remembered {
    fn default() -> Self {
        // From nowhere: whatever the control point does, it has moved too far.
        Self { x: Vec3::repeat(Real::INFINITY), holds_for: 0.0, surface: Seen::Nothing, at_edge: None, deep: false, leaves: 0 }
    }
}

#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Control points that have to be looked at anew.
    due: Vec<Due>,
    learnt: Vec<Remembered>,
}

/// A control point that what it remembers no longer holds for.
#[derive(Debug, Clone)]
struct Due {
    pair: u32,
    /// Its coupled nodes in the pair's list.
    coupled: Range<u32>,
    /// Where it is, in the frame of `b`.
    x: Vec3,
    /// How far the free motion takes it against `b`, m.
    approach: Real,
}

/// What all projections of a step look at: geometry is frozen at its start.
#[derive(Clone, Copy)]
pub(super) struct Snapshot<'a> {
    pub bodies: &'a [BodyEntry],
    pub free: &'a [FreeMotion],
    /// How far any surface point of each body may move in this step before contact forces, m.
    pub reach: &'a [Real],
    pub params: &'a Parameters,
    /// Whether what is remembered is held against its usual limits in this step, see [`Parameters::collision_every`].
    pub look: bool,
}

/// Every control point with a coupled leaf becomes a contact if it is near enough. Where what it remembers no longer holds it is projected first, once, from
/// the leaf that holds the nearest point that faces it.
pub(super) fn project_control_points(scratch: &mut Scratch, pairs: &mut [Pair], now: Snapshot<'_>, contacts: &mut Vec<Contact>) {
    let Snapshot { bodies, reach, params, .. } = now;
    // Between two looks a foot and its tangent plane are carried along with `b`, for as far as a contact is seen coming.
    let carried = if now.look { -1.0 } else { params.contact_margin };
    // Room for every control point that is coupled: how many of them are due at once may show long after a step has first met them.
    let room = pairs.iter().map(|pair| pair.coupling.coupled.capacity()).sum();
    scratch.due.clear();
    scratch.due.reserve(room);
    scratch.learnt.reserve(room);
    for (index, pair) in pairs.iter_mut().enumerate().filter(|(_, pair)| pair.near) {
        let approach = reach[pair.a as usize] + reach[pair.b as usize];
        if pair.coupling.coupled.is_empty() || pair.coupling.is_quiet(pair.a, pair.b, bodies, approach) {
            continue;
        }
        let Some(view) = View::of(pair, now) else { continue };
        let slack = SLACK * view.skin_b.surface.spacing;
        let first = scratch.due.len();
        let mut quiet_for = Real::INFINITY;
        for coupled in groups(&pair.coupling.coupled) {
            let control_point = pair.coupling.coupled[coupled.start].control_point as usize;
            let (x, approach) = view.locate(pair, control_point);
            let known = &pair.remembered[control_point];
            let (moved, approach) = ((x - known.x).norm(), approach.norm());
            let left_at_edge = known.at_edge.map_or(Real::INFINITY, |rest| slack - (view.at_rest(control_point) - rest).norm());
            let (left, sees) = match known.surface {
                Seen::Foot { .. } => (known.holds_for.max(carried) - moved, true),
                Seen::Nothing => (known.holds_for.max(carried) - moved, false),
                Seen::Apart => (known.holds_for - moved - approach, false),
            };
            if left_at_edge < 0.0 || left.is_nan() || left < 0.0 {
                scratch.due.push(Due { pair: index as u32, coupled: coupled.start as u32..coupled.end as u32, x, approach });
            }
            quiet_for = if sees { -1.0 } else { quiet_for.min(left).min(left_at_edge) };
        }
        if scratch.due.len() == first && quiet_for > 0.0 && pair.side_a.active.is_empty() {
            pair.coupling.be_quiet(quiet_for, pair.a, pair.b, bodies);
        }
    }
    scratch.learnt.clear();
    scratch.learnt.resize(scratch.due.len(), Remembered::default());
    let known: &[Pair] = pairs;
    let work = |(due, learnt): (&[Due], &mut [Remembered])| {
        let mut view: Option<(u32, View)> = None;
        for (due, learnt) in due.iter().zip(learnt) {
            let pair = &known[due.pair as usize];
            if view.as_ref().is_none_or(|(index, _)| *index != due.pair) {
                view = View::of(pair, now).map(|view| (due.pair, view));
            }
            if let Some((_, view)) = &view {
                *learnt = view.project(pair, due);
            }
        }
    };
    if params.threads > 1 && scratch.due.len() > CHUNK {
        scratch.due.par_chunks(CHUNK).zip(scratch.learnt.par_chunks_mut(CHUNK)).for_each(work);
    } else {
        work((&scratch.due, &mut scratch.learnt));
    }
    contacts.clear();
    let mut learnt = scratch.due.iter().zip(scratch.learnt.drain(..)).peekable();
    for (index, pair) in pairs.iter_mut().enumerate().filter(|(_, pair)| pair.near) {
        if pair.coupling.coupled.is_empty() || pair.coupling.sees_nothing() {
            continue;
        }
        let Some(view) = View::of(pair, now) else { continue };
        for coupled in groups(&pair.coupling.coupled) {
            let (start, control_point) = (coupled.start as u32, pair.coupling.coupled[coupled.start].control_point as usize);
            let new = learnt.next_if(|(due, _)| due.pair == index as u32 && due.coupled.start == start);
            let projected = new.is_some();
            if let Some((_, new)) = new {
                pair.coupling.deep |= new.deep;
                let known = &mut pair.remembered[control_point];
                *known = Remembered { leaves: known.leaves, ..new };
            }
            contacts.extend(view.contact(pair, index as u32, &pair.coupling.coupled[coupled], projected));
        }
    }
}

/// Ranges of a list of coupled nodes that belong to one control point each.
fn groups(coupled: &[Coupled]) -> impl Iterator<Item = Range<usize>> {
    let mut end = 0;
    coupled.chunk_by(|c, d| c.control_point == d.control_point).map(move |group| {
        end += group.len();
        end - group.len()..end
    })
}

/// What all control points of one pair need.
struct View<'a> {
    skin_a: &'a Skin,
    skin_b: &'a Skin,
    turn_a: Mat3,
    turn_b: Mat3,
    shift_b: Vec3,
    turn_ba: Mat3,
    shift_ba: Vec3,
    /// Displacement of `a` against `b` by free and prescribed motion at the point `x`, all in the frame of `b`: `drift + shear x`. Bodies are rigid, so it is affine.
    drift: Vec3,
    shear: Mat3,
    params: &'a Parameters,
}

impl<'a> View<'a> {
    fn of(pair: &Pair, now: Snapshot<'a>) -> Option<Self> {
        let Snapshot { bodies, free, params, .. } = now;
        let (a, b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        let (pose_a, pose_b) = (a.body.link_pose(a.skin_link), b.body.link_pose(b.skin_link));
        let pose_ba: Pose = pose_b.inverse() * pose_a;
        let matrix = |pose: &Pose| pose.rotation.to_rotation_matrix().into_inner();
        let (turn_b, shift_b) = (matrix(&pose_b), pose_b.translation.vector);
        let approach = |point: &Vec3| turn_b.tr_mul(&pair.free_displacement(bodies, free, point));
        let drift = approach(&shift_b);
        let axis = |k: usize| approach(&(shift_b + turn_b.column(k))) - drift;
        Some(Self {
            skin_a: a.active_skin()?,
            skin_b: b.active_skin()?,
            turn_a: matrix(&pose_a),
            turn_b,
            shift_b,
            turn_ba: matrix(&pose_ba),
            shift_ba: pose_ba.translation.vector,
            drift,
            shear: Mat3::from_columns(&[axis(0), axis(1), axis(2)]),
            params,
        })
    }

    /// A control point where the last step left it, and how far the free motion takes it against `b`, both in the frame of `b`.
    #[inline]
    fn locate(&self, pair: &Pair, control_point: usize) -> (Vec3, Vec3) {
        let local = self.skin_a.surface.control.points[control_point] + pair.side_a.displacement[control_point];
        let x = self.turn_ba * local + self.shift_ba;
        (x, self.drift + self.shear * x)
    }

    /// A control point without its elastic displacement, frame of `b`.
    #[inline]
    fn at_rest(&self, control_point: usize) -> Vec3 {
        self.turn_ba * self.skin_a.surface.control.points[control_point] + self.shift_ba
    }

    /// The contact of a control point, from what it remembers.
    #[inline]
    fn contact(&self, pair: &Pair, index: u32, coupled: &[Coupled], projected: bool) -> Option<Contact> {
        let control_point = coupled[0].control_point as usize;
        let Seen::Foot { foot, normal, weights } = &pair.remembered[control_point].surface else { return None };
        let (x, approach) = self.locate(pair, control_point);
        let u_b = pair.displacement_of_b(control_point, weights);
        let gap = normal.dot(&(x - foot - u_b));
        // Enters if it touches now or would after the free motion: nothing fast slips through a step.
        if gap + normal.dot(&approach).min(0.0) > self.params.contact_margin {
            return None;
        }
        // Larger than its own where a spent budget left it to stand for others.
        let height = |p: &Vec3| normal.dot(&(self.turn_ba * p + self.shift_ba - foot));
        let node = &self.skin_a.surface.tree.nodes[coupled[0].node_a as usize];
        let area = if node.children.is_none() {
            node.area
        } else {
            area_in_contact(&self.skin_a.surface, node, control_point, self.params.contact_margin, height)
        };
        let normal = self.turn_b * normal;
        let frame = pair.friction.frame(&normal, [&self.turn_a, &self.turn_b]);
        let frame = frame.unwrap_or_else(|| contact_frame(&normal, &(self.turn_a * self.skin_a.surface.control.tangents[control_point])));
        Some(Contact {
            pair: index,
            body_a: pair.a,
            body_b: pair.b,
            control_point: control_point as u32,
            point: self.turn_b * x + self.shift_b,
            frame,
            gap,
            solved_gap: gap.max(-self.params.push_out_speed * self.params.dt),
            area,
            foot: *foot,
            weights_b: *weights,
            projected,
        })
    }

    /// Whether a control point, at `rest` without elastic displacement, has passed the edge between the face of point `own` of `b` and another face that it looks at.
    ///
    /// A control point stands for half a spacing around it, so a face reaches that far beyond its edge; what is then inside it can leave over the other face, too. Its way
    /// out there is that half spacing less its height over the other face: the face is its own while its depth is less.
    fn is_past_edge(&self, coupled: &[Coupled], rest: &Vec3, own: usize, normal_a: &Vec3) -> bool {
        let surface = &self.skin_b.surface;
        let (p1, n1) = (&surface.points[own], &surface.normals[own]);
        let distance2 = |k: &usize| (surface.points[*k] - rest).norm_squared();
        let other = coupled
            .iter()
            .flat_map(|c| surface.tree.nodes[c.node_b as usize].points())
            .filter(|&k| surface.normals[k].dot(n1) < SAME_FACE && surface.normals[k].dot(normal_a) < FACES)
            .min_by(|i, j| distance2(i).total_cmp(&distance2(j)));
        other.is_some_and(|k| {
            let (p2, n2) = (&surface.points[k], &surface.normals[k]);
            let (depth, height) = (-n1.dot(&(rest - p1)), n2.dot(&(rest - p2)));
            // Of an inner edge the other face lies over the own.
            n1.dot(&(p2 - p1)) <= 0.0 && height > 0.0 && depth + height > 0.5 * self.skin_a.surface.control.spacing
        })
    }

    /// Projects a control point on `b`.
    fn project(&self, pair: &Pair, due: &Due) -> Remembered {
        let (x, coupled) = (&due.x, &pair.coupling.coupled[due.coupled.start as usize..due.coupled.end as usize]);
        let control_point = coupled[0].control_point as usize;
        let (params, surface) = (self.params, &self.skin_b.surface);
        let leaves = 0; // filled in by the caller
        let slack = SLACK * surface.spacing;
        let nothing = || Remembered { x: *x, holds_for: slack, surface: Seen::Nothing, at_edge: None, deep: false, leaves };
        let normal_a = self.turn_ba * self.skin_a.surface.control.normals[control_point];
        // Where faces meet, the one that the control point has least way to at rest is its own. Seen from where it is pressed to it would stay with a face that it has long passed.
        let at_edge = faces_meet(coupled, self.skin_b).then(|| self.at_rest(control_point));
        let Some((node_b, nearest)) = nearest_node(coupled, self.skin_b, at_edge.as_ref().unwrap_or(x), &normal_a) else {
            // Whether anything faces it is a matter of directions alone, so this holds for as long as it stays outside; a turn or other leaves make it look anew.
            let height = height_over_nearest(coupled, self.skin_b, x).unwrap_or(0.0);
            return Remembered { deep: height < -DEEP * surface.spacing, holds_for: height.max(slack), ..nothing() };
        };
        if let Some(rest) = &at_edge
            && self.is_past_edge(coupled, rest, nearest, &normal_a)
        {
            return Remembered { at_edge, ..nothing() };
        }
        let leaf_b = surface.tree.nodes[node_b as usize].first_leaf as usize;
        // The plane of the nearest point is off by far less than a leaf gap: most control points can be told to be apart without a projection.
        let plane_gap = surface.normals[nearest].dot(&(x - surface.points[nearest] - pair.side_b.displacement[leaf_b]));
        // The border is that of where the projection goes: deep inside, far from `x`.
        let goal = if plane_gap < -surface.kernel.cutoff() { x - surface.normals[nearest] * plane_gap } else { *x };
        let border = Border::of(self.skin_b, node_b, &goal);
        let clear = plane_gap - params.contact_margin - border.gap;
        if clear > due.approach {
            return Remembered { holds_for: clear, surface: Seen::Apart, ..nothing() };
        }
        // At an edge the projection keeps to the face that was chosen.
        let facing = if at_edge.is_some() { -surface.normals[nearest] } else { normal_a };
        let (points, normals) = (&surface.points, &surface.normals);
        let cloud = Cloud { points, normals, ranges: border.ranges(), kernel: &surface.kernel, facing: Some(&facing) };
        let Some(q) = project(x, &cloud, params.projection_tolerance, MOST_PROJECTIONS) else { return nothing() };
        // Artefacts of high curvature: a surface that does not face the control point, or a foot beyond the border of the leaf. So far beyond that only a row of points has
        // weight they do not say which way the surface lies, and the foot is not under the control point.
        let aside = |v: Vec3| (v - q.normal * q.normal.dot(&v)).norm();
        let border_width = BORDER_GAPS * border.gap;
        if q.normal.dot(&normal_a) >= FACES
            || aside(surface.points[q.nearest] - q.point) > border_width
            || aside(x - q.point) > border_width
        {
            return nothing();
        }
        // Deep under a face that looks the other way, yet outside: the far side of something thin that a fast body is about to meet on its near side.
        if q.normal.dot(&(q.point - x)) > surface.spacing && is_outside(coupled, self.skin_b, x) {
            return nothing();
        }
        let weights = if pair.rigid_b { Weights::none() } else { surface.control_weights(&q.point, &q.normal, leaf_b) };
        let holds_for = if pair.rigid_b { slack_of(params.projection_slack, q.curvature).min(slack) } else { params.projection_slack };
        let surface = Seen::Foot { foot: q.point, normal: q.normal, weights };
        Remembered { x: *x, holds_for, surface, at_edge, deep: plane_gap < -DEEP * border.gap, leaves }
    }
}

/// How far a control point may go over a surface of this curvature (1/m) until its tangent plane is off by as much as after `slack` (m) over [`SLACK_RADIUS`]: an error of
/// `slack^2 / (2 R)`. Only where the other surface does not yield: its displacement changes from place to place, whatever its shape.
fn slack_of(slack: Real, curvature: Real) -> Real {
    slack * (1.0 / (SLACK_RADIUS * curvature)).sqrt().clamp(1.0, 1e6)
}

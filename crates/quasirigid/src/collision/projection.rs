//! Control points of coupled leaves, projected on the other surface (design 3.2, points 3 to 5).

use super::budget::area_in_contact;
use super::cache::{CachedProjection, Coupled, Coupling, Found, PairCache};
use super::nearest_point::{Border, SAME_FACE, faces_meet, height_over_nearest, is_outside, may_face, nearest_node};
use super::separation::STRIDE;
use super::traversal::{TURNED, have_penetrated};
use crate::collider::Skin;
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Pose, Real, Vec3, contact_frame};
use crate::objects::{Objects, Side};
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use crate::surface::Weights;
use crate::surface::implicit::{Cloud, FACES, project};
use rayon::prelude::*;
use std::ops::Range;

/// A projection farther from the nearest sample than this many leaf gaps (half the distance to a close neighbour) has left the border of its leaf.
const BORDER_GAPS: Real = 1.5;

/// A control point that lies this many leaf gaps under the other surface lies deeper than contact goes.
const DEEP: Real = 1.0;

/// Cosine of the angle with their mean that the normals of contacts make at most which push two bodies out of each other together. At a corner
/// of a box it is 0.58.
const IN_COMMON: Real = 0.3;

/// A control point that nothing faces, or whose projection had to be rejected, is looked at again once it has moved by this many spacings of the other surface; one where
/// faces meet once its place at rest has. No projection is kept for longer.
const SLACK: Real = 0.05;

/// [`Parameters::projection_slack`] is meant for this radius of curvature, m.
const SLACK_RADIUS: Real = 1e-3;

/// Most steps of a projection; two or three are usual.
const MOST_PROJECTIONS: u32 = 10;

/// Projections of one chunk of parallel work.
const CHUNK: usize = 8;

#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Control points that have to be looked at anew.
    due: Vec<Due>,
    projected: Vec<CachedProjection>,
    stack: Vec<u32>,
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
pub(super) struct StepGeometry<'a> {
    pub objects: &'a Objects,
    pub free: &'a [FreeMotion],
    /// How far any surface point of each collider may move in this step before contact forces, m.
    pub reach: &'a [Real],
    pub params: &'a Parameters,
    /// Whether what is remembered is held against its usual limits in this step, see [`Parameters::collision_every`].
    pub refresh: bool,
}

/// Every control point with a coupled leaf becomes a contact if it is near enough. Where what it remembers no longer holds it is projected first, once, from
/// the leaf that holds the nearest point that faces it.
pub(super) fn project_control_points(
    scratch: &mut Scratch,
    pairs: &[Pair],
    caches: &mut [PairCache],
    now: StepGeometry<'_>,
    contacts: &mut Vec<Contact>,
) {
    let StepGeometry { objects, reach, params, .. } = now;
    // Between two looks a foot and its tangent plane are carried along with `b`, for as far as a contact is seen coming.
    let carried = if now.refresh { -1.0 } else { params.contact_margin };
    // Room for every control point that is coupled: how many of them are due at once may show long after a step has first met them.
    let room = caches.iter().map(|cache| cache.coupling.coupled.capacity()).sum();
    scratch.due.clear();
    scratch.due.reserve(room);
    scratch.projected.reserve(room);
    for (index, (pair, cache)) in pairs.iter().zip(caches.iter_mut()).enumerate().filter(|(_, (pair, _))| pair.near) {
        let PairCache { coupling, projections } = cache;
        let approach = reach[pair.a as usize] + reach[pair.b as usize];
        if coupling.coupled.is_empty() || coupling.is_still_asleep(pair, objects, approach) {
            continue;
        }
        let Some(view) = View::of(pair, now) else { continue };
        let slack = SLACK * view.skin_b.surface.spacing;
        let first = scratch.due.len();
        let mut asleep_for = Real::INFINITY;
        for coupled in groups(&coupling.coupled) {
            let control_point = coupling.coupled[coupled.start].control_point as usize;
            let (x, approach) = view.locate(pair, control_point);
            let known = &projections[control_point];
            let (moved, approach) = ((x - known.x).norm(), approach.norm());
            let left_at_edge = known.at_edge.map_or(Real::INFINITY, |rest| slack - (view.at_rest(control_point) - rest).norm());
            let (left, sees) = match known.surface {
                Found::Foot { .. } => (known.holds_for.max(carried) - moved, true),
                Found::Nothing => (known.holds_for.max(carried) - moved, false),
                Found::Apart => (known.holds_for - moved - approach, false),
            };
            if left_at_edge < 0.0 || left.is_nan() || left < 0.0 {
                scratch.due.push(Due { pair: index as u32, coupled: coupled.start as u32..coupled.end as u32, x, approach });
            }
            asleep_for = if sees { -1.0 } else { asleep_for.min(left).min(left_at_edge) };
        }
        if scratch.due.len() == first && asleep_for > 0.0 && pair.side_a.active.is_empty() {
            coupling.fall_asleep(asleep_for, pair, objects);
        }
    }
    scratch.projected.clear();
    scratch.projected.resize(scratch.due.len(), CachedProjection::default());
    let known: &[PairCache] = caches;
    let work = |(due, projected): (&[Due], &mut [CachedProjection])| {
        let mut view: Option<(u32, View)> = None;
        for (due, projected) in due.iter().zip(projected) {
            let (pair, cache) = (&pairs[due.pair as usize], &known[due.pair as usize]);
            if view.as_ref().is_none_or(|(index, _)| *index != due.pair) {
                view = View::of(pair, now).map(|view| (due.pair, view));
            }
            if let Some((_, view)) = &view {
                *projected = view.project(pair, &cache.coupling, due);
            }
        }
    };
    // Without threads of its own a world uses none: rayon's global pool is not safe to use in a process that was forked.
    if params.threads > 1 && rayon::current_thread_index().is_some() && scratch.due.len() > CHUNK {
        scratch.due.par_chunks(CHUNK).zip(scratch.projected.par_chunks_mut(CHUNK)).for_each(work);
    } else {
        work((&scratch.due, &mut scratch.projected));
    }
    contacts.clear();
    let mut projected = scratch.due.iter().zip(scratch.projected.drain(..)).peekable();
    for (index, (pair, cache)) in pairs.iter().zip(caches).enumerate().filter(|(_, (pair, _))| pair.near) {
        let PairCache { coupling, projections } = cache;
        // A pair with elastic memory touches or has just let go: what lies inside a body at rest may lie outside the deformed one.
        let idle = pair.is_idle();
        let unseen = idle && !coupling.examined && !coupling.penetrated;
        if coupling.coupled.is_empty() || coupling.is_asleep() {
            if unseen {
                coupling.examined = true;
                coupling.suspected = are_deep_inside(&mut scratch.stack, pair, objects);
            }
            continue;
        }
        let first = contacts.len();
        let Some(view) = View::of(pair, now) else { continue };
        for coupled in groups(&coupling.coupled) {
            let (start, control_point) = (coupled.start as u32, coupling.coupled[coupled.start].control_point as usize);
            let new = projected.next_if(|(due, _)| due.pair == index as u32 && due.coupled.start == start);
            let projected = new.is_some();
            if let Some((_, new)) = new {
                coupling.deep |= new.deep;
                let known = &mut projections[control_point];
                *known = CachedProjection { leaves: known.leaves, ..new };
            }
            contacts.extend(view.contact(pair, index as u32, &coupling.coupled[coupled], &projections[control_point], projected));
        }
        // Judged where the contacts were found: bodies that have since been moved into each other may push in the next step.
        let unloaded = unseen && contacts[first..].iter().all(|contact| contact.gap > 0.0);
        let at_odds = coupling.deep && !coupling.penetrated && are_at_odds(&contacts[first..]);
        coupling.examined |= unloaded;
        if (unloaded || at_odds) && are_deep_inside(&mut scratch.stack, pair, objects) {
            // Contacts at odds would only squeeze each other out, or turn the two with force.
            contacts.truncate(first);
            coupling.suspected = true;
        }
    }
}

/// Whether some of the control points of one body of a pair lie so deep in the other that they have penetrated each other fully.
fn are_deep_inside(stack: &mut Vec<u32>, pair: &Pair, objects: &Objects) -> bool {
    let [a, b] = pair.sides(objects);
    let (Some(skin_a), Some(skin_b)) = (a.active_skin(), b.active_skin()) else { return false };
    let pose_ba = b.pose().inverse() * a.pose();
    have_penetrated(stack, &pair.side_a.displacement, skin_a, skin_b, &pose_ba, STRIDE, 1.0)
}

/// Whether contacts that push an overlap apart do so in directions that have nothing in common.
fn are_at_odds(contacts: &[Contact]) -> bool {
    let pushes = || contacts.iter().filter(|contact| contact.gap < contact.solved_gap).map(|contact| contact.frame.column(0).into_owned());
    let sum: Vec3 = pushes().sum();
    pushes().any(|normal| normal.dot(&sum) < IN_COMMON * sum.norm())
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
    sides: [Side<'a>; 2],
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
    fn of(pair: &Pair, now: StepGeometry<'a>) -> Option<Self> {
        let StepGeometry { objects, free, params, .. } = now;
        let [a, b] = pair.sides(objects);
        let (pose_a, pose_b) = (a.pose(), b.pose());
        let pose_ba: Pose = pose_b.inverse() * pose_a;
        let matrix = |pose: &Pose| pose.rotation.to_rotation_matrix().into_inner();
        let (turn_b, shift_b) = (matrix(&pose_b), pose_b.translation.vector);
        let approach = |point: &Vec3| turn_b.tr_mul(&pair.free_displacement(objects, free, point));
        let drift = approach(&shift_b);
        let axis = |k: usize| approach(&(shift_b + turn_b.column(k))) - drift;
        Some(Self {
            sides: [a, b],
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
    fn contact(&self, pair: &Pair, index: u32, coupled: &[Coupled], known: &CachedProjection, projected: bool) -> Option<Contact> {
        let control_point = coupled[0].control_point as usize;
        let Found::Foot { foot, normal, weights } = &known.surface else { return None };
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
            self.skin_a.surface.control.areas[control_point]
        } else {
            area_in_contact(&self.skin_a.surface, node, control_point, self.params.contact_margin, height)
        };
        let normal = self.turn_b * normal;
        let directed = pair.friction.frame(&normal, [&self.turn_a, &self.turn_b]);
        let (frame, friction_ratio) =
            directed.unwrap_or_else(|| (contact_frame(&normal, &(self.turn_a * self.skin_a.surface.control.tangents[control_point])), 1.0));
        let [side_a, side_b] = self.sides.map(|side| side.collider);
        Some(Contact {
            pair: index,
            body_a: side_a.body,
            body_b: side_b.body,
            link_a: side_a.link as u32,
            link_b: side_b.link as u32,
            collider_a: pair.a,
            collider_b: pair.b,
            control_point: control_point as u32,
            point: self.turn_b * x + self.shift_b,
            frame,
            friction_ratio,
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
    fn project(&self, pair: &Pair, coupling: &Coupling, due: &Due) -> CachedProjection {
        let (x, coupled) = (&due.x, &coupling.coupled[due.coupled.start as usize..due.coupled.end as usize]);
        let control_point = coupled[0].control_point as usize;
        let (params, surface) = (self.params, &self.skin_b.surface);
        let leaves = 0; // filled in by the caller
        let slack = SLACK * surface.spacing;
        let nothing = || CachedProjection { x: *x, holds_for: slack, surface: Found::Nothing, at_edge: None, deep: false, leaves };
        if let Some(normal) = coupling.way_out {
            let leaf_b = surface.tree.nodes[coupled[0].node_b as usize].first_leaf;
            let weights = if pair.rigid_b { Weights::none() } else { Weights::single(leaf_b) };
            let surface = Found::Foot { foot: surface.control.points[leaf_b as usize], normal, weights };
            return CachedProjection { surface, ..nothing() };
        }
        let normal_a = self.turn_ba * self.skin_a.surface.control.normals[control_point];
        // Where faces meet, the one that the control point has least way to at rest is its own. Seen from where it is pressed to it would stay with a face that it has long passed.
        let at_edge = faces_meet(coupled, self.skin_b).then(|| self.at_rest(control_point));
        let Some((node_b, nearest)) = nearest_node(coupled, self.skin_b, at_edge.as_ref().unwrap_or(x), &normal_a) else {
            // Whether anything faces it is a matter of directions alone, so this holds for as long as it stays outside; a
            // turn or other leaves make it look anew. Where a turn too small
            // to do so would make something face it, it is looked at in every step: a control point on an edge is at the surface then.
            let height = height_over_nearest(coupled, self.skin_b, x).unwrap_or(0.0);
            let deep = height < -DEEP * surface.spacing;
            if may_face(coupled, self.skin_b, x, &normal_a, TURNED) {
                return CachedProjection { deep, holds_for: 0.0, ..nothing() };
            }
            return CachedProjection { deep, holds_for: height.max(slack), ..nothing() };
        };
        if let Some(rest) = &at_edge
            && self.is_past_edge(coupled, rest, nearest, &normal_a)
        {
            return CachedProjection { at_edge, ..nothing() };
        }
        let leaf_b = surface.tree.nodes[node_b as usize].first_leaf as usize;
        // The plane of the nearest point is off by far less than a leaf gap: most control points can be told to be apart without a projection.
        let plane_gap = surface.normals[nearest].dot(&(x - surface.points[nearest] - pair.side_b.displacement[leaf_b]));
        // The border is that of where the projection goes: deep inside, far from `x`.
        let goal = if plane_gap < -surface.kernel.cutoff() { x - surface.normals[nearest] * plane_gap } else { *x };
        let border = Border::of(self.skin_b, node_b, &goal);
        let clear = plane_gap - params.contact_margin - border.gap;
        if clear > due.approach {
            return CachedProjection { holds_for: clear, surface: Found::Apart, ..nothing() };
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
        let surface = Found::Foot { foot: q.point, normal: q.normal, weights };
        CachedProjection { x: *x, holds_for, surface, at_edge, deep: plane_gap < -DEEP * border.gap, leaves }
    }
}

/// How far a control point may go over a surface of this curvature (1/m) until its tangent plane is off by as much as after `slack` (m) over [`SLACK_RADIUS`]: an error of
/// `slack^2 / (2 R)`. Only where the other surface does not yield: its displacement changes from place to place, whatever its shape.
fn slack_of(slack: Real, curvature: Real) -> Real {
    slack * (1.0 / (SLACK_RADIUS * curvature)).sqrt().clamp(1.0, 1e6)
}

#[cfg(test)]
mod tests {
    use crate::body::{Amount, MassProperties, Motion, RigidBody};
    use crate::collider::Material;
    use crate::collision::PairCache;
    use crate::math::{Pose, Real, Vec3};
    use crate::pair::Contact;
    use crate::surface::{PointSurface, Surface, shapes};
    use crate::{Parameters, World};
    use std::sync::Arc;

    const RADIUS: Real = 0.01;

    /// A rigid ball of many points near a fixed rigid surface, whose pose is `place`.
    fn ball_at(fixed: PointSurface, control_points: usize, place: Pose, center: Vec3) -> World {
        let steel = Material::preset("steel").unwrap();
        let surface = |points, count| Some((Arc::new(Surface::build(points, Some(count)).unwrap()), steel.clone()));
        let params = Parameters { gravity: Vec3::zeros(), contact_margin: 5e-4, ..Parameters::default() };
        let mut world = World::new(params).unwrap();
        world.add_body(RigidBody::fixed("fixed", place).unwrap(), surface(fixed, control_points)).unwrap();
        let mass = MassProperties::sphere(RADIUS, Amount::Mass(0.1)).unwrap();
        let pose = place * Pose::new(center, Vec3::new(0.7, -0.2, 0.5));
        let ball = RigidBody::free("ball", mass, Motion::QuasiStatic, pose).unwrap();
        world.add_body(ball, surface(shapes::sample_sphere(RADIUS, 3_000).unwrap(), 800)).unwrap();
        world
    }

    /// Largest differences of gap (m), foot (m) and normal (-) of the contacts from `truth`, which has them for a place in the frame of the fixed body.
    fn worst(contacts: &[Contact], place: &Pose, truth: impl Fn(&Vec3) -> (Real, Vec3, Vec3)) -> [Real; 3] {
        let off = contacts.iter().map(|contact| {
            let (gap, foot, normal) = truth(&place.inverse_transform_point(&contact.point.into()).coords);
            [(contact.gap - gap).abs(), (contact.foot - foot).norm(), (contact.frame.column(0) - place.rotation * normal).norm()]
        });
        off.fold([0.0; 3], |worst, off| std::array::from_fn(|k| worst[k].max(off[k])))
    }

    #[test]
    fn a_projection_on_a_plane_or_a_sphere_is_that_of_its_closed_form() {
        let place = Pose::new(Vec3::new(0.1, -0.2, 0.3), Vec3::new(0.4, 1.1, -0.3));
        let mut world = ball_at(shapes::sample_half_space(0.03, 2_500).unwrap(), 200, place, Vec3::new(1e-3, 2e-3, RADIUS - 1e-4));
        world.step();
        let [gap, foot, normal] = worst(world.contacts(), &place, |x| (x.z, Vec3::new(x.x, x.y, 0.0), Vec3::z()));
        println!("plane: {} contacts, gap {gap:.1e} m, foot {foot:.1e} m, normal {normal:.1e}", world.contacts().len());
        assert!(world.contacts().len() > 20 && gap.max(foot) < 1e-10 && normal < 1e-7, "gap {gap:e} m, foot {foot:e} m, normal {normal:e}");

        let large = 0.03;
        let points = shapes::sample_sphere(large, 6_000).unwrap();
        let along = Vec3::new(0.3, -0.5, 0.8).normalize();
        let mut world = ball_at(points, 400, place, along * (large + RADIUS - 1e-4));
        world.step();
        let [gap, foot, normal] = worst(world.contacts(), &place, |x| (x.norm() - large, x.normalize() * large, x.normalize()));
        println!("sphere: {} contacts, gap {gap:.1e} m, foot {foot:.1e} m, normal {normal:.1e}", world.contacts().len());
        // The surface is known by points 1.4 mm apart: a plane through them would be off by 8 micrometres, the smooth surface is off by far less.
        assert!(
            world.contacts().len() > 15 && gap < 1e-7 && foot < 2e-6 && normal < 5e-3,
            "gap {gap:e} m, foot {foot:e} m, normal {normal:e}"
        );
    }

    #[test]
    fn a_projection_that_is_remembered_is_that_found_anew() {
        let place = Pose::new(Vec3::new(0.1, -0.2, 0.3), Vec3::new(0.4, 1.1, -0.3));
        let points = || shapes::sample_sphere(0.03, 6_000).unwrap();
        let mut worlds = [0, 1].map(|_| ball_at(points(), 400, place, Vec3::new(0.0, 0.0, 0.03 + RADIUS - 1e-4)));
        let (mut worst, mut remembered): (Real, usize) = (0.0, 0);
        for step in 0..60 {
            let pose = place
                * Pose::new(Vec3::new(1e-7 * step as Real, 0.0, 0.03 + RADIUS - 1e-4), Vec3::new(0.7, -0.2 + 1e-5 * step as Real, 0.5));
            for world in &mut worlds {
                let ball = world.handle_of(1);
                world.body_mut(ball).unwrap().set_pose(pose).unwrap();
                world.step();
            }
            worlds[1].workspace.collision.caches.iter_mut().for_each(PairCache::invalidate);
            let [here, anew] = [worlds[0].contacts(), worlds[1].contacts()];
            let keys = |contacts: &[Contact]| contacts.iter().map(|contact| contact.control_point).collect::<Vec<_>>();
            assert_eq!(keys(here), keys(anew), "step {step}");
            remembered += here.iter().filter(|contact| !contact.projected).count();
            assert!(anew.iter().all(|contact| contact.projected));
            worst = here.iter().zip(anew).map(|(c, d)| (c.gap - d.gap).abs()).fold(worst, Real::max);
        }
        println!("{remembered} remembered projections, gaps within {worst:.1e} m");
        assert!(remembered > 200 && worst < 1e-9, "{remembered} remembered projections, a gap is off by {worst:e} m");
    }
}

//! A control point projected on the other surface of its pair, and the contact that comes of it (design 3.2, points 3 to 5).

use super::budget::area_in_contact;
use super::cache::{CachedProjection, Coupled, Coupling, Found};
use super::nearest_point::{Border, SAME_FACE, faces_meet, height_over_nearest, is_outside, may_face, nearest_node};
use super::traversal::ROTATED;
use crate::collider::Skin;
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Pose, Real, Vec3, contact_frame};
use crate::objects::{Objects, Side};
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use crate::surface::Weights;
use crate::surface::implicit::{Cloud, FACING_COSINE, project};
use std::ops::Range;

/// A projection farther from the nearest sample than this many leaf gaps (half the
/// distance to a close neighbour) has left the border of its leaf.
const BORDER_GAPS: Real = 1.5;

/// A control point that lies this many leaf gaps under the other surface lies deeper than contact goes.
const DEEP: Real = 1.0;

/// A control point that nothing faces, or whose projection had to be rejected, is projected again once it has moved by this many
/// spacings of the other surface; one where faces meet once its place at rest has. No projection is kept for longer.
pub(super) const SLACK: Real = 0.05;

/// [`Parameters::projection_slack`] is meant for this radius of curvature, m.
const SLACK_RADIUS: Real = 1e-3;

/// Most steps of a projection; two or three are usual.
const MOST_PROJECTIONS: u32 = 10;

/// A control point whose last projection no longer holds.
#[derive(Debug, Clone)]
pub(super) struct Due {
    pub pair: u32,
    /// Its coupled nodes in the pair's list.
    pub coupled: Range<u32>,
    /// Where it is, in the frame of `b`.
    pub x: Vec3,
    /// How far the free motion takes it against `b`, m.
    pub approach: Real,
}

/// What all projections of a step use: geometry is frozen at its start.
#[derive(Clone, Copy)]
pub(super) struct StepGeometry<'a> {
    pub objects: &'a Objects,
    pub free: &'a [FreeMotion],
    /// How far any surface point of each collider may move in this step before contact forces, m.
    pub reach: &'a [Real],
    pub params: &'a Parameters,
    /// Whether remembered projections are held to their usual limits in this step, see [`Parameters::collision_every`].
    pub refresh: bool,
}

/// The geometry of a pair at the start of a step, for the projections of all its control points.
pub(super) struct PairGeometry<'a> {
    sides: [Side<'a>; 2],
    skin_a: &'a Skin,
    pub skin_b: &'a Skin,
    rotation_a: Mat3,
    rotation_b: Mat3,
    shift_b: Vec3,
    rotation_ba: Mat3,
    shift_ba: Vec3,
    /// Displacement of `a` against `b` by free and prescribed motion at the point `x`, all in
    /// the frame of `b`: `drift + shear x`. Bodies are rigid, so it is affine.
    drift: Vec3,
    shear: Mat3,
    params: &'a Parameters,
}

impl<'a> PairGeometry<'a> {
    pub fn of(pair: &Pair, now: StepGeometry<'a>) -> Option<Self> {
        let StepGeometry { objects, free, params, .. } = now;
        let [a, b] = pair.sides(objects);
        let (pose_a, pose_b) = (a.pose(), b.pose());
        let pose_ba: Pose = pose_b.inverse() * pose_a;
        let matrix = |pose: &Pose| pose.rotation.to_rotation_matrix().into_inner();
        let (rotation_b, shift_b) = (matrix(&pose_b), pose_b.translation.vector);
        let approach = |point: &Vec3| rotation_b.tr_mul(&pair.free_displacement(objects, free, point));
        let drift = approach(&shift_b);
        let axis = |k: usize| approach(&(shift_b + rotation_b.column(k))) - drift;
        Some(Self {
            sides: [a, b],
            skin_a: a.active_skin()?,
            skin_b: b.active_skin()?,
            rotation_a: matrix(&pose_a),
            rotation_b,
            shift_b,
            rotation_ba: matrix(&pose_ba),
            shift_ba: pose_ba.translation.vector,
            drift,
            shear: Mat3::from_columns(&[axis(0), axis(1), axis(2)]),
            params,
        })
    }

    /// A control point where the last step left it, and how far the free motion takes it against `b`, both in the frame of `b`.
    #[inline]
    pub fn locate(&self, pair: &Pair, control_point: usize) -> (Vec3, Vec3) {
        let local = self.skin_a.surface.control.points[control_point] + pair.side_a.displacement[control_point];
        let x = self.rotation_ba * local + self.shift_ba;
        (x, self.drift + self.shear * x)
    }

    /// A control point without its elastic displacement, frame of `b`.
    #[inline]
    pub fn at_rest(&self, control_point: usize) -> Vec3 {
        self.rotation_ba * self.skin_a.surface.control.points[control_point] + self.shift_ba
    }

    /// The contact of a control point, from what it remembers.
    #[inline]
    pub fn contact(&self, pair: &Pair, index: u32, coupled: &[Coupled], known: &CachedProjection, projected: bool) -> Option<Contact> {
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
        let height = |p: &Vec3| normal.dot(&(self.rotation_ba * p + self.shift_ba - foot));
        let node = &self.skin_a.surface.tree.nodes[coupled[0].node_a as usize];
        let area = if node.children.is_none() {
            self.skin_a.surface.control.areas[control_point]
        } else {
            area_in_contact(&self.skin_a.surface, node, control_point, self.params.contact_margin, height)
        };
        let normal = self.rotation_b * normal;
        let anisotropic = pair.friction.frame(&normal, [&self.rotation_a, &self.rotation_b]);
        let (frame, friction_ratio) = anisotropic
            .unwrap_or_else(|| (contact_frame(&normal, &(self.rotation_a * self.skin_a.surface.control.tangents[control_point])), 1.0));
        let [side_a, side_b] = self.sides.map(|side| side.collider);
        let point = self.rotation_b * x + self.shift_b;
        Some(Contact {
            pair: index,
            body_a: side_a.body,
            body_b: side_b.body,
            link_a: side_a.link as u32,
            link_b: side_b.link as u32,
            collider_a: pair.a,
            collider_b: pair.b,
            control_point: control_point as u32,
            point,
            frame,
            acts_at: pair.relative_motion.acts_at(&point),
            acts_along: pair.relative_motion.with_b(&frame),
            friction_ratio,
            gap,
            solved_gap: gap.max(-self.params.push_out_speed * self.params.dt),
            area,
            foot: *foot,
            weights_b: *weights,
            projected,
        })
    }

    /// Whether a control point, at `rest` without elastic displacement, has passed the edge
    /// between the face of point `own` of `b` and another face that it faces.
    ///
    /// A control point stands for half a spacing around it, so a face reaches that far beyond its edge;
    /// what is then inside it can leave over the other face, too. Its way out there is that half spacing
    /// less its height over the other face: the face is its own while its depth is less.
    fn is_past_edge(&self, coupled: &[Coupled], rest: &Vec3, own: usize, normal_a: &Vec3) -> bool {
        let surface = &self.skin_b.surface;
        let (p1, n1) = (&surface.points[own], &surface.normals[own]);
        let distance2 = |k: &usize| (surface.points[*k] - rest).norm_squared();
        let other = coupled
            .iter()
            .flat_map(|c| surface.tree.nodes[c.node_b as usize].points())
            .filter(|&k| surface.normals[k].dot(n1) < SAME_FACE && surface.normals[k].dot(normal_a) < FACING_COSINE)
            .min_by(|i, j| distance2(i).total_cmp(&distance2(j)));
        other.is_some_and(|k| {
            let (p2, n2) = (&surface.points[k], &surface.normals[k]);
            let (depth, height) = (-n1.dot(&(rest - p1)), n2.dot(&(rest - p2)));
            // Of an inner edge the other face lies over the own.
            n1.dot(&(p2 - p1)) <= 0.0 && height > 0.0 && depth + height > 0.5 * self.skin_a.surface.control.spacing
        })
    }

    /// Projects a control point on `b`.
    pub fn project(&self, pair: &Pair, coupling: &Coupling, due: &Due) -> CachedProjection {
        let (x, coupled) = (&due.x, &coupling.coupled[due.coupled.start as usize..due.coupled.end as usize]);
        let control_point = coupled[0].control_point as usize;
        let (params, surface) = (self.params, &self.skin_b.surface);
        let leaves = 0; // filled in by the caller
        let slack = SLACK * surface.spacing;
        let nothing = || CachedProjection { x: *x, holds_for: slack, surface: Found::Nothing, at_edge: None, deep: false, leaves };
        if let Some(normal) = coupling.separation {
            let leaf_b = surface.tree.nodes[coupled[0].node_b as usize].first_leaf;
            let weights = if pair.rigid_b { Weights::none() } else { Weights::single(leaf_b) };
            let surface = Found::Foot { foot: surface.control.points[leaf_b as usize], normal, weights };
            return CachedProjection { surface, ..nothing() };
        }
        let normal_a = self.rotation_ba * self.skin_a.surface.control.normals[control_point];
        // Where faces meet, its own is the one nearest to the control point at rest. The nearest to where
        // it is pressed would still be a face that it has long passed.
        let at_edge = faces_meet(coupled, self.skin_b).then(|| self.at_rest(control_point));
        let Some((node_b, nearest)) = nearest_node(coupled, self.skin_b, at_edge.as_ref().unwrap_or(x), &normal_a) else {
            // Whether anything faces it depends on directions alone, so this holds for as long as it stays outside; it is invalidated
            // when the bodies rotate, and when other leaves are coupled. Where a rotation too small to do so would make something
            // face it, it is projected in every step: a control point on an edge is at the surface then.
            let height = height_over_nearest(coupled, self.skin_b, x).unwrap_or(0.0);
            let deep = height < -DEEP * surface.spacing;
            if may_face(coupled, self.skin_b, x, &normal_a, ROTATED) {
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
        // The plane of the nearest point is off by far less than a leaf gap: most
        // control points are known to be separated without a projection.
        let plane_gap = surface.normals[nearest].dot(&(x - surface.points[nearest] - pair.side_b.displacement[leaf_b]));
        // The border is that of where the projection goes: deep inside, far from `x`.
        let goal = if plane_gap < -surface.kernel.cutoff() { x - surface.normals[nearest] * plane_gap } else { *x };
        let border = Border::of(self.skin_b, node_b, &goal);
        let clear = plane_gap - params.contact_margin - border.gap;
        if clear > due.approach {
            return CachedProjection { holds_for: clear, surface: Found::Separated, ..nothing() };
        }
        // At an edge the projection keeps to the face that was chosen.
        let facing = if at_edge.is_some() { -surface.normals[nearest] } else { normal_a };
        let (points, normals) = (&surface.points, &surface.normals);
        let cloud = Cloud { points, normals, ranges: border.ranges(), kernel: &surface.kernel, facing: Some(&facing) };
        let Some(q) = project(x, &cloud, params.projection_tolerance, MOST_PROJECTIONS) else { return nothing() };
        // Artefacts of high curvature: a surface that does not face the control point, or a foot beyond
        // the border of the leaf. So far beyond that only a row of points has weight they do not say
        // which way the surface lies, and the foot is not under the control point.
        let lateral = |v: Vec3| (v - q.normal * q.normal.dot(&v)).norm();
        let border_width = BORDER_GAPS * border.gap;
        if q.normal.dot(&normal_a) >= FACING_COSINE
            || lateral(surface.points[q.nearest] - q.point) > border_width
            || lateral(x - q.point) > border_width
        {
            return nothing();
        }
        // Deep under a face that looks the other way, yet outside: the far side of
        // something thin that a fast body is about to meet on its near side.
        if q.normal.dot(&(q.point - x)) > surface.spacing && is_outside(coupled, self.skin_b, x) {
            return nothing();
        }
        let weights = if pair.rigid_b { Weights::none() } else { surface.control_weights(&q.point, &q.normal, leaf_b) };
        let holds_for = if pair.rigid_b { slack_of(params.projection_slack, q.curvature).min(slack) } else { params.projection_slack };
        let surface = Found::Foot { foot: q.point, normal: q.normal, weights };
        CachedProjection { x: *x, holds_for, surface, at_edge, deep: plane_gap < -DEEP * border.gap, leaves }
    }
}

/// How far a control point may go over a surface of this curvature (1/m) until its tangent plane is off by as
/// much as after `slack` (m) over [`SLACK_RADIUS`]: an error of `slack^2 / (2 R)`. Only where the other
/// surface does not deform: its displacement changes from place to place, whatever its shape.
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

    /// Largest differences of gap (m), foot (m) and normal (-) of the contacts from
    /// `truth`, which has them for a place in the frame of the fixed body.
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
        // The surface is known by points 1.4 mm apart: a plane through them would be
        // off by 8 micrometres, the smooth surface is off by far less.
        assert!(
            world.contacts().len() > 15 && gap < 1e-7 && foot < 2e-6 && normal < 5e-3,
            "gap {gap:e} m, foot {foot:e} m, normal {normal:e}"
        );
    }

    #[test]
    fn a_projection_that_is_remembered_is_that_found_again() {
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
            let [here, fresh] = [worlds[0].contacts(), worlds[1].contacts()];
            let keys = |contacts: &[Contact]| contacts.iter().map(|contact| contact.control_point).collect::<Vec<_>>();
            assert_eq!(keys(here), keys(fresh), "step {step}");
            remembered += here.iter().filter(|contact| !contact.projected).count();
            assert!(fresh.iter().all(|contact| contact.projected));
            worst = here.iter().zip(fresh).map(|(c, d)| (c.gap - d.gap).abs()).fold(worst, Real::max);
        }
        println!("{remembered} remembered projections, gaps within {worst:.1e} m");
        assert!(remembered > 200 && worst < 1e-9, "{remembered} remembered projections, a gap is off by {worst:e} m");
    }
}

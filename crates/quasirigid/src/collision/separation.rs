//! Bodies that have penetrated each other fully: by half of their thickness or more, or one wholly inside the other.
//!
//! Control points then lie nearer to the wrong face than to the one that they came through, or not inside the other
//! body at all, and a search for the way out point by point ([`super::deep_overlap`]) finds nothing that pushes. The
//! pair is therefore treated as a whole. With `d` a unit vector, `x` control points of `a` and
//! `p` those of `b`,
//!
//! ```text
//! depth(d) = max_p d . p - min_x d . x
//! ```
//!
//! is how far `a` has to move along `d` until a plane separates the two (Cameron 1997, "Enhancing GJK", equation 1: the
//! penetration depth of convex bodies is the least of these; of others it is an upper bound). Contacts with this one normal
//! then separate them like any other overlap, at the push-out speed, until no point of one lies in the other.

use super::deep_overlap::depth_inside;
use crate::math::{Real, Vec3};
use crate::surface::Surface;

/// Directions that are tried from the normals of each of the two surfaces, about.
const DIRECTIONS: usize = 64;

/// Rounds of refinement of the best of them, each with a quarter of the angle of the one before, from [`FIRST_ANGLE`] (rad).
const ROUNDS: u32 = 4;
const FIRST_ANGLE: Real = 0.2;

/// A surface faces a direction if somewhere its normal makes no more than 45 degrees
/// with it: there is no way out through the back of an open surface.
const FACING: Real = 0.7;

/// Control points whose normals make less than 60 degrees with the direction bear the contacts.
const BEARING: Real = 0.5;

/// Another direction has to be shorter than this share of the last one to replace
/// it: of equal ways the bodies keep to the one that they began with.
const KEPT: Real = 0.9;

/// Of so many control points one is tested to find out whether two bodies that do not push each other have penetrated fully.
pub(super) const STRIDE: usize = 16;

/// Two surfaces, `a` seen in the frame of `b`.
pub(super) struct Overlap<'a, F: Fn(usize) -> (Vec3, Vec3)> {
    pub surface_a: &'a Surface,
    pub surface_b: &'a Surface,
    /// A control point of `a` and its normal.
    pub place: F,
    /// A point in the frame of `b`, in that of `a`.
    pub to_a: &'a dyn Fn(&Vec3) -> Vec3,
}

impl<F: Fn(usize) -> (Vec3, Vec3)> Overlap<'_, F> {
    /// Whether some place is inside both bodies, deeper than contact goes: the middle of one, of the other, or
    /// between the two. For bodies with the same centre and of the same size no other test finds anything.
    pub(super) fn middle_is_inside_both(&self, stack: &mut Vec<u32>, center_a: &Vec3, center_b: &Vec3) -> bool {
        let mut is_deep = |surface: &Surface, x: &Vec3| depth_inside(stack, surface, x).is_some_and(|depth| depth > surface.spacing);
        [*center_a, *center_b, 0.5 * (center_a + center_b)]
            .iter()
            .any(|x| is_deep(self.surface_b, x) && is_deep(self.surface_a, &(self.to_a)(x)))
    }

    /// Whether a control point of one, of every `stride` of them, lies inside the other
    /// by more than `depth`, as a share of the spacing of its points.
    pub(super) fn points_are_inside(&self, stack: &mut Vec<u32>, stride: usize, depth: Real) -> bool {
        let mut is_deep =
            |surface: &Surface, x: &Vec3| depth_inside(stack, surface, x).is_some_and(|found| found > depth * surface.spacing);
        let (control_a, control_b) = (&self.surface_a.control, &self.surface_b.control);
        (0..control_a.len()).step_by(stride).any(|c| is_deep(self.surface_b, &(self.place)(c).0))
            || control_b.points.iter().step_by(stride).any(|p| is_deep(self.surface_a, &(self.to_a)(p)))
    }

    /// The unit direction (frame of `b`) along which `a` has least way to leave `b`. `None` if there is none on which
    /// the two surfaces face each other. Of equal ones that of `last`, or the first in a fixed order.
    pub(super) fn shortest_separation(&self, last: Option<Vec3>) -> Option<Vec3> {
        let (points_a, points_b) = (self.surface_a.control.len(), self.surface_b.control.len());
        let mut best: Option<(Real, Vec3)> = last.and_then(|way| Some((KEPT * self.depth(&way)?, way)));
        let try_way = |way: Vec3, best: &mut Option<(Real, Vec3)>| {
            if let Some(depth) = self.depth(&way)
                && best.is_none_or(|(least, _)| depth < least)
            {
                *best = Some((depth, way));
            }
        };
        for control_point in (0..points_b).step_by(points_b.div_ceil(DIRECTIONS)) {
            try_way(self.surface_b.control.normals[control_point], &mut best);
        }
        for control_point in (0..points_a).step_by(points_a.div_ceil(DIRECTIONS)) {
            try_way(-(self.place)(control_point).1, &mut best);
        }
        let mut angle = FIRST_ANGLE;
        for _ in 0..ROUNDS {
            let (_, way) = best?;
            let frame = crate::math::contact_frame(&way, &Vec3::x());
            for side in [frame.column(1), frame.column(2)] {
                try_way((way + side * angle).normalize(), &mut best);
                try_way((way - side * angle).normalize(), &mut best);
            }
            angle *= 0.25;
        }
        best.map(|(_, way)| way)
    }

    /// How far `a` has to move along `way` until a plane separates the two, m; `None` if the surfaces do not face each other along it.
    fn depth(&self, way: &Vec3) -> Option<Real> {
        let control_b = &self.surface_b.control;
        let (mut top, mut facing_b) = (Real::NEG_INFINITY, Real::NEG_INFINITY);
        for (p, normal) in control_b.points.iter().zip(&control_b.normals) {
            (top, facing_b) = (top.max(way.dot(p)), facing_b.max(way.dot(normal)));
        }
        let (mut bottom, mut facing_a) = (Real::INFINITY, Real::INFINITY);
        for control_point in 0..self.surface_a.control.len() {
            let (x, normal) = (self.place)(control_point);
            (bottom, facing_a) = (bottom.min(way.dot(&x)), facing_a.min(way.dot(&normal)));
        }
        (facing_b > FACING && facing_a < -FACING).then_some(top - bottom)
    }

    /// Control points of `a` that bear a contact along `way`, each with the control point of `b` on the
    /// same line: those of the far side of `a` with `b` in front of them. At least one.
    pub(super) fn bearing(&self, way: &Vec3, mut found: impl FnMut(u32, u32)) {
        let control_b = &self.surface_b.control;
        let mut nearest_of_all: Option<(Real, u32, u32)> = None;
        let mut any = false;
        for control_point in 0..self.surface_a.control.len() {
            let (x, normal) = (self.place)(control_point);
            if normal.dot(way) > -BEARING {
                continue;
            }
            let mut nearest: Option<(Real, usize)> = None;
            for (k, (p, normal)) in control_b.points.iter().zip(&control_b.normals).enumerate() {
                if normal.dot(way) < BEARING {
                    continue;
                }
                let from = p - x;
                let aside2 = from.norm_squared() - from.dot(way).powi(2);
                if nearest.is_none_or(|(least, _)| aside2 < least) {
                    nearest = Some((aside2, k));
                }
            }
            let Some((aside2, k)) = nearest else { return };
            if aside2 < control_b.spacing * control_b.spacing {
                any = true;
                found(control_point as u32, k as u32);
            } else if nearest_of_all.is_none_or(|(least, ..)| aside2 < least) {
                nearest_of_all = Some((aside2, control_point as u32, k as u32));
            }
        }
        if let (false, Some((_, control_point, k))) = (any, nearest_of_all) {
            found(control_point, k);
        }
    }
}

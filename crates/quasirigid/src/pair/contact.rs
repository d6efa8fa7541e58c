//! One contact: a control point of a surface and its projection on another.

use crate::collider::Skin;
use crate::math::{Mat3, Real, Vec3};
use crate::surface::{Loaded, Weights};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A control point of body `a` and its projection on body `b`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Contact {
    /// Index of the pair in the world's list as it is in this step.
    pub pair: u32,
    /// Slot of the body that carries the control point, see [`crate::BodyHandle::slot`].
    pub body_a: u32,
    /// Slot of the body whose surface it is projected on.
    pub body_b: u32,
    /// Link of the body that carries the control point.
    pub link_a: u32,
    /// Link of the body whose surface it is projected on.
    pub link_b: u32,
    /// Slot of the collider that the control point is of, see [`crate::ColliderHandle::slot`].
    pub collider_a: u32,
    /// Slot of the collider whose surface it is projected on.
    pub collider_b: u32,
    /// The control point of `a`: with the two colliders, the stable key.
    pub control_point: u32,
    /// Where it is at the start of the step: the deformed control point, world, m.
    pub point: Vec3,
    /// Columns (normal, tangent1, tangent2) at the start of the step, world: orthonormal, right-handed. The normal is the outward
    /// normal of `b`: from `b` to `a`. tangent1 lies along the direction of anisotropic friction, where there is one.
    pub frame: Mat3,
    /// Where its reaction acts on both bodies, with the poses of the start of the step, world, m: `point`, but
    /// for what the two move in the step, see `docs/step.md`, "Rolling".
    pub acts_at: Vec3,
    /// The frame in which it acts, world: `frame` as `b` is expected to have rotated it at the end of the step.
    pub acts_along: Mat3,
    /// `mu_2/mu_1`: friction coefficient along tangent2 over that along tangent1 (-); 1 where friction is isotropic.
    pub friction_ratio: Real,
    /// Gap between the deformed surfaces at the start of the step, m; > 0 means separated.
    pub gap: Real,
    /// The gap that the solver gets, m: `gap`, but for an overlap, which is pushed apart no faster than [`Parameters::push_out_speed`].
    pub solved_gap: Real,
    /// Area that the contact stands for, m^2: the control point's, or its node's when the traversal stopped early.
    pub area: Real,
    /// Where it is projected to: on the undeformed surface of `b`, frame of the link of `b`, m.
    pub foot: Vec3,
    /// Control points of `b` that the foot is interpolated from; none if `b` counts as rigid.
    pub weights_b: Weights,
    /// Whether it was projected in this step; otherwise foot, normal and weights are those remembered.
    pub projected: bool,
}

impl Contact {
    /// The foot as a loaded place on the half-space `b`, frame of the link of `b`. `to_link_b`: rotation from the world.
    pub(crate) fn foot_on_b(&self, to_link_b: &Mat3) -> Loaded {
        Loaded { point: self.foot, normal: to_link_b * self.frame.column(0), area: self.area }
    }

    /// Mean of `1/r` over the contact's area as seen from its middle, 1/m; `skin_a` is the skin of `a`.
    pub(crate) fn inverse_distance(&self, skin_a: &Skin) -> Real {
        let (control, i) = (&skin_a.surface.control, self.control_point as usize);
        control.inverse_distances[i] * (control.areas[i] / self.area).sqrt()
    }
}

/// The contacts of each of `pairs` pairs, one after the other, as a range of
/// `contacts`, which are ordered by pair; empty for a pair that is out of touch.
pub(crate) fn patches(contacts: &[Contact], pairs: usize) -> impl Iterator<Item = Range<usize>> {
    let mut end = 0;
    (0..pairs).map(move |pair| {
        let start = end;
        end += contacts[start..].iter().take_while(|contact| contact.pair as usize == pair).count();
        start..end
    })
}

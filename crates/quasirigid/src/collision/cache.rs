//! What the search for contacts remembers of a pair from step to step. It changes no result
//! beyond rounding, but the last bits depend on it: a copy of a world takes it along.

use crate::collider::Sphere;
use crate::math::{Pose, Real, Rot, Vec3};
use crate::objects::Objects;
use crate::pair::Pair;
use crate::surface::Weights;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Coupled nodes and projections of one pair.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PairCache {
    /// Coupled nodes, found again when the two have moved enough.
    pub coupling: Coupling,
    /// Last projection of each control point of `a`.
    pub projections: Vec<CachedProjection>,
}

impl PairCache {
    /// Nothing found yet for a surface with so many control points.
    pub(super) fn new(control_points: usize) -> Self {
        Self { coupling: Coupling::default(), projections: vec![CachedProjection::default(); control_points] }
    }

    /// What was found of the two surfaces no longer holds.
    pub(crate) fn invalidate(&mut self) {
        self.coupling = Coupling::default();
        self.projections.fill(CachedProjection::default());
    }
}

/// A node of `a` and a leaf of `b` that overlap.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Coupled {
    /// Control point of `a`: the leaf's, or the one that stands for an inner node.
    pub control_point: u32,
    /// Node of `a`: a leaf unless the budget ran out.
    pub node_a: u32,
    /// Leaf of `b`, as a node.
    pub node_b: u32,
}

/// The coupled nodes of a pair, and how far the two may move before they have to be
/// found again (temporal coherence, which the paper proposes in section 4).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Coupling {
    /// Ordered by control point.
    pub coupled: Vec<Coupled>,
    /// Margin by which the spheres were inflated, m; negative: nothing found yet.
    pub(super) margin: Real,
    /// Whether control points were found inside the other body, deeper than contact
    /// goes: those that the trees do not reach are then searched for, too.
    pub(super) deep: bool,
    /// Whether they were searched for since the nodes were found.
    pub(super) searched: bool,
    /// When they were found.
    pub(super) found: Moment,
    /// Rotation of `a` against `b` when it last invalidated the projections of control points that nothing faced.
    pub(super) faced: Rot,
    /// Since when, and for how far a motion (m), no control point can become a contact.
    pub(super) asleep: Option<(Moment, Real)>,
    /// Whether control points deep inside the other body were searched for since the nodes were found,
    /// because no contact had a force: bodies that have penetrated each other fully do not push.
    pub(super) examined: bool,
    /// Whether the last step found that the two may have penetrated each other fully: the next one treats the pair as a whole.
    pub(super) suspected: bool,
    /// Whether the two have penetrated each other fully, see [`crate::collision::separation`].
    pub(super) penetrated: bool,
    /// Direction in which `a` leaves `b` soonest, a unit vector in the frame of `b`; of a pair that has penetrated fully.
    pub(super) separation: Option<Vec3>,
}

/// Pose of `a` in the frame of `b`, and how far the two surfaces had deformed (m), at some time.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Moment {
    pub(super) pose_ba: Pose,
    pub(super) travel: Real,
}

impl Moment {
    /// Of the step under way.
    pub(super) fn now(pair: &Pair, objects: &Objects) -> Self {
        let [a, b] = pair.sides(objects);
        Self { pose_ba: b.pose().inverse() * a.pose(), travel: a.collider.skin.travel + b.collider.skin.travel }
    }

    /// How far any point of `a`, within the sphere `root` of its frame, has moved against `b` since `old` at most, m.
    pub(super) fn moved_since(&self, old: &Self, root: &Sphere) -> Real {
        let center = Point3::from(root.center);
        (self.pose_ba * center - old.pose_ba * center).norm()
            + old.pose_ba.rotation.angle_to(&self.pose_ba.rotation) * root.radius
            + (self.travel - old.travel)
    }
}

impl Coupling {
    /// Whether no control point can have become a contact, though the free motion may take the two nearer to each other by `approach`, m.
    pub(super) fn is_still_asleep(&mut self, pair: &Pair, objects: &Objects, approach: Real) -> bool {
        let (Some((since, reach)), Some(skin_a)) = (&self.asleep, objects.side(pair.a).active_skin()) else { return false };
        let asleep = Moment::now(pair, objects).moved_since(since, &skin_a.bounding_sphere()) + approach <= *reach;
        if !asleep {
            self.asleep = None;
        }
        asleep
    }

    /// From now on, and until the two have moved by `reach` (m) or their nodes are found again, no control point can become a contact.
    pub(super) fn fall_asleep(&mut self, reach: Real, pair: &Pair, objects: &Objects) {
        self.asleep = Some((Moment::now(pair, objects), reach));
    }

    /// Whether the last search found that no control point can become a contact.
    pub(super) fn is_asleep(&self) -> bool {
        self.asleep.is_some()
    }
}

impl Default for Coupling {
    /// Nothing found yet.
    fn default() -> Self {
        let found = Moment { pose_ba: Pose::identity(), travel: 0.0 };
        Self {
            coupled: Vec::new(),
            margin: -1.0,
            deep: false,
            searched: false,
            found,
            faced: Rot::identity(),
            asleep: None,
            examined: false,
            suspected: false,
            penetrated: false,
            separation: None,
        }
    }
}

/// What a control point remembers of its last projection (temporal coherence,
/// which the paper proposes in section 4). All in the frame of `b`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CachedProjection {
    /// Where the control point was projected from.
    pub(super) x: Vec3,
    /// How far it may go from there before it has to be projected again, m.
    pub(super) holds_for: Real,
    /// What was found there.
    pub(super) surface: Found,
    /// Where it was at rest, without elastic displacement, if faces of the other
    /// surface meet near it: that decides which of them it belongs to.
    pub(super) at_edge: Option<Vec3>,
    /// Whether it lies inside the other body by more than contact does, see [`crate::collision::deep_overlap`].
    pub(super) deep: bool,
    /// Stands for the coupled leaves of the other surface.
    pub(super) leaves: u32,
}

impl CachedProjection {
    /// `leaves` stands for the leaves that the control point is coupled with from now on. If they are
    /// others and no foot was found among the old ones, there may be one now.
    pub(super) fn set_leaves(&mut self, leaves: u32) {
        if leaves != self.leaves {
            self.invalidate_without_foot();
        }
        self.leaves = leaves;
    }

    /// To be projected again if no foot was found: where the bodies have rotated against each other, other points may face it now.
    pub(super) fn invalidate_without_foot(&mut self) {
        if !matches!(self.surface, Found::Foot { .. }) {
            *self = Self { leaves: self.leaves, ..Self::default() };
        }
    }
}

/// The other surface as a control point sees it.
// A box around the larger variant would be an allocation in the step.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Found {
    /// Nothing that faces it, or no projection within the border.
    Nothing,
    /// Too far: no contact until control point and free motion together have gone as far as it holds.
    Separated,
    /// Foot, outward normal, and the control points that the foot is interpolated from.
    Foot { foot: Vec3, normal: Vec3, weights: Weights },
}

impl Default for CachedProjection {
    fn default() -> Self {
        // From infinitely far: wherever the control point is, it has moved too far.
        Self { x: Vec3::repeat(Real::INFINITY), holds_for: 0.0, surface: Found::Nothing, at_edge: None, deep: false, leaves: 0 }
    }
}

//! What two colliders remember of their contact from step to step: state, no caches and no scratch.

mod contact;
mod patch;
mod relative_motion;
mod stored;

pub use contact::Contact;
pub(crate) use contact::patches;
pub(crate) use patch::check_indices;
pub use patch::{PatchSide, Unloaded};
pub use relative_motion::RelativeMotion;

use crate::collider::friction_table::FrictionTable;
use crate::collider::{FrictionRule, PairFriction, Skin};
use crate::free_motion::{FreeMotion, unexpected_displacement};
use crate::math::{Real, Vec3};
use crate::objects::{Objects, Side};
use crate::params::Parameters;
use crate::surface::Weights;
use serde::{Deserialize, Serialize};

/// Two colliders that met. Each pair has an elastic memory of its own: two patches of different pairs on one surface have no
/// elastic effect on each other, so that the solver and the memory use the same operator.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Pair {
    /// Slot of the collider whose control points are used: the finer side.
    pub a: u32,
    /// Slot of the other collider.
    pub b: u32,
    /// Whether the broad phase found them near in this step.
    pub near: bool,
    /// Steps since it last did.
    pub steps_apart: u32,
    /// Relative displacement of the two in this step by motion that is prescribed or expected to go on.
    pub relative_motion: RelativeMotion,
    /// The reactions of the last steps.
    pub reactions: ReactionHistory,
    /// Elastic displacement of `a` under this pair's reactions.
    pub side_a: PatchSide,
    /// Elastic displacement of `b` under this pair's reactions.
    pub side_b: PatchSide,
    /// Whether `b` is so much stiffer than `a` that it counts as rigid here, see [`Parameters::rigid_beyond`].
    pub rigid_b: bool,
    /// Displacement of `b` under each control point of `a`, less what `side_b` gives there by interpolation, frame of the
    /// link of `b`. Only where `b` is a half-space: its Green's function holds at the feet of the contacts themselves, and
    /// the control points of `b`, the coarser side, cannot represent what is narrower than their spacing.
    pub fine_b: PatchSide,
    /// Friction between the two.
    pub friction: PairFriction,
    /// Slip speed of each control point of `a` at the end of the last step, m/s: 0 where it
    /// stuck or was not near. Empty unless friction is velocity-weakening.
    pub slip_speed: Vec<Real>,
}

/// Reactions of the last steps at the control points of `a`, contact frame, N: what the next solve starts from.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ReactionHistory {
    /// Last reaction of each control point; zero where there was none.
    pub last: Vec<Vec3>,
    /// By how much it is likely to change in the next step, where it was loaded in the last ones.
    pub trend: Vec<Vec3>,
    /// By how much it changed in the last step, where it was loaded before and after.
    pub change: Vec<Vec3>,
    /// Control points with a reaction of the last step.
    pub loaded: Vec<u32>,
}

impl ReactionHistory {
    /// No reaction at any of `control_points` control points.
    fn new(control_points: usize) -> Self {
        let none = vec![Vec3::zeros(); control_points];
        Self { last: none.clone(), trend: none.clone(), change: none, loaded: Vec::with_capacity(control_points.min(512)) }
    }
}

impl Pair {
    /// Two colliders that are near for the first time; `skins` are those of `a` and `b`.
    pub(crate) fn new([a, b]: [u32; 2], skins: [&Skin; 2], friction: PairFriction, params: &Parameters) -> Self {
        let [count_a, count_b] = skins.map(|skin| skin.surface.control.len());
        let mut pair = Self {
            a,
            b,
            near: true,
            steps_apart: 0,
            relative_motion: RelativeMotion::none(),
            reactions: ReactionHistory::new(count_a),
            side_a: PatchSide::new(count_a),
            side_b: PatchSide::new(count_b),
            rigid_b: counts_as_rigid(skins[0], skins[1], params),
            fine_b: PatchSide::new(count_a),
            friction,
            slip_speed: Vec::new(),
        };
        pair.set_friction(friction);
        pair
    }

    /// Both sides: the one whose control points are used, and the other.
    pub(crate) fn sides<'a>(&self, objects: &'a Objects) -> [Side<'a>; 2] {
        [self.a, self.b].map(|collider| objects.side(collider))
    }

    /// Elastic displacement of `b` under a control point of `a` whose foot is interpolated by `weights`, frame of the link of `b`, m.
    pub fn displacement_of_b(&self, control_point: usize, weights: &Weights) -> Vec3 {
        self.fine_b.displacement[control_point] + weights.iter().map(|(c, w)| self.side_b.displacement[c] * w).sum::<Vec3>()
    }

    /// Displacement of `a` against `b` (m, world) in this step at a point of both, before contact
    /// forces: what is expected, and what the free motions differ from it. Affine in the point.
    pub(crate) fn free_displacement(&self, objects: &Objects, free: &[FreeMotion], point: &Vec3) -> Vec3 {
        self.relative_motion.displacement(point) + self.unexpected_displacement(objects, free, point)
    }

    /// The part of it that is not expected, see [`RelativeMotion`], to first order.
    pub(crate) fn unexpected_displacement(&self, objects: &Objects, free: &[FreeMotion], point: &Vec3) -> Vec3 {
        let [a, b] = self.sides(objects).map(|side| unexpected_displacement(side, &free[side.collider.body as usize], point));
        a - b + self.relative_motion.shared_displacement(point)
    }

    /// How deep either surface is pressed in at most, over the thickness of its layer (-): 0 where it is not, or where its
    /// compliance knows no thickness.
    pub(crate) fn indentations(&self, objects: &Objects) -> [Real; 2] {
        let sides = self.sides(objects);
        let of = |side: Side<'_>, displaced: &PatchSide| {
            let skin = &side.collider.skin;
            let Some(thickness) = skin.material.yielding_thickness() else { return 0.0 };
            let inwards = |&c: &u32| -displaced.displacement[c as usize].dot(&skin.surface.control.normals[c as usize]);
            displaced.active.iter().map(inwards).fold(0.0, Real::max) / thickness
        };
        let [a, b] = sides;
        [of(a, &self.side_a), of(b, &self.side_b)]
    }

    /// The compliance of one of the two is another from now on; the displacements stay, but those of a `b` that
    /// counts as rigid. Returns whether `b` counts as rigid now where it did not before, or the other way round:
    /// feet on a rigid `b` have no weights, so projections found before no longer serve.
    pub(crate) fn compliance_changed(&mut self, rigid_b: bool) -> bool {
        if rigid_b {
            self.side_b.clear();
            self.fine_b.clear();
        }
        std::mem::replace(&mut self.rigid_b, rigid_b) != rigid_b
    }

    /// Replaces the friction. Slip speeds start from rest if they were not remembered before.
    pub(crate) fn set_friction(&mut self, friction: PairFriction) {
        self.friction = friction;
        self.slip_speed.resize(if friction.is_velocity_weakening() { self.reactions.last.len() } else { 0 }, 0.0);
    }

    /// Whether anything is left to remember.
    pub fn is_idle(&self) -> bool {
        self.reactions.loaded.is_empty() && [&self.side_a, &self.side_b, &self.fine_b].iter().all(|side| side.active.is_empty())
    }
}

/// Friction between two colliders, by slot, see [`FrictionTable::pair`].
pub(crate) fn friction_between(table: &FrictionTable, colliders: [u32; 2], objects: &Objects, rule: FrictionRule) -> PairFriction {
    let [a, b] = colliders.map(|slot| &objects.colliders[slot]);
    table.pair([a.body, b.body], objects.bodies.added_before(a.body, b.body), [&a.skin.material, &b.skin.material], rule)
}

/// Whether `b` is so much stiffer than `a` that it counts as rigid where they touch.
pub(crate) fn counts_as_rigid(skin_a: &Skin, skin_b: &Skin, params: &Parameters) -> bool {
    // Under a uniform pressure over what one control point of `a` stands for.
    let patch = skin_a.surface.control.spacing.powi(2);
    let compliance = |skin: &Skin| skin.compliance.patch_compliance(&skin.surface.control, patch);
    compliance(skin_a) > params.rigid_beyond * compliance(skin_b)
}

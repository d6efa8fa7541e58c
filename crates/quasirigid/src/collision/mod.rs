//! Stage 2: which control points touch, or are about to (design 3.2).
//!
//! Geometry is frozen at the start of the step: poses and deformation as the last step left them. What the free motion adds to
//! gap and slip enters linearly in the contact problem, with the same Jacobians as the reactions. `docs/step.md` says why: seen at the pose
//! after the free motion, a body at rest would be compared with a place where it never is, and the mismatch of second order would be a creep.

mod broad_phase;
mod coarse;
mod deep;
mod pair;
mod projection;
mod traversal;

pub(crate) use pair::counts_as_rigid;
pub use pair::{Afar, Pair, PatchSide};
pub use projection::Remembered;
pub use traversal::{Coupled, Coupling};

use crate::body::friction_table::FrictionTable;
use crate::body::{BodyEntry, Skin};
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Loaded, Weights};
use std::time::{Duration, Instant};

/// A control point of body `a` and its projection on body `b`.
#[derive(Debug, Clone)]
pub struct Contact {
    /// Index of the pair in the world's list.
    pub pair: u32,
    /// Dense index of the body that carries the control point.
    pub body_a: u32,
    /// Dense index of the body whose surface it is projected on.
    pub body_b: u32,
    /// The control point of `a`: with the pair, the stable key.
    pub control_point: u32,
    /// Where it is: the deformed control point, world, m. Reactions act here on both bodies.
    pub point: Vec3,
    /// Columns (normal, tangent1, tangent2), world. The normal is the outward normal of `b`: from `b` to `a`. Unit vectors; but where friction has a grain tangent2 is
    /// stretched ([`crate::body::PairFriction::frame`]): `frame f` is the force in world axes all the same, and `frame^T d` is what the contact problem calls a displacement.
    pub frame: Mat3,
    /// Gap between the deformed surfaces at the start of the step, m; > 0 means apart.
    pub gap: Real,
    /// The gap that the solver gets, m: `gap`, but for an overlap, which is pushed apart no faster than [`Parameters::push_out_speed`].
    pub solved_gap: Real,
    /// Area that the contact stands for, m^2: the control point's, or its node's when the traversal stopped early.
    pub area: Real,
    /// Where it is projected to: on the undeformed surface of `b`, frame of the link of `b`, m.
    pub foot: Vec3,
    /// Control points of `b` that the foot is interpolated from; none if `b` counts as rigid.
    pub weights_b: Weights,
    /// Whether it was projected anew in this step; otherwise foot, normal and weights are those remembered.
    pub projected: bool,
}

impl Contact {
    /// By how much tangent2 is stretched: `mu_2/mu_1`, 1 where friction has no grain.
    pub fn stretch(&self) -> Real {
        let length = self.frame.column(2).norm();
        // A unit vector is one but for rounding.
        if (length - 1.0).abs() < 1e-12 { 1.0 } else { length }
    }

    /// The frame with unit vectors only.
    pub fn unit_frame(&self) -> Mat3 {
        Mat3::from_columns(&[self.frame.column(0).into(), self.frame.column(1).into(), self.frame.column(2) / self.stretch()])
    }

    /// The foot as a half-space on `b` sees it, frame of the link of `b`. `to_link_b`: rotation from the world.
    pub(crate) fn foot_on_b(&self, to_link_b: &Mat3) -> Loaded {
        Loaded { point: self.foot, normal: to_link_b * self.frame.column(0), area: self.area }
    }

    /// Mean of `1/r` over the contact's area as seen from its middle, 1/m; `skin_a` is the skin of `a`.
    pub(crate) fn inverse_distance(&self, skin_a: &Skin) -> Real {
        let (control, i) = (&skin_a.surface.control, self.control_point as usize);
        control.inverse_distances[i] * (control.areas[i] / self.area).sqrt()
    }
}

/// Scratch and output of the stage.
#[derive(Debug, Default)]
pub struct Collision {
    /// The contacts, ordered by pair and control point.
    pub contacts: Vec<Contact>,
    /// Whether the traversal budget ran out, so that some contacts are coarser than the leaves.
    pub coarse: bool,
    /// Time in the sphere trees.
    pub traverse_time: Duration,
    /// Time in projections.
    pub projection_time: Duration,
    reach: Vec<Real>,
    near: Vec<(u32, u32)>,
    traversal: traversal::Traversal,
    projection: projection::Scratch,
}

/// Finds all contacts. `pairs` grows when two bodies meet for the first time; then `friction` is asked for theirs. `step`: number of the step, for
/// [`Parameters::collision_every`].
pub(crate) fn collision(
    out: &mut Collision,
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    pairs: &mut Vec<Pair>,
    friction: &FrictionTable,
    params: &Parameters,
    step: u64,
) {
    let start = Instant::now();
    broad_phase::reach_of_bodies(bodies, free, &mut out.reach);
    broad_phase::near_bodies(bodies, &out.reach, params, &mut out.near);
    pair::match_pairs(pairs, &out.near, bodies, friction, params);
    out.traversal.start(pairs.iter().filter(|pair| pair.near).count(), params.traversal_budget);
    for pair in pairs.iter_mut().filter(|pair| pair.near) {
        traversal::traverse(&mut out.traversal, pair, bodies, &out.reach, params);
    }
    out.coarse = out.traversal.coarse;
    let traversed = Instant::now();
    let look = step.is_multiple_of(u64::from(params.collision_every));
    projection::project_control_points(&mut out.projection, pairs, bodies, free, &out.reach, params, look, &mut out.contacts);
    out.traverse_time = traversed - start;
    out.projection_time = traversed.elapsed();
}

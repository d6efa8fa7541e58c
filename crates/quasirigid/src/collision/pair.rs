//! What two bodies remember of their contact from step to step: reactions for the warm start, elastic displacement.

use super::{Carried, Coupling, Remembered};
use crate::body::friction_table::FrictionTable;
use crate::body::{BodyEntry, PairFriction, Skin};
use crate::contact_problem::ElasticRows;
use crate::free_motion::FreeMotion;
use crate::math::{Real, Vec3};
use crate::params::Parameters;
use crate::surface::Weights;

/// Elastic displacement of one side of a pair, at the control points of its surface.
#[derive(Debug, Clone, Default)]
pub struct PatchSide {
    /// Displacement `u` of each control point, m, in the frame of the link that carries the surface.
    pub displacement: Vec<Vec3>,
    /// Control points whose displacement is not zero.
    pub active: Vec<u32>,
    /// Whether a control point is in `active`.
    pub is_active: Vec<bool>,
    /// Where control points that follow from afar are going.
    pub afar: Afar,
}

/// Control points that are moved by forces at others but are in no contact themselves: shown, and ready for when they are touched. Their static displacement under
/// the present forces is kept and found anew only when those have changed by more than the solver's last digits, so that a patch at rest costs nothing.
#[derive(Debug, Clone, Default)]
pub struct Afar {
    /// `K^-1 f` of each control point, m, where `found` is that of the present forces.
    pub settled: Vec<Vec3>,
    /// Which forces it was found for: the count below at that time.
    pub found: Vec<u64>,
    /// How often the forces have changed.
    pub count: u64,
    /// Those forces, N: control point and force.
    pub forces: Vec<(u32, Vec3)>,
}

/// Steps for which two bodies that are no longer near stay a pair, though nothing is left to remember: that two part and meet again costs no new memory. Then the pair is
/// forgotten, or of a heap of things that were thrown about there would soon be one for every two of them.
const KEPT: u32 = 1_000;

/// Two bodies that met. Each pair has an elastic memory of its own: two patches of different pairs on one surface do not see
/// each other elastically, so that what the solver sees and what is remembered are the same operator.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Dense index of the body whose control points are used: the finer side.
    pub a: u32,
    /// Dense index of the other body.
    pub b: u32,
    /// Whether the broad phase found them near in this step.
    pub near: bool,
    /// Steps since it last did.
    pub away: u32,
    /// Displacement of the two against each other by motion that is told or goes on, in this step.
    pub carried: Carried,
    /// Last reaction of each control point of `a`, contact frame, N; zero where there was none.
    pub reaction: Vec<Vec3>,
    /// By how much it is likely to change in the next step, where it was loaded in the last ones, N.
    pub trend: Vec<Vec3>,
    /// By how much it changed in the last step, where it was loaded before and after, N.
    pub change: Vec<Vec3>,
    /// Control points with a reaction of the last step.
    pub loaded: Vec<u32>,
    /// Elastic displacement of `a` under this pair's reactions.
    pub side_a: PatchSide,
    /// Elastic displacement of `b` under this pair's reactions.
    pub side_b: PatchSide,
    /// Whether `b` is so much stiffer than `a` that it counts as rigid here, see [`Parameters::rigid_beyond`].
    pub rigid_b: bool,
    /// What the displacement of `b` under each control point of `a` has beyond that interpolated from `side_b`, frame of the link of `b`. Only where `b` is a
    /// half-space: its Green's function holds at the feet themselves, and `b`, the coarser side, cannot show what is narrower than its spacing.
    pub beyond: PatchSide,
    /// Friction between the two.
    pub friction: PairFriction,
    /// Slip speed of each control point of `a` at the end of the last step, m/s: 0 where it stuck or was not near. Empty if friction does not fall with it.
    pub slip_speed: Vec<Real>,
    /// Coupled nodes, found anew when the two have moved enough.
    pub coupling: Coupling,
    /// Last projection of each control point of `a`.
    pub remembered: Vec<Remembered>,
    /// Elastic rows of the contact problem, kept while the contacts stay the same.
    pub elastic: ElasticRows,
}

impl PatchSide {
    fn new(control_points: usize) -> Self {
        Self {
            displacement: vec![Vec3::zeros(); control_points],
            active: Vec::with_capacity(control_points.min(512)),
            is_active: vec![false; control_points],
            afar: Afar {
                settled: vec![Vec3::zeros(); control_points],
                found: vec![0; control_points],
                count: 0,
                forces: Vec::with_capacity(control_points.min(512)),
            },
        }
    }

    /// Forgets all displacements.
    pub fn clear(&mut self) {
        for c in self.active.drain(..) {
            (self.displacement[c as usize], self.is_active[c as usize]) = (Vec3::zeros(), false);
        }
    }

    /// Marks a control point as displaced.
    pub fn touch(&mut self, control_point: usize) {
        if !self.is_active[control_point] {
            self.is_active[control_point] = true;
            self.active.push(control_point as u32);
        }
    }
}

impl Pair {
    /// Elastic displacement of `b` under a control point of `a` whose foot is interpolated by `weights`, frame of the link of `b`, m.
    pub fn displacement_of_b(&self, control_point: usize, weights: &Weights) -> Vec3 {
        self.beyond.displacement[control_point] + weights.iter().map(|(c, w)| self.side_b.displacement[c] * w).sum::<Vec3>()
    }

    /// Displacement of `a` against `b` (m, world) in this step at a point of both, before contact forces: free motion, and what is told, see [`Carried`]. Affine in the point.
    pub fn free_displacement(&self, bodies: &[BodyEntry], free: &[FreeMotion], point: &Vec3) -> Vec3 {
        let [a, b] = [self.a, self.b].map(|body| bodies[body as usize].unexpected_displacement(&free[body as usize], point));
        a - b + self.carried.displacement(point)
    }

    /// The compliance of one of the two is another from now on; the displacements stay, but those of a `b` that counts as rigid.
    pub(crate) fn compliance_changed(&mut self, rigid_b: bool) {
        if rigid_b != self.rigid_b {
            // Feet on a rigid `b` have no weights and are kept for longer.
            self.look_anew();
        }
        self.rigid_b = rigid_b;
        self.elastic = ElasticRows::default();
        if rigid_b {
            self.side_b.clear();
            self.beyond.clear();
        }
    }

    /// What was seen of the two surfaces no longer holds.
    pub(crate) fn look_anew(&mut self) {
        self.coupling = Coupling::default();
        self.remembered.fill(Remembered::default());
    }

    /// Replaces the friction. Slip speeds start from rest if they were not remembered before.
    pub(crate) fn set_friction(&mut self, friction: PairFriction) {
        self.friction = friction;
        self.slip_speed.resize(if friction.falls() { self.reaction.len() } else { 0 }, 0.0);
    }

    /// Whether anything is left to remember.
    pub fn is_idle(&self) -> bool {
        self.loaded.is_empty() && [&self.side_a, &self.side_b, &self.beyond].iter().all(|side| side.active.is_empty())
    }
}

/// Whether `b` is so much stiffer than `a` that it counts as rigid where they touch.
pub(crate) fn counts_as_rigid(skin_a: &Skin, skin_b: &Skin, params: &Parameters) -> bool {
    // Under a uniform pressure over what one control point of `a` stands for.
    let patch = skin_a.surface.control.spacing.powi(2);
    let gives = |skin: &Skin| skin.compliance.give(&skin.surface.control, patch);
    gives(skin_a) > params.rigid_beyond * gives(skin_b)
}

/// Marks the pairs that are near, adds those that are new and forgets those that have been apart for long, keeping the list sorted by body indices.
pub(super) fn match_pairs(pairs: &mut Vec<Pair>, near: &[(u32, u32)], bodies: &[BodyEntry], table: &FrictionTable, params: &Parameters) {
    pairs.retain_mut(|pair| {
        if !std::mem::replace(&mut pair.near, false) {
            pair.carried.forget();
        }
        pair.away = pair.away.saturating_add(1);
        pair.away < KEPT || !pair.is_idle()
    });
    for &(i, j) in near {
        let (Some(skin_i), Some(skin_j)) = (bodies[i as usize].active_skin(), bodies[j as usize].active_skin()) else { continue };
        // A pair is sampled once, from the side with the finer control points: counted neither twice nor not at all.
        let finer_first = skin_i.surface.control.spacing <= skin_j.surface.control.spacing;
        let (a, b) = if finer_first { (i, j) } else { (j, i) };
        match pairs.binary_search_by_key(&(a, b), |pair| (pair.a, pair.b)) {
            Ok(found) => (pairs[found].near, pairs[found].away) = (true, 0),
            Err(place) => {
                let (skin_a, skin_b) = if finer_first { (skin_i, skin_j) } else { (skin_j, skin_i) };
                let (count_a, count_b) = (skin_a.surface.control.len(), skin_b.surface.control.len());
                let Some(friction) = table.pair(bodies, a, b, params.friction_rule) else { continue };
                let mut pair = Pair {
                    a,
                    b,
                    near: true,
                    away: 0,
                    carried: Carried::none(),
                    reaction: vec![Vec3::zeros(); count_a],
                    trend: vec![Vec3::zeros(); count_a],
                    change: vec![Vec3::zeros(); count_a],
                    loaded: Vec::with_capacity(count_a.min(512)),
                    side_a: PatchSide::new(count_a),
                    side_b: PatchSide::new(count_b),
                    rigid_b: counts_as_rigid(skin_a, skin_b, params),
                    beyond: PatchSide::new(count_a),
                    friction,
                    slip_speed: Vec::new(),
                    coupling: Coupling::default(),
                    remembered: vec![Remembered::default(); count_a],
                    elastic: ElasticRows::default(),
                };
                pair.set_friction(friction);
                pairs.insert(place, pair);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::World;
    use crate::body::{Amount, MassProperties, Material, Motion, RigidBody};
    use crate::math::Pose;
    use crate::surface::{Surface, shapes};
    use std::sync::Arc;

    #[test]
    fn bodies_that_have_long_been_apart_are_no_pair_and_meet_like_strangers() {
        let steps = |world: &mut World, count: u32| (0..count).for_each(|_| drop(world.step()));
        let scene = || {
            let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
            let rubber = Material::preset("rubber").unwrap();
            let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
            let plate = RigidBody::fixed("plate", Pose::identity()).unwrap();
            world.add_body(plate, Some((surface(shapes::sample_half_space(0.1, 900).unwrap(), 100), rubber.clone()))).unwrap();
            let mass = MassProperties::sphere(0.02, Amount::Mass(0.05)).unwrap();
            let ball = RigidBody::free("ball", mass, Motion::QuasiStatic, Pose::translation(0.0, 0.0, 0.1)).unwrap();
            let ball = world.add_body(ball, Some((surface(shapes::sample_sphere(0.02, 900).unwrap(), 120), rubber))).unwrap();
            (world, ball)
        };
        let press = |world: &mut World, ball| {
            let body = world.body_mut(ball).unwrap();
            body.set_pose(Pose::translation(0.0, 0.0, 0.0201)).unwrap();
            body.set_external_wrench(Vec3::new(0.0, 0.0, -2.0), Vec3::zeros()).unwrap();
            steps(world, 30);
            assert!(world.contacts().len() > 3 && world.pairs.len() == 1, "{} contacts", world.contacts().len());
        };
        let (mut world, ball) = scene();
        press(&mut world, ball);
        let body = world.body_mut(ball).unwrap();
        body.set_pose(Pose::translation(0.0, 0.0, 0.1)).unwrap();
        body.set_external_wrench(Vec3::zeros(), Vec3::zeros()).unwrap();
        steps(&mut world, KEPT - 1);
        assert_eq!(world.pairs.len(), 1, "forgotten too early");
        steps(&mut world, 1);
        assert!(world.pairs.is_empty());
        press(&mut world, ball);

        let (mut fresh, ball) = scene();
        press(&mut fresh, ball);
        assert_eq!(world.state_hash(), fresh.state_hash());
    }
}

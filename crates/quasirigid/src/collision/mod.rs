//! Stage 2: which control points touch, or are about to (design 3.2).
//!
//! Geometry is frozen at the start of the step: poses and deformation as the last step left them. What the free motion adds to
//! gap and slip enters linearly in the contact problem, with the same Jacobians as the reactions. `docs/step.md` says why: seen at the pose
//! after the free motion, a body at rest would be compared with a place where it never is, and the mismatch of second order would be a creep.

mod broad_phase;
mod carried;
mod coarse;
mod deep;
mod nearest_point;
mod pair;
mod projection;
mod traversal;

pub use carried::Carried;
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
    /// Index of the pair in the world's list as it is in this step.
    pub pair: u32,
    /// Dense index of the body that carries the control point.
    pub body_a: u32,
    /// Dense index of the body whose surface it is projected on.
    pub body_b: u32,
    /// The control point of `a`: with the two bodies, the stable key.
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
    /// Time to refit them before.
    pub refit_time: Duration,
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
    bodies: &mut [BodyEntry],
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
        let sides = [pair.a as usize, pair.b as usize];
        pair.carried.renew(sides.map(|side| &bodies[side]), sides.map(|side| &free[side]));
        traversal::traverse(&mut out.traversal, pair, bodies, &out.reach, params);
    }
    out.coarse = out.traversal.coarse;
    let traversed = Instant::now();
    let look = step.is_multiple_of(u64::from(params.collision_every));
    let now = projection::Snapshot { bodies, free, reach: &out.reach, params, look };
    projection::project_control_points(&mut out.projection, pairs, now, &mut out.contacts);
    out.refit_time = out.traversal.refit_time;
    out.traverse_time = traversed - start - out.refit_time;
    out.projection_time = traversed.elapsed();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Material, Motion, PoseDrive, RigidBody};
    use crate::math::Pose;
    use crate::surface::{Surface, shapes};
    use crate::world::{BodyHandle, World};
    use std::sync::Arc;

    /// A box on a pedestal over a coarse mat, which couples with every control point of its bottom, and a fingertip that pushes at its side.
    fn scene() -> (World, BodyHandle) {
        let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
        let stuff = |name| Material::preset(name).unwrap();
        let mut world = World::new(Parameters::default()).unwrap();
        let mut fixed = |points, control, at: Vec3| {
            let body = RigidBody::fixed("fixed", Pose::translation(at.x, at.y, at.z)).unwrap();
            world.add_body(body, Some((surface(points, control), stuff("silicone")))).unwrap()
        };
        fixed(shapes::sample_box(Vec3::new(0.016, 0.016, 0.004), 1_000).unwrap(), 130, Vec3::new(0.0, 0.0, -0.002));
        fixed(shapes::sample_half_space(0.6, 1_600).unwrap(), 200, Vec3::new(0.0, 0.0, -0.004));
        let size = Vec3::repeat(0.04);
        let mass = crate::body::MassProperties::cuboid(size, crate::body::Amount::Mass(0.1)).unwrap();
        let object = RigidBody::free("box", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.02)).unwrap();
        let object = world.add_body(object, Some((surface(shapes::sample_box(size, 6_000).unwrap(), 800), stuff("wood")))).unwrap();
        let tip = shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 1_200).unwrap();
        let finger = RigidBody::fixed("finger", finger_at(0)).unwrap();
        world.add_body(finger, Some((surface(tip, 160), stuff("fingertip_pulp")))).unwrap();
        (world, object)
    }

    /// The fingertip comes from the side, pushes, and rolls a little.
    fn finger_at(step: usize) -> Pose {
        let s = step as Real * 1e-3;
        let turn = crate::math::Rot::from_axis_angle(&Vec3::y_axis(), std::f64::consts::FRAC_PI_2 + 0.5 * s);
        Pose::from_parts(Vec3::new(-0.0285 + 0.02 * s, 0.0, 0.022 + 0.004 * s).into(), turn)
    }

    #[test]
    fn what_is_remembered_is_what_would_be_found_anew() {
        let ((mut world, object), (mut forgetful, forgetful_object)) = (scene(), scene());
        let (mut most, mut projected) = (0, [0, 0]);
        for step in 1..=600 {
            for ((world, object), projected) in [(&mut world, object), (&mut forgetful, forgetful_object)].into_iter().zip(&mut projected) {
                let finger = world.handle_of(world.bodies().len() - 1);
                world.body_mut(finger).unwrap().move_to(finger_at(step)).unwrap();
                if step == 400 {
                    // The spring carries the box away from the pedestal, tilts it and puts it on the mat.
                    let pose = Pose::from_parts(Vec3::new(0.03, 0.0, 0.012).into(), crate::math::Rot::from_euler_angles(0.0, 0.3, 0.0));
                    let drive = PoseDrive::new(pose, [200.0, 0.2], [5.0, 0.005]).unwrap();
                    world.body_mut(object).unwrap().set_drive(Some(drive)).unwrap();
                }
                world.step();
                *projected += world.contacts().iter().filter(|contact| contact.projected).count();
            }
            forgetful.pairs.iter_mut().for_each(Pair::look_anew);
            let [here, there] =
                [(&world, object), (&forgetful, forgetful_object)].map(|(world, object)| *world.body(object).unwrap().pose());
            let apart = (here.translation.vector - there.translation.vector).norm() + here.rotation.angle_to(&there.rotation) * 0.02;
            assert!(apart < 1e-7, "step {step}: {apart:e} m apart");
            assert_eq!(world.contacts().len(), forgetful.contacts().len(), "step {step}");
            most = most.max(world.contacts().len());
        }
        println!("up to {most} contacts, projected {projected:?}");
        assert!(most > 40 && 2 * projected[0] < projected[1], "up to {most} contacts, projected {projected:?}");
    }
}

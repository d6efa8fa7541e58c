//! Stage 2: which control points touch, or are about to (design 3.2).
//!
//! Geometry is frozen at the start of the step: poses and deformation as the last step left them. What the free
//! motion adds to gap and slip enters linearly in the contact problem, with the same Jacobians as the
//! reactions. `docs/step.md` says why: seen at the pose after the free motion, a body at rest would be compared
//! with a place where it never is, and the mismatch of second order would be a creep.

mod broad_phase;
mod budget;
mod cache;
mod contacts;
mod deep_overlap;
mod nearest_point;
mod pairs;
mod projection;
mod separation;
mod stored;
mod traversal;

pub use cache::{CachedProjection, Coupled, Coupling, PairCache};
pub(crate) use pairs::retain_pairs;

use crate::collider::friction_table::FrictionTable;
use crate::free_motion::FreeMotion;
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use std::time::{Duration, Instant};

/// Scratch and output of the stage.
#[derive(Debug, Default)]
pub struct Collision {
    /// The contacts, ordered by pair and control point.
    pub contacts: Vec<Contact>,
    /// Whether the traversal budget ran out, so that some contacts are coarser than the leaves.
    pub budget_exhausted: bool,
    /// Pairs of bodies that have penetrated each other fully, by slot, the one that was added first first.
    pub penetrated: Vec<(u32, u32)>,
    /// Time in the sphere trees.
    pub traverse_time: Duration,
    /// Time to refit them before.
    pub refit_time: Duration,
    /// Time in projections.
    pub projection_time: Duration,
    /// What the search remembers of each pair, in the order of the world's pairs.
    pub(crate) caches: Vec<PairCache>,
    bounds: broad_phase::Bounds,
    near: Vec<(u32, u32)>,
    traversal: traversal::Traversal,
    projection: contacts::Scratch,
}

impl Collision {
    /// Contacts found before, and what the search remembers of the pairs.
    pub(crate) fn with(contacts: Vec<Contact>, caches: Vec<PairCache>) -> Self {
        Self { contacts, caches, ..Self::default() }
    }
}

/// Finds all contacts. `pairs` grows when two colliders meet for the first time; then `friction` is
/// asked for theirs. `step`: number of the step, for [`Parameters::collision_every`].
pub(crate) fn collision(
    out: &mut Collision,
    objects: &mut Objects,
    free: &[FreeMotion],
    pairs: &mut Vec<Pair>,
    friction: &FrictionTable,
    params: &Parameters,
    step: u64,
) {
    let start = Instant::now();
    out.bounds.update(objects, free);
    out.bounds.near_colliders(objects, params, &mut out.near);
    pairs::match_pairs(pairs, &mut out.caches, &out.near, objects, friction, params);
    out.traversal.start(pairs.iter().filter(|pair| pair.near).count(), params.traversal_budget);
    for (pair, cache) in pairs.iter_mut().zip(&mut out.caches).filter(|(pair, _)| pair.near) {
        pair.relative_motion.renew(pair.sides(objects), params.dt);
        traversal::traverse(&mut out.traversal, pair, cache, objects, &out.bounds.reach, params);
    }
    out.budget_exhausted = out.traversal.budget_exhausted;
    out.penetrated.clear();
    for (pair, _) in pairs.iter().zip(&out.caches).filter(|(pair, cache)| pair.near && cache.coupling.penetrated) {
        let [a, b] = pair.sides(objects).map(|side| side.collider.body);
        let bodies = if objects.bodies.added_before(a, b) { (a, b) } else { (b, a) };
        if !out.penetrated.contains(&bodies) {
            out.penetrated.push(bodies);
        }
    }
    let traversed = Instant::now();
    let refresh = step.is_multiple_of(u64::from(params.collision_every));
    let now = projection::StepGeometry { objects, free, reach: &out.bounds.reach, params, refresh };
    contacts::find_contacts(&mut out.projection, pairs, &mut out.caches, now, &mut out.contacts);
    out.refit_time = out.traversal.refit_time;
    out.traverse_time = traversed - start - out.refit_time;
    out.projection_time = traversed.elapsed();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Motion, PoseDrive, RigidBody};
    use crate::collider::Material;
    use crate::math::{Pose, Real, Vec3};
    use crate::surface::{Surface, shapes};
    use crate::world::{BodyHandle, World};
    use std::sync::Arc;

    /// A box on a pedestal over a coarse mat, which couples with every control
    /// point of its bottom, and a fingertip that pushes at its side.
    fn scene() -> (World, BodyHandle) {
        let surface = |points, control| Arc::new(Surface::build(points, Some(control)).unwrap());
        let material = |name| Material::preset(name).unwrap();
        let mut world = World::new(Parameters::default()).unwrap();
        let mut fixed = |points, control, at: Vec3| {
            let body = RigidBody::fixed("fixed", Pose::translation(at.x, at.y, at.z)).unwrap();
            world.add_body(body, Some((surface(points, control), material("silicone")))).unwrap()
        };
        fixed(shapes::sample_box(Vec3::new(0.016, 0.016, 0.004), 1_000).unwrap(), 130, Vec3::new(0.0, 0.0, -0.002));
        fixed(shapes::sample_half_space(0.6, 1_600).unwrap(), 200, Vec3::new(0.0, 0.0, -0.004));
        let size = Vec3::repeat(0.04);
        let mass = crate::body::MassProperties::cuboid(size, crate::body::Amount::Mass(0.1)).unwrap();
        let object = RigidBody::free("box", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.02)).unwrap();
        let object = world.add_body(object, Some((surface(shapes::sample_box(size, 6_000).unwrap(), 800), material("wood")))).unwrap();
        let tip = shapes::sample_fingertip(Vec3::new(0.009, 0.009, 0.008), 1_200).unwrap();
        let finger = RigidBody::fixed("finger", finger_at(0)).unwrap();
        world.add_body(finger, Some((surface(tip, 160), material("fingertip_pulp")))).unwrap();
        (world, object)
    }

    /// The fingertip comes from the side, pushes, and rolls a little.
    fn finger_at(step: usize) -> Pose {
        let s = step as Real * 1e-3;
        let rotation = crate::math::Rot::from_axis_angle(&Vec3::y_axis(), std::f64::consts::FRAC_PI_2 + 0.5 * s);
        Pose::from_parts(Vec3::new(-0.0285 + 0.02 * s, 0.0, 0.022 + 0.004 * s).into(), rotation)
    }

    #[test]
    fn what_is_remembered_is_what_would_be_found_again() {
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
            forgetful.workspace.collision.caches.iter_mut().for_each(PairCache::invalidate);
            let [here, there] =
                [(&world, object), (&forgetful, forgetful_object)].map(|(world, object)| *world.body(object).unwrap().pose());
            let difference = (here.translation.vector - there.translation.vector).norm() + here.rotation.angle_to(&there.rotation) * 0.02;
            assert!(difference < 1e-7, "step {step}: {difference:e} m apart");
            assert_eq!(world.contacts().len(), forgetful.contacts().len(), "step {step}");
            most = most.max(world.contacts().len());
        }
        println!("up to {most} contacts, projected {projected:?}");
        assert!(most > 40 && 2 * projected[0] < projected[1], "up to {most} contacts, projected {projected:?}");
    }
}

//! The list of pairs, brought up to date with what the broad phase found.

use super::cache::PairCache;
use crate::collider::friction_table::FrictionTable;
use crate::objects::Objects;
use crate::pair::{Pair, friction_between};
use crate::params::Parameters;

/// Steps for which two colliders that are no longer near stay a pair, though nothing is left to remember: that two separate and meet again
/// costs no new memory. Then the pair is forgotten, or in a heap that is stirred there would soon be one for every two bodies.
const KEPT: u32 = 1_000;

/// Marks the pairs that are near, adds those that are new and forgets those that have been separated for long, keeping the list
/// sorted by the slots of the colliders. `caches` has what the search remembers of each pair, in the same order.
pub(super) fn match_pairs(
    pairs: &mut Vec<Pair>,
    caches: &mut Vec<PairCache>,
    near: &[(u32, u32)],
    objects: &Objects,
    table: &FrictionTable,
    params: &Parameters,
) {
    for pair in pairs.iter_mut() {
        if !std::mem::replace(&mut pair.near, false) {
            pair.relative_motion.forget();
        }
        pair.steps_apart = pair.steps_apart.saturating_add(1);
    }
    retain_pairs(pairs, caches, |pair| pair.steps_apart < KEPT || !pair.is_idle());
    for &(i, j) in near {
        let (Some(skin_i), Some(skin_j)) = (objects.side(i).active_skin(), objects.side(j).active_skin()) else { continue };
        // A pair is sampled once, from the side with the finer control points: counted neither
        // twice nor not at all. Of two that are equal, from the one added first.
        let spacings = [skin_i, skin_j].map(|skin| skin.surface.control.spacing);
        let finer_first = spacings[0] < spacings[1] || (spacings[0] == spacings[1] && objects.colliders.added_before(i, j));
        let (a, b, skins) = if finer_first { (i, j, [skin_i, skin_j]) } else { (j, i, [skin_j, skin_i]) };
        match pairs.binary_search_by_key(&(a, b), |pair| (pair.a, pair.b)) {
            Ok(found) => (pairs[found].near, pairs[found].steps_apart) = (true, 0),
            Err(place) => {
                let friction = friction_between(table, [a, b], objects, params.friction_rule);
                pairs.insert(place, Pair::new([a, b], skins, friction, params));
                caches.insert(place, PairCache::new(skins[0].surface.control.len()));
            }
        }
    }
}

/// Keeps the pairs that `keep` accepts, and what the search remembers of them.
pub(crate) fn retain_pairs(pairs: &mut Vec<Pair>, caches: &mut Vec<PairCache>, keep: impl Fn(&Pair) -> bool) {
    let mut of_pairs = pairs.iter();
    caches.retain(|_| of_pairs.next().is_some_and(&keep));
    pairs.retain(keep);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::World;
    use crate::body::{Amount, MassProperties, Motion, RigidBody};
    use crate::collider::Material;
    use crate::math::{Pose, Vec3};
    use crate::surface::{Surface, shapes};
    use std::sync::Arc;

    #[test]
    fn bodies_that_have_long_been_separated_are_no_pair_and_meet_as_for_the_first_time() {
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
        assert_eq!(world.motion_hash(), fresh.motion_hash());
    }
}

//! Two sphere trees against each other, breadth-first, within a budget of sphere tests.
//!
//! Breadth-first, so that a traversal that runs out of budget has gone equally deep
//! everywhere: [`crate::collision::budget`] couples what is then left in the queue.

use super::budget::{LEAST, Trees};
use super::cache::{CachedProjection, Coupled, Coupling, Moment, PairCache};
use super::deep_overlap;
use super::separation::Overlap;
use crate::collider::Skin;
use crate::math::{Mat3, Pose, Real, Vec3};
use crate::objects::Objects;
use crate::pair::Pair;
use crate::params::Parameters;
use std::time::{Duration, Instant};

/// Coupled nodes are kept until the bodies have moved by this many spacings of the coarser control points, if that is more than
/// [`Parameters::traversal_slack`]: with spheres of that size it finds only a few nodes more.
const SLACK_SPACINGS: Real = 0.1;

/// Where two surfaces have rotated by more than this against each other, other points may face each other, rad.
pub(super) const ROTATED: Real = 0.02;

#[derive(Debug, Default)]
pub(super) struct Traversal {
    pub budget_exhausted: bool,
    /// Sphere tests that each pair may spend.
    share: usize,
    /// Time in which spheres were refitted.
    pub refit_time: Duration,
    queue: Vec<(u32, u32)>,
    stack: Vec<u32>,
}

impl Traversal {
    /// Starts a step in which `pairs` may have to be traversed.
    pub fn start(&mut self, pairs: usize, budget: usize) {
        (self.budget_exhausted, self.refit_time) = (false, Duration::ZERO);
        self.share = (budget / pairs.max(1)).max(LEAST);
    }
}

/// Finds the coupled nodes of one pair, among spheres that are refitted first, unless those found before still hold:
/// while the two have moved less than the slack they were inflated by, whatever overlaps now is among them.
pub(super) fn traverse(
    out: &mut Traversal,
    pair: &Pair,
    cache: &mut PairCache,
    objects: &mut Objects,
    reach: &[Real],
    params: &Parameters,
) {
    let Some(root_a) = objects.side(pair.a).active_skin().map(Skin::bounding_sphere) else { return };
    let now = Moment::now(pair, objects);
    let needed = params.contact_margin + reach[pair.a as usize] + reach[pair.b as usize];
    let PairCache { coupling, projections } = cache;
    let moved = now.moved_since(&coupling.found, &root_a);
    let rotated = coupling.faced.angle_to(&now.pose_ba.rotation) > ROTATED;
    if rotated {
        (coupling.faced, coupling.asleep) = (now.pose_ba.rotation, None);
        for c in &coupling.coupled {
            projections[c.control_point as usize].invalidate_without_foot();
        }
    }
    let newly_penetrated = std::mem::take(&mut coupling.suspected) && !coupling.penetrated;
    if needed + moved <= coupling.margin && (coupling.searched || !coupling.deep) && !newly_penetrated {
        return;
    }
    let start = Instant::now();
    for collider in [pair.a, pair.b] {
        objects.colliders[collider].skin.refit(params.refit_level);
    }
    out.refit_time += start.elapsed();
    let [Some(skin_a), Some(skin_b)] = pair.sides(objects).map(|side| side.active_skin()) else { return };
    let slack = params.traversal_slack.max(SLACK_SPACINGS * skin_a.surface.control.spacing.max(skin_b.surface.control.spacing));
    (coupling.margin, coupling.searched, coupling.found, coupling.asleep) = (needed + slack, coupling.deep, now, None);
    coupling.examined = false;
    if !(newly_penetrated || coupling.penetrated) || !couple_along_separation(out, pair, cache, skin_a, skin_b) {
        couple(out, pair, &mut cache.coupling, skin_a, skin_b);
    }
    let PairCache { coupling, projections } = cache;
    for group in coupling.coupled.chunk_by(|c, d| c.control_point == d.control_point) {
        // FNV-1a over the leaves; 0 stands for none.
        let leaves = group.iter().fold(0x811c_9dc5, |hash: u32, c| (hash ^ c.node_b).wrapping_mul(0x0100_0193));
        projections[group[0].control_point as usize].set_leaves(leaves.max(1));
    }
}

/// Whether control points of one, of every `stride` of them, lie inside the other, by
/// more than `depth` of the spacing of its points; or the middle of both.
pub(super) fn have_penetrated(
    stack: &mut Vec<u32>,
    displacement: &[Vec3],
    skin_a: &Skin,
    skin_b: &Skin,
    pose_ba: &Pose,
    stride: usize,
    depth: Real,
) -> bool {
    let (rotation, shift): (Mat3, Vec3) = (pose_ba.rotation.to_rotation_matrix().into_inner(), pose_ba.translation.vector);
    let control_a = &skin_a.surface.control;
    let place = |c: usize| (rotation * (control_a.points[c] + displacement[c]) + shift, rotation * control_a.normals[c]);
    let to_a = |x: &Vec3| rotation.tr_mul(&(x - shift));
    let overlap = Overlap { surface_a: &skin_a.surface, surface_b: &skin_b.surface, place, to_a: &to_a };
    let center_a = rotation * skin_a.bounding_sphere().center + shift;
    overlap.points_are_inside(stack, stride, depth) || overlap.middle_is_inside_both(stack, &center_a, &skin_b.bounding_sphere().center)
}

/// Couples control points of two bodies that have penetrated each other fully along the direction that separates them
/// soonest. False if they have not, or not any more.
fn couple_along_separation(out: &mut Traversal, pair: &Pair, cache: &mut PairCache, skin_a: &Skin, skin_b: &Skin) -> bool {
    let PairCache { coupling, projections } = cache;
    let side_a = &pair.side_a;
    let pose_ba = coupling.found.pose_ba;
    let (rotation, shift): (Mat3, Vec3) = (pose_ba.rotation.to_rotation_matrix().into_inner(), pose_ba.translation.vector);
    let control_a = &skin_a.surface.control;
    let place = |c: usize| (rotation * (control_a.points[c] + side_a.displacement[c]) + shift, rotation * control_a.normals[c]);
    let to_a = |x: &Vec3| rotation.tr_mul(&(x - shift));
    let overlap = Overlap { surface_a: &skin_a.surface, surface_b: &skin_b.surface, place, to_a: &to_a };
    // What was found in the step before need not be tested again.
    let still = !coupling.penetrated || have_penetrated(&mut out.stack, &side_a.displacement, skin_a, skin_b, &pose_ba, 1, 0.0);
    let separation = if still { overlap.shortest_separation(coupling.separation) } else { None };
    if separation.is_none() || coupling.separation.is_none() {
        projections.fill(CachedProjection::default());
    }
    (coupling.penetrated, coupling.separation, coupling.deep) = (still, separation, false);
    let Some(separation) = separation else { return false };
    coupling.coupled.clear();
    let (leaves_a, leaves_b) = (&skin_a.surface.tree.leaves, &skin_b.surface.tree.leaves);
    overlap.bearing(&separation, |control_point, k| {
        let (node_a, node_b) = (leaves_a[control_point as usize], leaves_b[k as usize]);
        coupling.coupled.push(Coupled { control_point, node_a, node_b });
    });
    true
}

/// Finds the coupled nodes from the roots on.
fn couple(out: &mut Traversal, pair: &Pair, coupling: &mut Coupling, skin_a: &Skin, skin_b: &Skin) {
    let (tree_a, tree_b) = (&skin_a.surface.tree, &skin_b.surface.tree);
    let (pose_ba, margin) = (coupling.found.pose_ba, coupling.margin);
    let (rotation, shift): (Mat3, Vec3) = (pose_ba.rotation.to_rotation_matrix().into_inner(), pose_ba.translation.vector);
    coupling.coupled.clear();
    let out_coupled = &mut coupling.coupled;
    let (mut exhausted, mut tests) = (false, 0);
    let mut separation = Real::INFINITY;
    out.queue.clear();
    out.queue.push((0, 0));
    let mut next = 0;
    while next < out.queue.len() {
        let (na, nb) = out.queue[next];
        next += 1;
        if 4 * tests >= out.share {
            exhausted = true;
            next -= 1;
            break;
        }
        tests += 1;
        let (sphere_a, sphere_b) = (&skin_a.spheres[na as usize], &skin_b.spheres[nb as usize]);
        let center_a = rotation * sphere_a.center + shift;
        let touching = sphere_a.radius + sphere_b.radius + margin;
        let distance2 = (center_a - sphere_b.center).norm_squared();
        if distance2 > touching * touching {
            separation = separation.min(distance2.sqrt() - touching);
            continue;
        }
        let (node_a, node_b) = (&tree_a.nodes[na as usize], &tree_b.nodes[nb as usize]);
        match (node_a.children, node_b.children) {
            (None, None) => out_coupled.push(Coupled { control_point: node_a.first_leaf, node_a: na, node_b: nb }),
            (Some([l, r]), other) if other.is_none() || sphere_a.radius >= sphere_b.radius => {
                out.queue.push((l, nb));
                out.queue.push((r, nb));
            }
            (_, Some([l, r])) => {
                out.queue.push((na, l));
                out.queue.push((na, r));
            }
            (Some(_), None) => {} // covered by the guard above
        }
    }
    if exhausted {
        out.queue.drain(..next);
        let trees = Trees {
            surface_a: &skin_a.surface,
            surface_b: &skin_b.surface,
            point: |p: &Vec3| rotation * p + shift,
            direction: |n: &Vec3| rotation * n,
        };
        trees.couple_queued(&mut out.stack, &mut out.queue, out_coupled, out.share - tests);
    }
    out_coupled.sort_unstable_by_key(|c| (c.control_point, c.node_a, c.node_b));
    if exhausted {
        // What was left over is traversed again in the next step.
        coupling.margin = -1.0;
        out.budget_exhausted = true;
        return;
    }
    let control = &skin_a.surface.control;
    let place = |c: usize| (rotation * (control.points[c] + pair.side_a.displacement[c]) + shift, rotation * control.normals[c]);
    if out_coupled.is_empty() && !coupling.deep {
        // Bounding spheres overlap, surfaces do not: the two are separated, or one is inside the other.
        coupling.deep = deep_overlap::depth_inside(&mut out.stack, &skin_b.surface, &place(0).0).is_some();
        coupling.searched = coupling.deep;
        if !coupling.deep {
            // Nothing can overlap before they have come nearer by the least separation of two spheres that were tested.
            coupling.margin += separation;
        }
    }
    if coupling.deep {
        coupling.deep = deep_overlap::couple_points_inside(&mut out.stack, &mut coupling.coupled, &tree_a.leaves, &skin_b.surface, place);
    }
}

#[cfg(test)]
mod tests {
    use crate::body::{Amount, MassProperties, Motion, RigidBody};
    use crate::collider::Material;
    use crate::math::{Pose, Real, Vec3};
    use crate::surface::{Surface, shapes};
    use crate::{Parameters, World};
    use proptest::prelude::*;
    use std::sync::{Arc, LazyLock};

    const RADIUS: Real = 0.01;

    static SURFACES: LazyLock<[Arc<Surface>; 2]> = LazyLock::new(|| {
        let ball = Surface::build(shapes::sample_sphere(RADIUS, 600).unwrap(), Some(120)).unwrap();
        let cube = Surface::build(shapes::sample_box(Vec3::repeat(0.03), 600).unwrap(), Some(100)).unwrap();
        [Arc::new(ball), Arc::new(cube)]
    });

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Against all pairs of leaves, one by one, on a way along which most nodes are remembered.
        #[test]
        fn leaves_whose_points_come_within_the_margin_are_coupled_and_none_beyond_their_spheres(
            rotations in prop::array::uniform3(-1.0..1.0f64), side in -0.5..0.5f64,
            way in prop::collection::vec((-3e-4..3e-4f64, prop::array::uniform3(-0.01..0.01f64)), 1..6),
        ) {
            let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap();
            let steel = Material::preset("steel").unwrap();
            let [ball, cube] = SURFACES.clone();
            world.add_body(RigidBody::fixed("cube", Pose::identity()).unwrap(), Some((cube, steel.clone()))).unwrap();
            let mass = MassProperties::sphere(RADIUS, Amount::Mass(0.1)).unwrap();
            let body = RigidBody::free("ball", mass, Motion::QuasiStatic, Pose::identity()).unwrap();
            let body = world.add_body(body, Some((ball, steel))).unwrap();
            let (mut height, mut theta) = (0.015 + RADIUS + 3e-4, Vec3::from(rotations) * 3.0);
            for (rise, rotation) in way {
                height = (height + rise).max(0.015 + RADIUS - 1e-4);
                theta += Vec3::from(rotation);
                let pose = Pose::new(Vec3::new(side * 0.02, 0.004, height), theta);
                world.body_mut(body).unwrap().set_pose(pose).unwrap();
                world.step();
                let cache = &world.workspace.collision.caches[0];
                let [side_a, side_b] = world.pairs[0].sides(&world.objects);
                let [skin_a, skin_b] = [side_a, side_b].map(|side| &side.collider.skin);
                let pose_ba = side_b.pose().inverse() * side_a.pose();
                let coupled: Vec<(u32, u32)> = cache.coupling.coupled.iter().map(|c| (c.node_a, c.node_b)).collect();
                let (tree_a, tree_b) = (&skin_a.surface.tree, &skin_b.surface.tree);
                let found = &cache.coupling.found.pose_ba;
                for &node_a in &tree_a.leaves {
                    for &node_b in &tree_b.leaves {
                        let is_coupled = coupled.contains(&(node_a, node_b));
                        let (sphere_a, sphere_b) = (&skin_a.spheres[node_a as usize], &skin_b.spheres[node_b as usize]);
                        let center_a = found * nalgebra::Point3::from(sphere_a.center);
                        let separation = (center_a - nalgebra::Point3::from(sphere_b.center)).norm() - sphere_a.radius - sphere_b.radius;
                        let margin = cache.coupling.margin;
                        prop_assert!(!is_coupled || separation <= margin, "coupled at {separation:e} m, margin {margin:e} m");
                        if is_coupled || separation > 2e-3 {
                            continue;
                        }
                        let points_b = || tree_b.nodes[node_b as usize].points().map(|k| skin_b.surface.points[k]);
                        let distance = |p: Vec3| points_b().map(|q| (p - q).norm()).fold(Real::INFINITY, Real::min);
                        let moved = |k: usize| (pose_ba * nalgebra::Point3::from(skin_a.surface.points[k])).coords;
                        let nearest = tree_a.nodes[node_a as usize].points().map(|k| distance(moved(k))).fold(Real::INFINITY, Real::min);
                        prop_assert!(nearest > world.params.contact_margin, "points at {nearest:e} m of each other are not coupled");
                    }
                }
            }
        }
    }
}

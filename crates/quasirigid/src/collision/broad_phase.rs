//! Which colliders are near enough to be traversed: bounding spheres, inflated by what the free motion can move.

use crate::free_motion::{FreeMotion, free_displacement};
use crate::math::{Real, Vec3};
use crate::objects::Objects;
use crate::params::Parameters;

/// What the broad phase knows of each collider, by slot.
#[derive(Debug, Default)]
pub(super) struct Bounds {
    /// How far any surface point may move in this step before contact forces, m.
    pub reach: Vec<Real>,
    /// Centre (m, world) and radius (m) of a sphere around the surface; `None` for a free slot and where the body is quarantined.
    spheres: Vec<Option<(Vec3, Real)>>,
}

impl Bounds {
    /// Finds them for the step under way.
    pub fn update(&mut self, objects: &Objects, free: &[FreeMotion]) {
        self.reach.clear();
        self.reach.resize(objects.colliders.slot_count(), 0.0);
        self.spheres.clear();
        self.spheres.resize(objects.colliders.slot_count(), None);
        for (slot, collider) in objects.colliders.iter() {
            let side = objects.side(slot);
            let Some(skin) = side.active_skin() else { continue };
            let root = skin.bounding_sphere();
            let center = side.pose() * nalgebra::Point3::from(root.center);
            // The displacement field is affine in the point, d(c + r) = d(c) + theta x r:
            // |theta|^2 is half the sum over the axes of |theta x e|^2.
            let at = |p: &Vec3| free_displacement(side, &free[collider.body as usize], p);
            let middle = at(&center.coords);
            let turned: Real =
                [Vec3::x(), Vec3::y(), Vec3::z()].iter().map(|e| (at(&(center.coords + e * root.radius)) - middle).norm_squared()).sum();
            self.reach[slot as usize] = middle.norm() + (0.5 * turned).sqrt();
            self.spheres[slot as usize] = Some((center.coords, root.radius));
        }
    }

    /// Pairs (i < j) of colliders whose spheres, reach and margin overlap and that may touch.
    pub fn near_colliders(&self, objects: &Objects, params: &Parameters, near: &mut Vec<(u32, u32)>) {
        near.clear();
        let from = |first: usize| (first as u32..).zip(&self.spheres[first..]).filter_map(|(slot, sphere)| Some((slot, (*sphere)?)));
        for (i, (center_i, radius_i)) in from(0) {
            for (j, (center_j, radius_j)) in from(i as usize + 1) {
                let (reach_i, reach_j) = (self.reach[i as usize], self.reach[j as usize]);
                let touching = radius_i + radius_j + reach_i + reach_j + params.contact_margin;
                if (center_i - center_j).norm() <= touching && may_touch(objects, i, j) {
                    near.push((i, j));
                }
            }
        }
    }
}

/// Colliders of one body never touch, and two fixed bodies have nothing to solve; fingers of one hand pass through each
/// other by choice of the model (their pads never meet around an object). The rest is up to the filters.
fn may_touch(objects: &Objects, i: u32, j: u32) -> bool {
    let (a, b) = (objects.side(i), objects.side(j));
    a.collider.body != b.collider.body
        && (a.body.body.dof() > 0 || b.body.body.dof() > 0)
        && (a.body.hand.is_none() || a.body.hand != b.body.hand)
        && a.collider.filter.meets(&b.collider.filter)
        && !objects.excluded.contains(i, j)
}

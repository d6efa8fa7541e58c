//! A body as the world keeps it: the body, its surface, its name.

use crate::body::{Body, Skin};
use crate::free_motion::FreeMotion;
use crate::math::Vec3;

/// One body of a world.
#[derive(Debug, Clone)]
pub struct BodyEntry {
    /// Coordinates, inertia, drives.
    pub body: Body,
    /// Its surface, if it can touch.
    pub skin: Option<Skin>,
    /// The link that carries the surface; 0 for a rigid body.
    pub skin_link: usize,
    /// The hand it belongs to: index in the world's list.
    pub hand: Option<u32>,
    /// Set aside because it became non-finite: it neither moves nor touches.
    pub quarantined: bool,
}

impl BodyEntry {
    /// The skin, unless the body is quarantined.
    pub fn active_skin(&self) -> Option<&Skin> {
        if self.quarantined { None } else { self.skin.as_ref() }
    }

    /// Displacement in this step, before contact forces, of the material point at `point` (world, m), all to first order: free motion and prescribed motion. For how far
    /// things may get; what a pair does is [`crate::collision::Pair::free_displacement`].
    pub fn free_displacement(&self, free: &FreeMotion, point: &Vec3) -> Vec3 {
        let prescribed = self.body.prescribed_displacement(point);
        if free.dof == 0 {
            return prescribed;
        }
        self.body.point_jacobian(self.skin_link, point) * free.displacement + prescribed
    }

    /// Displacement in this step, before contact forces, that is not in [`FreeMotion::expected`]: all of that of a free body, none of a fixed one.
    pub fn unexpected_displacement(&self, free: &FreeMotion, point: &Vec3) -> Vec3 {
        if free.dof == 0 {
            return Vec3::zeros();
        }
        self.body.point_jacobian(self.skin_link, point) * (free.displacement - free.expected.joints)
    }
}

//! What a world consists of: bodies, what moves, and colliders, what touches.

use crate::body::BodyEntry;
use crate::collider::filter::ExcludedPairs;
use crate::collider::{Collider, Skin};
use crate::math::{Mat3, Mat3x6, Pose, Vec3};
use crate::slots::Slots;

/// All bodies and colliders, and the pairs of colliders that never touch.
#[derive(Debug, Clone, Default)]
pub(crate) struct Objects {
    pub bodies: Slots<BodyEntry>,
    pub colliders: Slots<Collider>,
    pub excluded: ExcludedPairs,
}

impl Objects {
    /// Back to those of another time.
    pub fn restore(&mut self, earlier: &Self) {
        self.bodies.restore(&earlier.bodies);
        self.colliders.restore(&earlier.colliders);
        self.excluded.clone_from(&earlier.excluded);
    }

    /// A collider with its body, by slot.
    pub fn side(&self, collider: u32) -> Side<'_> {
        let collider = &self.colliders[collider];
        Side { body: &self.bodies[collider.body], collider }
    }
}

/// A collider and the body that carries it: one side of a pair.
#[derive(Debug, Clone, Copy)]
pub struct Side<'a> {
    /// What moves.
    pub body: &'a BodyEntry,
    /// What touches.
    pub collider: &'a Collider,
}

impl<'a> Side<'a> {
    /// Pose in the world of the link that carries the collider.
    pub fn pose(&self) -> Pose {
        self.body.body.link_pose(self.collider.link)
    }

    /// Rotation from the link that carries the collider to the world.
    pub fn axes(&self) -> Mat3 {
        self.pose().rotation.to_rotation_matrix().into_inner()
    }

    /// Surface and displacement, unless the body is quarantined.
    pub fn active_skin(&self) -> Option<&'a Skin> {
        if self.body.quarantined { None } else { Some(&self.collider.skin) }
    }

    /// Jacobian of the material point that is at `point` (m, world), see [`crate::body::Body::point_jacobian`].
    pub fn point_jacobian(&self, point: &Vec3) -> Mat3x6 {
        self.body.body.point_jacobian(self.collider.link, point)
    }
}

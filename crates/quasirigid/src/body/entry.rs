//! A body as the world keeps it.

use crate::body::Body;

/// One body of a world. What touches are the colliders on its links, see [`crate::collider::Collider`].
#[derive(Debug, Clone)]
pub struct BodyEntry {
    /// Coordinates, inertia, drives.
    pub body: Body,
    /// The hand it belongs to: index in the world's list.
    pub hand: Option<u32>,
    /// Quarantined because its state became non-finite: it neither moves nor touches.
    pub quarantined: bool,
}

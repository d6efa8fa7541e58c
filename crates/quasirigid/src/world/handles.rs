//! Handles: names of bodies, colliders and hands that stay theirs whatever else is added or removed.

use super::World;
use crate::body::BodyEntry;
use crate::error::{Error, Result};
use crate::slots::Slots;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU32, Ordering};

/// A body of one world. Stays valid until the body is removed; using it after that, or with another world, is an error, not another body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct BodyHandle {
    #[serde(skip)]
    world: u32,
    slot: u32,
    generation: u32,
}

/// A collider of one world. Stays valid until the collider, or its body, is
/// removed; using it after that, or with another world, is an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ColliderHandle {
    #[serde(skip)]
    world: u32,
    slot: u32,
    generation: u32,
}

/// A hand of one world. Using it with another world, or after the hand was removed, is an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct HandHandle {
    #[serde(skip)]
    pub(super) world: u32,
    pub(super) index: u32,
}

/// Numbers worlds, so that no handle is taken for one of another world.
static WORLDS: AtomicU32 = AtomicU32::new(0);

/// A number that no other world of this process has.
pub(super) fn new_world_number() -> u32 {
    WORLDS.fetch_add(1, Ordering::Relaxed)
}

impl BodyHandle {
    /// The number that contacts call the body by, see [`crate::pair::Contact::body_a`]: the
    /// same for as long as the body is there. Later it may be that of another.
    pub fn slot(self) -> u32 {
        self.slot
    }

    /// The body that it names among those of its world.
    pub(super) fn find_in(self, bodies: &Slots<BodyEntry>) -> Option<&BodyEntry> {
        bodies.find(self.slot, self.generation)
    }

    /// The same body in another world.
    pub(super) fn of_world(self, world: u32) -> Self {
        Self { world, ..self }
    }
}

impl ColliderHandle {
    /// The number that contacts call the collider by, see [`crate::pair::Contact::collider_a`]: the
    /// same for as long as the collider is there. Later it may be that of another.
    pub fn slot(self) -> u32 {
        self.slot
    }

    /// The same collider in another world.
    pub(super) fn of_world(self, world: u32) -> Self {
        Self { world, ..self }
    }
}

impl HandHandle {
    /// The same hand in another world.
    pub(super) fn of_world(self, world: u32) -> Self {
        Self { world, ..self }
    }
}

/// What is said of a handle that names nothing.
const GONE: &str = "it was removed, or belongs to another world";

impl World {
    /// Handle of the body in a slot: of the one that was there last, if it is free.
    pub(crate) fn body_at(&self, slot: u32) -> BodyHandle {
        BodyHandle { world: self.number, slot, generation: self.objects.bodies.generation(slot) }
    }

    /// Handle of the collider in a slot: of the one that was there last, if it is free.
    pub(crate) fn collider_at(&self, slot: u32) -> ColliderHandle {
        ColliderHandle { world: self.number, slot, generation: self.objects.colliders.generation(slot) }
    }

    /// Slot of a body that is there.
    pub(crate) fn slot(&self, handle: BodyHandle) -> Result<u32> {
        let there = handle.world == self.number && self.objects.bodies.find(handle.slot, handle.generation).is_some();
        if there { Ok(handle.slot) } else { Err(Error::handle("body", "a body of this world", format!("{handle:?}"), GONE)) }
    }

    /// Slot of a collider that is there.
    pub(crate) fn collider_slot(&self, handle: ColliderHandle) -> Result<u32> {
        let there = handle.world == self.number && self.objects.colliders.find(handle.slot, handle.generation).is_some();
        if there { Ok(handle.slot) } else { Err(Error::handle("collider", "a collider of this world", format!("{handle:?}"), GONE)) }
    }
}

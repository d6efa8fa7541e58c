//! Snapshots: the whole state of a world, to come back to and to branch from.
//!
//! In a snapshot is whatever a later step reads: bodies with their drives and targets, what pairs remember, friction,
//! parameters, and the caches of the search and of the elastic rows *with their validity*, for they decide the last
//! bits of later steps. So is what a controller reads between two steps: contacts and reactions of the last one. Not
//! in it is scratch that is written before it is read. Surfaces are shared, not copied.

mod bytes;
mod check;
mod hash;
mod numbers;
mod record;
#[cfg(test)]
mod tests;
mod walk;

use super::World;
use super::handles::{BodyHandle, ColliderHandle, HandHandle};
use super::hands::Hand;
use super::workspace::Workspace;
use crate::collider::Collider;
use crate::collider::friction_table::FrictionTable;
use crate::collision::{Collision, PairCache};
use crate::contact_problem::ContactProblem;
use crate::error::Result;
use crate::math::Real;
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;

/// The state of a world at one time. Immutable: it can be restored any number of times, and shared between threads.
#[derive(Debug, Clone)]
pub struct Snapshot {
    params: Parameters,
    objects: Objects,
    pairs: Vec<Pair>,
    caches: Vec<PairCache>,
    friction: FrictionTable,
    hands: Vec<Option<Hand>>,
    steps: u64,
    start_time: Real,
    start_steps: u64,
    contacts: Vec<Contact>,
    problem: ContactProblem,
}

impl Snapshot {
    /// Simulated time at which it was taken, s.
    pub fn time(&self) -> Real {
        self.start_time + (self.steps - self.start_steps) as Real * self.params.dt
    }

    /// Steps that the world had taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// How many bodies there were.
    pub fn body_count(&self) -> usize {
        self.objects.bodies.len()
    }

    /// About how much memory it takes, bytes, without the surfaces, which it shares with the world.
    pub fn memory(&self) -> usize {
        hash::size(&self.state(|_| [0; 2]))
    }

    /// A number that equal snapshots have in common.
    pub fn content_hash(&self) -> u64 {
        hash::hash(&self.state(hash::made_of))
    }
}

/// Snapshots are equal if worlds in their states have the same names for the same things, and the same future.
impl PartialEq for Snapshot {
    fn eq(&self, other: &Self) -> bool {
        let skins = |snapshot: &Self| -> Vec<_> {
            let made_of = |collider: &Collider| (collider.skin.surface.clone(), collider.skin.material.clone());
            snapshot.objects.colliders.iter().map(|(_, collider)| made_of(collider)).collect()
        };
        let words = |snapshot: &Self| hash::words(&snapshot.state(|_| [0; 2]));
        skins(self) == skins(other) && words(self) == words(other)
    }
}

impl World {
    /// The state as it is now.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            params: self.params.clone(),
            objects: self.objects.clone(),
            pairs: self.pairs.clone(),
            caches: self.workspace.collision.caches.clone(),
            friction: self.friction.clone(),
            hands: self.hands.clone(),
            steps: self.steps,
            start_time: self.start_time,
            start_steps: self.start_steps,
            contacts: self.workspace.collision.contacts.clone(),
            problem: self.workspace.problem.clone(),
        }
    }

    /// Takes this world back to a state that it, or any other world, was in. Any number of steps from here
    /// gives the same bits as it did from there. The number of threads stays that of this world.
    ///
    /// Handles of bodies, colliders and hands that were there at the time name them again,
    /// if the snapshot is of this world; those of later ones name nothing.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        let threads = self.params.threads;
        self.params = Parameters { threads, ..snapshot.params.clone() };
        self.objects.restore(&snapshot.objects);
        self.pairs.clone_from(&snapshot.pairs);
        self.friction.clone_from(&snapshot.friction);
        self.hands.resize(self.hands.len().max(snapshot.hands.len()), None);
        for (index, hand) in self.hands.iter_mut().enumerate() {
            *hand = snapshot.hands.get(index).and_then(|hand| hand.as_ref().map(|hand| hand.of_world(self.number)));
        }
        (self.steps, self.start_time, self.start_steps) = (snapshot.steps, snapshot.start_time, snapshot.start_steps);
        self.workspace = Workspace {
            collision: Collision::with(snapshot.contacts.clone(), snapshot.caches.clone()),
            problem: snapshot.problem.clone(),
            ..Workspace::default()
        };
    }

    /// A new world in the state of a snapshot. Steps of the one and of the other, or of
    /// the world that the snapshot is of, never influence each other.
    ///
    /// # Errors
    /// [`crate::Error::InvalidValue`] if the system cannot start as many threads.
    pub fn from_snapshot(snapshot: &Snapshot) -> Result<Self> {
        let mut world = Self::new(snapshot.params.clone())?;
        world.restore(snapshot);
        Ok(world)
    }

    /// This world's own handle of the body that `handle` names in the world that this one is a copy of.
    ///
    /// # Errors
    /// [`crate::Error::InvalidHandle`] if there is no such body here.
    pub fn own_body(&self, handle: BodyHandle) -> Result<BodyHandle> {
        let own = handle.of_world(self.number);
        self.slot(own).map(|_| own)
    }

    /// This world's own handle of the collider that `handle` names in the world that this one is a copy of.
    ///
    /// # Errors
    /// [`crate::Error::InvalidHandle`] if there is no such collider here.
    pub fn own_collider(&self, handle: ColliderHandle) -> Result<ColliderHandle> {
        let own = handle.of_world(self.number);
        self.collider(own).map(|_| own)
    }

    /// This world's own handle of the hand that `handle` names in the world that this one is a copy of.
    ///
    /// # Errors
    /// [`crate::Error::InvalidHandle`] if there is no such hand here.
    pub fn own_hand(&self, handle: HandHandle) -> Result<HandHandle> {
        let own = handle.of_world(self.number);
        self.hand(own).map(|_| own)
    }
}

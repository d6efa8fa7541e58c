//! The state of a simulation: bodies, colliders, hands, what pairs remember, parameters.

mod colliders;
mod edit;
mod friction;
mod handles;
mod hands;
mod pads;
pub mod report;
mod snapshot;
pub mod workspace;

pub use friction::FrictionSide;
pub use handles::{BodyHandle, ColliderHandle, HandHandle};
pub use hands::Hand;
pub use pads::Pads;
pub use snapshot::Snapshot;

use crate::body::{Body, BodyEntry, RigidBody};
use crate::collider::friction_table::FrictionTable;
use crate::collider::{Filter, Material, Skin};
use crate::collision::PairCache;
use crate::contact_problem::ContactProblem;
use crate::error::{Error, Result};
use crate::math::{Real, Vec3};
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use crate::surface::Surface;
use crate::threads::WorkerPool;
use crate::world::workspace::Workspace;
use std::sync::Arc;

/// A simulation.
#[derive(Debug)]
pub struct World {
    pub(crate) params: Parameters,
    pub(crate) objects: Objects,
    pub(crate) pairs: Vec<Pair>,
    pub(crate) friction: FrictionTable,
    pub(crate) hands: Vec<Option<Hand>>,
    pub(crate) workspace: Workspace,
    pub(crate) steps: u64,
    pub(crate) pool: WorkerPool,
    pub(crate) number: u32,
    start_time: Real,
    start_steps: u64,
}

impl World {
    /// An empty world.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for a parameter out of range.
    pub fn new(params: Parameters) -> Result<Self> {
        params.check()?;
        let pool = WorkerPool::new(params.threads)?;
        Ok(Self {
            params,
            objects: Objects::default(),
            pairs: Vec::new(),
            friction: FrictionTable::default(),
            hands: Vec::new(),
            workspace: Workspace::default(),
            steps: 0,
            pool,
            number: handles::new_world_number(),
            start_time: 0.0,
            start_steps: 0,
        })
    }

    /// The parameters.
    pub fn parameters(&self) -> &Parameters {
        &self.params
    }

    /// Replaces the parameters; they hold from the next step on.
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn set_parameters(&mut self, params: Parameters) -> Result<()> {
        params.check()?;
        if params.threads != self.params.threads {
            self.pool = WorkerPool::new(params.threads)?;
        }
        if params.dt != self.params.dt {
            (self.start_time, self.start_steps) = (self.time(), self.steps);
        }
        let limits = |p: &Parameters| (p.contact_margin, p.traversal_slack, p.projection_slack, p.projection_tolerance);
        if limits(&params) != limits(&self.params) {
            self.workspace.collision.caches.iter_mut().for_each(PairCache::invalidate);
        }
        let same_rule = params.friction_rule == self.params.friction_rule;
        self.params = params;
        if !same_rule {
            self.renew_friction();
        }
        Ok(())
    }

    /// Simulated time, s.
    pub fn time(&self) -> Real {
        self.start_time + (self.steps - self.start_steps) as Real * self.params.dt
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Adds a rigid body, with a surface if it is to touch anything: its first collider, see [`World::add_collider`].
    ///
    /// # Errors
    /// What [`Material::check_for`] refuses: a field out of range, a compliance matrix for other control points.
    pub fn add_body(&mut self, body: RigidBody, skin: Option<(Arc<Surface>, Material)>) -> Result<BodyHandle> {
        let skin = skin.map(|(surface, material)| Skin::new(surface, material)).transpose()?;
        let slot = self.objects.bodies.insert(BodyEntry { body: Body::Rigid(body), hand: None, quarantined: false });
        if let Some(skin) = skin {
            self.insert_collider(slot, 0, skin, Filter::default());
        }
        Ok(self.body_at(slot))
    }

    /// Takes a body out, with its colliders and what touched them. Nothing else changes.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it is gone already, or is a finger: those go with their hand.
    pub fn remove_body(&mut self, handle: BodyHandle) -> Result<()> {
        if self.entry(handle)?.hand.is_some() {
            return Err(Error::handle("remove_body", "a body that is not part of a hand", "a finger", "remove the hand"));
        }
        self.remove_entry(handle)
    }

    /// A body as it is now.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn entry(&self, handle: BodyHandle) -> Result<&BodyEntry> {
        Ok(&self.objects.bodies[self.slot(handle)?])
    }

    /// A rigid body.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed or is a finger.
    pub fn body(&self, handle: BodyHandle) -> Result<&RigidBody> {
        match &self.entry(handle)?.body {
            Body::Rigid(body) => Ok(body),
            Body::Finger(_) => Err(Error::handle("body", "a rigid body", "a finger", "use finger()")),
        }
    }

    /// A rigid body, to push, drive or move it.
    ///
    /// # Errors
    /// As [`World::body`].
    pub fn body_mut(&mut self, handle: BodyHandle) -> Result<&mut RigidBody> {
        let slot = self.slot(handle)?;
        match &mut self.objects.bodies[slot].body {
            Body::Rigid(body) => Ok(body),
            Body::Finger(_) => Err(Error::handle("body", "a rigid body", "a finger", "use finger_mut()")),
        }
    }

    /// All bodies that are there, in the order in which they were added.
    pub fn bodies(&self) -> Vec<&BodyEntry> {
        self.objects.bodies.in_order().collect()
    }

    /// Handle of the body at a place in [`World::bodies`].
    pub fn handle_of(&self, dense: usize) -> BodyHandle {
        self.body_at(self.objects.bodies.order().get(dense).copied().unwrap_or(u32::MAX))
    }

    /// Place of a body in [`World::bodies`]; it changes when one that was added earlier is removed.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn dense(&self, handle: BodyHandle) -> Result<usize> {
        let slot = self.slot(handle)?;
        Ok(self.objects.bodies.place(slot).unwrap_or(usize::MAX))
    }

    /// Place in [`World::bodies`] of the body in each slot, for what names bodies by their slots: [`Contact::body_a`]. 0 for a free one.
    pub fn body_places(&self) -> Vec<u32> {
        let mut places = vec![0; self.objects.bodies.slot_count()];
        for (place, &slot) in (0..).zip(self.objects.bodies.order()) {
            places[slot as usize] = place;
        }
        places
    }

    /// Contacts of the last step, ordered by pair and control point.
    pub fn contacts(&self) -> &[Contact] {
        &self.workspace.collision.contacts
    }

    /// The contact problem of the last step, with the reactions found.
    pub fn contact_problem(&self) -> &ContactProblem {
        &self.workspace.problem
    }

    /// How deep the surfaces of every pair of colliders that touch are pressed in at most, over the thickness of their layers (-): the two
    /// colliders, and the figures of both. 0 where a compliance knows no thickness. Beyond 0.5, small strains are not to be trusted.
    pub fn indentations(&self) -> Vec<([ColliderHandle; 2], [Real; 2])> {
        let touching = self.pairs.iter().filter(|pair| !pair.reactions.loaded.is_empty());
        touching.map(|pair| ([pair.a, pair.b].map(|slot| self.collider_at(slot)), pair.indentations(&self.objects))).collect()
    }

    /// Total contact force on a body in the last step, world axes, N.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if the body was removed.
    pub fn contact_force_on(&self, handle: BodyHandle) -> Result<Vec3> {
        let slot = self.slot(handle)?;
        let forces = self.contacts().iter().zip(&self.workspace.problem.reactions).map(|(contact, f)| {
            let sign = Real::from(u8::from(contact.body_a == slot)) - Real::from(u8::from(contact.body_b == slot));
            contact.acts_along * f * sign
        });
        Ok(forces.sum())
    }

    /// The hash of motion alone: the same for two worlds whose poses, velocities, joints and elastic displacements are
    /// the same bits, and the slip speeds where friction is velocity-weakening. It may be the same though their futures
    /// differ, so it is for tests that compare what moves; [`World::state_hash`] is of the whole state.
    #[doc(hidden)]
    pub fn motion_hash(&self) -> u64 {
        let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
        for (_, entry) in self.objects.bodies.iter() {
            entry.body.state().for_each_number(|x| hash.add(x));
        }
        for pair in &self.pairs {
            for (c, v) in pair.slip_speed.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                hash.add(c as Real);
                hash.add(*v);
            }
            for side in [&pair.side_a, &pair.side_b, &pair.fine_b] {
                for (c, u) in side.displacement.iter().enumerate().filter(|(_, u)| **u != Vec3::zeros()) {
                    hash.add(c as Real);
                    u.iter().for_each(|&x| hash.add(x));
                }
            }
        }
        hash.0
    }

    pub(crate) fn remove_entry(&mut self, handle: BodyHandle) -> Result<()> {
        let gone = self.slot(handle)?;
        for collider in self.collider_slots(gone) {
            self.remove_collider_at(collider);
        }
        self.friction.remove_body(gone);
        self.objects.bodies.remove(gone);
        Ok(())
    }
}

/// FNV-1a over the bits of numbers.
struct Fnv(u64);

impl Fnv {
    fn add(&mut self, x: Real) {
        for byte in x.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

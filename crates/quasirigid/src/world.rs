//! The state of a simulation: bodies, hands, what pairs remember, parameters.

use crate::body::friction_table::FrictionTable;
use crate::body::{Body, BodyEntry, Material, RigidBody, Skin};
use crate::collision::{Contact, Pair};
use crate::contact_problem::ContactProblem;
use crate::error::{Error, Result};
use crate::math::{Real, Vec3};
use crate::params::Parameters;
use crate::surface::Surface;
use crate::workspace::Workspace;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

pub use crate::world_hands::{Hand, HandHandle};

/// A body of one world. Stays valid until the body is removed; using it after that, or with another world, is an error, not another body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BodyHandle {
    world: u32,
    index: u32,
    generation: u32,
}

/// Numbers worlds, so that no handle is taken for one of another world.
static WORLDS: AtomicU32 = AtomicU32::new(0);

#[derive(Debug, Clone, Copy)]
struct Slot {
    generation: u32,
    dense: Option<u32>,
}

/// A simulation.
#[derive(Debug)]
pub struct World {
    pub(crate) params: Parameters,
    pub(crate) bodies: Vec<BodyEntry>,
    pub(crate) pairs: Vec<Pair>,
    pub(crate) friction: FrictionTable,
    pub(crate) hands: Vec<Option<Hand>>,
    pub(crate) workspace: Workspace,
    pub(crate) steps: u64,
    pub(crate) pool: Option<rayon::ThreadPool>,
    pub(crate) number: u32,
    slots: Vec<Slot>,
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
        let pool = make_pool(params.threads)?;
        Ok(Self {
            params,
            bodies: Vec::new(),
            pairs: Vec::new(),
            friction: FrictionTable::default(),
            hands: Vec::new(),
            workspace: Workspace::default(),
            steps: 0,
            pool,
            number: WORLDS.fetch_add(1, Ordering::Relaxed),
            slots: Vec::new(),
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
            self.pool = make_pool(params.threads)?;
        }
        if params.dt != self.params.dt {
            (self.start_time, self.start_steps) = (self.time(), self.steps);
        }
        let limits = |p: &Parameters| (p.contact_margin, p.traversal_slack, p.projection_slack, p.projection_tolerance);
        if limits(&params) != limits(&self.params) {
            self.pairs.iter_mut().for_each(Pair::look_anew);
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

    /// Adds a rigid body, with a surface if it is to touch anything.
    ///
    /// # Errors
    /// What [`Material::check_for`] refuses: a field out of range, a compliance matrix for other control points.
    pub fn add_body(&mut self, body: RigidBody, skin: Option<(Arc<Surface>, Material)>) -> Result<BodyHandle> {
        let skin = skin.map(|(surface, material)| Skin::new(surface, material)).transpose()?;
        Ok(self.add_entry(BodyEntry { body: Body::Rigid(body), skin, skin_link: 0, hand: None, quarantined: false }))
    }

    /// Takes a body out.
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
        Ok(&self.bodies[self.dense(handle)?])
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
        let dense = self.dense(handle)?;
        match &mut self.bodies[dense].body {
            Body::Rigid(body) => Ok(body),
            Body::Finger(_) => Err(Error::handle("body", "a rigid body", "a finger", "use finger_mut()")),
        }
    }

    /// All bodies, in the order in which contacts and reports count them.
    pub fn bodies(&self) -> &[BodyEntry] {
        &self.bodies
    }

    /// Handle of the body at a place in [`World::bodies`].
    pub fn handle_of(&self, dense: usize) -> BodyHandle {
        let index = self.slots.iter().position(|slot| slot.dense == Some(dense as u32)).unwrap_or(usize::MAX);
        self.body_handle(index, self.slots.get(index).map_or(0, |slot| slot.generation))
    }

    /// Place of a body in [`World::bodies`].
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn dense(&self, handle: BodyHandle) -> Result<usize> {
        let here = |slot: &&Slot| handle.world == self.number && slot.generation == handle.generation;
        let slot = self.slots.get(handle.index as usize).filter(here);
        slot.and_then(|slot| slot.dense).map(|dense| dense as usize).ok_or_else(|| {
            Error::handle("body", "a body of this world", format!("{handle:?}"), "it was removed, or belongs to another world")
        })
    }

    /// Contacts of the last step, ordered by pair and control point.
    pub fn contacts(&self) -> &[Contact] {
        &self.workspace.collision.contacts
    }

    /// The contact problem of the last step, with the reactions found.
    pub fn contact_problem(&self) -> &ContactProblem {
        &self.workspace.problem
    }

    /// Total contact force on a body in the last step, world axes, N.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if the body was removed.
    pub fn contact_force_on(&self, handle: BodyHandle) -> Result<Vec3> {
        let dense = self.dense(handle)? as u32;
        let forces = self.contacts().iter().zip(&self.workspace.problem.reactions).map(|(contact, f)| {
            let sign = Real::from(u8::from(contact.body_a == dense)) - Real::from(u8::from(contact.body_b == dense));
            contact.frame * f * sign
        });
        Ok(forces.sum())
    }

    /// A number that is the same for two worlds whose poses, velocities, joints and elastic displacements are the same bits, and the slip speeds
    /// where friction falls with them; and, but for one chance in 2^64, for no others. Targets, loads, and what only starts the next solve (last reactions) are not in it.
    pub fn state_hash(&self) -> u64 {
        let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
        for entry in &self.bodies {
            entry.body.state().for_each_number(|x| hash.add(x));
        }
        for pair in &self.pairs {
            for (c, v) in pair.slip_speed.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                hash.add(c as Real);
                hash.add(*v);
            }
            for side in [&pair.side_a, &pair.side_b, &pair.beyond] {
                for (c, u) in side.displacement.iter().enumerate().filter(|(_, u)| **u != Vec3::zeros()) {
                    hash.add(c as Real);
                    u.iter().for_each(|&x| hash.add(x));
                }
            }
        }
        hash.0
    }

    pub(crate) fn add_entry(&mut self, entry: BodyEntry) -> BodyHandle {
        let dense = Some(self.bodies.len() as u32);
        self.bodies.push(entry);
        if let Some(index) = self.slots.iter().position(|slot| slot.dense.is_none()) {
            self.slots[index].dense = dense;
            return self.body_handle(index, self.slots[index].generation);
        }
        self.slots.push(Slot { generation: 0, dense });
        self.body_handle(self.slots.len() - 1, 0)
    }

    fn body_handle(&self, index: usize, generation: u32) -> BodyHandle {
        BodyHandle { world: self.number, index: index as u32, generation }
    }

    pub(crate) fn remove_entry(&mut self, handle: BodyHandle) -> Result<()> {
        let gone = self.dense(handle)? as u32;
        let slot = &mut self.slots[handle.index as usize];
        (slot.dense, slot.generation) = (None, slot.generation + 1);
        self.bodies.remove(gone as usize);
        self.slots.iter_mut().filter_map(|slot| slot.dense.as_mut()).filter(|dense| **dense > gone).for_each(|dense| *dense -= 1);
        self.friction.remove_body(gone);
        self.pairs.retain(|pair| pair.a != gone && pair.b != gone);
        for pair in &mut self.pairs {
            pair.a -= u32::from(pair.a > gone);
            pair.b -= u32::from(pair.b > gone);
        }
        // Contacts count bodies by place: those of the last step mean nothing now.
        self.workspace.clear();
        for entry in &mut self.bodies {
            if let Some(skin) = &mut entry.skin {
                skin.clear_displacement();
            }
        }
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

fn make_pool(threads: usize) -> Result<Option<rayon::ThreadPool>> {
    if threads == 1 {
        return Ok(None);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(Some).map_err(|error| Error::value("threads", "a number of threads that the system can start", error, "ask for fewer"))
}

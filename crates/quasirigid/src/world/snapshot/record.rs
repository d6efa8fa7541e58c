//! What is stored of a snapshot: the same data to write and to read. Surfaces and materials are stored once each, by what they are made of.

use super::Snapshot;
use crate::body::{Body, BodyEntry};
use crate::collider::filter::ExcludedPairs;
use crate::collider::friction_table::FrictionTable;
use crate::collider::skin::StoredSkin;
use crate::collider::{Collider, Filter, Material, Skin};
use crate::collision::PairCache;
use crate::contact_problem::StoredProblem;
use crate::math::Real;
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use crate::slots::StoredSlots;
use crate::surface::{Surface, SurfaceSource};
use crate::world::Hand;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;

/// See the module.
#[derive(Serialize, Deserialize)]
pub(super) struct Record<'a> {
    pub surfaces: Vec<SurfaceSource>,
    pub materials: Vec<Cow<'a, Material>>,
    pub state: State<'a>,
}

/// All but surfaces and materials.
#[derive(Serialize, Deserialize)]
pub(super) struct State<'a> {
    pub params: Cow<'a, Parameters>,
    pub bodies: StoredSlots<StoredBody<'a>>,
    pub colliders: StoredSlots<StoredCollider<'a>>,
    pub excluded: Cow<'a, ExcludedPairs>,
    pub pairs: Cow<'a, [Pair]>,
    pub caches: Cow<'a, [PairCache]>,
    pub friction: Cow<'a, FrictionTable>,
    /// How many there have been, and which of them are there: so a list of none takes no more memory than bytes.
    pub hands: (u32, Vec<(u32, Cow<'a, Hand>)>),
    pub steps: u64,
    pub start_time: Real,
    pub start_steps: u64,
    pub contacts: Cow<'a, [Contact]>,
    pub problem: StoredProblem<'a>,
}

/// A body.
#[derive(Serialize, Deserialize)]
pub(super) struct StoredBody<'a> {
    pub body: Cow<'a, Body>,
    pub hand: Option<u32>,
    pub quarantined: bool,
}

/// A collider, and which surface and material it has.
#[derive(Serialize, Deserialize)]
pub(super) struct StoredCollider<'a> {
    pub body: u32,
    pub link: usize,
    pub surface: u64,
    pub material: u64,
    pub skin: StoredSkin<'a>,
    pub filter: Filter,
}

impl<'a> StoredBody<'a> {
    pub fn of(entry: &'a BodyEntry) -> Self {
        Self { body: Cow::Borrowed(&entry.body), hand: entry.hand, quarantined: entry.quarantined }
    }
}

impl<'a> StoredCollider<'a> {
    /// `made_of` gives surface and material their numbers.
    pub fn of(collider: &'a Collider, made_of: impl FnOnce(&'a Skin) -> [u64; 2]) -> Self {
        let Collider { body, link, skin, filter } = collider;
        let [surface, material] = made_of(skin);
        Self { body: *body, link: *link, surface, material, skin: skin.stored(), filter: *filter }
    }
}

/// The place of something in a list, to which it is added if it is not there.
fn place<'a, T>(list: &mut Vec<&'a T>, item: &'a T, same: impl Fn(&T, &T) -> bool) -> u64 {
    let found = list.iter().position(|other| same(other, item)).unwrap_or(list.len());
    if found == list.len() {
        list.push(item);
    }
    found as u64
}

impl Snapshot {
    /// What is stored.
    pub(super) fn record(&self) -> Record<'_> {
        let (mut surfaces, mut materials): (Vec<&Arc<Surface>>, Vec<&Material>) = (Vec::new(), Vec::new());
        let state = self.state(|skin| {
            let surface = place(&mut surfaces, &skin.surface, |a, b| Arc::ptr_eq(a, b) || a == b);
            [surface, place(&mut materials, &skin.material, Material::eq)]
        });
        Record {
            surfaces: surfaces.into_iter().map(|surface| surface.source()).collect(),
            materials: materials.into_iter().map(Cow::Borrowed).collect(),
            state,
        }
    }

    /// All but surfaces and materials; `made_of` gives these their numbers.
    pub(super) fn state<'a>(&'a self, mut made_of: impl FnMut(&'a Skin) -> [u64; 2]) -> State<'a> {
        let hands = self.hands.iter().enumerate().filter_map(|(index, hand)| Some((index as u32, Cow::Borrowed(hand.as_ref()?))));
        let Objects { bodies, colliders, excluded } = &self.objects;
        State {
            params: Cow::Borrowed(&self.params),
            bodies: bodies.stored(StoredBody::of),
            colliders: colliders.stored(|collider| StoredCollider::of(collider, &mut made_of)),
            excluded: Cow::Borrowed(excluded),
            pairs: Cow::Borrowed(&self.pairs),
            caches: Cow::Borrowed(&self.caches),
            friction: Cow::Borrowed(&self.friction),
            hands: (self.hands.len() as u32, hands.collect()),
            steps: self.steps,
            start_time: self.start_time,
            start_steps: self.start_steps,
            contacts: Cow::Borrowed(&self.contacts),
            problem: self.problem.stored(),
        }
    }
}

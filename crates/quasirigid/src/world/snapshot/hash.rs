//! Numbers that stand for states: equal where the states are, and but for one chance in 2^64 nowhere else.

use super::record::{StoredBody, StoredCollider};
use super::walk::{Visit, walk};
use crate::body::HandModel;
use crate::collider::Skin;
use crate::collider::filter::ExcludedPairs;
use crate::collider::friction_table::FrictionTable;
use crate::collision::PairCache;
use crate::contact_problem::ElasticRows;
use crate::delassus::ContactStatus;
use crate::math::{Pose, Real, Vec3};
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use crate::surface::Surface;
use crate::world::World;
use serde::Serialize;

/// What decides the future of a world: all that a later step reads, and what a controller reads between two steps.
#[derive(Serialize)]
struct Future<'a> {
    params: Parameters,
    bodies: Vec<(u32, StoredBody<'a>)>,
    colliders: Vec<(u32, StoredCollider<'a>)>,
    excluded: &'a ExcludedPairs,
    /// Slots of bodies and colliders in the order in which they were added. Not
    /// how often a slot was given: that only distinguishes handles.
    order: [&'a [u32]; 2],
    pairs: &'a [Pair],
    caches: &'a [PairCache],
    friction: &'a FrictionTable,
    hands: Vec<Option<HandOf<'a>>>,
    steps: u64,
    start_time: Real,
    start_steps: u64,
    contacts: &'a [Contact],
    reactions: &'a [Vec3],
    mu: &'a [Real],
    status: &'a [ContactStatus],
    elastic_rows: Vec<&'a ElasticRows>,
}

/// A hand, its fingers by their slots.
#[derive(Serialize)]
struct HandOf<'a> {
    model: &'a HandModel,
    fingers: Vec<Option<u32>>,
    base: &'a Pose,
    target: Option<&'a Pose>,
}

impl World {
    /// A number that is the same for two worlds in the same state: a world and its copy, or two worlds that were built and
    /// stepped alike. Worlds with the same number have, but for one chance in 2^64, the same future bit by bit: in it is all
    /// that decides a later step ([`crate::Snapshot`] says what that is), and what was found in the last one.
    ///
    /// Not in it: numbers of worlds and generations of handles, the number of
    /// threads, which changes no bit, times that were measured, and scratch.
    pub fn state_hash(&self) -> u64 {
        let finger = |&finger: &_| self.slot(finger).ok();
        let hand = |hand: &'_ crate::world::Hand| -> Vec<Option<u32>> { hand.fingers.iter().map(finger).collect() };
        let last_hand = self.hands.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
        let Objects { bodies, colliders, excluded } = &self.objects;
        let future = Future {
            params: Parameters { threads: 1, ..self.params.clone() },
            bodies: bodies.iter().map(|(slot, entry)| (slot, StoredBody::of(entry))).collect(),
            colliders: colliders.iter().map(|(slot, collider)| (slot, StoredCollider::of(collider, made_of))).collect(),
            excluded,
            order: [bodies.order(), colliders.order()],
            pairs: &self.pairs,
            caches: &self.workspace.collision.caches,
            friction: &self.friction,
            hands: self.hands[..last_hand]
                .iter()
                .map(|some| some.as_ref().map(|it| HandOf { model: &it.model, fingers: hand(it), base: &it.base, target: it.target() }))
                .collect(),
            steps: self.steps,
            start_time: self.start_time,
            start_steps: self.start_steps,
            contacts: &self.workspace.collision.contacts,
            reactions: &self.workspace.problem.reactions,
            mu: &self.workspace.problem.mu,
            status: &self.workspace.problem.status,
            elastic_rows: self.workspace.problem.held_rows().collect(),
        };
        hash(&future)
    }
}

/// What a skin is made of, by its content.
pub(super) fn made_of(skin: &Skin) -> [u64; 2] {
    [skin.surface.content_hash(), hash(&skin.material)]
}

/// All numbers of whatever can be stored.
pub(super) fn words(value: &impl Serialize) -> Vec<u64> {
    let mut words = Words(Vec::new());
    walk(value, &mut words);
    words.0
}

/// How many bytes they take.
pub(super) fn size(value: &impl Serialize) -> usize {
    let mut size = Size(0);
    walk(value, &mut size);
    size.0
}

struct Words(Vec<u64>);

impl Visit for Words {
    fn real(&mut self, x: Real) {
        self.0.push(x.to_bits());
    }

    fn whole(&mut self, n: u64) {
        self.0.push(n);
    }

    fn text(&mut self, text: &str) {
        self.0.push(text.len() as u64);
        self.0.extend(text.bytes().map(u64::from));
    }
}

struct Size(usize);

impl Visit for Size {
    fn real(&mut self, _x: Real) {
        self.0 += 8;
    }

    fn whole(&mut self, _n: u64) {
        self.0 += 4;
    }

    fn text(&mut self, text: &str) {
        self.0 += text.len();
    }
}

/// The hash of whatever can be stored.
pub(super) fn hash(value: &impl Serialize) -> u64 {
    let mut mixed = Mix(0x9e37_79b9_7f4a_7c15);
    walk(value, &mut mixed);
    mixed.0
}

/// Multiplies and shifts, word by word. Each word changes the number one to one: streams that differ in one word never meet.
struct Mix(u64);

impl Visit for Mix {
    #[inline]
    fn real(&mut self, x: Real) {
        self.whole(x.to_bits());
    }

    #[inline]
    fn whole(&mut self, n: u64) {
        self.0 = (self.0 ^ n).wrapping_mul(0x9fb2_1c65_1e98_df25).wrapping_add(0x2545_f491_4f6c_dd1d);
        self.0 ^= self.0 >> 32;
    }

    fn text(&mut self, text: &str) {
        self.whole(text.len() as u64);
        text.bytes().for_each(|byte| self.whole(byte.into()));
    }
}

impl Surface {
    /// The hash of what the surface is built of, found when it is first asked for.
    pub(crate) fn content_hash(&self) -> u64 {
        *self.hash.get_or_init(|| hash(&(&self.points, &self.normals, &self.areas, &self.order, self.control.len(), self.estimated)))
    }
}

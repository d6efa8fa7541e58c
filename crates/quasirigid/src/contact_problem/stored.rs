//! What is stored of a contact problem: what may be read of the last step, and the elastic rows that hold. The rows
//! that the operator has in common with the next step are handed to it again, with the same bits.

use super::{ContactProblem, ElasticRows};
use crate::delassus::{ContactStatus, MatrixFree};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// See the module.
#[derive(Serialize, Deserialize)]
pub(crate) struct StoredProblem<'a> {
    w: Cow<'a, MatrixFree>,
    delta_free: Cow<'a, [Vec3]>,
    mu: Cow<'a, [Real]>,
    unknowns: Cow<'a, [Vec3]>,
    reactions: Cow<'a, [Vec3]>,
    status: Cow<'a, [ContactStatus]>,
    predicted: bool,
    unfinished: Real,
    ill_posed: usize,
    elastic_rows: Vec<Cow<'a, ElasticRows>>,
}

impl ContactProblem {
    /// What is stored.
    pub(crate) fn stored(&self) -> StoredProblem<'_> {
        StoredProblem {
            w: Cow::Borrowed(&self.w),
            delta_free: Cow::Borrowed(&self.delta_free),
            mu: Cow::Borrowed(&self.mu),
            unknowns: Cow::Borrowed(&self.unknowns),
            reactions: Cow::Borrowed(&self.reactions),
            status: Cow::Borrowed(&self.status),
            predicted: self.predicted,
            unfinished: self.unfinished,
            ill_posed: self.ill_posed,
            elastic_rows: self.held_rows().map(Cow::Borrowed).collect(),
        }
    }

    /// The elastic rows that the next step may take over.
    pub(crate) fn held_rows(&self) -> impl Iterator<Item = &ElasticRows> {
        self.elastic_rows.iter().filter(|rows| rows.hold_any())
    }

    /// The problem that was stored, refused if it has another number of `contacts` or its
    /// parts do not fit together. `is_pair`: whether two bodies are a pair.
    pub(crate) fn of_stored(stored: StoredProblem, contacts: usize, is_pair: impl Fn((u32, u32)) -> bool) -> Result<Self, String> {
        let lengths = [stored.delta_free.len(), stored.mu.len(), stored.unknowns.len(), stored.reactions.len(), stored.status.len()];
        if lengths != [contacts; 5] {
            return Err(format!("a problem of {lengths:?} contacts, not of {contacts}"));
        }
        stored.w.check(contacts)?;
        let mut elastic_rows: Vec<ElasticRows> = stored.elastic_rows.into_iter().map(Cow::into_owned).collect();
        if !elastic_rows.is_sorted_by(|a, b| a.origin.colliders < b.origin.colliders)
            || !elastic_rows.iter().all(|rows| is_pair(rows.origin.colliders))
        {
            return Err("elastic rows of other pairs than those of the world".into());
        }
        for (k, rows) in elastic_rows.iter_mut().enumerate() {
            rows.check()?;
            rows.number(k as u64 + 1);
        }
        Ok(Self {
            w: stored.w.into_owned(),
            delta_free: stored.delta_free.into_owned(),
            mu: stored.mu.into_owned(),
            unknowns: stored.unknowns.into_owned(),
            reactions: stored.reactions.into_owned(),
            status: stored.status.into_owned(),
            predicted: stored.predicted,
            unfinished: stored.unfinished,
            ill_posed: stored.ill_posed,
            serial: elastic_rows.len() as u64,
            elastic_rows,
            ..Self::default()
        })
    }
}

impl ElasticRows {
    /// Whether there are contacts for which they hold.
    fn hold_any(&self) -> bool {
        !self.ends.is_empty()
    }

    /// Gives them a number that no other rows of the problem have.
    fn number(&mut self, serial: u64) {
        self.serial = serial;
    }

    /// Refuses rows that do not fit together.
    fn check(&self) -> Result<(), String> {
        let contacts = self.contacts.len();
        let ends_rise = self.ends.is_sorted() && self.ends.last().is_some_and(|&end| end as usize == self.columns.len());
        let tensors = self.tensors.iter().all(|side| side.is_empty() || Some(side.len()) == contacts.checked_mul(contacts));
        if self.ends.len() == contacts
            && ends_rise
            && self.columns.len() == self.values.len()
            && self.columns.iter().all(|&j| (j as usize) < contacts)
            && tensors
        {
            return Ok(());
        }
        Err(format!("elastic rows that do not fit together, of {contacts} contacts"))
    }
}

#[cfg(test)]
impl ContactProblem {
    /// Scratch as it is in a new world, and what is written before a step reads it.
    pub(crate) fn drop_scratch(&mut self, which: usize) {
        match which {
            0 => self.rigid = Vec::new(),
            1 => self.elastic = super::elastic::Scratch::default(),
            2 => self.held = Vec::new(),
            3 => (self.w, self.held) = (MatrixFree::default(), Vec::new()),
            4 => (self.delta_free, self.mu) = (Vec::new(), Vec::new()),
            5 => (self.unknowns, self.reactions) = (Vec::new(), Vec::new()),
            _ => (self.status, self.predicted, self.unfinished) = (Vec::new(), false, 0.0),
        }
    }
}

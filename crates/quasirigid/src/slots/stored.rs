//! What is stored of a list with stable indices, and what is refused when it is read.

use super::{Slot, Slots};
use serde::{Deserialize, Serialize};

/// More values than this no list has had.
const MOST_GENERATIONS: u32 = 1 << 31;

/// A list of values with stable indices, each as `V`.
#[derive(Serialize, Deserialize)]
pub(crate) struct StoredSlots<V> {
    /// Of each slot, free ones included.
    generations: Vec<u32>,
    /// Slots in use and their values, in the order of the slots.
    values: Vec<(u32, V)>,
    order: Vec<u32>,
    next_generation: u32,
}

impl<T> Slots<T> {
    /// What is stored, `store` of each value.
    pub(crate) fn stored<'a, V>(&'a self, mut store: impl FnMut(&'a T) -> V) -> StoredSlots<V> {
        StoredSlots {
            generations: self.slots.iter().map(|slot| slot.generation).collect(),
            values: self.iter().map(|(slot, value)| (slot, store(value))).collect(),
            order: self.order.clone(),
            next_generation: self.next_generation,
        }
    }
}

impl<V> StoredSlots<V> {
    /// The list that was stored, each value by `read`. Refused if it is none: each slot in use stands
    /// once in the order in which values were added, and no generation was given twice.
    pub(crate) fn read<T>(self, mut read: impl FnMut(V) -> Result<T, String>) -> Result<Slots<T>, String> {
        let Self { generations, values, order, next_generation } = self;
        if next_generation > MOST_GENERATIONS || generations.iter().any(|&generation| generation >= next_generation) {
            return Err("generations of slots that were never given".into());
        }
        let mut slots: Vec<Slot<T>> = generations.iter().map(|&generation| Slot { generation, value: None }).collect();
        let mut used: Vec<u32> = order.clone();
        used.sort_unstable();
        if !used.iter().eq(values.iter().map(|(slot, _)| slot)) || !used.is_sorted_by(|a, b| a < b) {
            return Err("an order in which not every slot in use stands once".into());
        }
        for (slot, value) in values {
            slots.get_mut(slot as usize).ok_or("a slot beyond the last one")?.value = Some(read(value)?);
        }
        let list = Slots { slots, order, next_generation };
        if !list.order.is_sorted_by(|&a, &b| list.added_before(a, b)) {
            return Err("an order that is not that of the generations".into());
        }
        Ok(list)
    }
}

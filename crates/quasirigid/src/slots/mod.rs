//! Values with stable indices: a slot is its value's for as long as that is there, whatever else is added or removed.
//!
//! Freed slots are used again, lowest first, so that what is kept by slot stays short. A generation, which no two values of one
//! list ever share, distinguishes a value from an earlier one in the same slot; it also gives the order in which values were added.

mod stored;

pub(crate) use stored::StoredSlots;

use std::ops::{Index, IndexMut};

/// A list of values with stable indices. Stages visit them in the order of their slots;
/// users see them in the order in which they were added ([`Slots::in_order`]).
#[derive(Debug, Clone)]
pub struct Slots<T> {
    slots: Vec<Slot<T>>,
    /// Slots in use, in the order in which their values were added.
    order: Vec<u32>,
    /// Generation of the next value. Never given twice, also where a world is taken back in
    /// time: a handle of a value that has not been never becomes one of another.
    next_generation: u32,
}

#[derive(Debug, Clone)]
struct Slot<T> {
    generation: u32,
    value: Option<T>,
}

impl<T> Default for Slots<T> {
    fn default() -> Self {
        Self { slots: Vec::new(), order: Vec::new(), next_generation: 0 }
    }
}

impl<T> Slots<T> {
    /// Puts a value into the lowest free slot, and returns that.
    pub fn insert(&mut self, value: T) -> u32 {
        let slot = Slot { generation: self.next_generation, value: Some(value) };
        self.next_generation += 1;
        let index = self.slots.iter().position(|slot| slot.value.is_none()).unwrap_or(self.slots.len());
        if index == self.slots.len() {
            self.slots.push(slot);
        } else {
            self.slots[index] = slot;
        }
        self.order.push(index as u32);
        index as u32
    }

    /// Takes the value out of a slot. The others stay where they are.
    pub fn remove(&mut self, slot: u32) -> Option<T> {
        let value = self.slots.get_mut(slot as usize)?.value.take();
        self.order.retain(|&used| used != slot);
        value
    }

    /// The value in a slot.
    pub fn get(&self, slot: u32) -> Option<&T> {
        self.slots.get(slot as usize)?.value.as_ref()
    }

    /// The value in a slot, if it is of this generation.
    pub fn find(&self, slot: u32, generation: u32) -> Option<&T> {
        self.slots.get(slot as usize).filter(|slot| slot.generation == generation)?.value.as_ref()
    }

    /// Generation of what is, or was last, in a slot.
    pub fn generation(&self, slot: u32) -> u32 {
        self.slots.get(slot as usize).map_or(0, |slot| slot.generation)
    }

    /// Whether the value in slot `a` was added before that in slot `b`.
    pub fn added_before(&self, a: u32, b: u32) -> bool {
        self.generation(a) < self.generation(b)
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Number of slots, free ones included: every slot is below it.
    pub fn slot_count(&self) -> usize {
        self.slots.len()
    }

    /// Slots in use, in the order in which their values were added.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The values in the order in which they were added.
    pub fn in_order(&self) -> impl Iterator<Item = &T> {
        self.order.iter().filter_map(|&slot| self.get(slot))
    }

    /// Place of a slot among those in use, in the order in which they were added.
    pub fn place(&self, slot: u32) -> Option<usize> {
        self.order.iter().position(|&used| used == slot)
    }

    /// Slots in use and their values, in the order of the slots.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &T)> {
        self.slots.iter().enumerate().filter_map(|(index, slot)| Some((index as u32, slot.value.as_ref()?)))
    }

    /// As [`Slots::iter`].
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (u32, &mut T)> {
        self.slots.iter_mut().enumerate().filter_map(|(index, slot)| Some((index as u32, slot.value.as_mut()?)))
    }

    /// The value of every slot in turn, `None` for a free one.
    pub fn all_slots(&self) -> impl Iterator<Item = Option<&T>> {
        self.slots.iter().map(|slot| slot.value.as_ref())
    }

    /// As [`Slots::all_slots`].
    pub fn all_slots_mut(&mut self) -> impl Iterator<Item = Option<&mut T>> {
        self.slots.iter_mut().map(|slot| slot.value.as_mut())
    }
}

impl<T: Clone> Slots<T> {
    /// Back to the values of another time. Generations given out since are not given out again.
    pub fn restore(&mut self, earlier: &Self) {
        self.slots.clone_from(&earlier.slots);
        self.order.clone_from(&earlier.order);
        self.next_generation = self.next_generation.max(earlier.next_generation);
    }
}

/// The value in a slot that is known to be in use.
impl<T> Index<u32> for Slots<T> {
    type Output = T;

    fn index(&self, slot: u32) -> &T {
        match &self.slots[slot as usize].value {
            Some(value) => value,
            None => unreachable!("slot {slot} is free"),
        }
    }
}

impl<T> IndexMut<u32> for Slots<T> {
    fn index_mut(&mut self, slot: u32) -> &mut T {
        match &mut self.slots[slot as usize].value {
            Some(value) => value,
            None => unreachable!("slot {slot} is free"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against a plain list of what is there, with the slot and the generation that each was given.
        #[test]
        fn a_value_keeps_its_slot_and_a_freed_slot_is_used_again_lowest_first(
            actions in prop::collection::vec((any::<bool>(), 0..100usize), 1..60),
        ) {
            let (mut slots, mut there, mut generations) = (Slots::default(), Vec::<(u32, u32, usize)>::new(), Vec::new());
            for (value, (add, which)) in actions.into_iter().enumerate() {
                if add || there.is_empty() {
                    let slot = slots.insert(value);
                    let lowest = (0..).find(|free| there.iter().all(|(used, ..)| used != free)).unwrap();
                    prop_assert_eq!(slot, lowest);
                    let generation = slots.generation(slot);
                    prop_assert!(!generations.contains(&generation), "generation {} twice", generation);
                    generations.push(generation);
                    there.push((slot, generation, value));
                } else {
                    let (slot, generation, value) = there.remove(which % there.len());
                    prop_assert_eq!(slots.remove(slot), Some(value));
                    prop_assert_eq!(slots.find(slot, generation), None);
                }
                for (place, &(slot, generation, value)) in there.iter().enumerate() {
                    prop_assert_eq!(slots.find(slot, generation), Some(&value));
                    prop_assert_eq!((slots.place(slot), slots[slot]), (Some(place), value));
                }
                let values: Vec<usize> = slots.in_order().copied().collect();
                prop_assert_eq!(values, there.iter().map(|&(.., value)| value).collect::<Vec<_>>());
                prop_assert!(there.windows(2).all(|pair| slots.added_before(pair[0].0, pair[1].0)));
                prop_assert_eq!(slots.iter().count(), slots.len());
            }
        }
    }

    #[test]
    fn a_generation_of_a_future_that_was_taken_back_is_not_given_again() {
        let mut slots = Slots::default();
        slots.insert('a');
        let earlier = slots.clone();
        let future = slots.insert('b');
        let generation = slots.generation(future);
        slots.restore(&earlier);
        assert_eq!((slots.len(), slots.find(future, generation)), (1, None));
        assert_eq!(slots.insert('c'), future);
        assert_eq!(slots.find(future, generation), None, "the handle of b names c");
    }
}

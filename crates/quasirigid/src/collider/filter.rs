//! Which colliders may touch: groups, and single pairs that are excluded.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Groups that a collider belongs to, and those that it meets, as sets of bits. Two
/// colliders may touch if each of them meets a group of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Filter {
    /// Groups that it belongs to.
    pub group: u32,
    /// Groups that it meets.
    pub mask: u32,
}

impl Default for Filter {
    /// In the first group, and meets everything.
    fn default() -> Self {
        Self { group: 1, mask: u32::MAX }
    }
}

impl Filter {
    /// Whether two colliders may touch as far as their groups say.
    pub fn meets(&self, other: &Self) -> bool {
        self.mask & other.group != 0 && other.mask & self.group != 0
    }
}

/// Pairs of colliders that never touch, by slot.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct ExcludedPairs(BTreeSet<(u32, u32)>);

impl ExcludedPairs {
    /// Excludes a pair, or (`false`) lets it touch again.
    pub fn set(&mut self, a: u32, b: u32, excluded: bool) {
        let pair = (a.min(b), a.max(b));
        if excluded {
            self.0.insert(pair);
        } else {
            self.0.remove(&pair);
        }
    }

    /// Whether a pair is excluded.
    pub fn contains(&self, a: u32, b: u32) -> bool {
        // Most worlds exclude none: the broad phase asks this of every two colliders.
        !self.0.is_empty() && self.0.contains(&(a.min(b), a.max(b)))
    }

    /// Refuses pairs that are none of the colliders that are there.
    pub fn check(&self, is_collider: impl Fn(u32) -> bool) -> Result<(), String> {
        if self.0.iter().all(|&(a, b)| a < b && is_collider(a) && is_collider(b)) {
            return Ok(());
        }
        Err("an excluded pair of colliders of which one is not there".into())
    }

    /// Forgets a collider.
    pub fn remove(&mut self, gone: u32) {
        self.0.retain(|&(a, b)| a != gone && b != gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_have_to_accept() {
        let filter = |group, mask| Filter { group, mask };
        let everything = Filter::default();
        for (a, b, meet) in [
            (everything, everything, true),
            (filter(2, 1), everything, true),
            (filter(1, 2), everything, false),
            (filter(2, 4), filter(4, 2), true),
            (filter(2, 4), filter(4, 1), false),
            (filter(0, u32::MAX), everything, false),
            (filter(6, 8), filter(8, 4), true),
        ] {
            assert_eq!((a.meets(&b), b.meets(&a)), (meet, meet), "{a:?} and {b:?}");
        }
    }

    #[test]
    fn an_excluded_pair_has_no_order_and_goes_with_either_collider() {
        let mut excluded = ExcludedPairs::default();
        excluded.set(3, 1, true);
        excluded.set(1, 2, true);
        assert!(excluded.contains(1, 3) && excluded.contains(3, 1) && !excluded.contains(2, 3));
        excluded.set(1, 3, false);
        assert!(!excluded.contains(3, 1) && excluded.contains(2, 1));
        excluded.remove(2);
        assert!(!excluded.contains(1, 2));
    }
}

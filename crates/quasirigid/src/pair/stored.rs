//! What is refused of a pair that is read.

use super::patch::check_indices;
use super::{Pair, ReactionHistory};

impl Pair {
    /// Refuses a pair that is none of surfaces with so many control points.
    pub(crate) fn check(&self, [count_a, count_b]: [usize; 2]) -> Result<(), String> {
        let ReactionHistory { last, trend, change, loaded } = &self.reactions;
        let lengths = [last.len(), trend.len(), change.len(), self.side_a.displacement.len(), self.fine_b.displacement.len()];
        if lengths != [count_a; 5] || self.side_b.displacement.len() != count_b {
            return Err(format!("a pair of other surfaces than those with {count_a} and {count_b} control points"));
        }
        check_indices(loaded.iter().copied(), count_a)?;
        let speeds = if self.friction.is_velocity_weakening() { count_a } else { 0 };
        if self.slip_speed.len() == speeds { Ok(()) } else { Err(format!("{} slip speeds, not {speeds}", self.slip_speed.len())) }
    }
}

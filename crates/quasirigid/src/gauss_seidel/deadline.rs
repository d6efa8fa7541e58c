//! When to stop early: a time budget, and an interrupt by the caller.

use super::Stop;
use std::time::{Duration, Instant};

/// Asked between any two pieces of work of the solver that take more than a fraction of a millisecond.
#[derive(Clone, Copy)]
pub(crate) struct Deadline<'a> {
    at: Option<Instant>,
    interrupted: Option<&'a dyn Fn() -> bool>,
}

impl<'a> Deadline<'a> {
    /// `budget` counts from now. A budget too long for the clock is none.
    pub(crate) fn new(budget: Option<Duration>, interrupted: Option<&'a dyn Fn() -> bool>) -> Self {
        Self { at: budget.and_then(|budget| Instant::now().checked_add(budget)), interrupted }
    }

    /// Why to stop now, if so.
    pub(crate) fn reason(&self) -> Option<Stop> {
        if self.at.is_some_and(|at| Instant::now() >= at) {
            Some(Stop::TimeBudget)
        } else if self.interrupted.is_some_and(|interrupted| interrupted()) {
            Some(Stop::Interrupted)
        } else {
            None
        }
    }

    /// Whether to stop now.
    pub(crate) fn passed(&self) -> bool {
        self.reason().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deadline_says_why() {
        assert_eq!(Deadline::new(None, None).reason(), None);
        assert_eq!(Deadline::new(Some(Duration::from_secs(3600)), None).reason(), None);
        assert_eq!(Deadline::new(Some(Duration::MAX), Some(&|| false)).reason(), None);
        assert_eq!(Deadline::new(Some(Duration::ZERO), Some(&|| true)).reason(), Some(Stop::TimeBudget));
        assert_eq!(Deadline::new(None, Some(&|| true)).reason(), Some(Stop::Interrupted));
    }
}

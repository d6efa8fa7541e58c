//! What can be chosen about the tracking of a hand.

use crate::error::{Result, check_within};

/// How far in the past the hand is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delay {
    /// One period of the tracker plus the lateness of 95 of 100 packets, at most 0.1 s.
    Auto,
    /// So many seconds. 0 predicts: the least latency, and overshoots when the hand turns back.
    Fixed(f64),
}

/// What can be chosen about [`crate::HandTracker`]; times in s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingOptions {
    /// How far in the past the hand is shown.
    pub delay: Delay,
    /// How long something that is not seen keeps its full weight: from the first frame without it, or, if no frames come, from the time
    /// when two of them are missing. Longer bridges longer losses, shorter lets go sooner.
    pub hold: f64,
    /// How long the weight then takes to 0.
    pub fade: f64,
    /// Time constant with which a pose glides to where it should be, and the time that the weight takes to 1. Shorter catches up sooner and
    /// jerks more.
    pub catch: f64,
}

impl Default for TrackingOptions {
    fn default() -> Self {
        Self { delay: Delay::Auto, hold: 0.5, fade: 0.5, catch: 0.1 }
    }
}

impl TrackingOptions {
    /// # Errors
    /// [`crate::Error::InvalidValue`] for times that are not finite, negative, or of no use: more than a minute, a delay over 1 s, `catch`
    /// under 1 ms.
    pub fn check(&self) -> Result<()> {
        if let Delay::Fixed(delay) = self.delay {
            check_within("delay", delay, 0.0, 1.0, "s")?;
        }
        check_within("hold", self.hold, 0.0, 60.0, "s")?;
        check_within("fade", self.fade, 0.0, 60.0, "s")?;
        check_within("catch", self.catch, 1e-3, 60.0, "s")
    }
}

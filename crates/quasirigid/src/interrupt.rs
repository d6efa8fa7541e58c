//! A flag that ends a long calculation from another thread.

use crate::error::{Error, Result};
use std::sync::atomic::{AtomicBool, Ordering};

/// Raised when the result is not wanted any more; the loops that build a surface test it often.
///
/// ```
/// use quasirigid::interrupt::Interrupt;
/// let interrupt = Interrupt::default();
/// assert!(interrupt.check().is_ok());
/// interrupt.raise();
/// assert!(interrupt.check().is_err());
/// ```
#[derive(Debug, Default)]
pub struct Interrupt(AtomicBool);

impl Interrupt {
    /// Asks the calculation to end.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to.
    pub fn raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Ends a stage.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if it was asked to end.
    pub fn check(&self) -> Result<()> {
        if self.raised() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

//! Stage 5: contact forces become motion.

pub mod integrate;

pub use integrate::advance;

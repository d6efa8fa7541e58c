//! What can be wrong: input, files, network. Every variant says what was expected, what came, and what to do.
//!
//! Packets that cannot be read are no errors of the program: [`crate::dtrack::PacketError`] says why, and a receiver counts them.

use thiserror::Error;

/// Result of every fallible call of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Bad input, an unusable file or a network that says no.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A number, name or text is not what it must be.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    InvalidValue {
        /// The argument or field.
        what: String,
        /// What would have been accepted, with unit.
        expected: String,
        /// What came.
        got: String,
        /// What to do.
        hint: String,
    },
    /// A file that is missing, unreadable or of another format.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    File {
        /// The file.
        what: String,
        /// What was looked for.
        expected: String,
        /// What was found.
        got: String,
        /// What to do.
        hint: String,
    },
    /// A socket that cannot be opened or used: port in use, no such group, no route.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    Network {
        /// The address.
        what: String,
        /// What was tried.
        expected: String,
        /// What the system said.
        got: String,
        /// What to do.
        hint: String,
    },
}

impl Error {
    /// [`Error::InvalidValue`] from anything printable.
    pub fn value(what: impl Into<String>, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::InvalidValue { what: what.into(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }

    /// [`Error::File`] from anything printable.
    pub fn file(what: impl ToString, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::File { what: what.to_string(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }

    /// [`Error::Network`] from anything printable.
    pub fn network(what: impl ToString, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::Network { what: what.to_string(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }
}

/// Refuses NaN, infinity and what lies outside of `low..=high`.
pub fn check_within(what: &str, value: f64, low: f64, high: f64, unit: &str) -> Result<()> {
    if value.is_finite() && (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::value(what, format!("a finite number from {low} to {high} ({unit})"), value, "give a value in SI units within this range"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_says_expected_got_and_hint() {
        let text = check_within("hold", -1.0, 0.0, 60.0, "s").unwrap_err().to_string();
        assert_eq!(text, "hold: expected a finite number from 0 to 60 (s), got -1; give a value in SI units within this range");
        assert!(check_within("hold", f64::NAN, 0.0, 60.0, "s").is_err());
        assert!(check_within("hold", 60.0, 0.0, 60.0, "s").is_ok());
    }
}

//! What can be wrong with input. Every variant says what was expected, what came, and what to do.

use thiserror::Error;

/// Result of every fallible call of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Bad input, caught where it enters. Nothing here is raised while a step runs:
/// a step reports through [`crate::world::report::StepReport`].
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is NaN, infinite, negative where it must not be, or otherwise out of range.
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
    /// An array has the wrong length, or two arrays disagree.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    InvalidShape {
        /// The argument.
        what: String,
        /// The length or shape that fits.
        expected: String,
        /// The length or shape that came.
        got: String,
        /// What to do.
        hint: String,
    },
    /// Points that do not make a surface: too few, all in one place or on one line.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    DegenerateSurface {
        /// The surface or the quantity computed from it.
        what: String,
        /// What a usable surface has.
        expected: String,
        /// What was found.
        got: String,
        /// What to do.
        hint: String,
    },
    /// A calculation that somebody ended before its result was there, see [`crate::interrupt::Interrupt`].
    #[error("interrupted")]
    Interrupted,
    /// A name that is not in the table it was looked up in.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    UnknownName {
        /// The table.
        what: String,
        /// The names there are.
        expected: String,
        /// The name that came.
        got: String,
        /// What to do.
        hint: String,
    },
    /// A handle whose body was removed, or that belongs to another world, or is of another kind.
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    InvalidHandle {
        /// The call.
        what: String,
        /// The kind of handle that fits.
        expected: String,
        /// The handle that came.
        got: String,
        /// What to do.
        hint: String,
    },
    /// Bytes that are no snapshot that this version can read, see [`crate::Snapshot::from_bytes`].
    #[error("{what}: expected {expected}, got {got}; {hint}")]
    InvalidSnapshot {
        /// What was read.
        what: String,
        /// What would have been accepted.
        expected: String,
        /// The version that came, or what is wrong with it.
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

    /// [`Error::InvalidShape`] from anything printable.
    pub fn shape(what: impl Into<String>, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::InvalidShape { what: what.into(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }

    /// [`Error::DegenerateSurface`] from anything printable.
    pub fn degenerate(what: impl Into<String>, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::DegenerateSurface { what: what.into(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }

    /// [`Error::UnknownName`] from anything printable.
    pub fn unknown(what: impl Into<String>, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::UnknownName { what: what.into(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }

    /// [`Error::InvalidHandle`] from anything printable.
    pub fn handle(what: impl Into<String>, expected: impl Into<String>, got: impl ToString, hint: impl Into<String>) -> Self {
        Self::InvalidHandle { what: what.into(), expected: expected.into(), got: got.to_string(), hint: hint.into() }
    }
}

/// Refuses NaN, infinity and values below or equal to zero.
pub fn check_positive(what: &str, value: f64, unit: &str) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::value(what, format!("a finite number > 0 ({unit})"), value, "give a positive value in SI units"))
}

/// Refuses NaN, infinity and negative values.
pub fn check_non_negative(what: &str, value: f64, unit: &str) -> Result<()> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Error::value(what, format!("a finite number >= 0 ({unit})"), value, "give a value that is not negative, in SI units"))
}

/// Refuses a list with a NaN or an infinity in it and names the first.
pub fn check_finite<'a>(what: &str, values: impl IntoIterator<Item = &'a f64>) -> Result<()> {
    match values.into_iter().enumerate().find(|(_, v)| !v.is_finite()) {
        None => Ok(()),
        Some((i, v)) => {
            Err(Error::value(what, "finite numbers only", format!("{v} at position {i}"), "remove or repair the non-finite entries"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_says_expected_got_and_hint() {
        let text = check_positive("mass", -1.0, "kg").unwrap_err().to_string();
        assert_eq!(text, "mass: expected a finite number > 0 (kg), got -1; give a positive value in SI units");
        assert!(check_positive("mass", f64::NAN, "kg").is_err());
        assert!(check_non_negative("friction", 0.0, "-").is_ok());
        assert!(check_finite("points", [0.0, f64::INFINITY].iter()).unwrap_err().to_string().contains("position 1"));
    }
}

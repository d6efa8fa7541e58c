//! Rust errors become the classes of `quasirigid.errors`, field by field.

use pyo3::prelude::*;
use quasirigid::Error;

/// The exception for an engine error.
pub fn to_py(py: Python<'_>, error: &Error) -> PyErr {
    let (class, what, expected, got, hint) = match error {
        Error::InvalidValue { what, expected, got, hint } => ("InvalidValueError", what, expected, got, hint),
        Error::InvalidShape { what, expected, got, hint } => ("InvalidShapeError", what, expected, got, hint),
        Error::DegenerateSurface { what, expected, got, hint } => ("DegenerateSurfaceError", what, expected, got, hint),
        Error::UnknownName { what, expected, got, hint } => ("UnknownNameError", what, expected, got, hint),
        Error::InvalidHandle { what, expected, got, hint } => ("InvalidHandleError", what, expected, got, hint),
        Error::InvalidSnapshot { what, expected, got, hint } => ("SnapshotError", what, expected, got, hint),
        other => return pyo3::exceptions::PyRuntimeError::new_err(other.to_string()),
    };
    make(py, class, [what, expected, got, hint])
}

/// An exception of `quasirigid.errors` from its class and (what, expected, got, hint).
pub fn make(py: Python<'_>, class: &str, [what, expected, got, hint]: [&str; 4]) -> PyErr {
    let made = py.import("quasirigid.errors").and_then(|m| m.getattr(class)).and_then(|c| c.call1((what, expected, got, hint)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(failure) => failure,
    }
}

/// `?` for engine results.
pub trait OrRaise<T> {
    /// The value, or the exception for the error.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for quasirigid::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| to_py(py, &error))
    }
}

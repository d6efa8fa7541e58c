//! Values: what never changes once it is made. Equal if the contents are equal, however they were made; copied by sharing; pickled as CBOR,
//! which names its fields, so that a pickle of another version is refused rather than misread.

use crate::errors::to_py;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use quasirigid::Error;
use quasirigid::math::Real;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::hash::{DefaultHasher, Hash, Hasher};

/// A class whose instances are values. [`value!`] gives it what Python asks of values.
pub trait Value: Sized {
    /// What users call it.
    const NAME: &'static str;
    /// Whether both are equal.
    fn same(&self, other: &Self) -> bool;
    /// Some of its numbers: equal values have equal ones.
    fn digest(&self) -> Vec<Real>;
    /// As CBOR.
    fn write(&self) -> Result<Vec<u8>, String>;
    /// From CBOR, checked as if a user had given it.
    fn read(bytes: &[u8]) -> Result<Self, String>;
}

/// A content as CBOR.
pub fn to_cbor(content: &impl Serialize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    ciborium::into_writer(content, &mut bytes).map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// A content from CBOR.
pub fn from_cbor<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let mut rest = bytes;
    let content = ciborium::from_reader(&mut rest).map_err(|error| match error {
        ciborium::de::Error::Semantic(_, why) => why,
        ciborium::de::Error::Io(_) => "one that ends too early".into(),
        other => other.to_string(),
    })?;
    if rest.is_empty() { Ok(content) } else { Err(format!("{} bytes behind its end", rest.len())) }
}

/// Equal numbers have equal hashes, 0 and -0 too.
pub fn hash(numbers: &[Real]) -> u64 {
    let mut hasher = DefaultHasher::new();
    numbers.iter().for_each(|x| (x + 0.0).to_bits().hash(&mut hasher));
    hasher.finish()
}

/// The hash of a handle: two objects for one body are the same key.
pub fn hash_of(handle: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    handle.hash(&mut hasher);
    hasher.finish()
}

/// What is pickled.
pub fn pickled<'py, T: Value>(py: Python<'py>, value: &T) -> PyResult<Bound<'py, PyBytes>> {
    let bytes =
        value.write().map_err(|why| to_py(py, &Error::value(T::NAME, "a value that can be pickled", why, "this should not happen")))?;
    Ok(PyBytes::new(py, &bytes))
}

/// The value that was pickled.
pub fn unpickled<T: Value>(py: Python<'_>, bytes: &[u8]) -> PyResult<T> {
    T::read(bytes).map_err(|why| {
        let hint = "read it with the version that has written it";
        to_py(py, &Error::value(T::NAME, "a whole pickle of this version of quasirigid", why, hint))
    })
}

/// The methods of a [`Value`].
macro_rules! value {
    ($class:ident) => {
        #[pymethods]
        impl $class {
            fn __eq__(&self, other: &Self) -> bool {
                $crate::value::Value::same(self, other)
            }

            // The usual one asks for the truth of what `==` says, and an array that is compared with has none.
            fn __ne__(&self, other: &Self) -> bool {
                !$crate::value::Value::same(self, other)
            }

            fn __hash__(&self) -> u64 {
                $crate::value::hash(&$crate::value::Value::digest(self))
            }

            fn __copy__(this: Py<Self>) -> Py<Self> {
                this
            }

            fn __deepcopy__(this: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
                this
            }

            fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, pyo3::types::PyBytes>,))> {
                let bytes = $crate::value::pickled(this.py(), this.get())?;
                Ok((this.get_type().getattr("_unpickled")?, (bytes,)))
            }

            #[classmethod]
            fn _unpickled(class: &Bound<'_, pyo3::types::PyType>, bytes: &[u8]) -> PyResult<Self> {
                $crate::value::unpickled(class.py(), bytes)
            }
        }
    };
}

pub(crate) use value;

//! What all handles have: two are equal if they name the same body, hand or collider of the same world, and a set or dictionary may hold
//! them.

use crate::body::Body;
use crate::collider::Collider;
use crate::hand::Hand;
use pyo3::prelude::*;

macro_rules! equal_by_handle {
    ($($class:ident),+) => {$(
        #[pymethods]
        impl $class {
            fn __eq__(&self, other: &Self) -> bool {
                self.handle == other.handle
            }

            // The usual one asks for the truth of what `==` says, and an array that is compared with has none.
            fn __ne__(&self, other: &Self) -> bool {
                self.handle != other.handle
            }

            fn __hash__(&self) -> u64 {
                crate::value::hash_of(&self.handle)
            }
        }
    )+};
}

equal_by_handle!(Body, Collider, Hand);

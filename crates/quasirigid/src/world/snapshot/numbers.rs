//! Checks of every number of a state that is read: finite, not too large, and quaternions of unit length.

use super::walk::{Visit, walk};
use crate::math::Real;
use serde::Serialize;

/// Fields in which infinity has a meaning: no limit, or not found yet.
const MAY_BE_INFINITE: [&str; 6] = ["push_out_speed", "rigid_beyond", "max_pull", "max_speed", "x", "holds_for"];
/// Where a solve has failed because of a NaN, it stays to be inspected; no step reads it.
const MAY_BE_NONE: &str = "delta_free";
/// Fields that hold a unit quaternion.
const ROTATIONS: [&str; 2] = ["rotation", "faced"];
/// Integers that may be as large as they can.
const MAY_BE_HUGE: [&str; 2] = ["traversal_budget", "secs"];
/// Others count something.
const MOST: u64 = 1 << 53;
/// By how much the length of a quaternion may be off.
const UNIT: Real = 1e-6;

/// Refuses a state with a number that no state has. The message names the field.
pub(super) fn check_numbers(state: &impl Serialize) -> Result<(), String> {
    let mut numbers = Numbers { fields: Vec::new(), wrong: None, length2: 0.0 };
    walk(state, &mut numbers);
    numbers.wrong.map_or(Ok(()), Err)
}

struct Numbers {
    fields: Vec<&'static str>,
    /// What was found first.
    wrong: Option<String>,
    /// Of the quaternion that is being read.
    length2: Real,
}

impl Numbers {
    fn field(&self) -> &'static str {
        self.fields.last().copied().unwrap_or("state")
    }

    fn refuse(&mut self, got: String) {
        let place = self.fields.join(".");
        self.wrong.get_or_insert_with(|| format!("{got} in {place}"));
    }
}

impl Visit for Numbers {
    fn real(&mut self, x: Real) {
        self.length2 += x * x;
        if !x.is_finite() {
            let field = self.field();
            if field != MAY_BE_NONE && (x.is_nan() || !MAY_BE_INFINITE.contains(&field)) {
                self.refuse(x.to_string());
            }
        }
    }

    fn whole(&mut self, n: u64) {
        if n > MOST && !MAY_BE_HUGE.contains(&self.field()) {
            self.refuse(n.to_string());
        }
    }

    fn text(&mut self, _text: &str) {}

    fn enter(&mut self, name: &'static str) {
        self.fields.push(name);
        self.length2 = 0.0;
    }

    fn leave(&mut self) {
        if ROTATIONS.contains(&self.field()) && (self.length2.sqrt() - 1.0).abs() > UNIT {
            self.refuse(format!("a quaternion of length {}", self.length2.sqrt()));
        }
        self.fields.pop();
    }
}

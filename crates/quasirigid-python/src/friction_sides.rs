//! Whom an entry of a world's friction table is about.

use crate::body::Body;
use crate::errors::{OrRaise, to_py};
use crate::hand::Hand;
use crate::material::Material;
use crate::process::SharedWorld;
use pyo3::prelude::*;
use quasirigid::{Error, FrictionSide};
use std::sync::Arc;

/// Whom `value` stands for: a material (or its name), a body, or the fingers of a hand, of the world `of`, which is locked as `world`.
pub fn sides(of: &SharedWorld, world: &quasirigid::World, value: &Bound<'_, PyAny>) -> PyResult<Vec<FrictionSide>> {
    let py = value.py();
    let elsewhere =
        || to_py(py, &Error::handle("set_friction", "a body of this world", "one of another", "ask the world that it was added to"));
    if let Ok(material) = value.cast::<Material>() {
        return Ok(vec![(&material.get().engine).into()]);
    }
    if let Ok(body) = value.cast::<Body>() {
        return if Arc::ptr_eq(&body.get().world, of) { Ok(vec![body.get().handle.into()]) } else { Err(elsewhere()) };
    }
    if let Ok(hand) = value.cast::<Hand>() {
        if !Arc::ptr_eq(&hand.get().world, of) {
            return Err(elsewhere());
        }
        return Ok(world.hand(hand.get().handle).or_raise(py)?.fingers.iter().map(|&finger| finger.into()).collect());
    }
    if let Ok(name) = value.extract::<String>() {
        return Ok(vec![FrictionSide::Name(name)]);
    }
    let hint = "name the two sides of the pair";
    Err(to_py(py, &Error::handle("set_friction", "a Material, the name of one, a Body or a Hand", value.get_type(), hint)))
}

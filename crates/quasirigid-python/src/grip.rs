//! `Grip`: the controller that closes a hand.

use crate::conv;
use crate::errors::OrRaise;
use crate::world::World;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use quasirigid::grip::GripState;
use quasirigid::math::Real;
use std::sync::{Mutex, MutexGuard, PoisonError};

#[doc = doc!("Grip")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Grip {
    world: Py<World>,
    engine: Mutex<quasirigid::grip::Grip>,
}

impl Grip {
    /// Wraps a controller of a hand of `world`.
    pub fn new(world: Py<World>, grip: quasirigid::grip::Grip) -> Self {
        Self { world, engine: Mutex::new(grip) }
    }

    fn lock(&self, py: Python<'_>) -> MutexGuard<'_, quasirigid::grip::Grip> {
        self.engine.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Grip {
    #[doc = doc!("Grip.state")]
    #[getter]
    fn state(&self, py: Python<'_>) -> &'static str {
        match self.lock(py).state() {
            GripState::Closing => "closing",
            GripState::Squeezing => "squeezing",
            GripState::Holding => "holding",
            GripState::Weak => "weak",
            GripState::Opening => "opening",
            GripState::Open => "open",
            GripState::Missed => "missed",
        }
    }

    #[doc = doc!("Grip.squeeze")]
    #[getter]
    fn squeeze(&self, py: Python<'_>) -> Real {
        self.lock(py).squeeze()
    }

    #[setter]
    fn set_squeeze(&self, py: Python<'_>, value: Real) -> PyResult<()> {
        self.lock(py).set_squeeze(value).or_raise(py)
    }

    #[doc = doc!("Grip.forces")]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let world = self.world.get().lock(py);
        let forces = self.lock(py).forces(&world).or_raise(py)?;
        Ok(conv::from_vec(py, forces))
    }

    #[doc = doc!("Grip.update")]
    fn update(&self, py: Python<'_>) -> PyResult<()> {
        // Always the world first: one order of locks.
        let mut world = self.world.get().lock(py);
        self.lock(py).update(&mut world).or_raise(py)
    }

    #[doc = doc!("Grip.hold")]
    fn hold(&self, py: Python<'_>) {
        self.lock(py).hold();
    }

    #[doc = doc!("Grip.open")]
    fn open(&self, py: Python<'_>) {
        self.lock(py).open();
    }

    #[doc = doc!("Grip.close")]
    fn close(&self, py: Python<'_>) {
        self.lock(py).close();
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("Grip({}, squeeze={} N)", self.state(py), self.squeeze(py))
    }
}

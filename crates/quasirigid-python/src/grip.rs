//! `Grip`: the controller that closes a hand.

use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::process::{ForkMutex, SharedWorld};
use numpy::PyArray1;
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::control::grip::GripState;
use quasirigid::math::Real;
use std::sync::MutexGuard;

#[doc = doc!("Grip")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Grip {
    pub(crate) world: SharedWorld,
    engine: ForkMutex<quasirigid::control::grip::Grip>,
}

impl Grip {
    /// Wraps a controller of a hand of `world`.
    pub fn new(world: SharedWorld, grip: quasirigid::control::grip::Grip) -> Self {
        Self { world, engine: ForkMutex::new("grip", grip) }
    }

    /// The controller.
    pub(crate) fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, quasirigid::control::grip::Grip>> {
        self.engine.lock(py)
    }
}

#[pymethods]
impl Grip {
    #[doc = doc!("Grip.state")]
    #[getter]
    fn state(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(match self.lock(py)?.state() {
            GripState::Closing => "closing",
            GripState::Squeezing => "squeezing",
            GripState::Holding => "holding",
            GripState::Weak => "weak",
            GripState::Opening => "opening",
            GripState::Open => "open",
            GripState::Missed => "missed",
        })
    }

    #[doc = doc!("Grip.squeeze")]
    #[getter]
    fn squeeze(&self, py: Python<'_>) -> PyResult<Real> {
        Ok(self.lock(py)?.squeeze())
    }

    #[setter]
    fn set_squeeze(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] value: Real) -> PyResult<()> {
        self.lock(py)?.set_squeeze(value).or_raise(py)
    }

    #[doc = doc!("Grip.forces")]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<Real>>> {
        let world = self.world.lock(py)?;
        let forces = self.lock(py)?.forces(&world).or_raise(py)?;
        Ok(conv::from_vec(py, forces))
    }

    #[doc = doc!("Grip.update")]
    fn update(&self, py: Python<'_>) -> PyResult<()> {
        // Always the world first: one order of locks.
        let mut world = self.world.lock(py)?;
        self.lock(py)?.update(&mut world).or_raise(py)
    }

    #[doc = doc!("Grip.hold")]
    fn hold(&self, py: Python<'_>) -> PyResult<()> {
        self.lock(py)?.hold();
        Ok(())
    }

    #[doc = doc!("Grip.open")]
    fn open(&self, py: Python<'_>) -> PyResult<()> {
        self.lock(py)?.open();
        Ok(())
    }

    #[doc = doc!("Grip.close")]
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.lock(py)?.close();
        Ok(())
    }

    #[doc = doc!("Grip.restore")]
    fn restore(&self, py: Python<'_>, earlier: &Self) -> PyResult<()> {
        // A copy, so that no two controllers are locked at once.
        let earlier = earlier.lock(py)?.clone();
        let world = self.world.lock(py)?;
        let mut here = self.lock(py)?;
        let restored = earlier.for_copy(&world).or_raise(py)?;
        if restored.hand() != here.hand() {
            let (expected, hint) = ("a Grip of the same hand, or of its copy", "give what copy.copy of this grip has made");
            return Err(to_py(py, &Error::handle("grip", expected, "one of another hand", hint)));
        }
        *here = restored;
        Ok(())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        match (self.state(py), self.squeeze(py)) {
            (Ok(state), Ok(squeeze)) => format!("Grip({state}, squeeze={squeeze} N)"),
            _ => "Grip(in use by another process)".into(),
        }
    }
}

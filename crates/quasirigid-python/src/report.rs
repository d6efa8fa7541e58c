//! `StepReport`.

use pyo3::exceptions::PyDeprecationWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quasirigid::gauss_seidel::Stop;
use quasirigid::math::Real;
use quasirigid::world::report::{PARTS, STAGES};
use std::time::Duration;

#[doc = doc!("StepReport")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct StepReport {
    pub(crate) engine: quasirigid::StepReport,
    pub(crate) quarantined: Vec<usize>,
    pub(crate) penetrated: Vec<(usize, usize)>,
}

/// What is stored of a report: that of the engine, and the bodies in it by their places.
pub type Stored = (quasirigid::StepReport, Vec<usize>, Vec<(usize, usize)>);

/// No step has taken longer, s: a sum of its times is a time.
const LONGEST: Duration = Duration::from_secs(1 << 40);

impl StepReport {
    /// What is stored.
    pub fn stored(&self) -> Stored {
        (self.engine.clone(), self.quarantined.clone(), self.penetrated.clone())
    }

    /// From what was stored.
    pub fn of_stored((engine, quarantined, penetrated): Stored) -> Result<Self, String> {
        if engine.times.stages().iter().chain(&engine.times.parts()).any(|time| *time > LONGEST) {
            return Err("a step that took longer than there is time".into());
        }
        Ok(Self { engine, quarantined, penetrated })
    }
}

#[pymethods]
impl StepReport {
    #[doc = doc!("StepReport.time")]
    #[getter]
    fn time(&self) -> Real {
        self.engine.time
    }

    #[doc = doc!("StepReport.contacts")]
    #[getter]
    fn contacts(&self) -> usize {
        self.engine.contacts
    }

    #[doc = doc!("StepReport.sweeps")]
    #[getter]
    fn sweeps(&self) -> u32 {
        self.engine.sweeps
    }

    #[doc = doc!("StepReport.newton_steps")]
    #[getter]
    fn newton_steps(&self) -> u32 {
        self.engine.newton_steps
    }

    #[doc = doc!("StepReport.residual")]
    #[getter]
    fn residual(&self) -> Real {
        self.engine.residual
    }

    #[getter]
    fn converged(&self) -> bool {
        self.engine.converged()
    }

    #[getter]
    fn stop_reason(&self) -> &'static str {
        stop_name(self.engine.stop)
    }

    #[doc = doc!("StepReport.stage_times")]
    #[getter]
    fn stage_times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        for (name, time) in STAGES.iter().zip(self.engine.times.stages()) {
            times.set_item(name, time.as_secs_f64())?;
        }
        Ok(times)
    }

    #[doc = doc!("StepReport.part_times")]
    #[getter]
    fn part_times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        for (name, time) in PARTS.iter().zip(self.engine.times.parts()) {
            times.set_item(name, time.as_secs_f64())?;
        }
        Ok(times)
    }

    #[doc = doc!("StepReport.step_time")]
    #[getter]
    fn step_time(&self) -> f64 {
        self.engine.times.total().as_secs_f64()
    }

    #[doc = doc!("StepReport.budget_exhausted")]
    #[getter]
    fn budget_exhausted(&self) -> bool {
        self.engine.budget_exhausted
    }

    #[doc = doc!("StepReport.coarse")]
    #[getter]
    fn coarse(&self, py: Python<'_>) -> PyResult<bool> {
        let warning = py.get_type::<PyDeprecationWarning>();
        PyErr::warn(py, &warning, c"StepReport.coarse is now budget_exhausted; the old name goes with the next release", 1)?;
        Ok(self.engine.budget_exhausted)
    }

    #[doc = doc!("StepReport.indentation")]
    #[getter]
    fn indentation(&self) -> f64 {
        self.engine.indentation
    }

    #[doc = doc!("StepReport.ill_posed")]
    #[getter]
    fn ill_posed(&self) -> usize {
        self.engine.ill_posed
    }

    #[doc = doc!("StepReport.quarantined")]
    #[getter]
    fn quarantined(&self) -> Vec<usize> {
        self.quarantined.clone()
    }

    #[doc = doc!("StepReport.penetrated")]
    #[getter]
    fn penetrated(&self) -> Vec<(usize, usize)> {
        self.penetrated.clone()
    }

    fn __repr__(&self) -> String {
        let r = &self.engine;
        let (stop, ms) = (self.stop_reason(), 1e3 * self.step_time());
        format!("StepReport(contacts={}, sweeps={}, residual={:.2e}, {stop}, {ms:.3} ms)", r.contacts, r.sweeps, r.residual)
    }
}

/// The name of a reason to stop.
pub fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Converged => "converged",
        Stop::SweepCap => "sweep-cap",
        Stop::Stagnated => "stagnated",
        Stop::TimeBudget => "time-budget",
        Stop::Interrupted => "interrupted",
        Stop::NonFinite => "non-finite",
    }
}

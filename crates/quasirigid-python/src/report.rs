//! `StepReport`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use quasirigid::gauss_seidel::Stop;
use quasirigid::math::Real;
use quasirigid::report::{PARTS, STAGES};

/// What a step did, and how well.
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct StepReport {
    pub(crate) engine: quasirigid::StepReport,
    pub(crate) quarantined: Vec<usize>,
}

#[pymethods]
impl StepReport {
    #[getter]
    fn time(&self) -> Real {
        self.engine.time
    }

    #[getter]
    fn contacts(&self) -> usize {
        self.engine.contacts
    }

    #[getter]
    fn sweeps(&self) -> u32 {
        self.engine.sweeps
    }

    #[getter]
    fn newton_steps(&self) -> u32 {
        self.engine.newton_steps
    }

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

    #[getter]
    fn stage_times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        for (name, time) in STAGES.iter().zip(self.engine.times.stages()) {
            times.set_item(name, time.as_secs_f64())?;
        }
        Ok(times)
    }

    #[getter]
    fn part_times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        for (name, time) in PARTS.iter().zip(self.engine.times.parts()) {
            times.set_item(name, time.as_secs_f64())?;
        }
        Ok(times)
    }

    #[getter]
    fn step_time(&self) -> f64 {
        self.engine.times.total().as_secs_f64()
    }

    #[getter]
    fn coarse(&self) -> bool {
        self.engine.coarse
    }

    #[getter]
    fn ill_posed(&self) -> usize {
        self.engine.ill_posed
    }

    #[getter]
    fn quarantined(&self) -> Vec<usize> {
        self.quarantined.clone()
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
        Stop::TimeBudget => "time-budget",
        Stop::Interrupted => "interrupted",
        Stop::NonFinite => "non-finite",
    }
}

//! `World`: the engine behind a lock, so that other Python threads may look at it while one steps.

use crate::body::Body;
use crate::collider::Collider;
use crate::contacts::Contacts;
use crate::conv;
use crate::errors::OrRaise;
use crate::friction_sides::sides;
use crate::hand::Hand;
use crate::process::{SharedWorld, WorldEngine};
use crate::report::StepReport;
use pyo3::prelude::*;
use quasirigid::math::Real;
use quasirigid::{ColliderHandle, Parameters};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often a long run of steps looks for Ctrl-C.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);

#[doc = doc!("World")]
#[pyclass(frozen, weakref, module = "quasirigid._quasirigid")]
pub struct World {
    engine: SharedWorld,
    report: Mutex<Option<Py<StepReport>>>,
}

impl World {
    /// The engine, waiting without the GIL if another thread steps it.
    pub fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, quasirigid::World>> {
        self.engine.lock(py)
    }

    /// A world around an engine, and what its last step said.
    pub fn of(engine: quasirigid::World, report: Option<Py<StepReport>>) -> Self {
        Self::around(WorldEngine::shared(engine), report)
    }

    /// Another `World` around the same engine.
    pub fn around(engine: SharedWorld, report: Option<Py<StepReport>>) -> Self {
        Self { engine, report: Mutex::new(report) }
    }

    /// The engine, for a handle that this world gives out.
    pub fn shared(this: &Bound<'_, Self>) -> PyResult<SharedWorld> {
        this.get().engine.belongs_to(this.as_any())?;
        Ok(this.get().engine.clone())
    }

    /// A handle to a collider that is there, and to what carries it.
    pub fn collider_handle(this: &Bound<'_, Self>, handle: ColliderHandle) -> PyResult<Collider> {
        let (py, world) = (this.py(), Self::shared(this)?);
        let (body, hand) = {
            let engine = world.lock(py)?;
            let body = engine.body_of(handle).or_raise(py)?;
            (body, engine.hand_of(body).or_raise(py)?)
        };
        let (owner, finger) = match hand {
            Some((hand, finger)) => (Py::new(py, Hand { world: world.clone(), handle: hand })?.into_any(), Some(finger)),
            None => (Py::new(py, Body { world: world.clone(), handle: body })?.into_any(), None),
        };
        Ok(Collider { world, handle, owner, finger })
    }

    /// What the last step said.
    pub fn last_report(&self, py: Python<'_>) -> Option<Py<StepReport>> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|report| report.clone_ref(py))
    }

    /// See [`World::last_report`].
    pub fn set_report(&self, report: Option<Py<StepReport>>) {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}

/// A time that steps may take, s. A time too long for the clock is no limit.
fn step_budget(py: Python<'_>, seconds: Option<Real>) -> PyResult<Option<Duration>> {
    let Some(seconds) = seconds else { return Ok(None) };
    quasirigid::error::check_positive("step_budget", seconds, "s").or_raise(py)?;
    // What is less than the clock can tell is still a limit.
    Ok(Duration::try_from_secs_f64(seconds).ok().map(|budget| budget.max(Duration::from_nanos(1))))
}

#[pymethods]
impl World {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (dt = 1e-3, gravity = None, *, threads = 1.into(), tolerance = 1e-8, max_sweeps = 1000.into(), time_budget = None,
                        traversal_budget = None, contact_margin = None, collision_every = 1.into(), push_out_speed = None,
                        friction_rule = "geometric-mean", step_budget = None),
           text_signature = "(dt=1e-3, gravity=(0.0, 0.0, -9.81), *, threads=1, tolerance=1e-8, max_sweeps=1000, time_budget=None, \
                             traversal_budget=None, contact_margin=None, collision_every=1, push_out_speed=None, \
                             friction_rule='geometric-mean', step_budget=None)")]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] dt: Real,
        gravity: Option<&Bound<'_, PyAny>>,
        threads: conv::Whole,
        #[pyo3(from_py_with = conv::real)] tolerance: Real,
        max_sweeps: conv::Whole,
        #[pyo3(from_py_with = conv::optional_real)] time_budget: Option<Real>,
        traversal_budget: Option<conv::Whole>,
        #[pyo3(from_py_with = conv::optional_real)] contact_margin: Option<Real>,
        collision_every: conv::Whole,
        #[pyo3(from_py_with = conv::optional_real)] push_out_speed: Option<Real>,
        #[pyo3(from_py_with = conv::text)] friction_rule: &str,
        #[pyo3(from_py_with = conv::optional_real)] step_budget: Option<Real>,
    ) -> PyResult<Self> {
        let mut params = Parameters { dt, friction_rule: crate::friction::rule(py, friction_rule)?, ..Parameters::default() };
        if let Some(gravity) = gravity {
            params.gravity = conv::vec3(gravity, "gravity")?;
        }
        params.threads = conv::count(py, "threads", threads)?;
        params.solver.tolerance = tolerance;
        params.solver.max_sweeps = conv::count_from(py, "max_sweeps", max_sweeps, 1)?.try_into().unwrap_or(u32::MAX);
        if let Some(budget) = time_budget {
            quasirigid::error::check_positive("time_budget", budget, "s").or_raise(py)?;
            params.solver.time_budget = Duration::try_from_secs_f64(budget).ok();
        }
        params.step_budget = self::step_budget(py, step_budget)?;
        if let Some(budget) = traversal_budget {
            params.traversal_budget = conv::count(py, "traversal_budget", budget)?;
        }
        if let Some(margin) = contact_margin {
            params.contact_margin = margin;
        }
        if let Some(speed) = push_out_speed {
            params.push_out_speed = speed;
        }
        params.collision_every = conv::count_from(py, "collision_every", collision_every, 1)?.try_into().unwrap_or(u32::MAX);
        Ok(Self::of(quasirigid::World::new(params).or_raise(py)?, None))
    }

    #[doc = doc!("World.dt")]
    #[getter]
    fn dt(&self, py: Python<'_>) -> PyResult<Real> {
        Ok(self.lock(py)?.parameters().dt)
    }

    #[doc = doc!("World.gravity")]
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let gravity = self.lock(py)?.parameters().gravity;
        conv::state("World.gravity", conv::from_vec3(py, &gravity))
    }

    #[setter]
    fn set_gravity(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let gravity = conv::vec3(value, "gravity")?;
        self.lock(value.py())?.set_gravity(gravity).or_raise(value.py())
    }

    #[doc = doc!("World.step_budget")]
    #[getter]
    fn step_budget(&self, py: Python<'_>) -> PyResult<Option<Real>> {
        Ok(self.lock(py)?.parameters().step_budget.map(|budget| budget.as_secs_f64()))
    }

    #[setter]
    fn set_step_budget(&self, py: Python<'_>, #[pyo3(from_py_with = conv::optional_real)] value: Option<Real>) -> PyResult<()> {
        let step_budget = self::step_budget(py, value)?;
        let mut engine = self.lock(py)?;
        let params = Parameters { step_budget, ..engine.parameters().clone() };
        engine.set_parameters(params).or_raise(py)
    }

    #[getter]
    fn friction_rule(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(crate::friction::rule_name(self.lock(py)?.parameters().friction_rule))
    }

    #[doc = doc!("World.time")]
    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<Real> {
        Ok(self.lock(py)?.time())
    }

    #[getter]
    fn steps(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.lock(py)?.steps())
    }

    #[doc = doc!("World.report")]
    #[getter]
    fn report(&self, py: Python<'_>) -> Option<Py<StepReport>> {
        self.last_report(py)
    }

    #[doc = doc!("World.quarantined")]
    #[getter]
    fn quarantined(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        let engine = self.lock(py)?;
        Ok(engine.bodies().iter().enumerate().filter(|(_, entry)| entry.quarantined).map(|(index, _)| index).collect())
    }

    #[doc = doc!("World.step")]
    #[pyo3(signature = (n = 1.into()), text_signature = "($self, n=1)")]
    fn step(&self, py: Python<'_>, n: conv::Whole) -> PyResult<Py<StepReport>> {
        let mut left = conv::count_from(py, "n", n, 1)?;
        let mut so_far = None;
        loop {
            self.engine.check(py)?;
            // The lock is taken and let go without the GIL: whoever waits for it holds nothing that this thread needs.
            let report = py.detach(|| {
                let mut engine = self.engine.lock_detached();
                let start = Instant::now();
                loop {
                    let mut report = engine.step();
                    if let Some(before) = so_far.take() {
                        report = report.after(before);
                    }
                    left -= 1;
                    if left == 0 || start.elapsed() > SIGNALS_EVERY {
                        let quarantined = report.quarantined.iter().filter_map(|&body| engine.dense(body).ok()).collect();
                        let dense = |&(a, b): &(_, _)| Some((engine.dense(a).ok()?, engine.dense(b).ok()?));
                        let penetrated = report.penetrated.iter().filter_map(dense).collect();
                        break StepReport { engine: report, quarantined, penetrated };
                    }
                    so_far = Some(report);
                }
            });
            so_far = (left > 0).then(|| report.engine.clone());
            let report = Py::new(py, report)?;
            self.set_report(Some(report.clone_ref(py)));
            py.check_signals()?;
            if left == 0 {
                return Ok(report);
            }
        }
    }

    #[doc = doc!("World.set_friction")]
    fn set_friction(
        this: &Bound<'_, Self>,
        a: &Bound<'_, PyAny>,
        b: &Bound<'_, PyAny>,
        friction: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let py = a.py();
        let friction = friction.map(crate::friction::friction).transpose()?;
        let mut engine = this.get().lock(py)?;
        let (a, b) = (sides(&this.get().engine, &engine, a)?, sides(&this.get().engine, &engine, b)?);
        for a in &a {
            for b in &b {
                engine.set_friction(a.clone(), b.clone(), friction).or_raise(py)?;
            }
        }
        Ok(())
    }

    #[doc = doc!("World.contacts")]
    fn contacts(&self, py: Python<'_>) -> PyResult<Contacts> {
        Ok(Contacts::of(&*self.lock(py)?))
    }

    #[doc = doc!("World.contact_problem")]
    #[pyo3(signature = (*, sparse = false))]
    fn contact_problem<'py>(&self, py: Python<'py>, sparse: bool) -> PyResult<Bound<'py, PyAny>> {
        crate::solver::contact_problem(py, &*self.lock(py)?, sparse)
    }

    #[doc = doc!("World.state_hash")]
    fn state_hash(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.lock(py)?.state_hash())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let Ok(engine) = self.lock(py) else { return "World(in use by another process)".into() };
        format!("World({} bodies, dt={}, time={:.6})", engine.bodies().len(), engine.parameters().dt, engine.time())
    }
}

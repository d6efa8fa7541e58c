//! `World`: the engine behind a lock, so that other Python threads may look at it while one steps.

use crate::body::Body;
use crate::contacts::Contacts;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::hand::Hand;
use crate::hand_model::HandModel;
use crate::mass_properties::MassProperties;
use crate::material::Material;
use crate::report::StepReport;
use crate::surface::Surface;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use quasirigid::body::{Amount, Motion, RigidBody};
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::surface::shapes;
use quasirigid::{Error, Parameters};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often a long run of steps looks for Ctrl-C.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);

#[doc = doc!("World")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct World {
    engine: Mutex<quasirigid::World>,
    report: Mutex<Option<Py<StepReport>>>,
}

impl World {
    /// The engine, waiting without the GIL if another thread steps it.
    pub fn lock(&self, py: Python<'_>) -> MutexGuard<'_, quasirigid::World> {
        self.engine.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
    }
}

fn motion(py: Python<'_>, name: &str, known: &str) -> PyResult<Option<Motion>> {
    match name {
        "inertial" => Ok(Some(Motion::Inertial)),
        "quasi-static" => Ok(Some(Motion::QuasiStatic)),
        "fixed" if known.contains("fixed") => Ok(None),
        other => Err(to_py(py, &Error::unknown("motion", known, format!("{other:?}"), "choose one of them"))),
    }
}

/// A time that steps may take, s. A time too long for the clock is no limit.
fn step_budget(py: Python<'_>, seconds: Option<Real>) -> PyResult<Option<Duration>> {
    let Some(seconds) = seconds else { return Ok(None) };
    quasirigid::error::check_positive("step_budget", seconds, "s").or_raise(py)?;
    // What is less than the clock can tell is still a limit.
    Ok(Duration::try_from_secs_f64(seconds).ok().map(|budget| budget.max(Duration::from_nanos(1))))
}

fn optional_pose(position: Option<&Bound<'_, PyAny>>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<Pose> {
    let position = position.map_or(Ok(Vec3::zeros()), |p| conv::vec3(p, "position"))?;
    let rotation = quaternion.map_or(Ok(Rot::identity()), |q| conv::quaternion(q, "quaternion"))?;
    Ok(Pose::from_parts(position.into(), rotation))
}

/// Mass properties given as such, or as a number with the inertia of the bounding box.
pub fn mass_properties(
    mass: Option<&Bound<'_, PyAny>>,
    surface: &quasirigid::surface::Surface,
    py: Python<'_>,
) -> PyResult<quasirigid::body::MassProperties> {
    let Some(mass) = mass else {
        let hint = "give mass=MassProperties... or a number, or motion=\"fixed\"";
        return Err(to_py(py, &Error::value("mass", "the mass of a body that is free to move", "none", hint)));
    };
    if let Ok(given) = mass.cast::<MassProperties>() {
        return Ok(given.get().engine);
    }
    let kg: Real = mass.extract().map_err(|_| {
        to_py(py, &Error::value("mass", "MassProperties or a number (kg)", mass.get_type(), "see MassProperties.box and its siblings"))
    })?;
    let points = &surface.points;
    let (low, high) = points.iter().fold((points[0], points[0]), |(low, high), p| (low.inf(p), high.sup(p)));
    let cuboid = quasirigid::body::MassProperties::cuboid(high - low, Amount::Mass(kg)).or_raise(py)?;
    cuboid.transformed(&Pose::from_parts(((low + high) * 0.5).into(), Rot::identity())).or_raise(py)
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
        dt: Real,
        gravity: Option<&Bound<'_, PyAny>>,
        threads: conv::Whole,
        tolerance: Real,
        max_sweeps: conv::Whole,
        time_budget: Option<Real>,
        traversal_budget: Option<conv::Whole>,
        contact_margin: Option<Real>,
        collision_every: conv::Whole,
        push_out_speed: Option<Real>,
        friction_rule: &str,
        step_budget: Option<Real>,
    ) -> PyResult<Self> {
        let mut params = Parameters { dt, friction_rule: crate::friction::rule(py, friction_rule)?, ..Parameters::default() };
        if let Some(gravity) = gravity {
            params.gravity = conv::vec3(gravity, "gravity")?;
        }
        params.threads = conv::count(py, "threads", threads)?;
        params.solver.tolerance = tolerance;
        params.solver.max_sweeps = conv::count(py, "max_sweeps", max_sweeps)?.try_into().unwrap_or(u32::MAX);
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
        params.collision_every = conv::count(py, "collision_every", collision_every)?.try_into().unwrap_or(u32::MAX);
        Ok(Self { engine: Mutex::new(quasirigid::World::new(params).or_raise(py)?), report: Mutex::new(None) })
    }

    #[doc = doc!("World.dt")]
    #[getter]
    fn dt(&self, py: Python<'_>) -> Real {
        self.lock(py).parameters().dt
    }

    #[doc = doc!("World.gravity")]
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        let gravity = self.lock(py).parameters().gravity;
        conv::from_vec3(py, &gravity)
    }

    #[setter]
    fn set_gravity(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let gravity = conv::vec3(value, "gravity")?;
        self.lock(value.py()).set_gravity(gravity).or_raise(value.py())
    }

    #[doc = doc!("World.step_budget")]
    #[getter]
    fn step_budget(&self, py: Python<'_>) -> Option<Real> {
        self.lock(py).parameters().step_budget.map(|budget| budget.as_secs_f64())
    }

    #[setter]
    fn set_step_budget(&self, py: Python<'_>, value: Option<Real>) -> PyResult<()> {
        let step_budget = self::step_budget(py, value)?;
        let mut engine = self.lock(py);
        let params = Parameters { step_budget, ..engine.parameters().clone() };
        engine.set_parameters(params).or_raise(py)
    }

    #[doc = doc!("World.bodies")]
    #[getter]
    fn bodies(this: &Bound<'_, Self>) -> Vec<Body> {
        let handles = this.get().lock(this.py()).rigid_bodies();
        handles.into_iter().map(|handle| Body { world: this.clone().unbind(), handle }).collect()
    }

    #[doc = doc!("World.hands")]
    #[getter]
    fn hands(this: &Bound<'_, Self>) -> Vec<Hand> {
        let handles = this.get().lock(this.py()).hand_handles();
        handles.into_iter().map(|handle| Hand { world: this.clone().unbind(), handle }).collect()
    }

    #[getter]
    fn friction_rule(&self, py: Python<'_>) -> &'static str {
        crate::friction::rule_name(self.lock(py).parameters().friction_rule)
    }

    #[doc = doc!("World.time")]
    #[getter]
    fn time(&self, py: Python<'_>) -> Real {
        self.lock(py).time()
    }

    #[getter]
    fn steps(&self, py: Python<'_>) -> u64 {
        self.lock(py).steps()
    }

    #[doc = doc!("World.report")]
    #[getter]
    fn report(&self, py: Python<'_>) -> Option<Py<StepReport>> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|report| report.clone_ref(py))
    }

    #[doc = doc!("World.quarantined")]
    #[getter]
    fn quarantined(&self, py: Python<'_>) -> Vec<usize> {
        let engine = self.lock(py);
        engine.bodies().iter().enumerate().filter(|(_, entry)| entry.quarantined).map(|(index, _)| index).collect()
    }

    #[doc = doc!("World.add_body")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (surface, material, *, mass = None, motion = "inertial", position = None, quaternion = None, name = None, viscosity = None),
           text_signature = "($self, surface, material, *, mass=None, motion='inertial', position=(0.0, 0.0, 0.0), \
                             quaternion=(1.0, 0.0, 0.0, 0.0), name=None, viscosity=None)")]
    fn add_body(
        this: &Bound<'_, Self>,
        surface: &Surface,
        material: &Material,
        mass: Option<&Bound<'_, PyAny>>,
        motion: &str,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
        viscosity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Body> {
        let py = this.py();
        let pose = optional_pose(position, quaternion)?;
        let name = name.unwrap_or_else(|| "body".into());
        let mut body = match self::motion(py, motion, "\"inertial\", \"quasi-static\" or \"fixed\"")? {
            Some(motion) => RigidBody::free(name, mass_properties(mass, &surface.engine, py)?, motion, pose),
            None => RigidBody::fixed(name, pose),
        }
        .or_raise(py)?;
        if let Some(viscosity) = viscosity {
            let (linear, angular) = conv::pair(viscosity, "viscosity")?;
            body.set_viscosity(linear, angular).or_raise(py)?;
        }
        let handle = this.get().lock(py).add_body(body, Some((surface.engine.clone(), material.engine.clone()))).or_raise(py)?;
        Ok(Body { world: this.clone().unbind(), handle })
    }

    #[doc = doc!("World.add_hand")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (model = None, *, position = None, quaternion = None, material = None, motion = "inertial", points = 2400.into(),
                        control_points = 320.into()),
           text_signature = "($self, model=None, *, position=(0.0, 0.0, 0.0), quaternion=(1.0, 0.0, 0.0, 0.0), material=None, \
                             motion='inertial', points=2400, control_points=320)")]
    fn add_hand(
        this: &Bound<'_, Self>,
        model: Option<&HandModel>,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        material: Option<&Material>,
        motion: &str,
        points: conv::Whole,
        control_points: conv::Whole,
    ) -> PyResult<Hand> {
        let py = this.py();
        let model = match model {
            Some(model) => model.engine.clone(),
            None => quasirigid::body::HandModel::three_finger().or_raise(py)?,
        };
        let material = match material {
            Some(material) => material.engine.clone(),
            None => quasirigid::body::Material::preset("fingertip_pulp").or_raise(py)?,
        };
        let pose = optional_pose(position, quaternion)?;
        let motion = self::motion(py, motion, "\"inertial\" or \"quasi-static\"")?.unwrap_or(Motion::Inertial);
        let pad = shapes::sample_fingertip(model.tips()[0].pad_semi_axes, conv::count(py, "points", points)?).or_raise(py)?;
        let control_points = Some(conv::count(py, "control_points", control_points)?);
        let handle = this.get().lock(py).add_hand(&model, pose, motion, &pad, control_points, &material).or_raise(py)?;
        Ok(Hand { world: this.clone().unbind(), handle })
    }

    #[doc = doc!("World.remove")]
    fn remove(&self, py: Python<'_>, handle: &Bound<'_, PyAny>) -> PyResult<()> {
        if let Ok(body) = handle.cast::<Body>() {
            return self.lock(py).remove_body(body.get().handle).or_raise(py);
        }
        if let Ok(hand) = handle.cast::<Hand>() {
            return self.lock(py).remove_hand(hand.get().handle).or_raise(py);
        }
        Err(to_py(py, &Error::handle("remove", "a Body or a Hand", handle.get_type(), "give what add_body or add_hand returned")))
    }

    #[doc = doc!("World.step")]
    #[pyo3(signature = (n = 1.into()), text_signature = "($self, n=1)")]
    fn step(&self, py: Python<'_>, n: conv::Whole) -> PyResult<Py<StepReport>> {
        let mut left = conv::count(py, "n", n)?;
        if left == 0 {
            return Err(to_py(py, &Error::value("n", "at least 1 step", 0, "ask for a step to get a report")));
        }
        let mut so_far = None;
        loop {
            // The lock is taken and let go without the GIL: whoever waits for it holds nothing that this thread needs.
            let report = py.detach(|| {
                let mut engine = self.engine.lock().unwrap_or_else(PoisonError::into_inner);
                let start = Instant::now();
                loop {
                    let mut report = engine.step();
                    if let Some(before) = so_far.take() {
                        report = report.after(before);
                    }
                    left -= 1;
                    if left == 0 || start.elapsed() > SIGNALS_EVERY {
                        let quarantined = report.quarantined.iter().filter_map(|&body| engine.dense(body).ok()).collect();
                        break StepReport { engine: report, quarantined };
                    }
                    so_far = Some(report);
                }
            });
            so_far = (left > 0).then(|| report.engine.clone());
            let report = Py::new(py, report)?;
            *self.report.lock().unwrap_or_else(PoisonError::into_inner) = Some(report.clone_ref(py));
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
        let mut engine = this.get().lock(py);
        let (a, b) = (crate::friction::sides(this, &engine, a)?, crate::friction::sides(this, &engine, b)?);
        for a in &a {
            for b in &b {
                engine.set_friction(a.clone(), b.clone(), friction).or_raise(py)?;
            }
        }
        Ok(())
    }

    #[doc = doc!("World.contacts")]
    fn contacts(&self, py: Python<'_>) -> Contacts {
        Contacts::of(&self.lock(py))
    }

    #[doc = doc!("World.contact_problem")]
    #[pyo3(signature = (*, sparse = false))]
    fn contact_problem<'py>(&self, py: Python<'py>, sparse: bool) -> PyResult<Bound<'py, PyAny>> {
        crate::solver::contact_problem(py, &self.lock(py), sparse)
    }

    #[doc = doc!("World.state_hash")]
    fn state_hash(&self, py: Python<'_>) -> u64 {
        self.lock(py).state_hash()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let engine = self.lock(py);
        format!("World({} bodies, dt={}, time={:.6})", engine.bodies().len(), engine.parameters().dt, engine.time())
    }
}

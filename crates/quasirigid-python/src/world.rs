//! `World`: the engine behind a lock, so that other Python threads may look at it while one steps.

use crate::body::Body;
use crate::collider::{Collider, groups};
use crate::contacts::Contacts;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::friction_sides::sides;
use crate::hand::Hand;
use crate::hand_model::HandModel;
use crate::mass_properties::mass_properties;
use crate::material::Material;
use crate::process::{SharedWorld, WorldEngine};
use crate::report::StepReport;
use crate::surface::Surface;
use pyo3::prelude::*;
use quasirigid::body::{Motion, RigidBody};
use quasirigid::collider::Filter;
use quasirigid::math::{Pose, Real, Rot, Vec3};
use quasirigid::world::Pads;
use quasirigid::{ColliderHandle, Error, Parameters};
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

impl World {
    /// Applies `change` to every pair of a collider of `a` and one of `b`.
    fn each_pair(
        &self,
        a: &Bound<'_, PyAny>,
        b: &Bound<'_, PyAny>,
        change: impl Fn(&mut quasirigid::World, ColliderHandle, ColliderHandle) -> quasirigid::Result<()>,
    ) -> PyResult<()> {
        let py = a.py();
        let mut engine = self.lock(py)?;
        let (of_a, of_b) = (colliders_of(&engine, a)?, colliders_of(&engine, b)?);
        of_a.iter().flat_map(|&a| of_b.iter().map(move |&b| (a, b))).try_for_each(|(a, b)| change(&mut engine, a, b)).or_raise(py)
    }
}

/// A collider, or those that a body or the fingers of a hand have now.
fn colliders_of(engine: &quasirigid::World, value: &Bound<'_, PyAny>) -> PyResult<Vec<ColliderHandle>> {
    let py = value.py();
    if let Ok(collider) = value.cast::<Collider>() {
        return Ok(vec![collider.get().handle]);
    }
    if let Ok(body) = value.cast::<Body>() {
        return engine.colliders_of(body.get().handle).or_raise(py);
    }
    if let Ok(hand) = value.cast::<Hand>() {
        let fingers = &engine.hand(hand.get().handle).or_raise(py)?.fingers;
        let colliders: quasirigid::Result<Vec<_>> = fingers.iter().map(|&finger| engine.colliders_of(finger)).collect();
        return colliders.map(|colliders| colliders.concat()).or_raise(py);
    }
    Err(to_py(py, &Error::handle("pair", "a Collider, a Body or a Hand", value.get_type(), "name the two that are not to touch")))
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

    #[doc = doc!("World.bodies")]
    #[getter]
    fn bodies(this: &Bound<'_, Self>) -> PyResult<Vec<Body>> {
        let (handles, world) = (this.get().lock(this.py())?.rigid_bodies(), Self::shared(this)?);
        Ok(handles.into_iter().map(|handle| Body { world: world.clone(), handle }).collect())
    }

    #[doc = doc!("World.hands")]
    #[getter]
    fn hands(this: &Bound<'_, Self>) -> PyResult<Vec<Hand>> {
        let (handles, world) = (this.get().lock(this.py())?.hand_handles(), Self::shared(this)?);
        Ok(handles.into_iter().map(|handle| Hand { world: world.clone(), handle }).collect())
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
        #[pyo3(from_py_with = conv::text)] motion: &str,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::optional_text)] name: Option<&str>,
        viscosity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Body> {
        let py = this.py();
        let pose = optional_pose(position, quaternion)?;
        let name = name.unwrap_or("body");
        let mut body = match self::motion(py, motion, "\"inertial\", \"quasi-static\" or \"fixed\"")? {
            Some(motion) => RigidBody::free(name, mass_properties(mass, &surface.engine, py)?, motion, pose),
            None => RigidBody::fixed(name, pose),
        }
        .or_raise(py)?;
        if let Some(viscosity) = viscosity {
            let (linear, angular) = conv::pair(viscosity, "viscosity")?;
            body.set_viscosity(linear, angular).or_raise(py)?;
        }
        let handle = this.get().lock(py)?.add_body(body, Some((surface.engine.clone(), material.engine.clone()))).or_raise(py)?;
        Ok(Body { world: Self::shared(this)?, handle })
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
        #[pyo3(from_py_with = conv::text)] motion: &str,
        points: conv::Whole,
        control_points: conv::Whole,
    ) -> PyResult<Hand> {
        let py = this.py();
        let model = match model {
            Some(model) => model.engine.clone(),
            None => quasirigid::body::HandModel::three_finger().or_raise(py)?,
        };
        let pose = optional_pose(position, quaternion)?;
        let motion = self::motion(py, motion, "\"inertial\" or \"quasi-static\"")?.unwrap_or(Motion::Inertial);
        let mut pads = Pads::usual().or_raise(py)?;
        if let Some(material) = material {
            pads.material = material.engine.clone();
        }
        pads.points = conv::count(py, "points", points)?;
        pads.control_points = conv::count(py, "control_points", control_points)?;
        let handle = this.get().lock(py)?.add_hand_with_pads(&model, pose, motion, &pads).or_raise(py)?;
        Ok(Hand { world: Self::shared(this)?, handle })
    }

    #[doc = doc!("World.remove")]
    fn remove(&self, py: Python<'_>, handle: &Bound<'_, PyAny>) -> PyResult<()> {
        if let Ok(body) = handle.cast::<Body>() {
            return self.lock(py)?.remove_body(body.get().handle).or_raise(py);
        }
        if let Ok(hand) = handle.cast::<Hand>() {
            return self.lock(py)?.remove_hand(hand.get().handle).or_raise(py);
        }
        if let Ok(collider) = handle.cast::<Collider>() {
            return self.lock(py)?.remove_collider(collider.get().handle).or_raise(py);
        }
        let hint = "give what add_body, add_hand or add_collider returned";
        Err(to_py(py, &Error::handle("remove", "a Body, a Hand or a Collider", handle.get_type(), hint)))
    }

    #[doc = doc!("World.colliders")]
    #[getter]
    fn colliders(this: &Bound<'_, Self>) -> PyResult<Vec<Collider>> {
        let py = this.py();
        let handles = this.get().lock(py)?.colliders();
        handles.into_iter().map(|handle| Self::collider_handle(this, handle)).collect()
    }

    #[doc = doc!("World.add_collider")]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (body, surface, material, *, link = 0.into(), finger = None, group = 1.into(), mask = 0xffff_ffff.into()),
           text_signature = "($self, body, surface, material, *, link=0, finger=None, group=1, mask=0xffffffff)")]
    fn add_collider(
        this: &Bound<'_, Self>,
        body: &Bound<'_, PyAny>,
        surface: &Surface,
        material: &Material,
        link: conv::Whole,
        finger: Option<conv::Whole>,
        group: conv::Whole,
        mask: conv::Whole,
    ) -> PyResult<Collider> {
        let py = this.py();
        let filter = Filter { group: groups(py, "group", group)?, mask: groups(py, "mask", mask)? };
        let link = conv::count(py, "link", link)?;
        let finger = finger.map(|finger| conv::count(py, "finger", finger)).transpose()?;
        let mut engine = this.get().lock(py)?;
        let wrong =
            |expected, got: String| Err(to_py(py, &Error::handle("add_collider", expected, got, "say whom the surface is fixed to")));
        let on = match (body.cast::<Body>(), body.cast::<Hand>(), finger) {
            (Ok(body), _, None) => body.get().handle,
            (_, Ok(hand), Some(finger)) => engine.finger_handle(hand.get().handle, finger).or_raise(py)?,
            (Ok(_), _, Some(finger)) => return wrong("a Hand with finger=", format!("a Body with finger={finger}")),
            (_, Ok(_), None) => return wrong("a Hand with finger=", "a Hand without".into()),
            _ => return wrong("a Body, or a Hand with finger=", body.get_type().to_string()),
        };
        let handle = engine.add_collider(on, link, surface.engine.clone(), material.engine.clone(), filter).or_raise(py)?;
        Ok(Collider { world: Self::shared(this)?, handle, owner: body.clone().unbind(), finger })
    }

    #[doc = doc!("World.exclude")]
    fn exclude(&self, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<()> {
        self.each_pair(a, b, quasirigid::World::exclude_pair)
    }

    #[doc = doc!("World.include")]
    fn include(&self, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<()> {
        self.each_pair(a, b, quasirigid::World::include_pair)
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

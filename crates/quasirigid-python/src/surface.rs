//! `Surface`.

use crate::conv;
use crate::errors::OrRaise;
use crate::value::{Value, from_cbor, to_cbor, value};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use quasirigid::interrupt::Interrupt;
use quasirigid::math::Real;
use quasirigid::surface::{PointSurface, SurfaceSource, check_memory, screen_cloud, shapes};
use std::ffi::CString;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

#[doc = doc!("Surface")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Surface {
    pub(crate) engine: Arc<quasirigid::surface::Surface>,
}

impl Surface {
    /// A surface of what `sample` gives. It is made by a thread of its own, so that Ctrl-C ends it.
    fn build<F>(py: Python<'_>, control_points: Option<conv::Whole>, sample: F) -> PyResult<Self>
    where
        F: FnOnce(&Interrupt) -> quasirigid::Result<PointSurface> + Send + 'static,
    {
        let control_points = control_points.map(|n| conv::count(py, "control_points", n)).transpose()?;
        let (engine, notes) = interruptible(py, move |interrupt| {
            let surface = sample(interrupt)?;
            let mut notes = surface.findings().notes();
            let engine = quasirigid::surface::Surface::build_until(surface, control_points, interrupt)?;
            notes.extend(engine.note());
            Ok((engine, notes))
        })?;
        warn(py, &notes)?;
        Ok(Self { engine: Arc::new(engine) })
    }
}

/// How often a signal is looked for while the engine works.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);

/// The result of `work`, which runs in a thread of its own; or what a signal handler raises, `KeyboardInterrupt` as a rule. Then `work` is interrupted, and
/// what it has made so far is dropped.
fn interruptible<T, F>(py: Python<'_>, work: F) -> PyResult<T>
where
    T: Send + 'static,
    F: FnOnce(&Interrupt) -> quasirigid::Result<T> + Send + 'static,
{
    let interrupt = Arc::new(Interrupt::default());
    let (flag, (sender, mut receiver)) = (Arc::clone(&interrupt), mpsc::channel());
    let worker = std::thread::Builder::new().name("surface".into()).spawn(move || {
        // Nobody listens any more after an interrupt.
        let _ = sender.send(work(&flag));
    })?;
    loop {
        let result;
        (receiver, result) = py.detach(move || {
            let result = receiver.recv_timeout(SIGNALS_EVERY);
            (receiver, result)
        });
        match result {
            Ok(result) => return result.or_raise(py),
            Err(RecvTimeoutError::Timeout) => py.check_signals().inspect_err(|_| interrupt.raise())?,
            Err(RecvTimeoutError::Disconnected) => match worker.join() {
                Err(panic) => std::panic::resume_unwind(panic),
                Ok(()) => return Err(PyRuntimeError::new_err("the surface was not made")),
            },
        }
    }
}

/// A `SurfaceWarning` for each note, at the line that called.
fn warn(py: Python<'_>, notes: &[String]) -> PyResult<()> {
    if notes.is_empty() {
        return Ok(());
    }
    let category = py.import("quasirigid.errors")?.getattr("SurfaceWarning")?;
    notes.iter().try_for_each(|note| PyErr::warn(py, &category, &CString::new(note.as_str())?, 1))
}

/// Rows of an array-like before it is copied, if it says.
fn check_rows(py: Python<'_>, value: &Bound<'_, PyAny>) -> PyResult<()> {
    value.len().map_or(Ok(()), |rows| check_memory(rows).or_raise(py))
}

/// Looks for stray points and checks normals: positions of the points that are part of the surface, their normals if they are such, and a note on whatever was met.
#[pyfunction]
#[pyo3(signature = (points, normals = None, /))]
pub fn _screen_cloud<'py>(py: Python<'py>, points: &Bound<'py, PyAny>, normals: Option<&Bound<'py, PyAny>>) -> PyResult<Screening<'py>> {
    let points = conv::points(points, "points")?;
    let normals = normals.map(|n| conv::points(n, "normals")).transpose()?;
    let found = interruptible(py, move |interrupt| screen_cloud(points, normals, interrupt))?;
    let normals = found.normals.map(|normals| conv::from_points(py, normals)).transpose()?;
    Ok((conv::from_vec(py, found.kept), normals, found.findings.notes()))
}

type Screening<'py> = (Bound<'py, PyArray1<u32>>, Option<Bound<'py, PyArray2<Real>>>, Vec<String>);

#[pymethods]
impl Surface {
    #[doc = doc!("Surface.box")]
    #[staticmethod]
    #[pyo3(name = "box", signature = (size, *, points, control_points = None))]
    fn cuboid(py: Python<'_>, size: &Bound<'_, PyAny>, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        let (size, n) = (conv::vec3(size, "size")?, conv::count(py, "points", points)?);
        Self::build(py, control_points, move |_| shapes::sample_box(size, n))
    }

    #[doc = doc!("Surface.sphere")]
    #[staticmethod]
    #[pyo3(signature = (radius, *, points, control_points = None))]
    fn sphere(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        points: conv::Whole,
        control_points: Option<conv::Whole>,
    ) -> PyResult<Self> {
        let n = conv::count(py, "points", points)?;
        Self::build(py, control_points, move |_| shapes::sample_sphere(radius, n))
    }

    #[doc = doc!("Surface.capsule")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, points, control_points = None))]
    fn capsule(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        #[pyo3(from_py_with = conv::real)] length: Real,
        points: conv::Whole,
        control_points: Option<conv::Whole>,
    ) -> PyResult<Self> {
        let n = conv::count(py, "points", points)?;
        Self::build(py, control_points, move |_| shapes::sample_capsule(radius, length, n))
    }

    #[doc = doc!("Surface.cylinder")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, points, control_points = None))]
    fn cylinder(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        #[pyo3(from_py_with = conv::real)] length: Real,
        points: conv::Whole,
        control_points: Option<conv::Whole>,
    ) -> PyResult<Self> {
        let n = conv::count(py, "points", points)?;
        Self::build(py, control_points, move |_| shapes::sample_cylinder(radius, length, n))
    }

    #[doc = doc!("Surface.half_space")]
    #[staticmethod]
    #[pyo3(signature = (side, *, points, control_points = None))]
    fn half_space(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] side: Real,
        points: conv::Whole,
        control_points: Option<conv::Whole>,
    ) -> PyResult<Self> {
        let n = conv::count(py, "points", points)?;
        Self::build(py, control_points, move |_| shapes::sample_half_space(side, n))
    }

    #[doc = doc!("Surface.fingertip")]
    #[staticmethod]
    #[pyo3(signature = (semi_axes, *, points = 2400.into(), control_points = Some(320.into())), text_signature = "(semi_axes, *, points=2400, control_points=320)")]
    fn fingertip(py: Python<'_>, semi_axes: &Bound<'_, PyAny>, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        let (axes, n) = (conv::vec3(semi_axes, "semi_axes")?, conv::count(py, "points", points)?);
        Self::build(py, control_points, move |_| shapes::sample_fingertip(axes, n))
    }

    #[doc = doc!("Surface.from_points")]
    #[staticmethod]
    #[pyo3(signature = (points, normals = None, areas = None, *, control_points = None))]
    fn from_points(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        normals: Option<&Bound<'_, PyAny>>,
        areas: Option<&Bound<'_, PyAny>>,
        control_points: Option<conv::Whole>,
    ) -> PyResult<Self> {
        check_rows(py, points)?;
        let points = conv::points(points, "points")?;
        let normals = normals.map(|n| conv::points(n, "normals")).transpose()?;
        let areas = areas.map(|a| conv::vector(a, "areas")).transpose()?;
        Self::build(py, control_points, move |interrupt| PointSurface::from_cloud(points, normals, areas, interrupt))
    }

    #[doc = doc!("Surface.points")]
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.engine.in_callers_order(&self.engine.points))
    }

    #[doc = doc!("Surface.normals")]
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.engine.in_callers_order(&self.engine.normals))
    }

    #[doc = doc!("Surface.areas")]
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.engine.in_callers_order(&self.engine.areas))
    }

    #[doc = doc!("Surface.control_points")]
    #[getter]
    fn control_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.engine.control.points.iter().copied())
    }

    #[doc = doc!("Surface.control_normals")]
    #[getter]
    fn control_normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.engine.control.normals.iter().copied())
    }

    #[doc = doc!("Surface.control_areas")]
    #[getter]
    fn control_areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.engine.control.areas.clone())
    }

    #[doc = doc!("Surface.area")]
    #[getter]
    fn area(&self) -> Real {
        self.engine.total_area()
    }

    #[doc = doc!("Surface.spacing")]
    #[getter]
    fn spacing(&self) -> Real {
        self.engine.spacing
    }

    #[doc = doc!("Surface.unresolved")]
    #[getter]
    fn unresolved(&self) -> usize {
        self.engine.unresolved
    }

    #[doc = doc!("Surface.__len__")]
    fn __len__(&self) -> usize {
        self.engine.len()
    }

    fn __repr__(&self) -> String {
        format!("Surface({} points, {} control points, {:.3e} m^2)", self.engine.len(), self.engine.control.len(), self.area())
    }
}

impl Value for Surface {
    const NAME: &'static str = "Surface";

    fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.engine, &other.engine) || self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let s = &self.engine;
        [s.len() as Real, s.control.len() as Real, s.spacing].iter().chain(&s.points[0]).copied().collect()
    }

    /// What it is built of: a tenth of its size. To build it anew takes as long as it took to make.
    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.engine.source())
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let source: SurfaceSource = from_cbor(bytes)?;
        let engine = source.build().map_err(|error| error.to_string())?;
        Ok(Self { engine: Arc::new(engine) })
    }
}

value!(Surface);

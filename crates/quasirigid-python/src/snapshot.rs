//! `Snapshot`, and copies of worlds.

use crate::copies::{Reduced, damaged};
use crate::errors::OrRaise;
use crate::report::StepReport;
use crate::value::{from_cbor, to_cbor};
use crate::world::World;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use std::sync::Arc;

#[doc = doc!("Snapshot")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Snapshot {
    engine: Arc<quasirigid::Snapshot>,
    /// `World.report` at that time.
    report: Option<Py<StepReport>>,
}

impl Snapshot {
    /// The state of a world.
    fn of(py: Python<'_>, world: &World) -> PyResult<Self> {
        let engine = Arc::new(world.lock(py)?.snapshot());
        Ok(Self { engine, report: world.last_report(py) })
    }

    fn new_world(&self, py: Python<'_>) -> PyResult<World> {
        let engine = quasirigid::World::from_snapshot(&self.engine).or_raise(py)?;
        Ok(World::of(engine, self.report.as_ref().map(|report| report.clone_ref(py))))
    }

    fn write(&self, py: Python<'_>) -> PyResult<Vec<u8>> {
        let engine = self.engine.clone();
        let mut bytes = py.detach(move || engine.to_bytes()).or_raise(py)?;
        let report = self.report.as_ref().map(|report| report.get().stored());
        bytes.extend(to_cbor(&report).map_err(|why| damaged(py, &why))?);
        Ok(bytes)
    }

    fn read(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        // The bytes belong to an object that Python holds while this runs.
        let (engine, rest) = py
            .detach(|| {
                let mut rest = bytes;
                quasirigid::Snapshot::read(&mut rest).map(|engine| (engine, rest))
            })
            .or_raise(py)?;
        let report = from_cbor::<Option<crate::report::Stored>>(rest).and_then(|stored| stored.map(StepReport::of_stored).transpose());
        let report = report.map_err(|why| damaged(py, &why))?.map(|report| Py::new(py, report)).transpose()?;
        Ok(Self { engine: Arc::new(engine), report })
    }
}

#[pymethods]
impl Snapshot {
    #[doc = doc!("Snapshot.time")]
    #[getter]
    fn time(&self) -> f64 {
        self.engine.time()
    }

    #[doc = doc!("Snapshot.steps")]
    #[getter]
    fn steps(&self) -> u64 {
        self.engine.steps()
    }

    #[doc = doc!("Snapshot.nbytes")]
    #[getter]
    fn nbytes(&self) -> usize {
        self.engine.memory()
    }

    #[doc = doc!("Snapshot.to_bytes")]
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.write(py)?))
    }

    #[doc = doc!("Snapshot.from_bytes")]
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        Self::read(py, data)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        Self::read(py, data)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Reduced<'py, (Bound<'py, PyBytes>,)>> {
        Ok((this.get_type().getattr("_unpickled")?, (this.get().to_bytes(this.py())?,)))
    }

    fn __eq__(&self, py: Python<'_>, other: Py<Self>) -> bool {
        let (here, there) = (self.engine.clone(), other.get().engine.clone());
        py.detach(move || Arc::ptr_eq(&here, &there) || here == there)
    }

    // The usual one asks for the truth of what `==` says, and an array that is compared with has none.
    fn __ne__(&self, py: Python<'_>, other: Py<Self>) -> bool {
        !self.__eq__(py, other)
    }

    fn __hash__(&self) -> u64 {
        self.engine.content_hash()
    }

    fn __copy__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __deepcopy__(this: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        this
    }

    fn __repr__(&self) -> String {
        let engine = &self.engine;
        format!("Snapshot({} bodies, time={:.6}, steps={})", engine.body_count(), engine.time(), engine.steps())
    }
}

#[pymethods]
impl World {
    #[doc = doc!("World.snapshot")]
    fn snapshot(&self, py: Python<'_>) -> PyResult<Snapshot> {
        Snapshot::of(py, self)
    }

    #[doc = doc!("World.restore")]
    fn restore(&self, py: Python<'_>, snapshot: &Snapshot) -> PyResult<()> {
        self.lock(py)?.restore(&snapshot.engine);
        self.set_report(snapshot.report.as_ref().map(|report| report.clone_ref(py)));
        Ok(())
    }

    #[doc = doc!("World.from_snapshot")]
    #[staticmethod]
    fn from_snapshot(py: Python<'_>, snapshot: &Snapshot) -> PyResult<Self> {
        snapshot.new_world(py)
    }

    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        Snapshot::of(py, self)?.new_world(py)
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__(py)
    }

    #[classmethod]
    fn _unpickled(_class: &Bound<'_, PyType>, py: Python<'_>, snapshot: &Snapshot) -> PyResult<Self> {
        snapshot.new_world(py)
    }

    fn __reduce__<'py>(this: &Bound<'py, Self>) -> PyResult<Reduced<'py, (Snapshot,)>> {
        Ok((this.get_type().getattr("_unpickled")?, (Snapshot::of(this.py(), this.get())?,)))
    }
}

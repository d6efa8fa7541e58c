//! `Collider`: a handle to a surface on a link of a body.

use crate::conv;
use crate::errors::OrRaise;
use crate::material::Material;
use crate::process::SharedWorld;
use crate::skin::{deformed_points, displacements, material, moved_points, surface};
use crate::surface::Surface;
use numpy::PyArray2;
use pyo3::prelude::*;
use quasirigid::ColliderHandle;
use quasirigid::collider::Filter;
use quasirigid::math::Real;
use quasirigid::objects::Side;

#[doc = doc!("Collider")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Collider {
    pub(crate) world: SharedWorld,
    pub(crate) handle: ColliderHandle,
    /// The `Body` or the `Hand` that carries it, and which finger of the hand.
    pub(crate) owner: Py<PyAny>,
    pub(crate) finger: Option<usize>,
}

impl Collider {
    fn read<T>(&self, py: Python<'_>, of: impl FnOnce(Side<'_>) -> T) -> PyResult<T> {
        let world = self.world.lock(py)?;
        world.side(self.handle).map(of).or_raise(py)
    }

    fn change_filter(&self, py: Python<'_>, change: impl FnOnce(&mut Filter)) -> PyResult<()> {
        let mut world = self.world.lock(py)?;
        let mut filter = world.collider(self.handle).or_raise(py)?.filter;
        change(&mut filter);
        world.set_filter(self.handle, filter).or_raise(py)
    }
}

/// A set of groups from Python.
pub fn groups(py: Python<'_>, what: &str, value: conv::Whole) -> PyResult<u32> {
    Ok(conv::within(py, what, value, 0, u32::MAX.into())? as u32)
}

#[pymethods]
impl Collider {
    #[doc = doc!("Collider.id")]
    #[getter]
    fn id(&self, py: Python<'_>) -> PyResult<u32> {
        self.read(py, |_| self.handle.slot())
    }

    #[doc = doc!("Collider.body")]
    #[getter]
    fn body(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.read(py, |_| ())?;
        Ok(self.owner.clone_ref(py))
    }

    #[doc = doc!("Collider.finger")]
    #[getter]
    fn finger(&self) -> Option<usize> {
        self.finger
    }

    #[doc = doc!("Collider.link")]
    #[getter]
    fn link(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |side| side.collider.link)
    }

    #[doc = doc!("Collider.surface")]
    #[getter]
    fn surface(&self, py: Python<'_>) -> PyResult<Surface> {
        self.read(py, surface)
    }

    #[doc = doc!("Collider.material")]
    #[getter]
    fn material(&self, py: Python<'_>) -> PyResult<Material> {
        self.read(py, material)
    }

    #[setter]
    fn set_material(&self, py: Python<'_>, value: &Material) -> PyResult<()> {
        self.world.lock(py)?.set_collider_material(self.handle, &value.engine).or_raise(py)
    }

    #[doc = doc!("Collider.group")]
    #[getter]
    fn group(&self, py: Python<'_>) -> PyResult<u32> {
        self.read(py, |side| side.collider.filter.group)
    }

    #[setter]
    fn set_group(&self, py: Python<'_>, value: conv::Whole) -> PyResult<()> {
        let group = groups(py, "group", value)?;
        self.change_filter(py, |filter| filter.group = group)
    }

    #[doc = doc!("Collider.mask")]
    #[getter]
    fn mask(&self, py: Python<'_>) -> PyResult<u32> {
        self.read(py, |side| side.collider.filter.mask)
    }

    #[setter]
    fn set_mask(&self, py: Python<'_>, value: conv::Whole) -> PyResult<()> {
        let mask = groups(py, "mask", value)?;
        self.change_filter(py, |filter| filter.mask = mask)
    }

    #[doc = doc!("Collider.deformed_points")]
    fn deformed_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let points = self.read(py, deformed_points)?;
        conv::from_points(py, points)
    }

    #[doc = doc!("Collider.moved_points")]
    fn moved_points<'py>(&self, py: Python<'py>) -> PyResult<conv::Numbered<'py>> {
        let moved = self.read(py, moved_points)?;
        conv::from_numbered(py, moved)
    }

    #[doc = doc!("Collider.displacements")]
    fn displacements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let values = self.read(py, displacements)?;
        conv::from_points(py, values)
    }

    #[doc = doc!("Collider.remove")]
    fn remove(&self, py: Python<'_>) -> PyResult<()> {
        self.world.lock(py)?.remove_collider(self.handle).or_raise(py)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let text = |side: Side<'_>| {
            let (name, collider) = (side.body.body.name(), side.collider);
            format!("Collider({}, link {} of {name:?}, {:?})", self.handle.slot(), collider.link, collider.skin.material.name)
        };
        self.read(py, text).unwrap_or_else(|_| "Collider(removed)".into())
    }
}

//! `Surface`.

use crate::conv;
use crate::errors::OrRaise;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use quasirigid::math::Real;
use quasirigid::surface::{PointSurface, shapes};
use std::sync::Arc;

#[doc = doc!("Surface")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Surface {
    pub(crate) engine: Arc<quasirigid::surface::Surface>,
}

impl Surface {
    fn build(py: Python<'_>, points: quasirigid::Result<PointSurface>, control_points: Option<conv::Whole>) -> PyResult<Self> {
        let control_points = control_points.map(|n| conv::count(py, "control_points", n)).transpose()?;
        let points = points.or_raise(py)?;
        let engine = py.detach(|| quasirigid::surface::Surface::build(points, control_points)).or_raise(py)?;
        Ok(Self { engine: Arc::new(engine) })
    }
}

#[pymethods]
impl Surface {
    #[doc = doc!("Surface.box")]
    #[staticmethod]
    #[pyo3(name = "box", signature = (size, *, points, control_points = None))]
    fn cuboid(py: Python<'_>, size: &Bound<'_, PyAny>, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        let (size, n) = (conv::vec3(size, "size")?, conv::count(py, "points", points)?);
        Self::build(py, shapes::sample_box(size, n), control_points)
    }

    #[doc = doc!("Surface.sphere")]
    #[staticmethod]
    #[pyo3(signature = (radius, *, points, control_points = None))]
    fn sphere(py: Python<'_>, radius: Real, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        Self::build(py, shapes::sample_sphere(radius, conv::count(py, "points", points)?), control_points)
    }

    #[doc = doc!("Surface.capsule")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, points, control_points = None))]
    fn capsule(py: Python<'_>, radius: Real, length: Real, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        Self::build(py, shapes::sample_capsule(radius, length, conv::count(py, "points", points)?), control_points)
    }

    #[doc = doc!("Surface.cylinder")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, points, control_points = None))]
    fn cylinder(py: Python<'_>, radius: Real, length: Real, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        Self::build(py, shapes::sample_cylinder(radius, length, conv::count(py, "points", points)?), control_points)
    }

    #[doc = doc!("Surface.half_space")]
    #[staticmethod]
    #[pyo3(signature = (side, *, points, control_points = None))]
    fn half_space(py: Python<'_>, side: Real, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        Self::build(py, shapes::sample_half_space(side, conv::count(py, "points", points)?), control_points)
    }

    #[doc = doc!("Surface.fingertip")]
    #[staticmethod]
    #[pyo3(signature = (semi_axes, *, points = 2400.into(), control_points = Some(320.into())), text_signature = "(semi_axes, *, points=2400, control_points=320)")]
    fn fingertip(py: Python<'_>, semi_axes: &Bound<'_, PyAny>, points: conv::Whole, control_points: Option<conv::Whole>) -> PyResult<Self> {
        let (axes, n) = (conv::vec3(semi_axes, "semi_axes")?, conv::count(py, "points", points)?);
        Self::build(py, shapes::sample_fingertip(axes, n), control_points)
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
        let points = conv::points(points, "points")?;
        let normals = normals.map(|n| conv::points(n, "normals")).transpose()?;
        let areas = areas.map(|a| conv::vector(a, "areas")).transpose()?;
        let surface = py.detach(|| match (normals, areas) {
            (Some(normals), Some(areas)) => PointSurface::new(points, normals, areas),
            (Some(normals), None) => PointSurface::from_points_and_normals(points, normals),
            (None, None) => PointSurface::from_points(points),
            (None, Some(areas)) => {
                let (points, normals, _) = PointSurface::from_points(points)?.into_parts();
                PointSurface::new(points, normals, areas)
            }
        });
        Self::build(py, surface, control_points)
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

    #[doc = doc!("Surface.__len__")]
    fn __len__(&self) -> usize {
        self.engine.len()
    }

    fn __repr__(&self) -> String {
        format!("Surface({} points, {} control points, {:.3e} m^2)", self.engine.len(), self.engine.control.len(), self.area())
    }
}

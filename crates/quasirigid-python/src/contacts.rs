//! `Contacts` and `ContactStatus`.

use crate::conv;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use quasirigid::delassus::Delassus;
use quasirigid::math::{Mat3, Real, Vec3};

#[doc = doc!("ContactStatus")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct ContactStatus;

#[pymethods]
impl ContactStatus {
    #[classattr]
    #[allow(non_upper_case_globals)] // names as Python users write them
    const Open: u8 = 0;
    #[classattr]
    #[allow(non_upper_case_globals)]
    const Stick: u8 = 1;
    #[classattr]
    #[allow(non_upper_case_globals)]
    const Slip: u8 = 2;
}

#[doc = doc!("Contacts")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Contacts {
    points: Vec<Vec3>,
    frames: Vec<Mat3>,
    gaps: Vec<Real>,
    reactions: Vec<Vec3>,
    areas: Vec<Real>,
    friction: Vec<Real>,
    friction_ratio: Vec<Real>,
    status: Vec<u8>,
    body_a: Vec<u32>,
    body_b: Vec<u32>,
    link_a: Vec<u32>,
    link_b: Vec<u32>,
    collider_a: Vec<u32>,
    collider_b: Vec<u32>,
    control_point: Vec<u32>,
}

impl Contacts {
    /// Copies the contacts of the last step.
    pub fn of(world: &quasirigid::World) -> Self {
        let (contacts, problem) = (world.contacts(), world.contact_problem());
        // Row i of delta = W f + delta_free: the gap at the end of the step.
        let gap = |i: usize| problem.delta_free[i].x + problem.w.displacement(i).x;
        let places = world.body_places();
        let place = |slot: u32| places[slot as usize];
        Self {
            points: contacts.iter().map(|c| c.point).collect(),
            frames: contacts.iter().map(|c| c.frame).collect(),
            gaps: (0..problem.len()).map(gap).collect(),
            reactions: problem.reactions.clone(),
            areas: contacts.iter().map(|c| c.area).collect(),
            friction: problem.mu.clone(),
            friction_ratio: contacts.iter().map(|c| c.friction_ratio).collect(),
            status: problem.status.iter().map(|&s| s as u8).collect(),
            body_a: contacts.iter().map(|c| place(c.body_a)).collect(),
            body_b: contacts.iter().map(|c| place(c.body_b)).collect(),
            link_a: contacts.iter().map(|c| c.link_a).collect(),
            link_b: contacts.iter().map(|c| c.link_b).collect(),
            collider_a: contacts.iter().map(|c| c.collider_a).collect(),
            collider_b: contacts.iter().map(|c| c.collider_b).collect(),
            control_point: contacts.iter().map(|c| c.control_point).collect(),
        }
    }
}

#[pymethods]
impl Contacts {
    #[doc = doc!("Contacts.points")]
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.points.iter().copied())
    }

    #[doc = doc!("Contacts.normals")]
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.frames.iter().map(|e| e.column(0).into_owned()))
    }

    #[doc = doc!("Contacts.frames")]
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<Real>>> {
        conv::from_matrices(py, self.frames.iter().copied())
    }

    #[doc = doc!("Contacts.gaps")]
    #[getter]
    fn gaps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.gaps.clone())
    }

    #[doc = doc!("Contacts.reactions")]
    #[getter]
    fn reactions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.reactions.iter().copied())
    }

    #[doc = doc!("Contacts.forces")]
    #[getter]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        conv::from_points(py, self.frames.iter().zip(&self.reactions).map(|(e, f)| e * f))
    }

    #[doc = doc!("Contacts.areas")]
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.areas.clone())
    }

    #[doc = doc!("Contacts.pressures")]
    #[getter]
    fn pressures<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.reactions.iter().zip(&self.areas).map(|(f, area)| f.x / area).collect())
    }

    #[doc = doc!("Contacts.friction")]
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.friction.clone())
    }

    #[doc = doc!("Contacts.friction_ratio")]
    #[getter]
    fn friction_ratio<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        conv::from_vec(py, self.friction_ratio.clone())
    }

    #[doc = doc!("Contacts.status")]
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        conv::from_vec(py, self.status.clone())
    }

    #[doc = doc!("Contacts.body_a")]
    #[getter]
    fn body_a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.body_a.clone())
    }

    #[doc = doc!("Contacts.body_b")]
    #[getter]
    fn body_b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.body_b.clone())
    }

    #[doc = doc!("Contacts.link_a")]
    #[getter]
    fn link_a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.link_a.clone())
    }

    #[doc = doc!("Contacts.link_b")]
    #[getter]
    fn link_b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.link_b.clone())
    }

    #[doc = doc!("Contacts.collider_a")]
    #[getter]
    fn collider_a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.collider_a.clone())
    }

    #[doc = doc!("Contacts.collider_b")]
    #[getter]
    fn collider_b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.collider_b.clone())
    }

    #[doc = doc!("Contacts.control_point")]
    #[getter]
    fn control_point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        conv::from_vec(py, self.control_point.clone())
    }

    fn __len__(&self) -> usize {
        self.points.len()
    }

    fn __repr__(&self) -> String {
        let count = |status: u8| self.status.iter().filter(|&&s| s == status).count();
        format!("Contacts({}: {} open, {} stick, {} slip)", self.points.len(), count(0), count(1), count(2))
    }
}

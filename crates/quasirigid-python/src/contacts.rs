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
            points: contacts.iter().map(|c| c.acts_at).collect(),
            frames: contacts.iter().map(|c| c.acts_along).collect(),
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

    /// Normal forces over the areas of the control points, Pa.
    fn normal_pressures(&self) -> Vec<Real> {
        self.reactions.iter().zip(&self.areas).map(|(f, area)| f.x / area).collect()
    }
}

/// A getter for every field: its docstring in the stubs, its name, its array and what that holds of `self`. The fields are those of the
/// table in `python/quasirigid/scene/contact_fields.py`; a test there holds shapes, types, units and docstrings against it.
macro_rules! getters {
    ($($doc:tt $name:ident -> $array:ty: |$contacts:ident, $py:ident| $value:expr;)+) => {
        #[pymethods]
        impl Contacts {
            $(
                #[doc = doc!($doc)]
                #[getter]
                fn $name<'py>(&self, $py: Python<'py>) -> PyResult<Bound<'py, $array>> {
                    let $contacts = self;
                    $value
                }
            )+
        }
    };
}

getters! {
    "Contacts.points" points -> PyArray2<Real>: |c, py| conv::from_points(py, c.points.iter().copied());
    "Contacts.normals" normals -> PyArray2<Real>: |c, py| conv::from_points(py, c.frames.iter().map(|e| e.column(0).into_owned()));
    "Contacts.frames" frames -> PyArray3<Real>: |c, py| conv::from_matrices(py, c.frames.iter().copied());
    "Contacts.forces" forces -> PyArray2<Real>: |c, py| conv::from_points(py, c.frames.iter().zip(&c.reactions).map(|(e, f)| e * f));
    "Contacts.reactions" reactions -> PyArray2<Real>: |c, py| conv::from_points(py, c.reactions.iter().copied());
    "Contacts.gaps" gaps -> PyArray1<Real>: |c, py| Ok(conv::from_vec(py, c.gaps.clone()));
    "Contacts.pressures" pressures -> PyArray1<Real>: |c, py| Ok(conv::from_vec(py, c.normal_pressures()));
    "Contacts.areas" areas -> PyArray1<Real>: |c, py| Ok(conv::from_vec(py, c.areas.clone()));
    "Contacts.friction" friction -> PyArray1<Real>: |c, py| Ok(conv::from_vec(py, c.friction.clone()));
    "Contacts.friction_ratio" friction_ratio -> PyArray1<Real>: |c, py| Ok(conv::from_vec(py, c.friction_ratio.clone()));
    "Contacts.status" status -> PyArray1<u8>: |c, py| Ok(conv::from_vec(py, c.status.clone()));
    "Contacts.body_a" body_a -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.body_a.clone()));
    "Contacts.link_a" link_a -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.link_a.clone()));
    "Contacts.collider_a" collider_a -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.collider_a.clone()));
    "Contacts.control_point" control_point -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.control_point.clone()));
    "Contacts.body_b" body_b -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.body_b.clone()));
    "Contacts.link_b" link_b -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.link_b.clone()));
    "Contacts.collider_b" collider_b -> PyArray1<u32>: |c, py| Ok(conv::from_vec(py, c.collider_b.clone()));
}

#[pymethods]
impl Contacts {
    fn __len__(&self) -> usize {
        self.points.len()
    }

    fn __repr__(&self) -> String {
        let count = |status: u8| self.status.iter().filter(|&&s| s == status).count();
        format!("Contacts({}: {} open, {} stick, {} slip)", self.points.len(), count(0), count(1), count(2))
    }
}

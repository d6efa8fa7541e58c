//! The parts of a tracked hand as rows of arrays: 0 to 4 are thumb to little finger, 5 is the palm.

use crate::conv;
use crate::errors::to_py;
use numpy::PyArray2;
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid_mocap::{Pose, Side};

/// Fingers and palm.
pub const PARTS: usize = 6;
pub const PALM: usize = 5;

/// Left or right.
pub fn named_side(py: Python<'_>, name: &str) -> PyResult<Side> {
    match name {
        "left" => Ok(Side::Left),
        "right" => Ok(Side::Right),
        other => Err(to_py(py, &Error::unknown("side", "left or right", format!("{other:?}"), "one hand at a time"))),
    }
}

/// Row `k` of an array with one row for each part.
pub fn row<'py>(array: &Bound<'py, PyAny>, what: &str, k: usize) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let refuse = |got: String| to_py(py, &Error::shape(what, "shape (6, ...)", got, "five fingers and the palm"));
    match array.len() {
        Ok(PARTS) => array.get_item(k).map_err(|_| refuse("something without rows".into())),
        Ok(rows) => Err(refuse(format!("{rows} rows"))),
        Err(_) => Err(refuse("something without rows".into())),
    }
}

/// `(6, 3)`; NaN where there is no pose.
pub fn positions<'py>(py: Python<'py>, poses: &[Option<Pose>; PARTS]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    conv::rows(py, poses.iter().flat_map(|p| p.map_or([f64::NAN; 3], |p| p.translation.vector.into())).collect(), 3)
}

/// `(6, 4)`; NaN where there is no pose.
pub fn quaternions<'py>(py: Python<'py>, poses: &[Option<Pose>; PARTS]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let wxyz = |p: Pose| [p.rotation.w, p.rotation.i, p.rotation.j, p.rotation.k];
    conv::rows(py, poses.iter().flat_map(|p| p.map_or([f64::NAN; 4], wxyz)).collect(), 4)
}

/// Numbers as they come from constructors: a rotation that is one, a place that is somewhere.
pub fn check_read(pose: &Pose) -> Result<(), String> {
    let finite = pose.translation.vector.iter().all(|x| x.is_finite());
    if finite && (pose.rotation.norm() - 1.0).abs() < 1e-9 { Ok(()) } else { Err("a pose that is none".into()) }
}

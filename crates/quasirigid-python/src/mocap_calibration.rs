//! `Calibration`: where the tracker stands in the world.

use crate::conv;
use crate::mocap::OrRaiseMocap;
use crate::mocap_parts::check_read;
use crate::value::{Value, from_cbor, to_cbor, value};
use pyo3::prelude::*;
use quasirigid_mocap as mocap;
use quasirigid_mocap::Pose;
use std::path::PathBuf;

#[doc = doc!("Calibration")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Calibration {
    pub(crate) calibration: mocap::Calibration,
}

#[pymethods]
impl Calibration {
    #[new]
    #[pyo3(signature = (position = None, quaternion = None))]
    fn new(position: Option<&Bound<'_, PyAny>>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let translation = position.map_or(Ok(mocap::Vec3::zeros()), |p| conv::vec3(p, "position"))?;
        let rotation = quaternion.map_or(Ok(mocap::Rot::identity()), |q| conv::quaternion(q, "quaternion"))?;
        let world_from_tracker = Pose::from_parts(translation.into(), rotation);
        Ok(Self { calibration: mocap::Calibration { world_from_tracker, residual: None } })
    }

    #[doc = doc!("Calibration.read")]
    #[staticmethod]
    fn read(py: Python<'_>, #[pyo3(from_py_with = conv::path)] path: PathBuf) -> PyResult<Self> {
        mocap::Calibration::read(&path).or_raise(py).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.write")]
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = conv::path)] path: PathBuf) -> PyResult<()> {
        self.calibration.write(&path).or_raise(py)
    }

    #[doc = doc!("Calibration.from_three_points")]
    #[staticmethod]
    fn from_three_points(origin: &Bound<'_, PyAny>, on_x: &Bound<'_, PyAny>, in_plane: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = (conv::vec3(origin, "origin")?, conv::vec3(on_x, "on_x")?, conv::vec3(in_plane, "in_plane")?);
        mocap::Calibration::from_three_points(points.0, points.1, points.2).or_raise(origin.py()).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.from_points")]
    #[staticmethod]
    fn from_points(tracker: &Bound<'_, PyAny>, world: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (from, to) = (conv::points(tracker, "tracker")?, conv::points(world, "world")?);
        mocap::Calibration::from_points(&from, &to).or_raise(tracker.py()).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.position")]
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Calibration.position", conv::from_vec3(py, &self.calibration.world_from_tracker.translation.vector))
    }

    #[doc = doc!("Calibration.quaternion")]
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("Calibration.quaternion", conv::from_rot(py, &self.calibration.world_from_tracker.rotation))
    }

    #[doc = doc!("Calibration.residual")]
    #[getter]
    fn residual(&self) -> Option<f64> {
        self.calibration.residual
    }
}

impl Value for Calibration {
    const NAME: &'static str = "Calibration";

    fn same(&self, other: &Self) -> bool {
        self.calibration == other.calibration
    }

    // Not of the rotation: q and -q are the same one.
    fn digest(&self) -> Vec<f64> {
        self.calibration.world_from_tracker.translation.vector.iter().chain(&self.calibration.residual).copied().collect()
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.calibration)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let calibration: mocap::Calibration = from_cbor(bytes)?;
        check_read(&calibration.world_from_tracker)?;
        if calibration.residual.is_some_and(|residual| !(residual.is_finite() && residual >= 0.0)) {
            return Err("a residual that is none".into());
        }
        Ok(Self { calibration })
    }
}

value!(Calibration);

//! `HandModel`.

use crate::conv;
use crate::errors::OrRaise;
use crate::value::{Value, from_cbor, to_cbor, value};
use numpy::PyArray2;
use pyo3::prelude::*;
use quasirigid::body::{FingerModel, JointModel};
use quasirigid::math::Real;

#[doc = doc!("HandModel")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandModel {
    pub(crate) engine: quasirigid::body::HandModel,
}

/// One number per joint, (fingers, joints). All fingers of a hand have as many joints as the first.
pub fn per_joint<'py>(py: Python<'py>, fingers: &[FingerModel], of: impl Fn(&JointModel) -> Real) -> PyResult<Bound<'py, PyArray2<Real>>> {
    conv::rows(py, fingers.iter().flat_map(|finger| finger.joints().iter().map(&of)).collect(), fingers[0].dof())
}

#[pymethods]
impl HandModel {
    #[doc = doc!("HandModel.three_finger")]
    #[staticmethod]
    fn three_finger(py: Python<'_>) -> PyResult<Self> {
        Ok(Self { engine: quasirigid::body::HandModel::three_finger().or_raise(py)? })
    }

    #[doc = doc!("HandModel.with_gains")]
    fn with_gains(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] stiffness: Real,
        #[pyo3(from_py_with = conv::real)] damping: Real,
    ) -> PyResult<Self> {
        Ok(Self { engine: self.engine.with_gains(stiffness, damping).or_raise(py)? })
    }

    #[getter]
    fn name(&self) -> &str {
        self.engine.name()
    }

    #[getter]
    fn finger_names(&self) -> Vec<&str> {
        self.engine.fingers().iter().map(FingerModel::name).collect()
    }

    #[doc = doc!("HandModel.joint_names")]
    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.engine.fingers()[0].joints().iter().map(|joint| joint.name.as_str()).collect()
    }

    #[doc = doc!("HandModel.lower_limits")]
    #[getter]
    fn lower_limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("HandModel.lower_limits", per_joint(py, self.engine.fingers(), |joint| joint.lower)?)
    }

    #[doc = doc!("HandModel.upper_limits")]
    #[getter]
    fn upper_limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("HandModel.upper_limits", per_joint(py, self.engine.fingers(), |joint| joint.upper)?)
    }

    #[doc = doc!("HandModel.knuckles")]
    #[getter]
    fn knuckles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("HandModel.knuckles", conv::from_points(py, self.engine.knuckles().collect::<Vec<_>>())?)
    }

    #[doc = doc!("HandModel.three_finger_link_radii")]
    #[staticmethod]
    fn three_finger_link_radii() -> (Real, Real, Real) {
        quasirigid::body::HandModel::THREE_FINGER_LINK_RADII.into()
    }

    #[doc = doc!("HandModel.pad_semi_axes")]
    #[getter]
    fn pad_semi_axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("HandModel.pad_semi_axes", conv::from_vec3(py, &self.engine.tips()[0].pad_semi_axes))
    }

    fn __repr__(&self) -> String {
        format!("HandModel({:?}, fingers={:?})", self.engine.name(), self.finger_names())
    }
}

impl Value for HandModel {
    const NAME: &'static str = "HandModel";

    fn same(&self, other: &Self) -> bool {
        self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let joints = self.engine.fingers().iter().flat_map(FingerModel::joints);
        let name = self.engine.name().bytes().map(Real::from);
        name.chain(joints.flat_map(|joint| [joint.lower, joint.upper, joint.stiffness, joint.damping])).collect()
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.engine)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let engine: quasirigid::body::HandModel = from_cbor(bytes)?;
        let mut fingers = engine.fingers().iter().map(FingerModel::dof);
        let joints = fingers.next();
        if fingers.any(|other| Some(other) != joints) {
            return Err("fingers with different numbers of joints".into());
        }
        Ok(Self { engine })
    }
}

value!(HandModel);

//! `Material`.

use crate::compliance_matrix::ComplianceMatrix;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::friction::Friction;
use crate::value::{Value, from_cbor, to_cbor, value};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::collider::ComplianceModel;
use quasirigid::math::Real;

#[doc = doc!("Material")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Material {
    pub(crate) engine: quasirigid::collider::Material,
}

/// A model by its name, or a matrix, checked if it is not yet.
fn model(value: &Bound<'_, PyAny>, material: &quasirigid::collider::Material) -> PyResult<ComplianceModel> {
    let py = value.py();
    if let Ok(given) = value.cast::<ComplianceMatrix>() {
        return Ok(ComplianceModel::Matrix(given.get().engine.clone()));
    }
    match value.extract::<&str>() {
        Ok("local") => Ok(ComplianceModel::Local),
        Ok("gaussian") => material.gaussian().or_raise(py),
        Ok("half-space") => Ok(ComplianceModel::HalfSpace),
        Ok("layer") => Ok(ComplianceModel::Layer),
        Ok(other) => {
            let hint = "choose one of them, or give a matrix";
            Err(to_py(
                py,
                &Error::unknown("compliance", "\"local\", \"layer\", \"half-space\" or \"gaussian\"", format!("{other:?}"), hint),
            ))
        }
        Err(_) => Ok(ComplianceModel::Matrix(ComplianceMatrix::new(py, value)?.engine)),
    }
}

#[pymethods]
impl Material {
    #[doc = doc!("Material.preset")]
    #[staticmethod]
    #[pyo3(signature = (name, *, version = None), text_signature = "(name, *, version=None)")]
    fn preset(py: Python<'_>, #[pyo3(from_py_with = conv::text)] name: &str, version: Option<&str>) -> PyResult<Self> {
        use quasirigid::collider::Material;
        let engine = version.map_or_else(|| Material::preset(name), |version| Material::preset_of(name, version));
        Ok(Self { engine: engine.or_raise(py)? })
    }

    #[doc = doc!("Material.preset_names")]
    #[staticmethod]
    fn preset_names() -> Vec<&'static str> {
        quasirigid::collider::Material::preset_names().collect()
    }

    #[doc = doc!("Material.replace")]
    #[allow(clippy::too_many_arguments)] // keyword arguments, one for each field
    #[pyo3(signature = (*, name = None, density = None, friction = None, young_modulus = None, poisson_ratio = None, layer_thickness = None,
                        relaxation_time = None, compliance = None))]
    fn replace(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = conv::optional_text)] name: Option<&str>,
        #[pyo3(from_py_with = conv::optional_real)] density: Option<Real>,
        friction: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::optional_real)] young_modulus: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] poisson_ratio: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] layer_thickness: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] relaxation_time: Option<Real>,
        compliance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let old = &self.engine;
        let mut new = quasirigid::collider::Material { name: name.map_or_else(|| old.name.clone(), str::to_owned), ..old.clone() };
        new = new.with_density(density.unwrap_or(old.density)).or_raise(py)?;
        let friction = friction.map_or(Ok(old.friction), crate::friction::friction)?;
        new = new.with_friction(friction).or_raise(py)?;
        new = new.with_relaxation_time(relaxation_time.unwrap_or(old.relaxation_time)).or_raise(py)?;
        if young_modulus.is_some() || poisson_ratio.is_some() || layer_thickness.is_some() {
            let (e, nu) = (young_modulus.unwrap_or(old.young_modulus), poisson_ratio.unwrap_or(old.poisson_ratio));
            new = new.with_elasticity(e, nu, layer_thickness.unwrap_or(old.layer_thickness)).or_raise(py)?;
        }
        if let Some(compliance) = compliance {
            let model = model(compliance, &new)?;
            new = new.with_model(model).or_raise(py)?;
        }
        Ok(Self { engine: new })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.engine.name
    }

    #[doc = doc!("Material.density")]
    #[getter]
    fn density(&self) -> Real {
        self.engine.density
    }

    #[doc = doc!("Material.friction")]
    #[getter]
    fn friction(&self) -> Real {
        self.engine.friction.static_coefficient
    }

    #[doc = doc!("Material.friction_law")]
    #[getter]
    fn friction_law(&self) -> Friction {
        Friction { engine: self.engine.friction }
    }

    #[doc = doc!("Material.young_modulus")]
    #[getter]
    fn young_modulus(&self) -> Real {
        self.engine.young_modulus
    }

    #[doc = doc!("Material.poisson_ratio")]
    #[getter]
    fn poisson_ratio(&self) -> Real {
        self.engine.poisson_ratio
    }

    #[doc = doc!("Material.layer_thickness")]
    #[getter]
    fn layer_thickness(&self) -> Real {
        self.engine.layer_thickness
    }

    #[doc = doc!("Material.relaxation_time")]
    #[getter]
    fn relaxation_time(&self) -> Real {
        self.engine.relaxation_time
    }

    #[doc = doc!("Material.compliance")]
    #[getter]
    fn compliance(&self) -> &'static str {
        match self.engine.model {
            ComplianceModel::Local => "local",
            ComplianceModel::Gaussian { .. } => "gaussian",
            ComplianceModel::HalfSpace => "half-space",
            ComplianceModel::Layer => "layer",
            ComplianceModel::Matrix(_) => "matrix",
        }
    }

    #[doc = doc!("Material.compliance_matrix")]
    #[getter]
    fn compliance_matrix(&self) -> Option<ComplianceMatrix> {
        match &self.engine.model {
            ComplianceModel::Matrix(engine) => Some(ComplianceMatrix { engine: engine.clone() }),
            _ => None,
        }
    }

    fn __repr__(&self) -> String {
        format!("Material({:?}, friction={}, compliance={:?})", self.engine.name, self.friction(), self.compliance())
    }
}

impl Value for Material {
    const NAME: &'static str = "Material";

    fn same(&self, other: &Self) -> bool {
        self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let m = &self.engine;
        let name = m.name.bytes().map(Real::from);
        let figures = [m.density, m.friction.static_coefficient, m.young_modulus, m.poisson_ratio, m.layer_thickness, m.relaxation_time];
        name.chain(figures).collect()
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.engine)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let engine: quasirigid::collider::Material = from_cbor(bytes)?;
        engine.check().map_err(|error| error.to_string())?;
        Ok(Self { engine })
    }
}

value!(Material);

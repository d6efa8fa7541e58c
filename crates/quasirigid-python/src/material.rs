//! `Material`.

use crate::compliance_matrix::ComplianceMatrix;
use crate::errors::{OrRaise, to_py};
use crate::friction::Friction;
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::body::ComplianceModel;
use quasirigid::math::Real;

#[doc = doc!("Material")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Material {
    pub(crate) engine: quasirigid::body::Material,
}

/// A model by its name, or a matrix, checked if it is not yet.
fn model(value: &Bound<'_, PyAny>, material: &quasirigid::body::Material) -> PyResult<ComplianceModel> {
    let py = value.py();
    if let Ok(given) = value.cast::<ComplianceMatrix>() {
        return Ok(ComplianceModel::Matrix(given.get().engine.clone()));
    }
    match value.extract::<&str>() {
        Ok("local") => material.local().or_raise(py),
        Ok("half-space") => Ok(ComplianceModel::HalfSpace),
        Ok(other) => {
            let hint = "choose one of them, or give a matrix";
            Err(to_py(py, &Error::unknown("compliance", "\"local\" or \"half-space\"", format!("{other:?}"), hint)))
        }
        Err(_) => Ok(ComplianceModel::Matrix(ComplianceMatrix::new(py, value)?.engine)),
    }
}

#[pymethods]
impl Material {
    #[doc = doc!("Material.preset")]
    #[staticmethod]
    fn preset(py: Python<'_>, name: &str) -> PyResult<Self> {
        Ok(Self { engine: quasirigid::body::Material::preset(name).or_raise(py)? })
    }

    #[doc = doc!("Material.preset_names")]
    #[staticmethod]
    fn preset_names() -> Vec<&'static str> {
        quasirigid::body::Material::preset_names().collect()
    }

    #[doc = doc!("Material.replace")]
    #[allow(clippy::too_many_arguments)] // keyword arguments, one for each field
    #[pyo3(signature = (*, name = None, density = None, friction = None, young_modulus = None, poisson_ratio = None, layer_thickness = None,
                        relaxation_time = None, compliance = None))]
    fn replace(
        &self,
        py: Python<'_>,
        name: Option<String>,
        density: Option<Real>,
        friction: Option<&Bound<'_, PyAny>>,
        young_modulus: Option<Real>,
        poisson_ratio: Option<Real>,
        layer_thickness: Option<Real>,
        relaxation_time: Option<Real>,
        compliance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let old = &self.engine;
        let mut new = quasirigid::body::Material { name: name.unwrap_or_else(|| old.name.clone()), ..old.clone() };
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
            ComplianceModel::Local { .. } => "local",
            ComplianceModel::HalfSpace => "half-space",
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

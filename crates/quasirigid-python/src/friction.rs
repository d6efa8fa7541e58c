//! `Friction`, and the rules by which two materials make that of their pair.

use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::value::{Value, from_cbor, to_cbor, value};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::collider::FrictionRule;
use quasirigid::collider::friction::USUAL_STRIBECK_VELOCITY;
use quasirigid::math::Real;

#[doc = doc!("Friction")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Friction {
    pub(crate) engine: quasirigid::collider::Friction,
}

#[pymethods]
impl Friction {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (r#static, kinetic = None, *, stribeck_velocity = USUAL_STRIBECK_VELOCITY, viscous = 0.0, direction = None,
                        ratio = None),
           text_signature = "(static, kinetic=None, *, stribeck_velocity=1e-3, viscous=0.0, direction=None, ratio=None)")]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] r#static: Real,
        #[pyo3(from_py_with = conv::optional_real)] kinetic: Option<Real>,
        #[pyo3(from_py_with = conv::real)] stribeck_velocity: Real,
        #[pyo3(from_py_with = conv::real)] viscous: Real,
        direction: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = conv::optional_real)] ratio: Option<Real>,
    ) -> PyResult<Self> {
        let engine = quasirigid::collider::Friction::coulomb(r#static)
            .and_then(|friction| friction.with_kinetic(kinetic.unwrap_or(r#static), stribeck_velocity))
            .and_then(|friction| friction.with_viscous(viscous))
            .or_raise(py)?;
        let engine = match (direction, ratio) {
            (None, None) => engine,
            (Some(direction), Some(ratio)) => engine.with_anisotropy(conv::vec3(direction, "direction")?, ratio).or_raise(py)?,
            (direction, _) => {
                let got = if direction.is_some() { "direction alone" } else { "ratio alone" };
                let hint = "the coefficients hold along the direction, and are ratio times as large across it";
                return Err(to_py(py, &Error::value("anisotropic friction", "direction and ratio together", got, hint)));
            }
        };
        Ok(Self { engine })
    }

    #[getter(r#static)]
    fn static_coefficient(&self) -> Real {
        self.engine.static_coefficient
    }

    #[getter]
    fn kinetic(&self) -> Real {
        self.engine.kinetic_coefficient
    }

    #[doc = doc!("Friction.stribeck_velocity")]
    #[getter]
    fn stribeck_velocity(&self) -> Real {
        self.engine.stribeck_velocity
    }

    #[doc = doc!("Friction.viscous")]
    #[getter]
    fn viscous(&self) -> Real {
        self.engine.viscous_coefficient
    }

    #[doc = doc!("Friction.direction")]
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.engine.anisotropy.map(|anisotropy| conv::state("Friction.direction", conv::from_vec3(py, &anisotropy.direction))).transpose()
    }

    #[doc = doc!("Friction.ratio")]
    #[getter]
    fn ratio(&self) -> Real {
        self.engine.anisotropy.map_or(1.0, |anisotropy| anisotropy.ratio)
    }

    #[doc = doc!("Friction.coefficient")]
    fn coefficient(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] speed: Real) -> PyResult<Real> {
        quasirigid::error::check_non_negative("speed", speed, "m/s").or_raise(py)?;
        Ok(self.engine.coefficient(speed))
    }

    fn __repr__(&self) -> String {
        let f = &self.engine;
        let mut text = format!("Friction({}", f.static_coefficient);
        if f.is_velocity_weakening() {
            text += &format!(", {}, stribeck_velocity={}", f.kinetic_coefficient, f.stribeck_velocity);
        }
        if f.viscous_coefficient > 0.0 {
            text += &format!(", viscous={}", f.viscous_coefficient);
        }
        if let Some(anisotropy) = &f.anisotropy {
            let d = &anisotropy.direction;
            text += &format!(", direction=({}, {}, {}), ratio={}", d.x, d.y, d.z, anisotropy.ratio);
        }
        text + ")"
    }
}

/// A coefficient or a `Friction`.
pub fn friction(value: &Bound<'_, PyAny>) -> PyResult<quasirigid::collider::Friction> {
    if let Ok(friction) = value.cast::<Friction>() {
        return Ok(friction.get().engine);
    }
    let py = value.py();
    let coefficient: Real = value.extract().map_err(|_| {
        to_py(py, &Error::value("friction", "a coefficient or a Friction", value.get_type(), "for example 0.5, or Friction(0.5, 0.4)"))
    })?;
    quasirigid::collider::Friction::coulomb(coefficient).or_raise(py)
}

/// Names of the rules, as in `World.friction_rule`.
const RULES: [(&str, FrictionRule); 5] = [
    ("geometric-mean", FrictionRule::GeometricMean),
    ("minimum", FrictionRule::Minimum),
    ("maximum", FrictionRule::Maximum),
    ("mean", FrictionRule::Mean),
    ("product", FrictionRule::Product),
];

/// The rule of this name.
pub fn rule(py: Python<'_>, name: &str) -> PyResult<FrictionRule> {
    RULES.iter().find(|(known, _)| *known == name).map(|(_, rule)| *rule).ok_or_else(|| {
        let known = RULES.map(|(known, _)| format!("{known:?}")).join(", ");
        to_py(py, &Error::unknown("friction_rule", format!("one of {known}"), format!("{name:?}"), "choose one of them"))
    })
}

/// The name of a rule.
pub fn rule_name(rule: FrictionRule) -> &'static str {
    RULES.iter().find(|(_, known)| *known == rule).map_or("", |(name, _)| *name)
}

impl Value for Friction {
    const NAME: &'static str = "Friction";

    fn same(&self, other: &Self) -> bool {
        self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let f = &self.engine;
        vec![f.static_coefficient, f.kinetic_coefficient, f.stribeck_velocity, f.viscous_coefficient, self.ratio()]
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.engine)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let engine: quasirigid::collider::Friction = from_cbor(bytes)?;
        engine.check().map_err(|error| error.to_string())?;
        Ok(Self { engine })
    }
}

value!(Friction);

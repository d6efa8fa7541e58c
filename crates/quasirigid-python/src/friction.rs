//! `Friction`, and whom an entry of a world's friction table is about.

use crate::body::Body;
use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::hand::Hand;
use crate::material::Material;
use crate::world::World;
use numpy::PyArray1;
use pyo3::prelude::*;
use quasirigid::body::FrictionRule;
use quasirigid::body::friction::USUAL_STRIBECK_VELOCITY;
use quasirigid::math::Real;
use quasirigid::{Error, FrictionSide};

#[doc = doc!("Friction")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Friction {
    pub(crate) engine: quasirigid::body::Friction,
}

#[pymethods]
impl Friction {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (r#static, kinetic = None, *, stribeck_velocity = USUAL_STRIBECK_VELOCITY, viscous = 0.0, direction = None, ratio = None),
           text_signature = "(static, kinetic=None, *, stribeck_velocity=1e-3, viscous=0.0, direction=None, ratio=None)")]
    fn new(
        py: Python<'_>,
        r#static: Real,
        kinetic: Option<Real>,
        stribeck_velocity: Real,
        viscous: Real,
        direction: Option<&Bound<'_, PyAny>>,
        ratio: Option<Real>,
    ) -> PyResult<Self> {
        let engine = quasirigid::body::Friction::coulomb(r#static)
            .and_then(|friction| friction.with_kinetic(kinetic.unwrap_or(r#static), stribeck_velocity))
            .and_then(|friction| friction.with_viscous(viscous))
            .or_raise(py)?;
        let engine = match (direction, ratio) {
            (None, None) => engine,
            (Some(direction), Some(ratio)) => engine.with_grain(conv::vec3(direction, "direction")?, ratio).or_raise(py)?,
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
    fn direction<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<Real>>> {
        self.engine.grain.map(|grain| conv::from_vec3(py, &grain.direction))
    }

    #[doc = doc!("Friction.ratio")]
    #[getter]
    fn ratio(&self) -> Real {
        self.engine.grain.map_or(1.0, |grain| grain.ratio)
    }

    #[doc = doc!("Friction.coefficient")]
    fn coefficient(&self, py: Python<'_>, speed: Real) -> PyResult<Real> {
        quasirigid::error::check_non_negative("speed", speed, "m/s").or_raise(py)?;
        Ok(self.engine.coefficient(speed))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().engine == self.engine)
    }

    fn __repr__(&self) -> String {
        let f = &self.engine;
        let mut text = format!("Friction({}", f.static_coefficient);
        if f.falls() {
            text += &format!(", {}, stribeck_velocity={}", f.kinetic_coefficient, f.stribeck_velocity);
        }
        if f.viscous_coefficient > 0.0 {
            text += &format!(", viscous={}", f.viscous_coefficient);
        }
        if let Some(grain) = &f.grain {
            let d = &grain.direction;
            text += &format!(", direction=({}, {}, {}), ratio={}", d.x, d.y, d.z, grain.ratio);
        }
        text + ")"
    }
}

/// A coefficient or a `Friction`.
pub fn friction(value: &Bound<'_, PyAny>) -> PyResult<quasirigid::body::Friction> {
    if let Ok(friction) = value.cast::<Friction>() {
        return Ok(friction.get().engine);
    }
    let py = value.py();
    let coefficient: Real = value.extract().map_err(|_| {
        to_py(py, &Error::value("friction", "a coefficient or a Friction", value.get_type(), "for example 0.5, or Friction(0.5, 0.4)"))
    })?;
    quasirigid::body::Friction::coulomb(coefficient).or_raise(py)
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

/// Whom `value` stands for: a material (or its name), a body, or the fingers of a hand, of the world `of` whose engine is `world`.
pub fn sides(of: &Bound<'_, World>, world: &quasirigid::World, value: &Bound<'_, PyAny>) -> PyResult<Vec<FrictionSide>> {
    let py = value.py();
    let elsewhere =
        || to_py(py, &Error::handle("set_friction", "a body of this world", "one of another", "ask the world that it was added to"));
    if let Ok(material) = value.cast::<Material>() {
        return Ok(vec![(&material.get().engine).into()]);
    }
    if let Ok(body) = value.cast::<Body>() {
        return if body.get().world.is(of) { Ok(vec![body.get().handle.into()]) } else { Err(elsewhere()) };
    }
    if let Ok(hand) = value.cast::<Hand>() {
        if !hand.get().world.is(of) {
            return Err(elsewhere());
        }
        return Ok(world.hand(hand.get().handle).or_raise(py)?.fingers.iter().map(|&finger| finger.into()).collect());
    }
    if let Ok(name) = value.extract::<String>() {
        return Ok(vec![name.as_str().into()]);
    }
    let hint = "name the two sides of the pair";
    Err(to_py(py, &Error::handle("set_friction", "a Material, the name of one, a Body or a Hand", value.get_type(), hint)))
}

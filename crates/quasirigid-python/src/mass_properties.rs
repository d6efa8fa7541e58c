//! `MassProperties`.

use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::value::{Value, from_cbor, to_cbor, value};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::body::Amount;
use quasirigid::math::Real;

#[doc = doc!("MassProperties")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct MassProperties {
    pub(crate) engine: quasirigid::body::MassProperties,
}

fn amount(py: Python<'_>, mass: Option<Real>, density: Option<Real>) -> PyResult<Amount> {
    match (mass, density) {
        (Some(mass), None) => Ok(Amount::Mass(mass)),
        (None, Some(density)) => Ok(Amount::Density(density)),
        (given, _) => {
            let got = if given.is_some() { "both" } else { "neither" };
            Err(to_py(py, &Error::value("mass and density", "one of the two", got, "give mass=... (kg) or density=... (kg/m^3)")))
        }
    }
}

impl From<quasirigid::body::MassProperties> for MassProperties {
    fn from(engine: quasirigid::body::MassProperties) -> Self {
        Self { engine }
    }
}

#[pymethods]
impl MassProperties {
    #[new]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] mass: Real,
        centre: &Bound<'_, PyAny>,
        inertia: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (centre, inertia) = (conv::vec3(centre, "centre")?, conv::mat3(inertia, "inertia")?);
        quasirigid::body::MassProperties::new(mass, centre, inertia).map(Self::from).or_raise(py)
    }

    #[doc = doc!("MassProperties.box")]
    #[staticmethod]
    #[pyo3(name = "box", signature = (size, *, mass = None, density = None))]
    fn cuboid(
        py: Python<'_>,
        size: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = conv::optional_real)] mass: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] density: Option<Real>,
    ) -> PyResult<Self> {
        let size = conv::vec3(size, "size")?;
        quasirigid::body::MassProperties::cuboid(size, amount(py, mass, density)?).map(Self::from).or_raise(py)
    }

    #[doc = doc!("MassProperties.sphere")]
    #[staticmethod]
    #[pyo3(signature = (radius, *, mass = None, density = None))]
    fn sphere(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        #[pyo3(from_py_with = conv::optional_real)] mass: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] density: Option<Real>,
    ) -> PyResult<Self> {
        quasirigid::body::MassProperties::sphere(radius, amount(py, mass, density)?).map(Self::from).or_raise(py)
    }

    #[doc = doc!("MassProperties.capsule")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, mass = None, density = None))]
    fn capsule(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        #[pyo3(from_py_with = conv::real)] length: Real,
        #[pyo3(from_py_with = conv::optional_real)] mass: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] density: Option<Real>,
    ) -> PyResult<Self> {
        quasirigid::body::MassProperties::capsule(radius, length, amount(py, mass, density)?).map(Self::from).or_raise(py)
    }

    #[doc = doc!("MassProperties.cylinder")]
    #[staticmethod]
    #[pyo3(signature = (radius, length, *, mass = None, density = None))]
    fn cylinder(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::real)] radius: Real,
        #[pyo3(from_py_with = conv::real)] length: Real,
        #[pyo3(from_py_with = conv::optional_real)] mass: Option<Real>,
        #[pyo3(from_py_with = conv::optional_real)] density: Option<Real>,
    ) -> PyResult<Self> {
        quasirigid::body::MassProperties::cylinder(radius, length, amount(py, mass, density)?).map(Self::from).or_raise(py)
    }

    #[doc = doc!("MassProperties.mass")]
    #[getter]
    fn mass(&self) -> Real {
        self.engine.mass()
    }

    #[doc = doc!("MassProperties.centre")]
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("MassProperties.centre", conv::from_vec3(py, self.engine.center_of_mass()))
    }

    #[doc = doc!("MassProperties.inertia")]
    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        conv::state("MassProperties.inertia", conv::from_mat3(py, self.engine.inertia())?)
    }

    #[doc = doc!("MassProperties.scaled_to_mass")]
    fn scaled_to_mass(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] mass: Real) -> PyResult<Self> {
        self.engine.scaled_to_mass(mass).map(Self::from).or_raise(py)
    }

    fn __repr__(&self) -> String {
        let c = self.engine.center_of_mass();
        format!("MassProperties(mass={}, centre=({}, {}, {}))", self.mass(), c.x, c.y, c.z)
    }
}

/// Mass properties given as such, or as a number with the inertia of the bounding box.
pub fn mass_properties(
    mass: Option<&Bound<'_, PyAny>>,
    surface: &quasirigid::surface::Surface,
    py: Python<'_>,
) -> PyResult<quasirigid::body::MassProperties> {
    let Some(mass) = mass else {
        let hint = "give mass=MassProperties... or a number, or motion=\"fixed\"";
        return Err(to_py(py, &Error::value("mass", "the mass of a body that is free to move", "none", hint)));
    };
    if let Ok(given) = mass.cast::<MassProperties>() {
        return Ok(given.get().engine);
    }
    let kg: Real = mass.extract().map_err(|_| {
        to_py(py, &Error::value("mass", "MassProperties or a number (kg)", mass.get_type(), "see MassProperties.box and its siblings"))
    })?;
    quasirigid::body::MassProperties::of_bounding_box(&surface.points, kg).or_raise(py)
}

impl Value for MassProperties {
    const NAME: &'static str = "MassProperties";

    fn same(&self, other: &Self) -> bool {
        self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let m = &self.engine;
        [m.mass()].iter().chain(m.center_of_mass()).chain(m.inertia()).copied().collect()
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.engine)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        from_cbor(bytes).map(|engine| Self { engine })
    }
}

value!(MassProperties);

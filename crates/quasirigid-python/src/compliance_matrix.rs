//! `ComplianceMatrix`.

use crate::conv;
use crate::errors::OrRaise;
use crate::value::{Value, from_cbor, to_cbor, value};
use numpy::PyArray2;
use pyo3::prelude::*;
use quasirigid::math::Real;
use std::sync::Arc;

#[doc = doc!("ComplianceMatrix")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct ComplianceMatrix {
    pub(crate) engine: Arc<quasirigid::surface::ComplianceMatrix>,
}

#[pymethods]
impl ComplianceMatrix {
    #[new]
    pub fn new(py: Python<'_>, matrix: &Bound<'_, PyAny>) -> PyResult<Self> {
        let matrix = conv::matrix(matrix, "compliance matrix")?;
        let engine = py.detach(|| quasirigid::surface::ComplianceMatrix::new(&matrix)).or_raise(py)?;
        Ok(Self { engine: Arc::new(engine) })
    }

    #[doc = doc!("ComplianceMatrix.matrix")]
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<Real>>> {
        let n = 3 * self.engine.control_points();
        let entry = |k: usize| self.engine.block(k / n / 3, k % n / 3)[(k / n % 3, k % n % 3)];
        conv::rows(py, (0..n * n).map(entry).collect(), n)
    }

    #[doc = doc!("ComplianceMatrix.asymmetry")]
    #[getter]
    fn asymmetry(&self) -> Real {
        self.engine.asymmetry()
    }

    #[doc = doc!("ComplianceMatrix.__len__")]
    fn __len__(&self) -> usize {
        self.engine.control_points()
    }

    fn __repr__(&self) -> String {
        format!("ComplianceMatrix({} control points, asymmetry {:.1e})", self.engine.control_points(), self.engine.asymmetry())
    }
}

impl Value for ComplianceMatrix {
    const NAME: &'static str = "ComplianceMatrix";

    fn same(&self, other: &Self) -> bool {
        self.engine == other.engine
    }

    fn digest(&self) -> Vec<Real> {
        let n = self.engine.control_points();
        let first_row = (0..n).map(|j| self.engine.block(0, j)[(0, 0)]);
        std::iter::once(n as Real).chain(first_row).collect()
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&*self.engine)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        from_cbor(bytes).map(|engine| Self { engine: Arc::new(engine) })
    }
}

value!(ComplianceMatrix);

//! `HandDecoder`: hands from the packets of a tracker.

use crate::conv;
use crate::mocap::{OrRaiseMocap, Packet};
use crate::mocap_frame::HandFrame;
use crate::mocap_parts::named_side;
use crate::process::ForkMutex;
use pyo3::prelude::*;
use quasirigid_mocap as mocap;

#[doc = doc!("HandDecoder")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandDecoder {
    decoder: ForkMutex<mocap::HandDecoder>,
}

#[pymethods]
impl HandDecoder {
    #[new]
    #[pyo3(signature = (side = "right", *, bodies = None))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::text)] side: &str,
        #[pyo3(from_py_with = conv::optional_text)] bodies: Option<&str>,
    ) -> PyResult<Self> {
        let side = named_side(py, side)?;
        let choice = mocap::HandChoice::of(side, bodies).or_raise(py)?;
        Ok(Self { decoder: ForkMutex::new("hand decoder", mocap::HandDecoder::new(choice)) })
    }

    #[getter]
    fn side(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(self.decoder.lock(py)?.side().name())
    }

    #[doc = doc!("HandDecoder.decode")]
    pub fn decode(&self, py: Python<'_>, packet: &Packet) -> PyResult<Option<HandFrame>> {
        Ok(self.decoder.lock(py)?.decode(&packet.packet, packet.arrival).map(|frame| HandFrame { frame }))
    }
}

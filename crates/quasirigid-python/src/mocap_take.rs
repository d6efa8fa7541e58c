//! `Take`, `TakeWriter` and `Replay`: packets of a tracker in files, and on their way again.

use crate::conv;
use crate::mocap::{OrRaiseMocap, Packet, address, duration, figures, pair, raise, read, read_detached};
use crate::mocap_decoder::HandDecoder;
use crate::mocap_frame::HandFrame;
use crate::mocap_parts::named_side;
use crate::process::{ForkMutex, elsewhere};
use crate::value::{Value, from_cbor, to_cbor, value};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use quasirigid_mocap as mocap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

#[doc = doc!("Take")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Take {
    take: mocap::Take,
    /// Its packets as Python has them, read when they are first asked for.
    packets: PyOnceLock<Vec<Py<Packet>>>,
}

impl Take {
    fn new(take: mocap::Take) -> Self {
        Self { take, packets: PyOnceLock::new() }
    }

    fn taken(&self, py: Python<'_>) -> PyResult<&[Py<Packet>]> {
        let taken = || self.take.packets.iter().map(|taken| Py::new(py, Packet::taken(py, taken)?)).collect();
        self.packets.get_or_try_init(py, taken).map(Vec::as_slice)
    }
}

#[pymethods]
impl Take {
    #[doc = doc!("Take.read")]
    #[staticmethod]
    fn read(py: Python<'_>, #[pyo3(from_py_with = conv::path)] path: PathBuf) -> PyResult<Self> {
        py.detach(|| mocap::Take::read(&path)).or_raise(py).map(Self::new)
    }

    #[doc = doc!("Take.pinch")]
    #[staticmethod]
    #[pyo3(signature = (*, seed = 1.into(), rate = 60.0, noise = 3e-4, tremor = 1.5e-4, side = "right"),
           text_signature = "(*, seed=1, rate=60.0, noise=3e-4, tremor=1.5e-4, side='right')")]
    fn pinch(
        py: Python<'_>,
        seed: conv::Whole,
        #[pyo3(from_py_with = conv::real)] rate: f64,
        #[pyo3(from_py_with = conv::real)] noise: f64,
        #[pyo3(from_py_with = conv::real)] tremor: f64,
        #[pyo3(from_py_with = conv::text)] side: &str,
    ) -> PyResult<Self> {
        let seed = conv::within(py, "seed", seed, 0, i64::MAX)? as u64;
        let options = mocap::synthetic::PinchOptions { seed, rate, noise, tremor, side: named_side(py, side)? };
        mocap::synthetic::pinch_take(&options).or_raise(py).map(Self::new)
    }

    #[doc = doc!("Take.write")]
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = conv::path)] path: PathBuf) -> PyResult<()> {
        py.detach(|| self.take.write(&path)).or_raise(py)
    }

    #[getter]
    fn packets(&self, py: Python<'_>) -> PyResult<Vec<Py<Packet>>> {
        Ok(self.taken(py)?.iter().map(|packet| packet.clone_ref(py)).collect())
    }

    #[doc = doc!("Take.arrivals")]
    #[getter]
    fn arrivals<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.take.packets.iter().map(|packet| packet.arrival).collect::<Vec<_>>().into_pyarray(py)
    }

    #[doc = doc!("Take.notes")]
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.take.notes.clone()
    }

    #[doc = doc!("Take.damaged")]
    #[getter]
    fn damaged(&self) -> usize {
        self.take.damaged
    }

    #[doc = doc!("Take.duration")]
    #[getter]
    fn duration(&self) -> f64 {
        self.take.duration()
    }

    #[doc = doc!("Take.statistics")]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut meter = mocap::statistics::StreamMeter::default();
        for taken in self.taken(py)? {
            let taken = taken.get();
            meter.counts().datagrams += 1;
            meter.counts().bytes += taken.bytes.len() as u64;
            meter.add(&taken.packet, taken.arrival);
        }
        figures(py, &meter.figures(self.take.packets.last().map_or(0.0, |last| last.arrival)))
    }

    #[doc = doc!("Take.frames")]
    fn frames(&self, py: Python<'_>, decoder: &HandDecoder) -> PyResult<Vec<HandFrame>> {
        let mut frames = Vec::new();
        for packet in self.taken(py)? {
            frames.extend(decoder.decode(py, packet.get())?);
        }
        Ok(frames)
    }

    fn __len__(&self) -> usize {
        self.take.packets.len()
    }

    fn __repr__(&self) -> String {
        format!("Take({} packets, {:.2} s)", self.take.packets.len(), self.take.duration())
    }
}

#[doc = doc!("TakeWriter")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct TakeWriter {
    /// None once it is closed.
    writer: ForkMutex<Option<mocap::TakeWriter>>,
    /// The process that writes. In a forked child the file is the parent's, and its place in it.
    process: u32,
}

impl TakeWriter {
    /// Refuses a forked child.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        Err(elsewhere(py, "take writer", "one of the process that this one was forked from", "write another file here"))
    }

    fn write(&self, py: Python<'_>, write: impl Send + FnOnce(&mut mocap::TakeWriter) -> mocap::Result<()>) -> PyResult<()> {
        self.check(py)?;
        let mut writer = self.writer.lock(py)?;
        let written = match writer.as_mut() {
            Some(writer) => py.detach(|| write(writer)),
            None => Err(mocap::Error::value("take writer", "an open one", "one that was closed", "open the file again with append=True")),
        };
        drop(writer);
        written.or_raise(py)
    }
}

#[pymethods]
impl TakeWriter {
    #[new]
    #[pyo3(signature = (path, *, append = false))]
    fn new(py: Python<'_>, #[pyo3(from_py_with = conv::path)] path: PathBuf, append: bool) -> PyResult<Self> {
        let open = || if append { mocap::TakeWriter::append(&path) } else { mocap::TakeWriter::create(&path) };
        py.detach(open).or_raise(py).map(|writer| Self { writer: ForkMutex::new("take writer", Some(writer)), process: std::process::id() })
    }

    #[doc = doc!("TakeWriter.note")]
    fn note(&self, py: Python<'_>, #[pyo3(from_py_with = conv::text)] text: &str) -> PyResult<()> {
        self.write(py, |writer| writer.note(text))
    }

    #[doc = doc!("TakeWriter.packet")]
    fn packet(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] arrival: f64, data: &[u8]) -> PyResult<()> {
        self.write(py, |writer| writer.packet(arrival, data))
    }

    #[doc = doc!("TakeWriter.close")]
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.check(py)?;
        *self.writer.lock(py)? = None;
        Ok(())
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        // An error is a forked child that leaves the block: its parent goes on writing.
        let _ = self.close(py);
    }
}

#[doc = doc!("Replay")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Replay {
    replay: RwLock<mocap::Replay>,
    address: SocketAddr,
    process: u32,
}

impl Replay {
    /// Refuses a forked child: nothing is sent from there.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        Err(elsewhere(py, "replay", "one of the process that this one was forked from", "start another one here"))
    }
}

#[pymethods]
impl Replay {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (take, targets = vec![], *, speed = 1.0, rounds = 1.into(), source_port = 50_107.into(), bind = None,
                        serve_greeters = true,
                        bodies = false),
           text_signature = "(take, targets=(), *, speed=1.0, rounds=1, source_port=50107, bind=None, serve_greeters=True, bodies=False)")]
    fn new(
        py: Python<'_>,
        take: &Take,
        #[pyo3(from_py_with = conv::texts)] targets: Vec<String>,
        #[pyo3(from_py_with = conv::real)] speed: f64,
        rounds: conv::Whole,
        source_port: conv::Whole,
        #[pyo3(from_py_with = conv::optional_text)] bind: Option<&str>,
        serve_greeters: bool,
        bodies: bool,
    ) -> PyResult<Self> {
        let rounds = conv::within(py, "rounds", rounds, 0, i64::from(u32::MAX))? as u32;
        let (source_port, bind) = (conv::port(py, "source_port", source_port, 0)?, bind.map(|text| address(py, "bind", text)).transpose()?);
        let options = mocap::ReplayOptions { speed, rounds, source_port, bind, serve_greeters, bodies, ..Default::default() };
        let start = || {
            let targets =
                targets.iter().map(|text| mocap::endpoint::target(text).map(SocketAddr::V4)).collect::<mocap::Result<Vec<_>>>()?;
            mocap::Replay::start(&take.take, &targets, &options)
        };
        py.detach(start).or_raise(py).map(|replay| Self {
            address: replay.address(),
            replay: RwLock::new(replay),
            process: std::process::id(),
        })
    }

    #[doc = doc!("Replay.address")]
    #[getter]
    fn address(&self) -> (String, u16) {
        pair(self.address)
    }

    #[doc = doc!("Replay.wait")]
    fn wait(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] timeout: f64) -> PyResult<bool> {
        self.check(py)?;
        let end = std::time::Instant::now() + duration(py, "timeout", timeout)?;
        loop {
            let left = end.saturating_duration_since(std::time::Instant::now());
            let done = py.detach(|| read_detached(&self.replay).wait(left.min(Duration::from_millis(50))));
            py.check_signals()?;
            if done || left.is_zero() {
                let failure = read(py, &self.replay).state().failure;
                return match failure {
                    Some(failure) => Err(raise(py, &failure)),
                    None => Ok(done),
                };
            }
        }
    }

    #[doc = doc!("Replay.state")]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.check(py)?;
        let s = read(py, &self.replay).state();
        let dict = PyDict::new(py);
        dict.set_item("sent", s.sent)?;
        dict.set_item("rounds", s.rounds)?;
        dict.set_item("greetings", s.greetings)?;
        dict.set_item("targets", s.targets.iter().copied().map(pair).collect::<Vec<_>>())?;
        dict.set_item("displaced", s.displaced)?;
        dict.set_item("expired", s.expired)?;
        dict.set_item("strangers", s.strangers)?;
        dict.set_item("withheld", s.withheld)?;
        dict.set_item("refused", s.refused)?;
        dict.set_item("latest", s.latest)?;
        dict.set_item("done", s.done)?;
        Ok(dict)
    }

    #[doc = doc!("Replay.stop")]
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.check(py)?;
        py.detach(|| self.replay.write().unwrap_or_else(PoisonError::into_inner).stop());
        Ok(())
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        // An error is a forked child that leaves the block: its parent goes on sending.
        let _ = self.stop(py);
    }
}

impl Value for Take {
    const NAME: &'static str = "Take";

    fn same(&self, other: &Self) -> bool {
        self.take == other.take
    }

    fn digest(&self) -> Vec<f64> {
        vec![self.take.packets.len() as f64, self.take.damaged as f64, self.take.duration()]
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.take)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let take: mocap::Take = from_cbor(bytes)?;
        take.check().map_err(|error| error.to_string())?;
        Ok(Self::new(take))
    }
}

value!(Take);

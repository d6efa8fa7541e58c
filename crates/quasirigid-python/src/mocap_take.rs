//! `Take`, `TakeWriter` and `Replay`: packets of a tracker in files, and on their way again.

use crate::conv;
use crate::mocap::{OrRaiseMocap, Packet, address, duration, figures, lock, pair, parse, raise, read, read_detached};
use crate::mocap_hand::{HandDecoder, HandFrame, named_side};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quasirigid_mocap as mocap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError, RwLock};
use std::time::Duration;

#[doc = doc!("Take")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Take {
    take: mocap::Take,
}

#[pymethods]
impl Take {
    #[doc = doc!("Take.read")]
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| mocap::Take::read(&path)).or_raise(py).map(|take| Self { take })
    }

    #[doc = doc!("Take.pinch")]
    #[staticmethod]
    #[pyo3(signature = (*, seed = 1.into(), rate = 60.0, noise = 3e-4, tremor = 1.5e-4, side = "right"),
           text_signature = "(*, seed=1, rate=60.0, noise=3e-4, tremor=1.5e-4, side='right')")]
    fn pinch(py: Python<'_>, seed: conv::Whole, rate: f64, noise: f64, tremor: f64, side: &str) -> PyResult<Self> {
        let seed = conv::within(py, "seed", seed, 0, i64::MAX)? as u64;
        let options = mocap::synthetic::PinchOptions { seed, rate, noise, tremor, side: named_side(py, side)? };
        mocap::synthetic::pinch_take(&options).or_raise(py).map(|take| Self { take })
    }

    #[doc = doc!("Take.write")]
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.take.write(&path)).or_raise(py)
    }

    #[getter]
    fn packets(&self, py: Python<'_>) -> PyResult<Vec<Packet>> {
        self.take.packets.iter().map(|taken| Packet::taken(py, taken)).collect()
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
        for taken in &self.take.packets {
            meter.counts().datagrams += 1;
            meter.counts().bytes += taken.bytes.len() as u64;
            meter.add(&parse(py, &taken.bytes)?, taken.arrival);
        }
        figures(py, &meter.figures(self.take.packets.last().map_or(0.0, |last| last.arrival)))
    }

    #[doc = doc!("Take.frames")]
    fn frames(&self, py: Python<'_>, decoder: &HandDecoder) -> PyResult<Vec<HandFrame>> {
        let mut frames = Vec::new();
        for packet in self.packets(py)? {
            frames.extend(decoder.decode(py, &packet));
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
    writer: Mutex<Option<mocap::TakeWriter>>,
}

impl TakeWriter {
    fn write(&self, py: Python<'_>, write: impl Send + FnOnce(&mut mocap::TakeWriter) -> mocap::Result<()>) -> PyResult<()> {
        let mut writer = lock(py, &self.writer);
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
    fn new(py: Python<'_>, path: PathBuf, append: bool) -> PyResult<Self> {
        let open = || if append { mocap::TakeWriter::append(&path) } else { mocap::TakeWriter::create(&path) };
        py.detach(open).or_raise(py).map(|writer| Self { writer: Mutex::new(Some(writer)) })
    }

    #[doc = doc!("TakeWriter.note")]
    fn note(&self, py: Python<'_>, text: &str) -> PyResult<()> {
        self.write(py, |writer| writer.note(text))
    }

    #[doc = doc!("TakeWriter.packet")]
    fn packet(&self, py: Python<'_>, arrival: f64, data: &[u8]) -> PyResult<()> {
        self.write(py, |writer| writer.packet(arrival, data))
    }

    #[doc = doc!("TakeWriter.close")]
    fn close(&self, py: Python<'_>) {
        *lock(py, &self.writer) = None;
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        self.close(py);
    }
}

#[doc = doc!("Replay")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Replay {
    replay: RwLock<mocap::Replay>,
}

#[pymethods]
impl Replay {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (take, targets = vec![], *, speed = 1.0, rounds = 1.into(), source_port = 50_107.into(), bind = None, serve_greeters = true,
                        bodies = false),
           text_signature = "(take, targets=(), *, speed=1.0, rounds=1, source_port=50107, bind=None, serve_greeters=True, bodies=False)")]
    fn new(
        py: Python<'_>,
        take: &Take,
        targets: Vec<String>,
        speed: f64,
        rounds: conv::Whole,
        source_port: conv::Whole,
        bind: Option<&str>,
        serve_greeters: bool,
        bodies: bool,
    ) -> PyResult<Self> {
        let rounds = conv::within(py, "rounds", rounds, 0, i64::from(u32::MAX))? as u32;
        let (source_port, bind) = (conv::port(py, "source_port", source_port, 0)?, bind.map(|text| address(py, "bind", text)).transpose()?);
        let options = mocap::ReplayOptions { speed, rounds, source_port, bind, serve_greeters, bodies };
        let start = || {
            let targets =
                targets.iter().map(|text| mocap::endpoint::target(text).map(SocketAddr::V4)).collect::<mocap::Result<Vec<_>>>()?;
            mocap::Replay::start(&take.take, &targets, &options)
        };
        py.detach(start).or_raise(py).map(|replay| Self { replay: RwLock::new(replay) })
    }

    #[doc = doc!("Replay.address")]
    #[getter]
    fn address(&self, py: Python<'_>) -> (String, u16) {
        pair(read(py, &self.replay).address())
    }

    #[doc = doc!("Replay.wait")]
    fn wait(&self, py: Python<'_>, timeout: f64) -> PyResult<bool> {
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
        let s = read(py, &self.replay).state();
        let dict = PyDict::new(py);
        dict.set_item("sent", s.sent)?;
        dict.set_item("rounds", s.rounds)?;
        dict.set_item("greetings", s.greetings)?;
        dict.set_item("targets", s.targets.iter().copied().map(pair).collect::<Vec<_>>())?;
        dict.set_item("displaced", s.displaced)?;
        dict.set_item("refused", s.refused)?;
        dict.set_item("latest", s.latest)?;
        dict.set_item("done", s.done)?;
        Ok(dict)
    }

    #[doc = doc!("Replay.stop")]
    fn stop(&self, py: Python<'_>) {
        py.detach(|| self.replay.write().unwrap_or_else(PoisonError::into_inner).stop());
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        self.stop(py);
    }
}

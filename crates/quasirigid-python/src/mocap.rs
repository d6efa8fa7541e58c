//! `Packet` and `Receiver`: packets of a tracker on the network. And what the other files of motion capture share.

use crate::conv;
use crate::errors::to_py;
use crate::process::elsewhere;
use pyo3::prelude::*;
use pyo3::sync::RwLockExt;
use pyo3::types::{PyBytes, PyDict};
use quasirigid_mocap as mocap;
use quasirigid_mocap::{Error, Order};
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};
use std::time::Duration;

/// `?` for results of the mocap crate.
pub trait OrRaiseMocap<T> {
    /// The value, or the exception for the error.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaiseMocap<T> for mocap::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| raise(py, &error))
    }
}

/// The exception of `quasirigid.errors` for an error of the mocap crate.
pub(crate) fn raise(py: Python<'_>, error: &Error) -> PyErr {
    let (class, what, expected, got, hint) = match error {
        Error::InvalidValue { what, expected, got, hint } => ("InvalidValueError", what, expected, got, hint),
        Error::File { what, expected, got, hint } => ("CaptureFileError", what, expected, got, hint),
        Error::Network { what, expected, got, hint } => ("NetworkError", what, expected, got, hint),
        other => return pyo3::exceptions::PyRuntimeError::new_err(other.to_string()),
    };
    crate::errors::make(py, class, [what, expected, got, hint])
}

/// What is shared, to read it, waiting without the GIL: whoever has it may want the GIL before it gives it back. An error is raised after
/// that.
pub(crate) fn read<'a, T>(py: Python<'_>, shared: &'a RwLock<T>) -> RwLockReadGuard<'a, T> {
    shared.read_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

/// The same for a thread that has let go of the GIL already.
pub(crate) fn read_detached<T>(shared: &RwLock<T>) -> RwLockReadGuard<'_, T> {
    shared.read().unwrap_or_else(PoisonError::into_inner)
}

/// Seconds from Python; NaN and negative numbers are refused, more than a year is for ever.
pub(crate) fn duration(py: Python<'_>, what: &str, seconds: f64) -> PyResult<Duration> {
    mocap::error::check_within(what, seconds, 0.0, f64::MAX, "s").or_raise(py)?;
    Ok(Duration::from_secs_f64(seconds.min(3.2e7)))
}

pub(crate) fn address(py: Python<'_>, what: &str, text: &str) -> PyResult<Ipv4Addr> {
    text.parse().map_err(|_| {
        let expected = "an IPv4 address in numbers";
        to_py(py, &quasirigid::Error::value(what, expected, format!("{text:?}"), "127.0.0.1 is this machine, 0.0.0.0 any address of it"))
    })
}

/// (address, port).
pub(crate) fn pair(address: SocketAddr) -> (String, u16) {
    (address.ip().to_string(), address.port())
}

#[doc = doc!("Packet")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Packet {
    pub(crate) packet: mocap::dtrack::Packet,
    pub(crate) arrival: f64,
    pub(crate) bytes: Vec<u8>,
    from: Option<SocketAddr>,
    order: Option<Order>,
}

impl Packet {
    fn received(received: &mocap::Received) -> Self {
        Self {
            packet: received.packet.clone(),
            arrival: received.arrival,
            bytes: received.bytes.clone(),
            from: Some(received.from),
            order: Some(received.order),
        }
    }

    pub(crate) fn taken(py: Python<'_>, taken: &mocap::TakePacket) -> PyResult<Self> {
        Ok(Self { packet: parse(py, &taken.bytes)?, arrival: taken.arrival, bytes: taken.bytes.clone(), from: None, order: None })
    }
}

fn parse(py: Python<'_>, bytes: &[u8]) -> PyResult<mocap::dtrack::Packet> {
    mocap::dtrack::Packet::parse(bytes).map_err(|error| {
        let why = error.to_string();
        crate::errors::make(
            py,
            "PacketError",
            ["packet", "a DTrack packet", &why, "lines that begin with fr, ts, gl, 6d and the like: is it DTrack that sends?"],
        )
    })
}

#[pymethods]
impl Packet {
    #[doc = doc!("Packet.parse")]
    #[staticmethod]
    #[pyo3(signature = (data, arrival = 0.0))]
    fn parse(py: Python<'_>, data: &[u8], #[pyo3(from_py_with = conv::real)] arrival: f64) -> PyResult<Self> {
        mocap::error::check_within("arrival", arrival, f64::MIN, f64::MAX, "s").or_raise(py)?;
        Ok(Self { packet: parse(py, data)?, arrival, bytes: data.to_vec(), from: None, order: None })
    }

    #[doc = doc!("Packet.frame")]
    #[getter]
    fn frame(&self) -> u32 {
        self.packet.frame
    }

    #[doc = doc!("Packet.time")]
    #[getter]
    fn time(&self) -> Option<f64> {
        self.packet.time()
    }

    #[doc = doc!("Packet.arrival")]
    #[getter]
    fn arrival(&self) -> f64 {
        self.arrival
    }

    #[doc = doc!("Packet.data")]
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    #[doc = doc!("Packet.sender")]
    #[getter]
    fn sender(&self) -> Option<(String, u16)> {
        self.from.map(pair)
    }

    #[doc = doc!("Packet.order")]
    #[getter]
    fn order(&self) -> Option<&'static str> {
        self.order.map(|order| match order {
            Order::New => "new",
            Order::Late => "late",
            Order::Duplicate => "duplicate",
            Order::Restart => "restart",
        })
    }

    #[doc = doc!("Packet.bodies")]
    #[getter]
    fn bodies(&self) -> BTreeMap<u32, [f64; 3]> {
        let seen = self.packet.bodies.iter().flatten().filter(|body| body.is_tracked());
        seen.map(|body| (body.id, mocap::hands::pose_from_placement(&body.placement).translation.vector.into())).collect()
    }

    #[doc = doc!("Packet.hands")]
    #[getter]
    fn hands(&self) -> Vec<(u32, &'static str, Vec<bool>)> {
        let hand = |hand: &mocap::dtrack::Hand| {
            (hand.id, hand.side.name(), hand.fingers.iter().map(mocap::dtrack::HandFinger::is_tracked).collect())
        };
        self.packet.hands.iter().flatten().map(hand).collect()
    }

    #[doc = doc!("Packet.counts")]
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (p, dict) = (&self.packet, PyDict::new(py));
        let counts = [
            ("calibrated_bodies", p.standard_bodies()),
            ("bodies", p.bodies.as_ref().map(|_| self.bodies().len() as u32)),
            ("hybrid_bodies", p.hybrid_bodies.as_ref().map(|b| b.len() as u32)),
            ("flysticks", p.flysticks.as_ref().map(|f| f.items.len()).or(p.old_flysticks.as_ref().map(Vec::len)).map(|n| n as u32)),
            ("tools", p.tools.as_ref().map(|t| t.items.len()).or(p.old_tools.as_ref().map(Vec::len)).map(|n| n as u32)),
            ("markers", p.markers.as_ref().map(|m| m.len() as u32)),
            ("calibrated_hands", p.calibrated_hands),
            ("hands", p.hands.as_ref().map(|h| h.len() as u32)),
            ("people", p.people.as_ref().map(|l| l.items.len() as u32)),
            ("unknown_lines", Some(p.unknown_lines)),
        ];
        for (name, count) in counts {
            dict.set_item(name, count)?;
        }
        Ok(dict)
    }

    fn __repr__(&self) -> String {
        format!(
            "Packet(frame={}, {} bytes, {} hands, {} bodies)",
            self.packet.frame,
            self.bytes.len(),
            self.hands().len(),
            self.bodies().len()
        )
    }
}

/// Figures of a stream as a dictionary.
pub(crate) fn figures<'py>(py: Python<'py>, s: &mocap::Statistics) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let counts = [
        ("datagrams", s.datagrams),
        ("bytes", s.bytes),
        ("packets", s.packets),
        ("lost", s.lost),
        ("late", s.late),
        ("duplicates", s.duplicates),
        ("restarts", s.restarts),
        ("malformed", s.malformed),
        ("oversize", s.oversize),
        ("empty", s.empty),
        ("foreign", s.foreign),
        ("overrun", s.overrun),
    ];
    for (name, count) in counts {
        dict.set_item(name, count)?;
    }
    let (mean, largest) = s.pick_up;
    let figures = [
        ("rate", Some(s.rate)),
        ("tracker_rate", Some(s.tracker_rate)),
        ("jitter", Some(s.jitter)),
        ("lateness", Some(s.lateness)),
        ("tracker_latency", s.tracker_latency),
        ("pick_up_mean", Some(mean)),
        ("pick_up_max", Some(largest)),
    ];
    for (name, figure) in figures {
        dict.set_item(name, figure)?;
    }
    dict.set_item("last_refusal", s.last_refusal.map(|why| why.to_string()))?;
    Ok(dict)
}

#[doc = doc!("Receiver")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Receiver {
    // Written to close it; all else only reads, so that nobody waits for one who waits.
    receiver: RwLock<mocap::Receiver>,
    address: SocketAddr,
    process: u32,
}

impl Receiver {
    /// Refuses a forked child: nothing is heard there.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        Err(elsewhere(py, "receiver", "one of the process that this one was forked from", "close it before the fork, and open one here"))
    }
}

#[pymethods]
impl Receiver {
    #[new]
    #[pyo3(signature = (connection = "5000", *, bind = "0.0.0.0", interface = "0.0.0.0", max_bytes = 32_768.into(),
                        controller_port = 50_107.into()),
           text_signature = "(connection='5000', *, bind='0.0.0.0', interface='0.0.0.0', max_bytes=32768, controller_port=50107)")]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::text)] connection: &str,
        #[pyo3(from_py_with = conv::text)] bind: &str,
        #[pyo3(from_py_with = conv::text)] interface: &str,
        max_bytes: conv::Whole,
        controller_port: conv::Whole,
    ) -> PyResult<Self> {
        let (bind, interface) = (address(py, "bind", bind)?, address(py, "interface", interface)?);
        let (max_bytes, controller_port) =
            (conv::count(py, "max_bytes", max_bytes)?, conv::port(py, "controller_port", controller_port, 1)?);
        let options = mocap::ReceiverOptions { bind, interface, max_bytes, controller_port };
        // Names of hosts are looked up, which may take long.
        let receiver = py.detach(|| mocap::Receiver::open(mocap::Endpoint::parse(connection)?, &options)).or_raise(py)?;
        Ok(Self { address: receiver.address(), receiver: RwLock::new(receiver), process: std::process::id() })
    }

    #[doc = doc!("Receiver.address")]
    #[getter]
    fn address(&self) -> (String, u16) {
        pair(self.address)
    }

    #[doc = doc!("Receiver.now")]
    fn now(&self, py: Python<'_>) -> PyResult<f64> {
        self.check(py)?;
        Ok(read(py, &self.receiver).now())
    }

    #[doc = doc!("Receiver.wait")]
    fn wait(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] timeout: f64) -> PyResult<bool> {
        self.check(py)?;
        let end = std::time::Instant::now() + duration(py, "timeout", timeout)?;
        loop {
            // In pieces, so that Ctrl-C is heard and `close` from another thread is not kept waiting.
            let left = end.saturating_duration_since(std::time::Instant::now());
            let came = py.detach(|| read_detached(&self.receiver).wait(left.min(Duration::from_millis(50))));
            py.check_signals()?;
            let failure = read(py, &self.receiver).failure();
            if let Some(failure) = failure {
                return Err(raise(py, &failure));
            }
            if came || left.is_zero() {
                return Ok(came);
            }
        }
    }

    #[doc = doc!("Receiver.take")]
    fn take(&self, py: Python<'_>) -> PyResult<Vec<Packet>> {
        self.check(py)?;
        let taken = py.detach(|| read_detached(&self.receiver).take());
        Ok(taken.iter().map(|received| Packet::received(received)).collect())
    }

    #[doc = doc!("Receiver.latest")]
    #[getter]
    fn latest(&self, py: Python<'_>) -> PyResult<Option<Packet>> {
        self.check(py)?;
        let latest: Option<Arc<mocap::Received>> = py.detach(|| read_detached(&self.receiver).latest());
        Ok(latest.map(|received| Packet::received(&received)))
    }

    #[doc = doc!("Receiver.statistics")]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.check(py)?;
        figures(py, &py.detach(|| read_detached(&self.receiver).statistics()))
    }

    #[doc = doc!("Receiver.close")]
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.check(py)?;
        py.detach(|| self.receiver.write().unwrap_or_else(PoisonError::into_inner).close());
        Ok(())
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyAny>) {
        // An error is a forked child that leaves the block: its parent goes on listening.
        let _ = self.close(py);
    }

    fn __repr__(&self) -> String {
        format!("Receiver({})", self.address)
    }
}

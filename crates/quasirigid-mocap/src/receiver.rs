//! Listens for packets on a thread of its own: newest frame first, all frames for whoever wants them, figures of the stream.

use crate::dtrack::Packet;
use crate::endpoint::{CONTROLLER_PORT, Endpoint, GREETING};
use crate::error::{Error, Result};
use crate::own_thread::OwnThread;
use crate::statistics::{Order, Statistics, StreamMeter};
use socket2::{Domain, Protocol, Socket, Type};
use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Packets that wait to be taken; older ones go.
const WAITING: usize = 512;
/// How long the thread sleeps before it looks whether it shall end.
const PATIENCE: Duration = Duration::from_millis(20);
/// Silence after which a controller is greeted again.
const GREET_AGAIN: Duration = Duration::from_secs(2);
/// And while its stream comes: so that firewalls remember who listens, and emulators, which serve nobody for long who does not greet again.
const GREET_ANYWAY: Duration = Duration::from_secs(3);
/// What the socket may hold back while the thread is not running, bytes: a second of the largest packets at 30 Hz.
const SOCKET_BUFFER: usize = 1 << 20;
/// So many failures in a row are no accident.
const FAILURES: u32 = 100;

/// What can be chosen about a [`Receiver`].
#[derive(Debug, Clone, PartialEq)]
pub struct ReceiverOptions {
    /// Address of this machine to listen on. Any by default: trackers are other machines. For a multicast group it names the interface.
    pub bind: Ipv4Addr,
    /// Interface that joins a multicast group; unspecified takes that of `bind`, or lets the system choose.
    pub interface: Ipv4Addr,
    /// Largest datagram that is read, bytes. The vendor's SDK has 32768.
    pub max_bytes: usize,
    /// Port of the controller that is greeted.
    pub controller_port: u16,
}

impl Default for ReceiverOptions {
    fn default() -> Self {
        Self { bind: Ipv4Addr::UNSPECIFIED, interface: Ipv4Addr::UNSPECIFIED, max_bytes: 32_768, controller_port: CONTROLLER_PORT }
    }
}

/// A packet that came.
#[derive(Debug, Clone, PartialEq)]
pub struct Received {
    /// What it says.
    pub packet: Packet,
    /// As it came.
    pub bytes: Vec<u8>,
    /// When it came, s since the receiver was opened.
    pub arrival: f64,
    /// Who sent it.
    pub from: SocketAddr,
    /// Where it stands among the others.
    pub order: Order,
}

#[derive(Default)]
struct State {
    latest: Option<Arc<Received>>,
    waiting: VecDeque<Arc<Received>>,
    meter: StreamMeter,
    failure: Option<Error>,
}

struct Shared {
    state: Mutex<State>,
    news: Condvar,
    stop: AtomicBool,
    start: Instant,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing under the lock panics; and if it did, counters and queues would still be usable.
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn now(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// An open port. Closed when dropped.
pub struct Receiver {
    shared: Arc<Shared>,
    thread: OwnThread,
    address: SocketAddr,
    endpoint: Endpoint,
}

impl Receiver {
    /// Opens the port and starts to listen.
    ///
    /// # Errors
    /// [`Error::Network`] if the port is in use or not allowed, or the group cannot be joined; [`Error::InvalidValue`] for a size of 0 or
    /// over 65507 bytes, and for two interfaces of one group.
    pub fn open(endpoint: Endpoint, options: &ReceiverOptions) -> Result<Self> {
        if !(1..=crate::dtrack::MAX_DATAGRAM).contains(&options.max_bytes) {
            return Err(Error::value("max_bytes", "1 to 65507 bytes", options.max_bytes, "32768 is the vendor's own limit"));
        }
        let socket = open_socket(&endpoint, options)?;
        let failed = |e: io::Error| Error::network(format!("UDP port {}", endpoint.port()), "a usable socket", e, "try another port");
        let address = socket.local_addr().map_err(failed)?;
        socket.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        let shared = Arc::new(Shared {
            state: Mutex::new(State::default()),
            news: Condvar::new(),
            stop: AtomicBool::new(false),
            start: Instant::now(),
        });
        let (for_thread, options) = (Arc::clone(&shared), options.clone());
        let run = move || listen(&socket, &for_thread, endpoint, &options);
        let thread = std::thread::Builder::new().name("quasirigid-mocap".into()).spawn(run).map_err(failed)?;
        Ok(Self { shared, thread: OwnThread::new(thread), address, endpoint })
    }

    /// Address and port that are listened on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What is listened to.
    pub fn endpoint(&self) -> Endpoint {
        self.endpoint
    }

    /// Seconds since it was opened: the clock of [`Received::arrival`].
    pub fn now(&self) -> f64 {
        self.shared.now()
    }

    /// The newest frame, by its counter. None before the first.
    pub fn latest(&self) -> Option<Arc<Received>> {
        self.shared.lock().latest.clone()
    }

    /// All packets that came since the last call and were not taken yet, in order of arrival; at most the last 512.
    pub fn take(&self) -> Vec<Arc<Received>> {
        let mut state = self.shared.lock();
        let now = self.shared.now();
        let taken: Vec<_> = state.waiting.drain(..).collect();
        taken.iter().for_each(|received| state.meter.pick_up(now - received.arrival));
        taken
    }

    /// Waits until there is something to [`Receiver::take`]. False if nothing came in time, or the receiver has failed.
    pub fn wait(&self, timeout: Duration) -> bool {
        let state = self.shared.lock();
        let idle = |state: &mut State| state.waiting.is_empty() && state.failure.is_none();
        match self.shared.news.wait_timeout_while(state, timeout, idle) {
            Ok((state, _)) => !state.waiting.is_empty(),
            Err(_) => false,
        }
    }

    /// Figures of the stream.
    pub fn statistics(&self) -> Statistics {
        self.shared.lock().meter.figures(self.now())
    }

    /// Why it does not listen any more, if so.
    pub fn failure(&self) -> Option<Error> {
        self.shared.lock().failure.clone()
    }

    /// Stops to listen and closes the port. What came can still be taken. In a forked child it does nothing: its parent goes on listening.
    pub fn close(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.thread.join();
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        self.close();
    }
}

fn open_socket(endpoint: &Endpoint, options: &ReceiverOptions) -> Result<UdpSocket> {
    let port = endpoint.port();
    let refuse = |e: io::Error| {
        let hint = match e.kind() {
            ErrorKind::AddrInUse => "another program listens there: end it, or choose another port here and at the controller",
            ErrorKind::PermissionDenied => "ports below 1024 belong to the system: choose another one",
            ErrorKind::AddrNotAvailable => "this machine has no such address: use 0.0.0.0",
            _ => "choose another port or address",
        };
        Error::network(format!("UDP port {port}"), "to listen", e, hint)
    };
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP)).map_err(refuse)?;
    // A larger buffer is a comfort; the system may have a limit.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER);
    if matches!(endpoint, Endpoint::Multicast { .. }) {
        // Several programs may listen to one group.
        socket.set_reuse_address(true).map_err(refuse)?;
    }
    let Endpoint::Multicast { group, .. } = endpoint else {
        socket.bind(&SocketAddr::from((options.bind, port)).into()).map_err(refuse)?;
        return Ok(socket.into());
    };
    let interface = interface(options)?;
    // A socket that is bound to an address of this machine hears no group. Where the group itself can be bound to, others on the same port
    // are not heard.
    let address = if cfg!(unix) { *group } else { Ipv4Addr::UNSPECIFIED };
    socket.bind(&SocketAddr::from((address, port)).into()).map_err(refuse)?;
    let hint = "check that the network is up, or name the interface to use by its address: `bind`, or --bind on the command line";
    let on = if interface.is_unspecified() { String::new() } else { format!(" on {interface}") };
    let failed = |e: io::Error| Error::network(format!("multicast group {group}{on}"), "to join", e, hint);
    socket.join_multicast_v4(group, &interface).map_err(failed)?;
    Ok(socket.into())
}

/// The interface that joins a group.
fn interface(options: &ReceiverOptions) -> Result<Ipv4Addr> {
    match (options.bind, options.interface) {
        (one, other) if one == other || other.is_unspecified() => Ok(one),
        (one, other) if one.is_unspecified() => Ok(other),
        (one, other) => Err(Error::value("interface", format!("{one}, the address to listen on"), other, "give one of the two")),
    }
}

/// The thread.
fn listen(socket: &UdpSocket, shared: &Shared, endpoint: Endpoint, options: &ReceiverOptions) {
    let mut buffer = vec![0u8; crate::dtrack::MAX_DATAGRAM + 1];
    let greeted = match endpoint {
        Endpoint::Controller { host, greet: true, .. } => Some(SocketAddrV4::new(host, options.controller_port)),
        _ => None,
    };
    let (mut last_word, mut last_greeting, mut failures) = (None::<Instant>, None::<Instant>, 0);
    while !shared.stop.load(Ordering::Relaxed) {
        if let Some(controller) = greeted
            && (last_word.is_none_or(|at| at.elapsed() > GREET_AGAIN) || last_greeting.is_none_or(|at| at.elapsed() > GREET_ANYWAY))
        {
            // Nobody there yet is no error: the controller may come later.
            let _ = socket.send_to(GREETING, controller);
            (last_word, last_greeting) = (Some(Instant::now()), Some(Instant::now()));
        }
        match socket.recv_from(&mut buffer) {
            Ok((length, from)) => {
                failures = 0;
                // What is refused is no word of the controller: it still has to be greeted.
                if take_in(shared, &buffer[..length], from, endpoint, options.max_bytes) {
                    last_word = Some(Instant::now());
                }
            }
            // Timeouts; and what a greeting that found nobody brings back.
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => failures = 0,
            Err(e) if failures < FAILURES => {
                failures += 1;
                if !matches!(e.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset) {
                    std::thread::sleep(PATIENCE);
                }
            }
            Err(e) => {
                let what = format!("UDP port {}", endpoint.port());
                shared.lock().failure = Some(Error::network(what, "to receive", e, "check the network and open it again"));
                shared.news.notify_all();
                return;
            }
        }
    }
}

/// One datagram: counted, read, put in its place. Whether it was a packet of the tracker.
fn take_in(shared: &Shared, bytes: &[u8], from: SocketAddr, endpoint: Endpoint, max_bytes: usize) -> bool {
    let arrival = shared.now();
    let foreign = matches!(endpoint, Endpoint::Controller { host, .. } if from.ip() != IpAddr::V4(host));
    // Read before locking: whoever asks for the newest frame does not wait for it.
    let parsed = if foreign || bytes.is_empty() || bytes.len() > max_bytes { None } else { Some(Packet::parse(bytes)) };
    let mut state = shared.lock();
    let counts = state.meter.counts();
    counts.datagrams += 1;
    counts.bytes += bytes.len() as u64;
    match parsed {
        None if foreign => counts.foreign += 1,
        None if bytes.is_empty() => counts.empty += 1,
        None => counts.oversize += 1,
        Some(Err(why)) => {
            counts.malformed += 1;
            counts.last_refusal = Some(why);
        }
        Some(Ok(packet)) => {
            let order = state.meter.add(&packet, arrival);
            let received = Arc::new(Received { packet, bytes: bytes.to_vec(), arrival, from, order });
            if matches!(order, Order::New | Order::Restart) {
                state.latest = Some(Arc::clone(&received));
            }
            if state.waiting.len() == WAITING {
                state.waiting.pop_front();
                state.meter.counts().overrun += 1;
            }
            state.waiting.push_back(received);
            drop(state);
            shared.news.notify_all();
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A controller is greeted until a packet of its own has come: strangers and nonsense do not stop that.
    #[test]
    fn only_packets_of_the_controller_count_as_its_word() {
        let shared = Shared { state: Mutex::default(), news: Condvar::new(), stop: AtomicBool::new(false), start: Instant::now() };
        let (host, stranger) = (Ipv4Addr::new(10, 0, 0, 7), Ipv4Addr::new(10, 0, 0, 8));
        let endpoint = Endpoint::Controller { host, port: 5000, greet: true };
        let heard = |bytes: &[u8], from: Ipv4Addr| take_in(&shared, bytes, SocketAddr::from((from, 50_107)), endpoint, 100);
        let packet = b"fr 1\r\n6d 0\r\n";
        assert_eq!([heard(packet, stranger), heard(b"hello", host), heard(b"", host), heard(&[b'x'; 200], host)], [false; 4]);
        assert!(heard(packet, host) && heard(packet, host), "a duplicate is a word as well");
    }
}

//! The emulator: sends a take as a controller would, in time, from the controller's port, deaf to nothing but greetings.

mod sender;

pub use sender::ReplayState;

use crate::dtrack::Packet;
use crate::endpoint::CONTROLLER_PORT;
use crate::error::{Error, Result, check_within};
use crate::hands::{FingertipIds, add_fingertips_as_bodies};
use crate::own_thread::OwnThread;
use crate::take::Take;
use sender::{Sender, Shared};
use std::cell::RefCell;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How long it sleeps before it looks for greetings and for the wish to stop.
const NAP: Duration = Duration::from_millis(10);
/// So many packets in a row that cannot be sent are no accident.
const FAILURES: u64 = 100;
const DAY: f64 = 86_400.0;

/// What can be chosen about a [`Replay`].
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// 1 is as it was recorded, 2 twice as fast.
    pub speed: f64,
    /// How often it is sent; 0 until it is stopped. Counters and clocks go on from round to round.
    pub rounds: u32,
    /// Port to send from: 50107 as a controller does. If it is taken, or 0, any.
    pub source_port: u16,
    /// Address of this machine to send from; None is 127.0.0.1 if all targets are there, and else any. Whoever reaches it can greet, and
    /// the stream then goes to the address that the greeting bears, which may be forged. So only addresses of local networks are served
    /// (loopback, private, link-local), no longer than `greeter_stays` for a greeting, and at 500 packets per second at most.
    pub bind: Option<Ipv4Addr>,
    /// Send to whoever greets, too.
    pub serve_greeters: bool,
    /// How long one that greeted is served without greeting again. Nobody says goodbye, so this ends the stream to who has gone, or never
    /// asked. Our receivers greet every 3 s; one that greets only once has to be named as a target. 10 s by default, a minute at most.
    pub greeter_stays: Duration,
    /// Send each tracked fingertip as a body of `6d` as well.
    pub bodies: bool,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self {
            speed: 1.0,
            rounds: 1,
            source_port: CONTROLLER_PORT,
            bind: None,
            serve_greeters: true,
            greeter_stays: Duration::from_secs(10),
            bodies: false,
        }
    }
}

/// A take on its way. Stopped when dropped.
pub struct Replay {
    shared: Arc<Shared>,
    thread: OwnThread,
    address: SocketAddr,
}

impl Replay {
    /// Starts to send to the targets (a multicast group is one, too). Without targets it waits for the first greeting.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for an empty take, a speed outside 0.01 to 100, nobody to send to, or more bodies than the format has ids
    /// for; [`Error::Network`] without a usable socket.
    pub fn start(take: &Take, targets: &[SocketAddr], options: &ReplayOptions) -> Result<Self> {
        check_within("speed", options.speed, 0.01, 100.0, "times real time")?;
        if take.packets.is_empty() {
            return Err(Error::value("take", "at least one packet", "none", "give a take made by `quasirigid mocap record`"));
        }
        if targets.is_empty() && !options.serve_greeters {
            return Err(Error::value("targets", "somebody to send to", "none", "name a target, or serve those who greet"));
        }
        let longest = Duration::from_secs(60);
        if options.greeter_stays > longest {
            let got = format!("{:?}", options.greeter_stays);
            return Err(Error::value("greeter_stays", "at most a minute", got, "name as a target who is to be served for longer"));
        }
        let script = Script::new(take, options)?;
        let from = options.bind.unwrap_or_else(|| usual_address(targets));
        let bind = |port| UdpSocket::bind((from, port));
        // A port that is taken is no reason to give up: `address` says which one it is.
        let refuse = |e| Error::network(format!("address {from}"), "to send", e, "choose another address of this machine");
        let socket = bind(options.source_port).or_else(|_| bind(0)).map_err(refuse)?;
        socket.set_nonblocking(true).map_err(refuse)?;
        let address = socket.local_addr().map_err(refuse)?;
        let state = ReplayState { targets: targets.to_vec(), ..ReplayState::default() };
        let shared = Arc::new(Shared { state: Mutex::new(state), stop: AtomicBool::new(false) });
        let (for_thread, options, named) = (Arc::clone(&shared), options.clone(), targets.len());
        let run = move || {
            let (serve, stays, heard) = (options.serve_greeters, options.greeter_stays, RefCell::default());
            script.play(&Sender { socket, shared: &for_thread, named, serve, stays, heard }, &options);
            for_thread.lock().done = true;
        };
        let thread = std::thread::Builder::new().name("quasirigid-replay".into()).spawn(run).map_err(refuse)?;
        Ok(Self { shared, thread: OwnThread::new(thread), address })
    }

    /// Address and port that it sends from.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// How far it is.
    pub fn state(&self) -> ReplayState {
        self.shared.lock().clone()
    }

    /// Waits for the end, at most so long. Whether it has ended.
    pub fn wait(&self, timeout: Duration) -> bool {
        let start = Instant::now();
        while !self.shared.lock().done {
            if start.elapsed() >= timeout {
                return false;
            }
            std::thread::sleep(NAP.min(timeout));
        }
        true
    }

    /// Stops. In a forked child it does nothing: its parent goes on sending.
    pub fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.thread.join();
    }
}

impl Drop for Replay {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Packets ready to be sent, and what is needed to send them once more.
struct Script {
    /// Seconds from the first packet, and the packet.
    packets: Vec<(f64, Vec<u8>)>,
    /// From the first packet of a round to the first of the next, s.
    round: f64,
    /// Frames of a round by the counter.
    frames: u32,
    /// Stamps of the first packet that has one: `ts`, s, and `ts2`, microseconds since 1970.
    first_of_day: f64,
    first_unix: i64,
}

impl Script {
    fn new(take: &Take, options: &ReplayOptions) -> Result<Self> {
        let first = take.packets[0].arrival;
        let parsed: Vec<Packet> = take.packets.iter().filter_map(|p| p.parse().ok()).collect();
        let ids = if options.bodies { Some(FingertipIds::of(&parsed)?) } else { None };
        let ready = |bytes: &[u8]| match (Packet::parse(bytes), &ids) {
            (Ok(mut packet), Some(ids)) => {
                add_fingertips_as_bodies(&mut packet, ids);
                packet.to_bytes()
            }
            _ => bytes.to_vec(),
        };
        let packets: Vec<_> = take.packets.iter().map(|p| (p.arrival - first, ready(&p.bytes))).collect();
        let frames = match (parsed.first(), parsed.last()) {
            (Some(first), Some(last)) => last.frame.wrapping_sub(first.frame).wrapping_add(1),
            _ => 0,
        };
        let steps = packets.len().max(2) - 1;
        let round = take.duration() * (1.0 + 1.0 / steps as f64);
        let first_of_day = parsed.iter().find_map(|packet| packet.time_of_day).unwrap_or(0.0);
        let first_unix = parsed.iter().find_map(|packet| packet.unix_time).map_or(0, |t| micros(t.seconds, t.microseconds));
        Ok(Self { packets, round: if round > 0.0 { round } else { 1.0 / 60.0 }, frames, first_of_day, first_unix })
    }

    fn play(&self, sender: &Sender<'_>, options: &ReplayOptions) {
        let shared = sender.shared;
        while shared.lock().targets.is_empty() {
            if !sender.rest(NAP) {
                return;
            }
        }
        let start = Instant::now();
        let mut failed_in_a_row = 0;
        for round in 0.. {
            if options.rounds > 0 && round == options.rounds {
                return;
            }
            let begun = f64::from(round) * self.round;
            for (at, bytes) in &self.packets {
                let due = (begun + at) / options.speed;
                while start.elapsed().as_secs_f64() < due {
                    let left = Duration::from_secs_f64(due).saturating_sub(start.elapsed());
                    if !sender.rest(left.min(NAP)) {
                        return;
                    }
                }
                // Without naps, when it is late or fast, it must hear the wish to stop as well.
                if !sender.rest(Duration::ZERO) {
                    return;
                }
                let late = start.elapsed().as_secs_f64() - due;
                let changed;
                let bytes = if round > 0 || options.speed != 1.0 {
                    changed = self.retimed(bytes, round, options.speed);
                    &changed
                } else {
                    bytes
                };
                let targets = sender.to_be_served();
                let mut refused = None;
                for target in &targets {
                    refused = sender.socket.send_to(bytes, target).err().filter(|e| is_failure(e.kind())).or(refused);
                }
                let mut state = shared.lock();
                state.sent += 1;
                state.latest = state.latest.max(late);
                failed_in_a_row = if refused.is_some() { failed_in_a_row + 1 } else { 0 };
                if let Some(error) = refused {
                    state.refused += 1;
                    if failed_in_a_row == FAILURES {
                        let name = targets.first().map_or(String::new(), ToString::to_string);
                        state.failure = Some(Error::network(name, "to send", error, "check the address and the network"));
                        return;
                    }
                }
            }
            shared.lock().rounds = round + 1;
        }
    }

    /// A packet whose counter and clocks go on from round to round and run with the speed of the replay. All else stays as it is.
    fn retimed(&self, bytes: &[u8], round: u32, speed: f64) -> Vec<u8> {
        // From s after the first packet to s after the first that was sent.
        let moved = |since: f64| (since + f64::from(round) * self.round) / speed;
        let mut out = Vec::with_capacity(bytes.len() + 16);
        for line in bytes.split_inclusive(|&byte| byte == b'\n') {
            let body = line.trim_ascii_end();
            let words: Vec<&str> = std::str::from_utf8(body).unwrap_or_default().split_ascii_whitespace().collect();
            let text = match words[..] {
                ["fr", n] => n.parse::<u32>().ok().map(|n| format!("fr {}", n.wrapping_add(round.wrapping_mul(self.frames)))),
                ["ts", s] => s.parse::<f64>().ok().map(|s| {
                    // `ts` falls back to 0 at midnight.
                    let since = if s < self.first_of_day - 0.5 * DAY { s + DAY } else { s } - self.first_of_day;
                    format!("ts {:.6}", (self.first_of_day + moved(since)).rem_euclid(DAY))
                }),
                ["ts2", s, us, latency] => match (s.parse(), us.parse()) {
                    (Ok(s), Ok(us)) => {
                        let since = 1e-6 * (micros(s, us) - self.first_unix) as f64;
                        let now = self.first_unix.saturating_add((1e6 * moved(since)).round() as i64);
                        Some(format!("ts2 {} {} {latency}", now.div_euclid(1_000_000), now.rem_euclid(1_000_000)))
                    }
                    _ => None,
                },
                _ => None,
            };
            match text {
                Some(text) => {
                    out.extend_from_slice(text.as_bytes());
                    out.extend_from_slice(&line[body.len()..]);
                }
                None => out.extend_from_slice(line),
            }
        }
        out
    }
}

/// Microseconds since 1970.
fn micros(seconds: u64, microseconds: u32) -> i64 {
    (seconds as i64).saturating_mul(1_000_000).saturating_add(i64::from(microseconds))
}

/// Where to send from, if nothing else is asked for: a replay for this machine alone is not open to others.
fn usual_address(targets: &[SocketAddr]) -> Ipv4Addr {
    let local = !targets.is_empty() && targets.iter().all(|target| target.ip().is_loopback());
    if local { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED }
}

/// Nobody listening, or a full buffer, is a loss as on any network.
fn is_failure(kind: ErrorKind) -> bool {
    !matches!(kind, ErrorKind::WouldBlock | ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset | ErrorKind::Interrupted)
}

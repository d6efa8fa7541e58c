//! Who gets the packets of a replay: named targets, and receivers that greeted.

use crate::error::Error;
use std::cell::RefCell;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Receivers that are served because they greeted. One more, and the one that greeted longest ago is served no longer.
const MOST_GREETERS: usize = 16;
/// Packets that each of them is sent per second, at most: those of any tracker.
const GREETER_RATE: u32 = 500;

/// How far a replay is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReplayState {
    /// Packets of the take that were sent, over all rounds; each counts once, however many receive it.
    pub sent: u64,
    /// Complete rounds.
    pub rounds: u32,
    /// Greetings that came.
    pub greetings: u64,
    /// Who gets the packets: those that were named, and those that greeted, the latest last.
    pub targets: Vec<SocketAddr>,
    /// Those that greeted and had to make room for others.
    pub displaced: u64,
    /// Those that greeted and did not do so again in time.
    pub expired: u64,
    /// Greetings from addresses that are in no local network.
    pub strangers: u64,
    /// Packets that were not sent to a greeter since it had its share of the second.
    pub withheld: u64,
    /// Sendings that the system refused.
    pub refused: u64,
    /// Farthest behind the schedule, s.
    pub latest: f64,
    /// Everything is sent, or it was stopped.
    pub done: bool,
    /// Why it gave up.
    pub failure: Option<Error>,
}

/// What the thread that sends and its owner share.
pub(super) struct Shared {
    pub state: Mutex<ReplayState>,
    pub stop: AtomicBool,
}

impl Shared {
    pub fn lock(&self) -> MutexGuard<'_, ReplayState> {
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

/// Its socket, and who is served.
pub(super) struct Sender<'a> {
    pub socket: UdpSocket,
    pub shared: &'a Shared,
    /// So many targets were named; those behind them greeted.
    pub named: usize,
    pub serve: bool,
    pub stays: Duration,
    /// Those that greeted, the latest last, as in the list of targets.
    pub heard: RefCell<Vec<Greeter>>,
}

/// One that greeted.
pub(super) struct Greeter {
    /// When it did so last.
    at: Instant,
    /// When the second began of which `sent` packets have gone to it.
    second: Instant,
    sent: u32,
}

/// Whether an address is in a local network: a forged one cannot then make this machine send to somebody in the world outside.
fn is_local(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(ip) => ip.is_loopback() || ip.is_private() || ip.is_link_local(),
        IpAddr::V6(ip) => ip.is_loopback() || ip.is_unique_local() || ip.is_unicast_link_local(),
    }
}

impl Sender<'_> {
    /// Sleeps and hears greetings. False when it shall stop.
    pub fn rest(&self, time: Duration) -> bool {
        let mut buffer = [0; 256];
        // At most as many as may ever be served: a flood of greetings must not stop the stream.
        for _ in 0..MOST_GREETERS {
            // Whatever it says, it is a greeting: a controller does not read it. (An error is a receiver that has gone.)
            let Ok((_, from)) = self.socket.recv_from(&mut buffer) else { break };
            self.greeted(from);
        }
        self.let_go();
        if !time.is_zero() {
            std::thread::sleep(time);
        }
        !self.shared.stop.load(Ordering::Relaxed)
    }

    /// Whoever greets last stands last. Nobody says goodbye, so the one that greeted longest ago makes room.
    fn greeted(&self, from: SocketAddr) {
        let mut state = self.shared.lock();
        state.greetings += 1;
        if !self.serve || state.targets[..self.named].contains(&from) {
            return;
        }
        if !is_local(from.ip()) {
            state.strangers += 1;
            return;
        }
        let mut heard = self.heard.borrow_mut();
        let now = Instant::now();
        let mut greeter = Greeter { at: now, second: now, sent: 0 };
        if let Some(again) = state.targets.iter().position(|target| *target == from) {
            state.targets.remove(again);
            // Its share of the second is no larger for greeting again.
            greeter = Greeter { at: now, ..heard.remove(again - self.named) };
        } else if heard.len() == MOST_GREETERS {
            state.targets.remove(self.named);
            heard.remove(0);
            state.displaced += 1;
        }
        state.targets.push(from);
        heard.push(greeter);
    }

    /// Who gets the next packet: those that were named, and those that greeted and have not had their share of this second.
    pub fn to_be_served(&self) -> Vec<SocketAddr> {
        let mut state = self.shared.lock();
        let mut heard = self.heard.borrow_mut();
        let mut served = state.targets[..self.named].to_vec();
        for (k, greeter) in heard.iter_mut().enumerate() {
            if greeter.second.elapsed() >= Duration::from_secs(1) {
                (greeter.second, greeter.sent) = (Instant::now(), 0);
            }
            if greeter.sent < GREETER_RATE {
                greeter.sent += 1;
                served.push(state.targets[self.named + k]);
            } else {
                state.withheld += 1;
            }
        }
        served
    }

    /// Ends the stream to those that have not greeted for long.
    fn let_go(&self) {
        let mut heard = self.heard.borrow_mut();
        let gone = heard.iter().take_while(|greeter| greeter.at.elapsed() > self.stays).count();
        if gone > 0 {
            heard.drain(..gone);
            let mut state = self.shared.lock();
            state.targets.drain(self.named..self.named + gone);
            state.expired += gone as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    /// Nobody outside can be made the target of a stream by a greeting that bears their address.
    #[test]
    fn only_addresses_of_local_networks_are_served_for_a_greeting() {
        let shared = Shared { state: Mutex::default(), stop: AtomicBool::new(false) };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let sender = Sender { socket, shared: &shared, named: 0, serve: true, stays: Duration::from_secs(10), heard: RefCell::default() };
        let local = ["127.0.0.1:9", "10.1.2.3:9", "172.16.0.1:9", "192.168.0.7:9", "169.254.1.1:9", "[::1]:9", "[fd00::1]:9"];
        let others = ["8.8.8.8:53", "1.1.1.1:9", "224.0.0.1:9", "255.255.255.255:9", "0.0.0.0:9", "[2001:4860:4860::8888]:53"];
        for address in local.into_iter().chain(others) {
            sender.greeted(address.parse().unwrap());
        }
        let state = shared.lock().clone();
        assert_eq!(state.targets, local.map(|address| address.parse::<SocketAddr>().unwrap()));
        assert_eq!(state.strangers, others.len() as u64);
    }

    /// However fast the take is sent, and however often somebody greets.
    #[test]
    fn a_greeter_is_sent_no_more_than_its_share_of_a_second() {
        let shared = Shared { state: Mutex::default(), stop: AtomicBool::new(false) };
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let sender = Sender { socket, shared: &shared, named: 0, serve: true, stays: Duration::from_secs(10), heard: RefCell::default() };
        let start = Instant::now();
        let mut served = 0;
        for _ in 0..5 * GREETER_RATE {
            sender.greeted("127.0.0.1:9".parse().unwrap());
            served += sender.to_be_served().len() as u64;
        }
        let seconds = start.elapsed().as_secs() + 1;
        assert!(served <= u64::from(GREETER_RATE) * seconds, "{served} packets in {seconds} s");
        assert_eq!(served + shared.lock().withheld, u64::from(5 * GREETER_RATE));
    }
}

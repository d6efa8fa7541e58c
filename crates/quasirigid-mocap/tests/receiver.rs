//! The receiver over real sockets of the loopback: newest frame wins, hostile datagrams are counted and dropped, errors say what to do.

use quasirigid_mocap::endpoint::GREETING;
use quasirigid_mocap::{Endpoint, Error, Order, Receiver, ReceiverOptions};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::Command;
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(5);

fn options() -> ReceiverOptions {
    ReceiverOptions { bind: Ipv4Addr::LOCALHOST, ..ReceiverOptions::default() }
}

fn any() -> Receiver {
    Receiver::open(Endpoint::Any { port: 0 }, &options()).unwrap()
}

fn sender() -> UdpSocket {
    UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap()
}

fn packet(frame: u32) -> Vec<u8> {
    format!("fr {frame}\r\nts {:.6}\r\n6d 0\r\n", f64::from(frame) / 60.0).into_bytes()
}

/// Waits until so many datagrams have come.
fn until(receiver: &Receiver, datagrams: u64) {
    let start = Instant::now();
    while receiver.statistics().datagrams < datagrams {
        assert!(start.elapsed() < LIMIT, "{:?}", receiver.statistics());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn newest_frame_wins_and_all_can_be_taken() {
    let (receiver, sender) = (any(), sender());
    for frame in [1, 2, 5, 3, 5, 6] {
        sender.send_to(&packet(frame), receiver.address()).unwrap();
    }
    until(&receiver, 6);
    assert_eq!(receiver.latest().unwrap().packet.frame, 6);
    let taken = receiver.take();
    let orders: Vec<_> = taken.iter().map(|r| (r.packet.frame, r.order)).collect();
    assert_eq!(orders, [(1, Order::New), (2, Order::New), (5, Order::New), (3, Order::Late), (5, Order::Duplicate), (6, Order::New)]);
    assert!(taken.windows(2).all(|pair| pair[0].arrival <= pair[1].arrival));
    assert_eq!(taken[0].bytes, packet(1));
    let figures = receiver.statistics();
    assert_eq!((figures.packets, figures.lost, figures.late, figures.duplicates), (6, 1, 1, 1));
    assert!(receiver.take().is_empty() && !receiver.wait(Duration::ZERO));
    assert!(figures.pick_up.1 < LIMIT.as_secs_f64() && figures.pick_up.0 > 0.0);
}

/// A take that is sent again, a measurement that is started again: the counter falls back by less than it may by overtaking.
#[test]
fn a_counter_that_starts_again_is_followed() {
    let (receiver, sender) = (any(), sender());
    for round in 1..=2 {
        std::thread::sleep(Duration::from_millis(if round == 2 { 550 } else { 0 }));
        for frame in 1..=10 {
            sender.send_to(&packet(frame), receiver.address()).unwrap();
        }
        until(&receiver, 10 * round);
        let latest = receiver.latest().unwrap();
        assert_eq!(latest.packet.frame, 10);
        assert!(receiver.now() - latest.arrival < 0.5, "round {round}: the latest is {} s old", receiver.now() - latest.arrival);
    }
    let figures = receiver.statistics();
    assert_eq!((figures.restarts, figures.late, figures.duplicates, figures.lost), (1, 0, 0, 0), "{figures:?}");
}

#[test]
fn what_is_no_packet_is_counted_and_dropped() {
    let (receiver, sender) = (any(), sender());
    let to = receiver.address();
    sender.send_to(&[], to).unwrap();
    sender.send_to(&vec![b'x'; 40_000], to).unwrap();
    sender.send_to(b"fr abc\r\n", to).unwrap();
    sender.send_to(&[0xff; 100], to).unwrap();
    sender.send_to(b"fr 1\r\n6d 1 [0 1.000][nan 0 0][1 0 0 0 1 0 0 0 1]\r\n", to).unwrap();
    sender.send_to(&packet(7), to).unwrap();
    until(&receiver, 6);
    let figures = receiver.statistics();
    assert_eq!((figures.empty, figures.oversize, figures.malformed, figures.packets), (1, 1, 3, 1));
    assert!(figures.last_refusal.unwrap().to_string().contains("not finite"));
    assert_eq!(receiver.latest().unwrap().packet.frame, 7);
}

#[test]
fn a_flood_is_bounded() {
    let (receiver, sender) = (any(), sender());
    for frame in 0..2000 {
        sender.send_to(&packet(frame), receiver.address()).unwrap();
        if frame % 100 == 0 {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    let start = Instant::now();
    while receiver.latest().is_none_or(|r| r.packet.frame < 1999) && start.elapsed() < LIMIT {
        std::thread::sleep(Duration::from_millis(1));
    }
    let figures = receiver.statistics();
    let taken = receiver.take();
    assert!(taken.len() <= 512 && taken.len() as u64 + figures.overrun == figures.packets, "{} taken, {figures:?}", taken.len());
    assert_eq!(figures.packets + figures.lost, 2000, "what the system dropped shows as lost: {figures:?}");
}

#[test]
fn a_controller_is_greeted_and_others_are_not_heard() {
    let (controller, stranger) = (sender(), UdpSocket::bind((Ipv4Addr::new(127, 0, 0, 2), 0)));
    let options = ReceiverOptions { controller_port: controller.local_addr().unwrap().port(), ..options() };
    let endpoint = Endpoint::Controller { host: Ipv4Addr::LOCALHOST, port: 0, greet: true };
    let receiver = Receiver::open(endpoint, &options).unwrap();
    controller.set_read_timeout(Some(LIMIT)).unwrap();
    let mut buffer = [0; 64];
    let (length, from) = controller.recv_from(&mut buffer).unwrap();
    assert_eq!((&buffer[..length], from), (&GREETING[..], receiver.address()), "from the data port, as firewalls need it");
    controller.send_to(&packet(1), from).unwrap();
    let mut expected = 1;
    match stranger {
        Ok(stranger) => {
            stranger.send_to(&packet(2), from).unwrap();
            expected += 1;
        }
        Err(error) => eprintln!("skipped the stranger: no 127.0.0.2 here ({error})"),
    }
    until(&receiver, expected);
    let figures = receiver.statistics();
    assert_eq!((figures.packets, figures.foreign), (1, expected - 1));
}

#[test]
fn a_port_in_use_is_told_and_a_closed_one_is_free_again() {
    let mut first = any();
    let port = first.address().port();
    let second = Receiver::open(Endpoint::Any { port }, &options());
    let Err(Error::Network { what, hint, .. }) = second.map(|_| ()) else { panic!("opened twice") };
    assert!(what.contains(&port.to_string()) && hint.contains("another program"), "{what}; {hint}");
    let start = Instant::now();
    first.close();
    assert!(start.elapsed() < Duration::from_secs(2), "closing took {:?}", start.elapsed());
    Receiver::open(Endpoint::Any { port }, &options()).unwrap();
    let bad = Receiver::open(Endpoint::Any { port: 0 }, &ReceiverOptions { max_bytes: 0, ..options() });
    assert!(matches!(bad, Err(Error::InvalidValue { .. })));
}

#[test]
fn waiting_ends_when_a_packet_comes() {
    let (receiver, sender) = (any(), sender());
    let to: SocketAddr = receiver.address();
    let thread = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(50));
        sender.send_to(&packet(1), to).unwrap();
    });
    assert!(receiver.wait(LIMIT));
    thread.join().unwrap();
    assert!(!any().wait(Duration::from_millis(10)));
}

/// Runs the test below in a network of its own, where a multicast route leads over the loopback.
#[test]
fn multicast_in_a_network_of_its_own() {
    let inner = std::env::current_exe().unwrap();
    let script = "ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo && exec \"$0\" --ignored --exact \
        multicast_group --nocapture";
    let probe = Command::new("unshare").args(["-rn", "sh", "-c", "ip link set lo up && ip route add 224.0.0.0/4 dev lo"]).output();
    if !probe.is_ok_and(|out| out.status.success()) {
        eprintln!("skipped: no private network here (unshare -rn and ip are needed)");
        return;
    }
    let out = Command::new("unshare").args(["-rn", "sh", "-c", script]).arg(inner).output().unwrap();
    assert!(out.status.success(), "{}\n{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert!(String::from_utf8_lossy(&out.stdout).contains("1 passed"));
}

#[test]
#[ignore = "run by multicast_in_a_network_of_its_own"]
fn multicast_group() {
    let (group, other) = (Ipv4Addr::new(225, 1, 1, 1), Ipv4Addr::new(225, 1, 1, 2));
    let open = |group, bind| {
        let options = ReceiverOptions { bind, ..ReceiverOptions::default() };
        Receiver::open(Endpoint::Multicast { group, port: 5000 }, &options).unwrap()
    };
    // The address of an interface to listen on names it; a socket bound to that would hear nothing.
    let receivers = [open(group, Ipv4Addr::UNSPECIFIED), open(group, Ipv4Addr::UNSPECIFIED), open(group, Ipv4Addr::LOCALHOST)];
    let others = open(other, Ipv4Addr::UNSPECIFIED);
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
    socket.send_to(&packet(8), (other, 5000)).unwrap();
    socket.send_to(&packet(9), (group, 5000)).unwrap();
    for (receiver, frame) in receivers.iter().map(|receiver| (receiver, 9)).chain([(&others, 8)]) {
        until(receiver, 1);
        assert_eq!(receiver.latest().unwrap().packet.frame, frame);
    }
    std::thread::sleep(Duration::from_millis(50));
    let came: Vec<u64> = receivers.iter().chain([&others]).map(|receiver| receiver.statistics().datagrams).collect();
    assert_eq!(came, [1; 4], "each hears its own group, and no other");
}

#[test]
fn one_group_has_one_interface() {
    let here = Ipv4Addr::LOCALHOST;
    let options = ReceiverOptions { bind: here, interface: Ipv4Addr::new(127, 0, 0, 2), ..ReceiverOptions::default() };
    let refused = Receiver::open(Endpoint::Multicast { group: Ipv4Addr::new(225, 1, 1, 1), port: 0 }, &options);
    assert!(matches!(refused, Err(Error::InvalidValue { .. })));
}

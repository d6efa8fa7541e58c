//! The emulator over the loopback: what it sends is the take, in time; greeters are served; a round goes on where the one before ended.

use quasirigid_mocap::synthetic::{PinchOptions, hand_at, pinch_take};
use quasirigid_mocap::{
    BodyMap, Endpoint, HandChoice, HandDecoder, HandTracker, Pose, Receiver, ReceiverOptions, Replay, ReplayOptions, Side, Take,
    TrackingOptions,
};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(20);

/// A part of the shipped motion, and a port of its own: 50107 is one for the whole machine.
fn part(from: f64, to: f64) -> Take {
    let mut take = pinch_take(&PinchOptions::default()).unwrap();
    take.packets.retain(|packet| (from..to).contains(&packet.arrival));
    take
}

fn options() -> ReplayOptions {
    ReplayOptions { source_port: 0, bind: Some(Ipv4Addr::LOCALHOST), ..ReplayOptions::default() }
}

fn receiver() -> Receiver {
    Receiver::open(Endpoint::Any { port: 0 }, &ReceiverOptions { bind: Ipv4Addr::LOCALHOST, ..ReceiverOptions::default() }).unwrap()
}

#[test]
fn bytes_arrive_as_recorded_and_in_time() {
    let take = part(2.0, 3.0);
    let receiver = receiver();
    let start = receiver.now();
    let replay = Replay::start(&take, &[receiver.address()], &options()).unwrap();
    assert!(replay.wait(LIMIT));
    let state = replay.state();
    assert_eq!((state.sent, state.rounds, state.failure), (take.packets.len() as u64, 1, None));
    std::thread::sleep(Duration::from_millis(50));
    let came = receiver.take();
    assert_eq!(came.len(), take.packets.len());
    for (got, sent) in came.iter().zip(&take.packets) {
        assert_eq!(got.bytes, sent.bytes);
        let due = start + sent.arrival - take.packets[0].arrival;
        assert!(got.arrival >= due, "{} s too early", due - got.arrival);
    }
}

#[test]
fn greeters_are_served_from_the_port_they_greeted() {
    let take = part(0.0, 0.5);
    let options = ReplayOptions { rounds: 0, ..options() };
    let mut replay = Replay::start(&take, &[], &options).unwrap();
    let listen = ReceiverOptions { controller_port: replay.address().port(), bind: Ipv4Addr::LOCALHOST, ..ReceiverOptions::default() };
    let receiver = Receiver::open(Endpoint::Controller { host: Ipv4Addr::LOCALHOST, port: 0, greet: true }, &listen).unwrap();
    assert!(receiver.wait(LIMIT), "{:?}", replay.state());
    let first = receiver.latest().unwrap();
    assert_eq!(first.from, replay.address());
    assert!(replay.state().greetings >= 1);
    replay.stop();
    assert!(replay.state().done);
}

/// Whoever comes is served: the seventeenth in the place of the one that greeted longest ago. Named targets stay.
#[test]
fn greeters_make_room_for_later_ones() {
    let named = receiver();
    let mut replay = Replay::start(&part(0.0, 0.5), &[named.address()], &ReplayOptions { rounds: 0, ..options() }).unwrap();
    let sockets: Vec<UdpSocket> = (0..20).map(|_| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap()).collect();
    let start = Instant::now();
    for (k, socket) in sockets.iter().enumerate() {
        socket.send_to(b"hello", replay.address()).unwrap();
        while replay.state().greetings < k as u64 + 1 {
            assert!(start.elapsed() < LIMIT, "{:?}", replay.state());
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let state = replay.state();
    replay.stop();
    let greeters: Vec<_> = sockets[4..].iter().map(|socket| socket.local_addr().unwrap()).collect();
    assert_eq!((state.targets[0], &state.targets[1..], state.displaced), (named.address(), &greeters[..], 4));
}

/// Nobody says goodbye: who does not greet again is served no longer, who does is, and who was named always.
#[test]
fn greeters_that_have_gone_are_let_go() {
    let named = receiver();
    let options = ReplayOptions { rounds: 0, greeter_stays: Duration::from_millis(400), ..options() };
    let mut replay = Replay::start(&part(0.0, 0.5), &[named.address()], &options).unwrap();
    let sockets: Vec<UdpSocket> = (0..2).map(|_| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap()).collect();
    let start = Instant::now();
    sockets[0].send_to(b"hello", replay.address()).unwrap();
    while replay.state().expired < 1 {
        assert!(start.elapsed() < LIMIT, "{:?}", replay.state());
        sockets[1].send_to(b"hello", replay.address()).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    let state = replay.state();
    replay.stop();
    assert!(start.elapsed() > Duration::from_millis(400));
    assert_eq!(state.targets, [named.address(), sockets[1].local_addr().unwrap()]);
}

#[test]
fn a_replay_for_this_machine_is_not_open_to_others() {
    let from = |targets: &[SocketAddr], bind| {
        let replay = Replay::start(&part(0.0, 0.1), targets, &ReplayOptions { source_port: 0, bind, ..ReplayOptions::default() });
        replay.unwrap().address().ip()
    };
    let (here, elsewhere) = ("127.0.0.1:9".parse().unwrap(), "192.0.2.1:9".parse().unwrap());
    assert_eq!(from(&[here], None), Ipv4Addr::LOCALHOST);
    assert_eq!([from(&[here, elsewhere], None), from(&[], None), from(&[here], Some(Ipv4Addr::UNSPECIFIED))], [Ipv4Addr::UNSPECIFIED; 3]);
}

#[test]
fn counters_and_clocks_go_on_from_round_to_round_and_follow_the_speed() {
    let take = part(0.0, 0.5);
    let receiver = receiver();
    let replay = Replay::start(&take, &[receiver.address()], &ReplayOptions { rounds: 3, speed: 5.0, ..options() }).unwrap();
    assert!(replay.wait(LIMIT));
    std::thread::sleep(Duration::from_millis(50));
    let came = receiver.take();
    let frames: Vec<u32> = came.iter().map(|r| r.packet.frame).collect();
    assert_eq!(frames, (1000..1000 + 3 * take.packets.len() as u32).collect::<Vec<_>>());
    let times: Vec<f64> = came.iter().filter_map(|r| r.packet.time()).collect();
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 1.0 / 300.0).abs() < 1e-4), "one period of 300 Hz after the other");
    assert_eq!(receiver.statistics().lost, 0);
}

/// A controller of today sends both clocks, and `ts` falls back to 0 at midnight: a replay at another speed keeps the two together.
#[test]
fn both_clocks_follow_the_speed_also_over_midnight() {
    let stamp = |k: u32| (86_399.9 + f64::from(k) / 60.0).rem_euclid(86_400.0);
    let packets = (0..30).map(|k| {
        let (seconds, microseconds) =
            ((1_700_000_000_000_000 + u64::from(k) * 1_000_000 / 60) / 1_000_000, u64::from(k) * 1_000_000 / 60 % 1_000_000);
        let bytes = format!("fr {k}\r\nts {:.6}\r\nts2 {seconds} {microseconds} 5000\r\n6d 0\r\n", stamp(k)).into_bytes();
        quasirigid_mocap::TakePacket { arrival: f64::from(k) / 60.0, bytes }
    });
    let take = Take { packets: packets.collect(), ..Take::default() };
    let receiver = receiver();
    let replay = Replay::start(&take, &[receiver.address()], &ReplayOptions { rounds: 2, speed: 4.0, ..options() }).unwrap();
    assert!(replay.wait(LIMIT));
    std::thread::sleep(Duration::from_millis(50));
    let came = receiver.take();
    assert_eq!(came.len(), 60);
    let midnight = 86_400.0;
    let of_day: Vec<f64> = came.iter().map(|r| r.packet.time_of_day.unwrap()).collect();
    let unix: Vec<f64> = came.iter().map(|r| r.packet.time().unwrap()).collect();
    for k in 1..came.len() {
        let (day, both) = ((of_day[k] - of_day[k - 1]).rem_euclid(midnight), unix[k] - unix[k - 1]);
        assert!((day - 1.0 / 240.0).abs() < 3e-6 && (both - 1.0 / 240.0).abs() < 3e-6, "packet {k}: {day} s by ts, {both} s by ts2");
        assert_eq!(came[k].packet.unix_time.unwrap().latency, 5000);
    }
    assert_eq!(came.iter().map(|r| r.packet.frame).collect::<Vec<_>>(), (0..60).collect::<Vec<_>>());
}

#[test]
fn fingertips_come_as_bodies_too() {
    let take = part(2.9, 3.6);
    let receiver = receiver();
    let replay = Replay::start(&take, &[receiver.address()], &ReplayOptions { bodies: true, speed: 2.0, ..options() }).unwrap();
    assert!(replay.wait(LIMIT));
    std::thread::sleep(Duration::from_millis(50));
    let map = BodyMap::parse("thumb=0,index=1,middle=2", Side::Right).unwrap();
    let (mut by_body, mut by_hand) =
        (HandDecoder::new(HandChoice::Bodies(Box::new(map))), HandDecoder::new(HandChoice::Fingertracking(Side::Right)));
    let mut lost = 0;
    for received in receiver.take() {
        let a = by_body.decode(&received.packet, received.arrival).unwrap();
        let b = by_hand.decode(&received.packet, received.arrival).unwrap();
        for k in 0..3 {
            let (a, b) = (a.fingers[k].unwrap(), b.fingers[k].unwrap());
            assert_eq!(a.tracked, b.tracked);
            assert!(!a.tracked || a.tip.inv_mul(&b.tip).translation.vector.norm() < 1e-5);
        }
        lost += usize::from(!a.fingers[2].unwrap().tracked);
    }
    assert!((10..=13).contains(&lost), "{lost} frames without the middle finger");
}

/// Socket, decoder and tracker together: the fingertips that come out are those of the hand, a little late.
#[test]
fn the_shipped_motion_comes_out_at_the_other_end() {
    let receiver = receiver();
    let replay = Replay::start(&part(2.0, 4.5), &[receiver.address()], &options()).unwrap();
    let mut decoder = HandDecoder::new(HandChoice::Fingertracking(Side::Right));
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let mut wrong = Vec::new();
    while !replay.state().done {
        receiver.wait(Duration::from_millis(1));
        for received in receiver.take() {
            if let Some(frame) = decoder.decode(&received.packet, received.arrival) {
                tracker.push(&frame).unwrap();
            }
        }
        let Some(targets) = tracker.sample(receiver.now()) else { continue };
        let truth = hand_at(targets.time - 36_000.0);
        for k in 0..3 {
            let Some(finger) = targets.fingers[k].filter(|f| f.weight == 1.0) else { continue };
            wrong.push((finger.pose.translation.vector - truth.fingers[k].unwrap().tip.translation.vector).norm());
        }
    }
    // Noise of 0.3 mm, digits and tremor. The median: on a busy machine packets come late, and then the motion is guessed.
    wrong.sort_by(f64::total_cmp);
    assert!(wrong.len() > 300, "{} samples", wrong.len());
    let (median, p95) = (wrong[wrong.len() / 2], wrong[wrong.len() * 95 / 100]);
    println!("{:.2} mm median, {:.2} mm at 95 %", 1e3 * median, 1e3 * p95);
    assert!(median < 1e-3, "{median} m");
}

#[test]
fn nonsense_is_refused() {
    let take = part(0.0, 0.1);
    let to = ["127.0.0.1:9".parse().unwrap()];
    assert!(Replay::start(&Take::default(), &to, &options()).is_err());
    assert!(Replay::start(&take, &[], &ReplayOptions { serve_greeters: false, ..options() }).is_err());
    for speed in [0.0, -1.0, f64::NAN, 1e9] {
        assert!(Replay::start(&take, &to, &ReplayOptions { speed, ..options() }).is_err());
    }
}

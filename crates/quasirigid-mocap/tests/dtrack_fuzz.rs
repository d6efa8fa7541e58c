//! Hostile packets: none of them panics, costs more memory than it has bytes warrants, or brings in a number that is not finite.

use quasirigid_mocap::dtrack::{Packet, Placement};
use quasirigid_mocap::{BodyMap, HandChoice, HandDecoder, HandTracker, Pose, Side, TrackingOptions};

/// One of each line, and the forms in which they may come.
const SEEDS: [&str; 4] = [
    "fr 21753\r\nts 39596.024831\r\n6dcal 2\r\n6d 2 [0 1.000][326.848 -187.216 109.503][1.000000 0.000000 0.000000 0.000000 1.000000 \
     0.000000 0.000000 0.000000 1.000000] [1 1.000][1 2 3][0 1 0 -1 0 0 0 0 1]\r\nglcal 1\r\ngl 1 [0 1.000 1 3][506.103 -122.871 \
     99.500][1 0 0 0 1 0 0 0 1][80.1 -5.2 -12.3][1 0 0 0 -1 0 0 0 -1][8.4 24.1 -12.5 25.0 -20.1 41.9][80.1 -5.2 -12.3][1 0 0 0 -1 0 0 0 \
     -1][8.4 24.1 -12.5 25.0 -20.1 41.9][0 0 0][0 0 0 0 0 0 0 0 0][8.4 24.1 -12.5 25.0 -20.1 41.9]\r\n",
    "fr 7\r\nts2 1700000000 24831 8500\r\n6df 1 [0 1.000 257][1 2 3 4 5 6][1 0 0 0 1 0 0 0 1]\r\n6df2 2 1 [0 1.000 6 2][1 2 3][1 0 0 0 1 \
     0 0 0 1][36 0.500 -1.000]\r\n6dmt 1 [0 -1.000 0][0 0 0][0 0 0 0 0 0 0 0 0]\r\n6dmt2 1 1 [0 1.000 2 1.500][1 2 3][1 0 0 0 1 0 0 0 \
     1][3][0.1 0.2 0.3 0.4 0.5 0.6]\r\n6dmtr 1 1 [0 1.000][1 2 3][1 0 0 0 1 0 0 0 1]\r\n3d 2 [1 1.000][210.730 -90.669 -108.554] [2 \
     1.000][0 0 0]\r\n",
    "fr 8\r\n6dcov 1 [0 1 2 3][1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21e-3]\r\n6di 2 [0 0 0.000][0 0 0][0 0 0 0 0 0 0 0 0] \
     [1 3 0.125][1 2 3][1 0 0 0 1 0 0 0 1]\r\n6dj 2 1 [0 2][0 1.000][1 2 3 4 5 6][1 0 0 0 1 0 0 0 1][1 -1.000][0 0 0 0 0 0][0 0 0 0 0 0 0 \
     0 0]\r\nst 3 [0 3][4 2 17][1 5][0 1 0 2 3][2 2 3][0 20 18 7][1 12 12 10]\r\n",
    "fr 9\nts 1.5\ngl 0 \n6d 0\n3d 0\n6dmtr 0 0\nglcal 0\n",
];

/// Words that break parsers.
const NASTY: [&[u8]; 14] = [
    b"nan",
    b"-inf",
    b"1e999",
    b"4294967295",
    b"-1",
    b"99999999999999999999",
    b"[",
    b"]",
    b"[]",
    b"\0",
    b"\r\n",
    b"6d 9999 ",
    b"0x10",
    b"\xff\xfe",
];

fn mutate(random: &mut fastrand::Rng, bytes: &mut Vec<u8>) {
    for _ in 0..random.usize(1..6) {
        let at = random.usize(0..=bytes.len());
        let end = (at + random.usize(0..24)).min(bytes.len());
        match random.u8(0..8) {
            0 if at < bytes.len() => bytes[at] = random.u8(..),
            1 if at < bytes.len() => bytes[at] ^= 1 << random.u8(0..8),
            2 => drop(bytes.drain(at..end)),
            3 => bytes.truncate(at),
            4 => {
                let copy = bytes[at..end].to_vec();
                let to = random.usize(0..=bytes.len());
                bytes.splice(to..to, copy);
            }
            5 => {
                let word = NASTY[random.usize(0..NASTY.len())];
                bytes.splice(at..end, word.iter().copied());
            }
            6 => {
                // Another number in the place of a digit.
                if let Some(digit) = bytes[at..].iter().position(u8::is_ascii_digit) {
                    let number = random.i64(..) >> random.u8(0..64);
                    bytes.splice(at + digit..at + digit + 1, number.to_string().into_bytes());
                }
            }
            _ => {
                let other = SEEDS[random.usize(0..SEEDS.len())].as_bytes();
                let from = random.usize(0..other.len());
                bytes.splice(at..at, other[from..(from + random.usize(0..200)).min(other.len())].iter().copied());
            }
        }
    }
}

/// Every number of a packet that was taken, whole ones too.
fn numbers(packet: &Packet) -> Vec<f64> {
    let mut all: Vec<f64> = packet.time().into_iter().chain(packet.time_of_day).collect();
    let place = |all: &mut Vec<f64>, placement: &Placement| all.extend(placement.position.iter().chain(&placement.rotation));
    for body in packet.bodies.iter().flatten().chain(packet.tool_references.iter().flat_map(|listed| &listed.items)) {
        place(&mut all, &body.placement);
        all.push(body.quality);
    }
    for covariance in packet.covariances.iter().flatten() {
        all.extend(covariance.reference.iter().chain(&covariance.upper));
    }
    for body in packet.hybrid_bodies.iter().flatten() {
        place(&mut all, &body.placement);
        all.extend([body.drift, f64::from(body.state)]);
    }
    for device in packet.old_flysticks.iter().chain(&packet.old_tools).flatten() {
        place(&mut all, &device.placement);
        all.push(device.quality);
    }
    for flystick in packet.flysticks.iter().flat_map(|listed| &listed.items) {
        place(&mut all, &flystick.placement);
        all.extend(flystick.joystick.iter().chain([&flystick.quality, &f64::from(flystick.button_count)]));
    }
    for tool in packet.tools.iter().flat_map(|listed| &listed.items) {
        place(&mut all, &tool.placement);
        all.extend(tool.covariance.iter().chain([&tool.quality, &tool.tip_radius, &f64::from(tool.button_count)]));
    }
    for marker in packet.markers.iter().flatten() {
        all.extend(marker.position.iter().chain([&marker.quality]));
    }
    for hand in packet.hands.iter().flatten() {
        place(&mut all, &hand.placement);
        all.push(hand.quality);
        for finger in &hand.fingers {
            place(&mut all, &finger.tip);
            all.extend(finger.lengths.iter().chain(&finger.angles).chain([&finger.tip_radius]));
        }
    }
    for joint in packet.people.iter().flat_map(|listed| &listed.items).flat_map(|person| &person.joints) {
        place(&mut all, &joint.placement);
        all.extend(joint.angles.iter().chain([&joint.quality]));
    }
    all
}

/// What is announced in a packet that was taken has come, and ids are those of a controller.
fn counts_are_true(packet: &Packet) -> bool {
    let bodies = packet.bodies.iter().flatten().all(|body| body.id < 10_000);
    let hands = packet.hands.iter().flatten().all(|hand| hand.fingers.len() <= 5 && hand.fingers.iter().all(|f| f.tip_radius <= 100.0));
    let buttons = |count: u32, words: usize| count <= 256 && words == count.div_ceil(32) as usize;
    let flysticks = packet.flysticks.iter().flat_map(|listed| &listed.items).all(|f| buttons(f.button_count, f.buttons.len()));
    let tools = packet.tools.iter().flat_map(|listed| &listed.items).all(|t| buttons(t.button_count, t.buttons.len()));
    let people = packet.people.iter().flat_map(|listed| &listed.items).all(|person| person.joints.len() <= 200);
    bodies && hands && flysticks && tools && people
}

/// Feeds `count` mutated packets; returns how many were taken.
fn fuzz(count: u64, seed: u64) -> u64 {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut taken = 0;
    let mut bytes = Vec::new();
    // What is taken goes all the way: hands, bodies, targets.
    let map = BodyMap::parse("thumb=0,index=1", Side::Right).unwrap();
    let mut decoders = [HandDecoder::new(HandChoice::Fingertracking(Side::Right)), HandDecoder::new(HandChoice::Bodies(Box::new(map)))];
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    for k in 0..count {
        bytes.clear();
        bytes.extend_from_slice(SEEDS[random.usize(0..SEEDS.len())].as_bytes());
        mutate(&mut random, &mut bytes);
        if let Ok(packet) = Packet::parse(&bytes) {
            taken += 1;
            assert!(numbers(&packet).iter().all(|x| x.abs() <= 1e12), "packet {k} of seed {seed}: {}", String::from_utf8_lossy(&bytes));
            assert!(counts_are_true(&packet), "packet {k} of seed {seed}: {}", String::from_utf8_lossy(&bytes));
            let now = k as f64 * 1e-3;
            for frame in decoders.iter_mut().filter_map(|decoder| decoder.decode(&packet, now)) {
                tracker.push(&frame).unwrap();
            }
            let targets = tracker.sample(now);
            let mut poses = targets.iter().flat_map(|t| t.fingers.iter().flatten()).map(|target| target.pose);
            assert!(poses.all(|pose| pose.to_homogeneous().iter().all(|x| x.is_finite())), "packet {k} of seed {seed}");
        }
    }
    taken
}

#[test]
fn mutated_packets_are_taken_or_refused_but_never_fatal() {
    let taken = fuzz(200_000, 1);
    // If nearly all or nearly none got through, the mutations would test nothing.
    assert!((20_000..180_000).contains(&taken), "{taken} of 200000 taken");
}

/// `cargo test -p quasirigid-mocap --release --test dtrack_fuzz -- --ignored --nocapture`
#[test]
#[ignore = "ten million packets take minutes"]
fn ten_million_mutated_packets() {
    let start = std::time::Instant::now();
    let taken = fuzz(10_000_000, 2);
    println!("10,000,000 packets in {:.1} s, {taken} taken, no panic", start.elapsed().as_secs_f64());
}

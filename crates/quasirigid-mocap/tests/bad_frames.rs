//! Frames that no hand can have made: they do no more than frames that do not see the hand. Fast hands are not taken for bad ones.

mod moving_hand;

use moving_hand::{RATES, STEP, ZERO, hand_at, palm_at, step_between, tip_in_palm};
use quasirigid_mocap::synthetic::{PinchOptions, pinch_take};
use quasirigid_mocap::{Dropped, HandChoice, HandDecoder, HandFrame, HandTargets, HandTracker, Pose, Rot, Side, TrackingOptions, Vec3};
use std::f64::consts::PI;

const THUMB: usize = 0;
const INDEX: usize = 1;
const MIDDLE: usize = 2;
const PALM: usize = 5;
/// With which what is seen elsewhere glides there, m/s and rad/s.
const GLIDE: (f64, f64) = (0.5, 3.0);

fn tracker() -> HandTracker {
    HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap()
}

/// Gives a tracker the frames `of(k)` of a rate, and shows `see` every sample of `duration` s.
fn follow(tracker: &mut HandTracker, rate: f64, duration: f64, of: impl Fn(usize) -> HandFrame, mut see: impl FnMut(f64, &HandTargets)) {
    let mut next = 0;
    for k in 0..(duration / STEP) as usize {
        let now = k as f64 * STEP;
        while next as f64 / rate + 0.004 <= now {
            tracker.push(&HandFrame { arrival: next as f64 / rate + 0.004, ..of(next) }).unwrap();
            next += 1;
        }
        if let Some(targets) = tracker.sample(now) {
            see(now, &targets);
        }
    }
}

fn without(mut frame: HandFrame, parts: &[usize]) -> HandFrame {
    for &part in parts {
        match part {
            PALM => frame.palm.as_mut().unwrap().tracked = false,
            finger => frame.fingers[finger].as_mut().unwrap().tracked = false,
        }
    }
    frame
}

fn moved(mut frame: HandFrame, parts: &[usize], by: &Pose) -> HandFrame {
    for &part in parts {
        match part {
            PALM => frame.palm.as_mut().unwrap().pose = by * frame.palm.unwrap().pose,
            finger => frame.fingers[finger].as_mut().unwrap().tip = by * frame.fingers[finger].unwrap().tip,
        }
    }
    frame
}

const HAND: [usize; 4] = [THUMB, INDEX, MIDDLE, PALM];

/// A name, the parts that it spoils, and how.
type Fault = (&'static str, &'static [usize], fn(HandFrame) -> HandFrame);

const FAULTS: [Fault; 6] = [
    ("hand 1 m aside", &HAND, |frame| moved(frame, &HAND, &Pose::translation(0.0, 1.0, 0.0))),
    ("index 100 mm towards its pad", &[INDEX], |frame| along_pad(frame, -0.1)),
    ("index 100 mm off", &[INDEX], |frame| along_pad(frame, 0.1)),
    ("thumb and middle finger exchanged", &[THUMB, MIDDLE], |frame| exchanged(frame, THUMB, MIDDLE)),
    ("index and middle finger exchanged", &[INDEX, MIDDLE], |frame| exchanged(frame, INDEX, MIDDLE)),
    ("nail and pad of the index flipped", &[INDEX], |mut frame| {
        let finger = frame.fingers[INDEX].as_mut().unwrap();
        finger.tip *= Rot::from_scaled_axis(Vec3::x() * PI);
        frame
    }),
];

fn along_pad(mut frame: HandFrame, by: f64) -> HandFrame {
    let finger = frame.fingers[INDEX].as_mut().unwrap();
    finger.tip *= Pose::translation(0.0, 0.0, by);
    frame
}

fn exchanged(mut frame: HandFrame, a: usize, b: usize) -> HandFrame {
    frame.fingers.swap(a, b);
    frame
}

/// At rest, and in the middle of a motion of 0.75 m/s; 1 to 3 in a row, 30 to 500 Hz.
#[test]
fn bad_frames_do_no_more_than_frames_that_do_not_see_the_part() {
    for (name, parts, spoil) in FAULTS {
        for rate in RATES {
            for (at, bad) in [(0.8, 1), (1.5, 1), (1.5, 2), (1.5, 3)] {
                let first = (at * rate) as usize;
                let is_bad = |k: usize| (first..first + bad).contains(&k);
                let clean = |k: usize| hand_at(k as f64 / rate, &[]);
                let (mut with, mut unseen) = (tracker(), tracker());
                let (mut shown, mut expected) = (Vec::new(), Vec::new());
                follow(&mut with, rate, 2.2, |k| if is_bad(k) { spoil(clean(k)) } else { clean(k) }, |_, targets| shown.push(*targets));
                let masked = |k: usize| if is_bad(k) { without(clean(k), parts) } else { clean(k) };
                follow(&mut unseen, rate, 2.2, masked, |_, targets| expected.push(*targets));
                assert!(shown == expected, "{name}, {rate} Hz, {bad} at {at} s");
                let dropped = with.dropped();
                assert_eq!(dropped.frames, bad as u64, "{name}, {rate} Hz, {bad} at {at} s: {dropped:?}");
                let of = if name.contains("exchanged") {
                    dropped.exchanged
                } else if name.contains("flipped") {
                    dropped.flipped
                } else {
                    dropped.jumps
                };
                assert_eq!(of, (bad * parts.len()) as u64, "{name}, {rate} Hz, {bad} at {at} s: {dropped:?}");
                assert_eq!((unseen.dropped(), dropped.relocations), (Dropped::default(), 0));
            }
        }
    }
}

/// Rest, and minimum jerk over `way` (m) in `time` s.
fn reach(t: f64, way: f64, time: f64) -> f64 {
    let s = ((t - 0.5) / time).clamp(0.0, 1.0);
    way * s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// Places of the hand and of the index finger in it (x, m), and a turn of the hand (rad), at a time, s.
type Motion = fn(f64) -> [f64; 3];

/// What people do as fast as they can.
const FAST: [(&str, Motion); 6] = [
    ("reaching 0.6 m in 0.25 s: 4.5 m/s, 55 m/s^2", |t| [reach(t, 0.6, 0.25), 0.0, 0.0]),
    ("reaching 0.3 m in 0.18 s: 3.1 m/s, 53 m/s^2", |t| [reach(t, 0.3, 0.18), 0.0, 0.0]),
    ("pinching, 50 mm in 0.1 s", |t| [0.0, reach(t, 0.05, 0.1), 0.0]),
    ("shaking 5 times a second by 50 mm: 49 m/s^2", |t| [0.05 * (10.0 * PI * t).sin(), 0.0, 0.0]),
    ("tapping 6 times a second by 20 mm while the hand moves", |t| [reach(t, 0.4, 0.5), 0.02 * (12.0 * PI * t).sin(), 0.0]),
    ("turning by 2 rad in 0.2 s", |t| [0.0, 0.0, reach(t, 2.0, 0.2)]),
];

fn fast_hand(t: f64, motion: Motion, random: &mut fastrand::Rng) -> HandFrame {
    let [hand, finger, turn] = motion(t);
    let palm = Pose::from_parts(Vec3::new(hand, 0.1, 1.0).into(), Rot::from_scaled_axis(Vec3::z() * turn));
    let mut noise = || Pose::from_parts((Vec3::from_fn(|_, _| 6e-4 * (random.f64() - 0.5))).into(), Rot::identity());
    let mut frame = hand_at(t, &[]);
    frame.palm.as_mut().unwrap().pose = noise() * palm;
    for k in 0..3 {
        let bent = if k == INDEX { finger } else { 0.0 };
        frame.fingers[k].as_mut().unwrap().tip = noise() * palm * Pose::translation(bent, 0.0, 0.0) * tip_in_palm(k);
    }
    frame
}

/// 20 % of the frames are lost, others late, twice and overtaken.
#[test]
fn fast_hands_on_bad_streams_are_never_dropped() {
    for (name, motion) in FAST {
        for rate in RATES {
            for seed in 0..5 {
                let mut random = fastrand::Rng::with_seed(seed);
                let mut frames = Vec::new();
                for k in 0..(1.5 * rate) as usize {
                    let t = k as f64 / rate;
                    let frame = fast_hand(t, motion, &mut random);
                    if random.f64() < 0.2 {
                        continue;
                    }
                    for _ in 0..1 + usize::from(random.f64() < 0.1) {
                        let overtaken = if random.f64() < 0.05 { 1.2 / rate } else { 0.0 };
                        frames.push(HandFrame { arrival: t + 0.004 + 0.01 * random.f64() + overtaken, ..frame });
                    }
                }
                frames.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
                let mut tracker = tracker();
                for frame in &frames {
                    tracker.push(frame).unwrap();
                    tracker.sample(frame.arrival);
                }
                assert_eq!(tracker.dropped(), Dropped::default(), "{name}, {rate} Hz, seed {seed}");
            }
        }
    }
}

/// A fingertip that hits a table at 3 m/s stands still from one frame to the next.
#[test]
fn a_finger_that_is_stopped_by_something_hard_is_believed() {
    for rate in RATES {
        let mut tracker = tracker();
        for k in 0..rate as usize {
            let t = k as f64 / rate;
            let way = -(1.5 * 9.0 * (t - 0.3).clamp(0.0, 0.2222).powi(2) * 3.0).min(0.3);
            tracker.push(&moved(hand_at(0.0, &[]), &[INDEX], &Pose::translation(0.0, 0.0, way))).unwrap();
        }
        assert_eq!(tracker.dropped(), Dropped::default(), "{rate} Hz");
    }
}

#[test]
fn the_shipped_motion_is_never_dropped() {
    for rate in RATES {
        for seed in 1..4 {
            let take = pinch_take(&PinchOptions { rate, seed, ..PinchOptions::default() }).unwrap();
            let (mut decoder, mut tracker) = (HandDecoder::new(HandChoice::Fingertracking(Side::Right)), tracker());
            for packet in &take.packets {
                tracker.push(&decoder.decode(&packet.parse().unwrap(), packet.arrival).unwrap()).unwrap();
                tracker.sample(packet.arrival);
            }
            assert_eq!(tracker.dropped(), Dropped::default(), "{rate} Hz, seed {seed}");
        }
    }
}

/// A tracker that is started elsewhere, and a finger whose marker has slipped.
#[test]
fn a_jump_that_lasts_is_believed_after_a_tenth_of_a_second_and_glided_to() {
    let aside = Pose::from_parts(Vec3::new(0.4, 0.8, -0.4).into(), Rot::from_scaled_axis(Vec3::z() * 0.6));
    let slipped = Pose::translation(0.06, -0.05, 0.0);
    for (parts, by) in [(&HAND[..], aside), (&[INDEX][..], slipped)] {
        for rate in RATES {
            let first = (0.8 * rate) as usize;
            let (mut tracker, mut before) = (tracker(), None::<Pose>);
            let (mut fastest, mut started, mut last) = ((0.0f64, 0.0f64), f64::INFINITY, Pose::identity());
            // At rest until 1 s and from 3.5 s on.
            let of = |k: usize| {
                let frame = HandFrame { time: ZERO + k as f64 / rate, ..hand_at(0.0, &[]) };
                if k < first { frame } else { moved(frame, parts, &by) }
            };
            follow(&mut tracker, rate, 4.0, of, |now, targets| {
                let tip = targets.fingers[INDEX].unwrap();
                assert!(now < 0.4 || tip.weight == 1.0, "{rate} Hz: weight {} at {now} s", tip.weight);
                if let Some(before) = before.replace(tip.pose) {
                    let step = step_between(&before, &tip.pose);
                    fastest = (fastest.0.max(step.0 / STEP), fastest.1.max(step.1 / STEP));
                    if step.0 > 1e-9 {
                        started = started.min(now);
                    }
                }
                last = tip.pose;
            });
            let (waited, off) = (started - first as f64 / rate, step_between(&last, &(by * palm_at(0.0) * tip_in_palm(INDEX))).0);
            println!("{rate} Hz, {parts:?}: believed after {waited:.3} s, {:.3} m/s, {:.2} rad/s, {off:.1e} m off", fastest.0, fastest.1);
            assert!((0.1..0.1 + 2.0 / rate + 0.01).contains(&waited), "{rate} Hz, {parts:?}: glides from {waited} s after the jump");
            assert!(fastest.0 <= GLIDE.0 * 1.001 && fastest.1 <= GLIDE.1 * 1.001, "{rate} Hz, {parts:?}: {fastest:?} m/s, rad/s");
            assert!(off < 1e-3, "{rate} Hz, {parts:?}: {off} m off at last");
            assert_eq!(tracker.dropped(), Dropped { relocations: 1, ..Dropped::default() }, "{rate} Hz, {parts:?}");
        }
    }
}

/// The thumb is seen again later, or was not seen in some frames of the new place: no finger crosses the room from one frame to the next.
#[test]
fn fingers_go_along_when_the_hand_is_elsewhere() {
    let aside = Pose::from_parts(Vec3::new(0.1, 0.25, 0.0).into(), Rot::identity());
    for rate in RATES {
        for unseen in [0.75..1.4, 0.79..0.84, 0.86..0.88, 0.85..1.0] {
            let (mut tracker, mut before, mut fastest) = (tracker(), None::<Pose>, 0.0f64);
            let of = |k: usize| {
                let t = k as f64 / rate;
                let frame = HandFrame { time: ZERO + t, ..hand_at(0.0, if unseen.contains(&t) { &[THUMB] } else { &[] }) };
                if t < 0.8 { frame } else { moved(frame, &HAND, &aside) }
            };
            let mut last = Pose::identity();
            follow(&mut tracker, rate, 2.5, of, |_, targets| {
                last = targets.fingers[THUMB].unwrap().pose;
                fastest = fastest.max(before.replace(last).map_or(0.0, |before| step_between(&before, &last).0) / STEP);
            });
            let off = step_between(&last, &(aside * palm_at(0.0) * tip_in_palm(THUMB))).0;
            println!("{rate} Hz, {unseen:?}: {fastest:.2} m/s, {off:.1e} m off, {:?}", tracker.dropped());
            assert!(fastest <= 2.0 * GLIDE.0 && off < 1e-3, "{rate} Hz, {unseen:?}: {fastest} m/s, {off} m off");
        }
    }
}

#[test]
fn fingers_that_stay_exchanged_or_flipped_are_believed_after_half_a_second() {
    for (name, _, spoil) in &FAULTS[3..] {
        for rate in RATES {
            let mut tracker = tracker();
            let mut believed = f64::INFINITY;
            let first = (0.8 * rate) as usize;
            for k in 0..(2.0 * rate) as usize {
                let frame = HandFrame { time: ZERO + k as f64 / rate, arrival: k as f64 / rate, ..hand_at(0.0, &[]) };
                tracker.push(&if k < first { frame } else { spoil(frame) }).unwrap();
                tracker.sample(frame.arrival);
                if tracker.dropped().relocations > 0 {
                    believed = believed.min((k - first) as f64 / rate);
                }
            }
            assert!((0.5 - 1e-6..0.5 + 1.5 / rate).contains(&believed), "{name}, {rate} Hz: believed after {believed} s");
            assert_eq!((tracker.dropped().frames, tracker.dropped().relocations), (0, 1), "{name}, {rate} Hz");
        }
    }
}

/// Half a second of frames that put the index finger anywhere: it goes with the palm, and they are all dropped.
#[test]
fn places_that_do_not_agree_are_never_believed() {
    for rate in RATES {
        let mut random = fastrand::Rng::with_seed(7);
        let places: Vec<Vec3> = (0..2000).map(|_| Vec3::from_fn(|_, _| 3.0 * (random.f64() - 0.5)) + Vec3::x() * 2.0).collect();
        let wild = (0.8 * rate) as usize..(1.3 * rate) as usize;
        let mut tracker = tracker();
        let mut worst = 0.0f64;
        let of = |k: usize| {
            let frame = HandFrame { time: ZERO + k as f64 / rate, ..hand_at(0.0, &[]) };
            if wild.contains(&k) { moved(frame, &[INDEX], &Pose::from(places[k])) } else { frame }
        };
        follow(&mut tracker, rate, 1.6, of, |_, targets| {
            worst = worst.max(step_between(&targets.fingers[INDEX].unwrap().pose, &(palm_at(0.0) * tip_in_palm(INDEX))).0);
        });
        assert!(worst < 1e-9, "{rate} Hz: {worst} m off");
        assert_eq!((tracker.dropped().frames, tracker.dropped().relocations), (wild.len() as u64, 0), "{rate} Hz");
    }
}

/// Every tenth frame puts one part somewhere else; frames are lost, late, doubled and overtaken.
#[test]
fn nothing_jumps_whatever_frames_are_bad() {
    let largest = (0..1000).map(|k| 1.0 + k as f64 * STEP).map(|t| {
        let tip = |t: f64| palm_at(t) * tip_in_palm(INDEX);
        step_between(&tip(t), &tip(t + STEP)).0
    });
    let hand = largest.fold(0.0, f64::max);
    for rate in RATES {
        for seed in 0..3 {
            let mut random = fastrand::Rng::with_seed(seed);
            let (mut frames, mut bad) = (Vec::new(), 0);
            for k in 0..(4.0 * rate) as usize {
                let t = k as f64 / rate;
                let mut frame = hand_at(t, &[]);
                let spoilt = random.f64() < 0.1 && (0.3..3.9).contains(&t);
                if spoilt {
                    let way = Vec3::from_fn(|_, _| random.f64() - 0.5).normalize() * (0.15 + random.f64());
                    frame = moved(frame, &[HAND[random.usize(0..4)]], &Pose::from(way));
                }
                if random.f64() < 0.1 {
                    continue;
                }
                bad += u64::from(spoilt);
                let overtaken = if random.f64() < 0.05 { 1.2 / rate } else { 0.0 };
                frames.push(HandFrame { arrival: t + 0.004 + 0.01 * random.f64() + overtaken, ..frame });
            }
            frames.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
            let (mut stream, mut tracker) = (frames.into_iter().peekable(), tracker());
            let (mut before, mut worst) = (None::<Pose>, 0.0f64);
            for k in 0..4000 {
                let now = k as f64 * STEP;
                while let Some(frame) = stream.next_if(|frame| frame.arrival <= now) {
                    tracker.push(&frame).unwrap();
                }
                let Some(tip) = tracker.sample(now).and_then(|targets| targets.fingers[INDEX]) else { continue };
                worst = before.map_or(0.0, |before| worst.max(step_between(&before, &tip.pose).0));
                before = Some(tip.pose);
            }
            let dropped = tracker.dropped();
            println!("{rate} Hz, seed {seed}: {:.2} of the hand's step, {bad} bad, {dropped:?}", worst / hand);
            // The first two in a row may find the hand anywhere: their reach is larger where frames are lost.
            assert!(dropped.frames.abs_diff(bad) <= 1, "{rate} Hz, seed {seed}: {} dropped of {bad} bad ones", dropped.frames);
            assert!(worst < 1.25 * hand + GLIDE.0 * STEP, "{rate} Hz, seed {seed}: {worst} m in a step");
        }
    }
}

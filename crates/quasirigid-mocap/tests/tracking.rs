//! Bad streams: the fingers shown never jump beyond what the hand did, and go on smoothly.

mod moving_hand;

use moving_hand::{RATES, STEP, ZERO, hand_at, palm_at, step_between, tip_in_palm};
use quasirigid_mocap::{Delay, FingerPose, HandFrame, HandTracker, Pose, Rot, Side, TargetState, TrackingOptions, Vec3};

/// Frames with their arrivals, in order of arrival: 20 % lost, up to 10 ms late, every tenth twice, some overtaken.
fn bad_stream(rate: f64, duration: f64, seed: u64) -> Vec<HandFrame> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut frames = Vec::new();
    for k in 0..(duration * rate) as usize {
        let t = k as f64 / rate;
        if random.f64() < 0.2 {
            continue;
        }
        let overtaken = if random.f64() < 0.05 { 1.2 / rate } else { 0.0 };
        let mut frame = hand_at(t, &[]);
        frame.arrival = t + 0.004 + 0.01 * random.f64() + overtaken;
        frames.push(frame);
        if random.f64() < 0.1 {
            frames.push(HandFrame { arrival: frame.arrival + 0.01 * random.f64(), ..frame });
        }
    }
    frames.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
    frames
}

/// Largest step of a fingertip of the hand itself: (m, rad) in one simulation step.
fn largest_hand_step() -> (f64, f64) {
    let tip = |k: usize| palm_at(1.0 + k as f64 * STEP) * tip_in_palm(1);
    (0..1000).map(|k| step_between(&tip(k), &tip(k + 1))).fold((0.0, 0.0), |a, b| (f64::max(a.0, b.0), f64::max(a.1, b.1)))
}

#[test]
fn no_jump_at_any_rate_with_loss_jitter_duplicates_and_reordering() {
    let hand = largest_hand_step();
    // Prediction runs ahead of a hand that stops: its bound shows that nothing jumps (a lost frame of 30 Hz alone is 25 steps), no more.
    for (delay, bound) in [(Delay::Auto, 1.25), (Delay::Fixed(0.0), 2.5)] {
        for rate in [30.0, 60.0, 120.0, 240.0, 500.0] {
            for seed in 0..5 {
                let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions { delay, ..Default::default() }).unwrap();
                let mut stream = bad_stream(rate, 4.5, seed).into_iter().peekable();
                let mut before: Option<Pose> = None;
                let (mut largest, mut worst, mut moved) = ((0.0f64, 0.0f64), 0.0f64, 0.0);
                for k in 0..4500 {
                    let now = k as f64 * STEP;
                    while let Some(frame) = stream.next_if(|frame| frame.arrival <= now) {
                        tracker.push(&frame).unwrap();
                    }
                    let Some(targets) = tracker.sample(now) else { continue };
                    let Some(tip) = targets.fingers[1].filter(|tip| tip.weight > 0.0) else { continue };
                    if let Some(before) = before {
                        let step = step_between(&before, &tip.pose);
                        largest = (largest.0.max(step.0), largest.1.max(step.1));
                        moved += step.0;
                    }
                    before = Some(tip.pose);
                    // Where the hand truly was at the time that is shown.
                    if now > 0.5 {
                        worst = worst.max(step_between(&tip.pose, &(palm_at(targets.time - ZERO) * tip_in_palm(1))).0);
                    }
                }
                let ratio = (largest.0 / hand.0, largest.1 / hand.1);
                println!(
                    "{delay:?} {rate} Hz, seed {seed}: step {:.2} and turn {:.2} of the hand's, {:.1} mm off, delay {:.1} ms",
                    ratio.0,
                    ratio.1,
                    1e3 * worst,
                    1e3 * tracker.delay()
                );
                assert!(ratio.0 < bound && ratio.1 < bound, "{delay:?} {rate} Hz, seed {seed}: steps {ratio:?} times those of the hand");
                assert!(moved > 0.5, "it does move: {moved} m");
            }
        }
    }
}

/// With which what is seen elsewhere glides there, m/s and rad/s.
const FASTEST: (f64, f64) = (0.5, 3.0);

/// What came of [`unseen_frames`]: largest step (m, rad) of the tips, how far one was from the hand (m) at most before the hand was set
/// aside and in the last half second.
struct Followed {
    step: (f64, f64),
    off: f64,
    off_at_last: f64,
}

/// A stream of the rate without disturbance, but some frames see none of `parts` (5 is the palm), and from 1.5 s on, in the middle of the
/// motion, these are put elsewhere by `aside`. Weights stay up all the time.
fn unseen_frames(rate: f64, delay: Delay, parts: &[usize], unseen: impl Fn(usize) -> bool, aside: impl Fn(f64, Pose) -> Pose) -> Followed {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions { delay, ..Default::default() }).unwrap();
    let placed = |k: usize, t: f64, pose: Pose| if t >= 1.5 && parts.contains(&k) { aside(t, pose) } else { pose };
    let (mut next, mut before) = (0, [None::<Pose>; 3]);
    let mut found = Followed { step: (0.0, 0.0), off: 0.0, off_at_last: 0.0 };
    for k in 0..5000 {
        let now = k as f64 * STEP;
        while next as f64 / rate + 0.004 <= now {
            let t = next as f64 / rate;
            let mut frame = HandFrame { arrival: t + 0.004, ..hand_at(t, if unseen(next) { parts } else { &[] }) };
            for (finger, pose) in frame.fingers.iter_mut().enumerate() {
                pose.iter_mut().for_each(|pose| pose.tip = placed(finger, t, pose.tip));
            }
            frame.palm.iter_mut().for_each(|palm| palm.pose = placed(5, t, palm.pose));
            frame.palm.iter_mut().for_each(|palm| palm.tracked = !(unseen(next) && parts.contains(&5)));
            tracker.push(&frame).unwrap();
            next += 1;
        }
        let Some(targets) = tracker.sample(now).filter(|_| now > 0.5) else { continue };
        for (finger, before) in before.iter_mut().enumerate() {
            let tip = targets.fingers[finger].unwrap();
            assert_eq!(tip.weight, 1.0, "at {now} s");
            let t = targets.time - ZERO;
            let off = step_between(&tip.pose, &placed(finger, t, palm_at(t) * tip_in_palm(finger))).0;
            found.off = if t < 1.4 { found.off.max(off) } else { found.off };
            found.off_at_last = if t > 3.5 { found.off_at_last.max(off) } else { 0.0 };
            if let Some(before) = before.replace(tip.pose) {
                let step = step_between(&before, &tip.pose);
                found.step = (found.step.0.max(step.0), found.step.1.max(step.1));
            }
        }
    }
    found
}

/// Another place for the whole hand after one unseen frame (the page of a headset recentres), or for one finger (two markers are taken for
/// each other).
#[test]
fn what_is_seen_elsewhere_after_one_unseen_frame_glides_there() {
    let hand = largest_hand_step();
    let aside = Pose::from_parts(Vec3::new(0.1, -0.25, 0.1).into(), Rot::from_euler_angles(0.0, 0.0, 0.8));
    let other_place = Pose::from_parts(Vec3::new(-0.02, 0.06, -0.03).into(), Rot::from_euler_angles(0.3, -0.6, 0.2));
    for parts in [&[0, 1, 2, 5][..], &[1]] {
        let placed = |t: f64, pose: Pose| if parts.len() > 1 { aside * pose } else { palm_at(t) * tip_in_palm(1) * other_place };
        for rate in RATES {
            let found = unseen_frames(rate, Delay::Auto, parts, |frame| frame == (1.5 * rate) as usize, placed);
            let (tip, turn) = ((found.step.0 - FASTEST.0 * STEP) / hand.0, (found.step.1 - FASTEST.1 * STEP) / hand.1);
            println!(
                "{rate} Hz, {parts:?}: {tip:.2} and {turn:.2} of the hand's step and that of a glide, {:.1e} m off at last",
                found.off_at_last
            );
            assert!(tip < 1.25 && turn < 1.25, "{rate} Hz, {parts:?}: steps of {:?}, the hand's {hand:?}", found.step);
            assert!(found.off_at_last < 1e-3, "{rate} Hz, {parts:?}: {} m from where it is seen", found.off_at_last);
        }
    }
}

/// A hand that is not seen in every seventh frame and goes on meanwhile is shown as if it had been.
#[test]
fn single_unseen_frames_of_a_moving_hand_do_not_show() {
    let hand = largest_hand_step();
    for rate in RATES {
        let found = unseen_frames(rate, Delay::Auto, &[0, 1, 2, 5], |frame| frame % 7 == 3, |_, pose| pose);
        println!("{rate} Hz: {:.2} of the hand's step, {:.2} mm off", found.step.0 / hand.0, 1e3 * found.off);
        assert!(found.step.0 < 1.25 * hand.0 && found.step.1 < 1.25 * hand.1, "{rate} Hz: {:?}, the hand's {hand:?}", found.step);
    }
}

/// The clock of a tracker is set by a time server: it is followed within a quarter of a second, and nothing goes limp or jumps.
#[test]
fn a_clock_that_is_set_back_a_little_is_followed_soon() {
    let hand = largest_hand_step();
    for back in [0.3, 0.7, 0.9] {
        let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
        let (mut next, mut before, mut largest) = (0, None::<Pose>, 0.0f64);
        for k in 0..3500 {
            let now = k as f64 * STEP;
            while next as f64 / 60.0 + 0.004 <= now {
                let t = next as f64 / 60.0;
                let stamp = ZERO + if t < 1.5 { t } else { t - back };
                tracker.push(&HandFrame { time: stamp, arrival: t + 0.004, ..hand_at(t, &[]) }).unwrap();
                next += 1;
            }
            let Some(tip) = tracker.sample(now).and_then(|targets| targets.fingers[1]).filter(|_| now > 0.5) else { continue };
            assert_eq!((tip.weight, tip.state), (1.0, TargetState::Live), "{back} s: at {now} s");
            let late = step_between(&tip.pose, &(palm_at(now) * tip_in_palm(1))).0;
            assert!(!(2.3..2.5).contains(&now) || late < 1e-3, "{back} s: {late} m behind a hand at rest");
            largest = before.map_or(0.0, |before| largest.max(step_between(&before, &tip.pose).0));
            before = Some(tip.pose);
        }
        println!("back by {back} s: steps of {:.2} of the hand's", largest / hand.0);
        assert!(largest < 1.25 * hand.0 + FASTEST.0 * STEP, "{back} s: {largest} m in a step");
    }
}

/// Not to be asked for 2.5 s, as by a program that was stopped, is no reason for a jump.
#[test]
fn after_a_stop_of_the_program_it_goes_on_from_where_it_was() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let (mut next, mut before, mut largest) = (0, None::<Pose>, 0.0f64);
    let stopped = 0.95..3.45;
    for now in (0..6000).map(|k| k as f64 * STEP).filter(|now| !stopped.contains(now)) {
        while next as f64 / 60.0 + 0.004 <= now {
            // At the other end when the program wakes.
            let t = next as f64 / 60.0;
            let frame = hand_at(t.min(2.3), &[]);
            tracker.push(&HandFrame { time: ZERO + t, arrival: t + 0.004, ..frame }).unwrap();
            next += 1;
        }
        let Some(tip) = tracker.sample(now).and_then(|targets| targets.fingers[0]).filter(|_| now > 0.5) else { continue };
        largest = before.map_or(0.0, |before| largest.max(step_between(&before, &tip.pose).0));
        before = Some(tip.pose);
        assert_eq!(tip.weight, 1.0, "at {now} s");
    }
    println!("largest step {:.2} mm", 1e3 * largest);
    assert!(largest < 1.01 * FASTEST.0 * STEP, "{largest} m in a step");
    assert!(step_between(&before.unwrap(), &(palm_at(2.3) * tip_in_palm(0))).0 < 1e-3);
}

#[test]
fn a_long_delay_is_kept_at_every_rate() {
    for rate in RATES {
        let options = TrackingOptions { delay: Delay::Fixed(1.0), ..TrackingOptions::default() };
        let mut tracker = HandTracker::new(Side::Right, Pose::identity(), options).unwrap();
        let mut next = 0;
        for k in 0..3000 {
            let now = k as f64 * STEP;
            while next as f64 / rate + 0.004 <= now {
                let t = next as f64 / rate;
                tracker.push(&HandFrame { arrival: t + 0.004, ..hand_at(t, &[]) }).unwrap();
                next += 1;
            }
            let Some(targets) = tracker.sample(now).filter(|_| now > 1.5) else { continue };
            let t = targets.time - ZERO;
            assert!((now - t - 1.004).abs() < 1e-6, "{rate} Hz: shows {t} s at {now} s");
            let tip = targets.fingers[1].unwrap();
            let off = step_between(&tip.pose, &(palm_at(t) * tip_in_palm(1))).0;
            assert!(off < 1e-3, "{rate} Hz: {off} m off at {now} s");
            let truth = (palm_at(t + 1e-4) * tip_in_palm(1)).translation.vector - (palm_at(t - 1e-4) * tip_in_palm(1)).translation.vector;
            let slip = (tip.linear_velocity - truth / 2e-4).norm();
            assert!(slip < 0.06, "{rate} Hz: velocity {slip} m/s off at {now} s");
        }
    }
}

#[test]
fn another_pad_radius_comes_by_and_by() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let mut radii = Vec::new();
    for k in 0..120 {
        let t = f64::from(k) / 60.0;
        let mut frame = hand_at(t, &[]);
        frame.fingers[0].as_mut().unwrap().pad_radius = if k < 60 { 0.008 } else { 0.02 };
        // What is not seen has no say.
        frame.fingers[1] =
            Some(FingerPose { pad_radius: if k == 30 { 0.05 } else { 0.008 }, tracked: k != 30, ..frame.fingers[1].unwrap() });
        tracker.push(&frame).unwrap();
        let fingers = tracker.sample(t).unwrap().fingers;
        radii.push(fingers[0].unwrap().pad_radius);
        assert_eq!(fingers[1].unwrap().pad_radius, 0.008);
    }
    assert_eq!((radii[0], radii[59]), (0.008, 0.008));
    let fastest = radii.windows(2).map(|pair| (pair[1] - pair[0]) * 60.0).fold(0.0, f64::max);
    assert!(fastest <= 0.013 / 0.1 && (radii[119] - 0.02).abs() < 1e-4, "{fastest} m/s, {} m at last", radii[119]);
}

#[test]
fn a_tracker_that_starts_anew_is_followed_without_a_jump() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let mut before: Option<Pose> = None;
    for k in 0..3000 {
        let now = f64::from(k) * STEP;
        if k % 16 == 0 {
            // After a second the clock is set back by ten hours and the hand is at the far end.
            let (t, clock) = if now < 1.0 { (0.0, ZERO) } else { (2.0, ZERO - 36_000.0) };
            tracker.push(&HandFrame { time: clock + now, arrival: now, ..hand_at(t, &[]) }).unwrap();
        }
        let Some(targets) = tracker.sample(now) else { continue };
        let tip = targets.fingers[0].unwrap().pose;
        if let Some(before) = before {
            let step = step_between(&before, &tip).0;
            assert!(step < 1.01 * FASTEST.0 * STEP, "{step} m in one step at {now} s");
        }
        before = Some(tip);
    }
    assert!(step_between(&before.unwrap(), &(palm_at(2.0) * tip_in_palm(0))).0 < 1e-3);
}

#[test]
fn bad_frames_are_refused_and_change_nothing() {
    let mut tracker = HandTracker::new(Side::Left, Pose::identity(), TrackingOptions::default()).unwrap();
    assert!(tracker.push(&hand_at(0.0, &[])).unwrap_err().to_string().contains("one tracker for each hand"));
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let mut frame = hand_at(0.0, &[]);
    frame.fingers[1].as_mut().unwrap().tip.translation.x = f64::NAN;
    assert!(tracker.push(&frame).is_err());
    for time in [f64::INFINITY, 1e13] {
        assert!(tracker.push(&HandFrame { time, ..hand_at(0.0, &[]) }).is_err());
        assert!(tracker.push(&HandFrame { arrival: -time, ..hand_at(0.0, &[]) }).is_err());
    }
    for pad_radius in [-0.001, 0.2, f64::NAN] {
        let mut frame = hand_at(0.0, &[]);
        frame.fingers[0].as_mut().unwrap().pad_radius = pad_radius;
        assert!(tracker.push(&frame).unwrap_err().to_string().contains("pad_radius"));
    }
    assert_eq!(tracker.sample(1.0), None);
    for bad in [TrackingOptions { hold: -1.0, ..Default::default() }, TrackingOptions { delay: Delay::Fixed(2.0), ..Default::default() }] {
        assert!(HandTracker::new(Side::Right, Pose::identity(), bad).is_err());
    }
}

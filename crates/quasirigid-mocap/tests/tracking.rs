//! Bad streams and losses: the fingers shown never jump beyond what the hand did, and go on smoothly.

use quasirigid_mocap::{
    Delay, Finger, FingerPose, HandFrame, HandTracker, PalmPose, Pose, Rot, Side, Source, TargetState, TrackingOptions, Vec3,
};

const STEP: f64 = 1e-3;
/// The tracker's clock is not ours.
const ZERO: f64 = 40_000.0;

/// There and back again within 0.4 m and 80 degrees, minimum jerk, then rest: the peak is 0.75 m/s.
fn palm_at(t: f64) -> Pose {
    let s = (t - 1.0).clamp(0.0, 1.0);
    let back = (t - 2.5).clamp(0.0, 1.0);
    let jerk = |s: f64| s * s * s * (10.0 + s * (6.0 * s - 15.0));
    let way = jerk(s) - jerk(back);
    Pose::from_parts(Vec3::new(0.4 * way, -0.1 * way, 1.0 + 0.1 * way).into(), Rot::from_euler_angles(0.2, 1.4 * way, 0.0))
}

fn tip_in_palm(finger: usize) -> Pose {
    Pose::from_parts(Vec3::new(0.09, 0.02 * finger as f64, -0.02).into(), Rot::from_euler_angles(0.0, 0.5, 0.0))
}

fn hand_at(t: f64, lost: &[usize]) -> HandFrame {
    let mut frame = HandFrame::unseen(Side::Right, ZERO + t, t, Source::Synthetic);
    frame.palm = Some(PalmPose { pose: palm_at(t), tracked: true });
    for finger in 0..3 {
        frame.fingers[finger] =
            Some(FingerPose { tip: palm_at(t) * tip_in_palm(finger), pad_radius: 0.008, tracked: !lost.contains(&finger) });
    }
    frame
}

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

fn step_between(a: &Pose, b: &Pose) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
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

/// Runs a good stream of 60 Hz in which the middle finger is lost from `from` to `to`.
fn with_loss(from: f64, to: f64, options: TrackingOptions, mut see: impl FnMut(f64, quasirigid_mocap::HandTargets)) {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), options).unwrap();
    let mut next = 0;
    for k in 0..4000 {
        let now = k as f64 * STEP;
        while next as f64 / 60.0 + 0.004 <= now {
            let t = next as f64 / 60.0;
            let lost: &[usize] = if (from..to).contains(&t) { &[Finger::Middle as usize] } else { &[] };
            tracker.push(&HandFrame { arrival: t + 0.004, ..hand_at(t, lost) }).unwrap();
            next += 1;
        }
        if let Some(targets) = tracker.sample(now) {
            see(now, targets);
        }
    }
}

#[test]
fn a_lost_finger_goes_with_the_palm_and_keeps_its_weight_for_a_while() {
    // In the middle of the motion, where the palm does 0.75 m/s: held in the room, the finger would stay 15 cm behind.
    let mut worst = 0.0f64;
    with_loss(1.4, 1.6, TrackingOptions::default(), |now, targets| {
        let finger = targets.fingers[Finger::Middle as usize].unwrap();
        let truth = palm_at(targets.time - ZERO) * tip_in_palm(Finger::Middle as usize);
        if now > 0.5 {
            worst = worst.max(step_between(&finger.pose, &truth).0);
            assert!((finger.weight - 1.0).abs() < 1e-9, "weight {} at {now}", finger.weight);
        }
    });
    assert!(worst < 2e-3, "{worst} m off the place where a rigid hand has it");
}

#[test]
fn a_long_loss_fades_out_and_comes_back_smoothly() {
    let options = TrackingOptions { hold: 0.3, fade: 0.2, ..TrackingOptions::default() };
    let (mut seen, mut largest, mut before) = (Vec::new(), 0.0f64, 0.0);
    with_loss(1.2, 2.2, options, |now, targets| {
        let finger = targets.fingers[Finger::Middle as usize].unwrap();
        if now > 1.0 {
            largest = largest.max((finger.weight - before).abs());
        }
        before = finger.weight;
        if seen.last().is_none_or(|&(state, _)| state != finger.state) {
            seen.push((finger.state, now));
        }
    });
    let states: Vec<_> = seen.iter().map(|&(state, _)| state).collect();
    assert_eq!(states, [TargetState::Live, TargetState::Held, TargetState::Fading, TargetState::Lost, TargetState::Live]);
    for ((_, at), wanted) in seen[1..].iter().zip([1.2, 1.5, 1.7, 2.2]) {
        assert!((at - wanted).abs() < 0.03, "{at} s for {wanted} s");
    }
    assert!(largest <= 0.011, "weight moves by {largest} in one step");
}

#[test]
fn a_stream_that_ends_lets_go() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    assert_eq!(tracker.sample(0.0), None);
    for k in 0..60 {
        let t = f64::from(k) / 60.0;
        tracker.push(&hand_at(t, &[])).unwrap();
        tracker.sample(t);
    }
    let weight = |tracker: &mut HandTracker, now: f64| tracker.sample(now).unwrap().palm.unwrap().weight;
    assert_eq!(weight(&mut tracker, 1.2), 1.0);
    let fading = weight(&mut tracker, 1.75);
    assert!(fading > 0.3 && fading < 0.7, "{fading}");
    assert_eq!(weight(&mut tracker, 3.0), 0.0);
}

#[test]
fn without_a_palm_a_lost_finger_goes_with_another_one() {
    let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
    let mut worst = 0.0f64;
    for k in 0..180 {
        let t = f64::from(k) / 60.0;
        let lost: &[usize] = if (1.4..1.6).contains(&t) { &[0] } else { &[] };
        tracker.push(&HandFrame { palm: None, ..hand_at(t, lost) }).unwrap();
        let targets = tracker.sample(t).unwrap();
        assert_eq!(targets.palm, None);
        let truth = palm_at(targets.time - ZERO) * tip_in_palm(0);
        if t > 0.5 {
            worst = worst.max(step_between(&targets.fingers[0].unwrap().pose, &truth).0);
        }
    }
    assert!(worst < 2e-3, "{worst} m");
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
            assert!(step < 0.5 * STEP / 0.1 * 1.1, "{step} m in one step at {now} s");
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
    assert!(tracker.push(&HandFrame { time: f64::INFINITY, ..hand_at(0.0, &[]) }).is_err());
    assert_eq!(tracker.sample(1.0), None);
    for bad in [TrackingOptions { hold: -1.0, ..Default::default() }, TrackingOptions { delay: Delay::Fixed(2.0), ..Default::default() }] {
        assert!(HandTracker::new(Side::Right, Pose::identity(), bad).is_err());
    }
}

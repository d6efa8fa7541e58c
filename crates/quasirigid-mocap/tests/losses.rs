//! What is not seen: how long it keeps its weight, where it is shown meanwhile, how it comes back.

mod moving_hand;

use moving_hand::{RATES, STEP, ZERO, hand_at, palm_at, step_between, tip_in_palm};
use quasirigid_mocap::{Finger, HandFrame, HandTracker, Pose, Side, TargetState, TrackingOptions};

/// Who wants to let go at once does not let go between two frames.
#[test]
fn without_a_hold_a_finger_that_is_seen_stays_live() {
    for rate in RATES {
        let options = TrackingOptions { hold: 0.0, ..TrackingOptions::default() };
        let mut tracker = HandTracker::new(Side::Right, Pose::identity(), options).unwrap();
        let mut next = 0;
        let mut state = TargetState::Live;
        for k in 0..2000 {
            let now = k as f64 * STEP;
            while next as f64 / rate + 0.004 <= now {
                let t = next as f64 / rate;
                let lost: &[usize] = if t >= 1.5 { &[1] } else { &[] };
                tracker.push(&HandFrame { arrival: t + 0.004, ..hand_at(t, lost) }).unwrap();
                next += 1;
            }
            let Some(tip) = tracker.sample(now).and_then(|targets| targets.fingers[1]) else { continue };
            if (0.3..1.5).contains(&now) {
                assert_eq!((tip.state, tip.weight), (TargetState::Live, 1.0), "{rate} Hz: at {now} s");
            }
            assert!(now < 1.51 + 1.0 / rate || tip.weight < 1.0, "{rate} Hz: weight {} at {now} s", tip.weight);
            state = tip.state;
        }
        assert!(matches!(state, TargetState::Fading | TargetState::Lost), "{rate} Hz: {state:?} after 0.5 s");
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

/// The first frame that sees a finger again, with two lost packets behind it.
#[test]
fn a_finger_that_was_seen_again_but_once_goes_on_with_the_palm() {
    for rate in [30.0, 60.0] {
        let mut tracker = HandTracker::new(Side::Right, Pose::identity(), TrackingOptions::default()).unwrap();
        let (mut next, mut worst) = (0, 0.0f64);
        for k in 0..2000 {
            let now = k as f64 * STEP;
            while next as f64 / rate + 0.004 <= now {
                let t = next as f64 / rate;
                let lost: &[usize] = if (1.2..1.4).contains(&t) { &[1] } else { &[] };
                let since_seen = next as i64 - (1.4 * rate).ceil() as i64;
                if !(1..=2).contains(&since_seen) {
                    tracker.push(&HandFrame { arrival: t + 0.004, ..hand_at(t, lost) }).unwrap();
                }
                next += 1;
            }
            let Some(targets) = tracker.sample(now).filter(|_| now > 0.5) else { continue };
            // The finger and the palm both run on, and together.
            let apart = targets.palm.unwrap().pose.inv_mul(&targets.fingers[1].unwrap().pose);
            worst = worst.max(step_between(&apart, &tip_in_palm(1)).0);
        }
        println!("{rate} Hz: {:.2} mm from its place in the hand", 1e3 * worst);
        assert!(worst < 3e-3, "{rate} Hz: {worst} m from its place in the hand");
    }
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

//! A hand that moves there and back, for the tests of tracking.

use quasirigid_mocap::{FingerPose, HandFrame, PalmPose, Pose, Rot, Side, Source, Vec3};

pub const STEP: f64 = 1e-3;
/// The tracker's clock is not ours.
pub const ZERO: f64 = 40_000.0;

/// There and back again within 0.4 m and 80 degrees, minimum jerk, then rest: the peak is 0.75 m/s.
pub fn palm_at(t: f64) -> Pose {
    let s = (t - 1.0).clamp(0.0, 1.0);
    let back = (t - 2.5).clamp(0.0, 1.0);
    let jerk = |s: f64| s * s * s * (10.0 + s * (6.0 * s - 15.0));
    let way = jerk(s) - jerk(back);
    Pose::from_parts(Vec3::new(0.4 * way, -0.1 * way, 1.0 + 0.1 * way).into(), Rot::from_euler_angles(0.2, 1.4 * way, 0.0))
}

pub fn tip_in_palm(finger: usize) -> Pose {
    Pose::from_parts(Vec3::new(0.09, 0.02 * finger as f64, -0.02).into(), Rot::from_euler_angles(0.0, 0.5, 0.0))
}

pub fn hand_at(t: f64, lost: &[usize]) -> HandFrame {
    let mut frame = HandFrame::unseen(Side::Right, ZERO + t, t, Source::Synthetic);
    frame.palm = Some(PalmPose { pose: palm_at(t), tracked: true });
    for finger in 0..3 {
        frame.fingers[finger] =
            Some(FingerPose { tip: palm_at(t) * tip_in_palm(finger), pad_radius: 0.008, tracked: !lost.contains(&finger) });
    }
    frame
}

pub fn step_between(a: &Pose, b: &Pose) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

pub const RATES: [f64; 5] = [30.0, 60.0, 120.0, 240.0, 500.0];

//! A take made by a program: a right hand reaches for a box, pinches it, lifts it by 10 cm, turns it by 30 degrees and puts it down again.
//!
//! Motion like that of people: minimum jerk from place to place (Flash and Hogan 1985), tremor of 8 to 12 Hz, measurement noise, arrivals
//! with jitter, and the middle finger lost for 0.2 s during the lift. For the box of the scene `grasp`: 60 x 60 x 80 mm, standing on z = 0
//! about the origin of the world, taken by the faces at x = -0.03 (thumb) and x = +0.03 (index and middle). The room of the tracker is the
//! world.

use crate::dtrack::{Hand, HandFinger, Packet, Placement};
use crate::error::{Result, check_within};
use crate::hands::{palm_from_dtrack, placement_from_pose};
use crate::take::{Take, TakePacket};
use crate::{Finger, FingerPose, HandFrame, PalmPose, Pose, Rot, Side, Source, Vec3};
use nalgebra::{Matrix3, Rotation3};
use std::f64::consts::PI;

/// Radius of the pads, m.
pub const PAD_RADIUS: f64 = 0.008;
/// How high the box is lifted, m.
pub const LIFT: f64 = 0.1;
/// How far it is turned about the vertical, rad.
pub const TURN: f64 = PI / 6.0;
/// When the middle finger is lost, s: in the middle of the lift.
pub const LOSS: (f64, f64) = (3.3, 3.5);
/// Length of the take, s.
pub const DURATION: f64 = 10.0;

/// Half of the box between thumb and fingers, m.
const HALF_BOX: f64 = 0.03;
/// Height of the pads over the table when they touch the box, m.
const HEIGHT: f64 = 0.04;
/// Distance of index and middle finger, m.
const SPREAD: f64 = 0.024;
/// Clearance between skin and box before the hand closes, m.
const OPEN: f64 = 0.010;
/// How far the tracked pads go into the box that is not there, m: springs to the simulated fingertips turn this into force. The thumb
/// opposes two fingers, so it goes in twice as far.
const PRESS: (f64, f64) = (0.010, 0.005);
/// Where the hand comes from, m.
const REST: Vec3 = Vec3::new(-0.03, -0.12, 0.24);
/// Palm in the frame between the pads: over the box, fingers forward (+x), back of the hand up.
const KNUCKLE: Vec3 = Vec3::new(-0.014, 0.5 * SPREAD, 0.067);
/// Lengths of outer, middle and inner phalanx, m.
const LENGTHS: [[f64; 3]; 3] = [[0.030, 0.034, 0.046], [0.024, 0.028, 0.048], [0.026, 0.030, 0.050]];

/// Roots of thumb, index and middle finger in the palm frame of the right hand, m. That of the thumb is put where a chain that bends in one
/// plane can start from; a real one has a saddle joint near the wrist.
const ROOTS: [Vec3; 3] = [Vec3::new(0.036, -0.5 * SPREAD, 0.0), Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.0, -SPREAD, 0.0)];

/// What can be chosen about the take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinchOptions {
    /// Same seed, same bytes.
    pub seed: u64,
    /// Frames per second, Hz.
    pub rate: f64,
    /// Standard deviation of measured positions, for each axis, m.
    pub noise: f64,
    /// Amplitude of the tremor, m.
    pub tremor: f64,
    /// The right hand, or its mirror image in the plane y = 0, which turns the box the other way.
    pub side: Side,
}

impl Default for PinchOptions {
    fn default() -> Self {
        Self { seed: 1, rate: 60.0, noise: 3e-4, tremor: 1.5e-4, side: Side::Right }
    }
}

/// 0 before `from`, 1 after `to`, minimum jerk between.
fn along(t: f64, from: f64, to: f64) -> f64 {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// The middle between the pads and how the hand is turned, at `t` s: free of tremor and noise.
pub fn grasp_frame_at(t: f64) -> Pose {
    let reach = along(t, 0.5, 1.7) - along(t, 9.0, 9.9);
    // Away from the box it goes straight up first: the box stands turned between the fingers.
    let lift = along(t, 2.7, 4.1) - along(t, 6.3, 7.7) + along(t, 8.4, 9.2);
    let turn = TURN * (along(t, 4.4, 5.7) - along(t, 9.1, 9.9));
    let place = Vec3::new(0.0, 0.0, HEIGHT);
    let position = REST + (place - REST) * reach + Vec3::z() * (LIFT * lift);
    Pose::from_parts(position.into(), Rot::from_scaled_axis(Vec3::z() * turn))
}

/// Where the box should be at `t` s if it is held without slip: its centre and turn.
pub fn box_at(t: f64) -> Pose {
    let lift = along(t, 2.7, 4.1) - along(t, 6.3, 7.7);
    let position = Vec3::new(0.0, 0.0, 0.04 + LIFT * lift);
    Pose::from_parts(position.into(), Rot::from_scaled_axis(Vec3::z() * (TURN * along(t, 4.4, 5.7))))
}

/// The hand at `t` s, free of tremor and noise, in the world; nothing is lost.
pub fn hand_at(t: f64) -> HandFrame {
    let closed = along(t, 1.7, 2.3) - along(t, 7.8, 8.4);
    let grasp = grasp_frame_at(t);
    let mut frame = HandFrame::unseen(Side::Right, t, t, Source::Synthetic);
    frame.palm = Some(PalmPose { pose: grasp * Pose::translation(KNUCKLE.x, KNUCKLE.y, KNUCKLE.z), tracked: true });
    for (finger, side, y) in [(Finger::Thumb, -1.0, 0.0), (Finger::Index, 1.0, 0.5 * SPREAD), (Finger::Middle, 1.0, -0.5 * SPREAD)] {
        let press = if finger == Finger::Thumb { PRESS.0 } else { PRESS.1 };
        let open = HALF_BOX + PAD_RADIUS + OPEN;
        let x = side * (open - (OPEN + press) * closed);
        // The finger hangs down (+X is -z), the nail looks away from the box.
        let (down, nail) = (-Vec3::z(), Vec3::x() * side);
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[down, nail.cross(&down), nail]));
        let tip = Pose::from_parts(Vec3::new(x, y, 0.0).into(), Rot::from_rotation_matrix(&axes));
        frame.fingers[finger as usize] = Some(FingerPose { tip: grasp * tip, pad_radius: PAD_RADIUS, tracked: true });
    }
    frame
}

/// The mirror image in the plane y = 0, of the other hand. Frames are mirrored with their y axes: x along the finger and z out of the nail
/// (or the back of the hand) stay so.
pub fn mirrored(frame: &HandFrame) -> HandFrame {
    let mirror = |pose: &Pose| {
        let (p, q) = (pose.translation.vector, pose.rotation);
        // M R M with M = diag(1, -1, 1): the turn about x and z changes its sense, that about y does not.
        let turned = nalgebra::Unit::new_unchecked(nalgebra::Quaternion::new(q.w, -q.i, q.j, -q.k));
        Pose::from_parts(Vec3::new(p.x, -p.y, p.z).into(), turned)
    };
    let mut other = *frame;
    other.side = if frame.side == Side::Right { Side::Left } else { Side::Right };
    if let Some(palm) = &mut other.palm {
        palm.pose = mirror(&palm.pose);
    }
    for finger in other.fingers.iter_mut().flatten() {
        finger.tip = mirror(&finger.tip);
    }
    other
}

/// The take.
///
/// # Errors
/// [`crate::Error::InvalidValue`] for a rate outside 10 to 1000 Hz, or noise or tremor outside 0 to 1 cm.
pub fn pinch_take(options: &PinchOptions) -> Result<Take> {
    check_within("rate", options.rate, 10.0, 1000.0, "Hz")?;
    check_within("noise", options.noise, 0.0, 0.01, "m")?;
    check_within("tremor", options.tremor, 0.0, 0.01, "m")?;
    let mut random = Random(fastrand::Rng::with_seed(options.seed));
    let tremors: Vec<Tremor> = (0..4).map(|_| Tremor::new(&mut random)).collect();
    let mut packets = Vec::new();
    for k in 0..(DURATION * options.rate).round() as u32 {
        let t = f64::from(k) / options.rate;
        let mut frame = hand_at(t);
        // The hand trembles as a whole, and each finger a little by itself.
        let shake = tremors[3].at(t) * options.tremor;
        let turn_noise = options.noise * 10.0; // 0.3 mm go with 0.17 degrees
        if let Some(palm) = &mut frame.palm {
            palm.pose = random.shaken(&palm.pose, shake, options.noise, turn_noise);
        }
        for (finger, tremor) in frame.fingers.iter_mut().zip(&tremors) {
            if let Some(finger) = finger {
                finger.tip = random.shaken(&finger.tip, shake + tremor.at(t) * (0.4 * options.tremor), options.noise, turn_noise);
            }
        }
        if let Some(middle) = frame.fingers[Finger::Middle as usize].as_mut() {
            middle.tracked = !(LOSS.0..LOSS.1).contains(&t);
        }
        if options.side == Side::Left {
            frame = mirrored(&frame);
        }
        let packet = Packet {
            frame: 1000 + k,
            time_of_day: Some(36_000.0 + (1e6 * t).round() / 1e6),
            calibrated_bodies: Some(0),
            bodies: Some(Vec::new()),
            calibrated_hands: Some(1),
            hands: Some(vec![dtrack_hand(&frame)]),
            ..Packet::default()
        };
        let arrival = t + 2e-4 * random.normal().abs();
        packets.push(TakePacket { arrival, bytes: packet.to_bytes() });
    }
    packets.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
    let notes = vec![
        format!(
            "synthetic: {} hand, pinch, lift by 100 mm, turn by 30 degrees, put down; seed {}, {} Hz",
            options.side.name(),
            options.seed,
            options.rate
        ),
        format!(
            "noise {:.2} mm, tremor {:.2} mm, middle finger lost from {} to {} s",
            1e3 * options.noise,
            1e3 * options.tremor,
            LOSS.0,
            LOSS.1
        ),
    ];
    Ok(Take { packets, notes, damaged: 0 })
}

/// The hand as a controller describes it.
fn dtrack_hand(frame: &HandFrame) -> Hand {
    let palm = frame.palm.map_or_else(Pose::identity, |palm| palm.pose);
    let hand = palm * palm_from_dtrack(frame.side);
    let fingers = frame.fingers.iter().flatten().zip(LENGTHS).enumerate().map(|(k, (finger, lengths))| {
        let root = Vec3::new(ROOTS[k].x, if frame.side == Side::Right { ROOTS[k].y } else { -ROOTS[k].y }, ROOTS[k].z);
        let angles = bend(&finger.tip, (palm * nalgebra::Point3::from(root)).coords, lengths);
        let tip = if finger.tracked { placement_from_pose(&(hand.inverse() * finger.tip)) } else { Placement::UNTRACKED };
        HandFinger { tip, tip_radius: 1e3 * finger.pad_radius, lengths: lengths.map(|l| 1e3 * l), angles }
    });
    Hand { id: 0, quality: 1.0, side: frame.side, placement: placement_from_pose(&hand), fingers: fingers.collect() }
}

/// Angles (outer to middle, middle to inner phalanx; degrees, flexion negative) of a finger whose tip and root are known: the triangle of
/// root, middle joint and outer joint, in the plane in which the finger bends.
fn bend(tip: &Pose, root: Vec3, [outer, middle, inner]: [f64; 3]) -> [f64; 2] {
    // In the frame of the tip: the finger bends in its x-z plane, nails at +z.
    let root = tip.inverse_transform_point(&root.into());
    let to_root = nalgebra::Vector2::new(root.x + outer, root.z);
    let distance = to_root.norm().clamp((middle - inner).abs() + 1e-6, middle + inner - 1e-6);
    // Law of cosines at the outer joint; the middle joint is on the side of the nail.
    let corner = ((middle * middle + distance * distance - inner * inner) / (2.0 * middle * distance)).clamp(-1.0, 1.0).acos();
    let direction = to_root.y.atan2(to_root.x) - corner;
    let joint = nalgebra::Vector2::new(middle * direction.cos(), middle * direction.sin());
    // X(R_m) = cos a X_o - sin a Z_o points from the middle to the outer joint, so a is negative where the joint lies on the side of the
    // pad.
    let along_middle = -joint;
    let along_inner = joint - to_root;
    let angle = |v: nalgebra::Vector2<f64>| -v.y.atan2(v.x);
    let [outer_middle, whole] = [angle(along_middle), angle(along_inner)];
    [outer_middle.to_degrees(), (whole - outer_middle).to_degrees()]
}

struct Random(fastrand::Rng);

impl Random {
    /// Normal deviate (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.f64()).ln()).sqrt();
        radius * (2.0 * PI * self.0.f64()).cos()
    }

    fn normals(&mut self) -> Vec3 {
        Vec3::new(self.normal(), self.normal(), self.normal())
    }

    /// A pose that is moved by `shift`, and measured with noise (m and rad).
    fn shaken(&mut self, pose: &Pose, shift: Vec3, noise: f64, turn: f64) -> Pose {
        let position = pose.translation.vector + shift + self.normals() * noise;
        Pose::from_parts(position.into(), Rot::from_scaled_axis(self.normals() * turn) * pose.rotation)
    }
}

/// Three waves of 8 to 12 Hz in random directions, amplitude about 1.
struct Tremor([(f64, f64, Vec3); 3]);

impl Tremor {
    fn new(random: &mut Random) -> Self {
        Self(std::array::from_fn(|_| (8.0 + 4.0 * random.0.f64(), 2.0 * PI * random.0.f64(), random.normals().normalize() / 3f64.sqrt())))
    }

    fn at(&self, t: f64) -> Vec3 {
        self.0.iter().map(|(frequency, phase, way)| way * (2.0 * PI * frequency * t + phase).sin()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HandChoice, HandDecoder};

    #[test]
    fn the_hand_pinches_lifts_turns_and_puts_down() {
        let between = |t: f64| {
            let hand = hand_at(t);
            let tip = |k: usize| hand.fingers[k].unwrap().tip.translation.vector;
            (0.5 * (tip(0) + 0.5 * (tip(1) + tip(2))), (tip(0) - 0.5 * (tip(1) + tip(2))).norm())
        };
        let (open, closed) = (2.0 * (HALF_BOX + PAD_RADIUS + OPEN), 2.0 * (HALF_BOX + PAD_RADIUS) - PRESS.0 - PRESS.1);
        assert!((between(0.0).1 - open).abs() < 1e-12 && (between(3.0).1 - closed).abs() < 1e-12);
        assert!((between(4.2).0.z - between(2.5).0.z - LIFT).abs() < 1e-12);
        assert!((between(7.75).0 - between(2.5).0).norm() < 2e-3, "put down where it was taken");
        let turn = hand_at(6.0).palm.unwrap().pose.rotation.angle_to(&hand_at(4.2).palm.unwrap().pose.rotation);
        assert!((turn - TURN).abs() < 1e-7);
        assert!((box_at(DURATION).translation.vector - Vec3::new(0.0, 0.0, 0.04)).norm() < 1e-12);
        // Nothing touches the box on the way to it and back.
        for k in 0..1000 {
            let t = 0.01 * f64::from(k);
            let hand = hand_at(t);
            let stand = box_at(t);
            for (finger, pose) in hand.tracked_fingers().filter(|_| !(1.7..8.4).contains(&t)) {
                let p = stand.inverse_transform_point(&pose.tip.translation.vector.into());
                let outside = (p.x.abs() - 0.03).max(p.y.abs() - 0.03).max(p.z.abs() - 0.04);
                assert!(outside > PAD_RADIUS + 2e-3, "{} is {outside} m from the box at {t} s", finger.name());
            }
        }
    }

    #[test]
    fn the_take_is_that_hand_with_noise_and_one_loss() {
        let take = pinch_take(&PinchOptions::default()).unwrap();
        assert_eq!(take.packets.len(), 600);
        let mut decoder = HandDecoder::new(HandChoice::Fingertracking(Side::Right));
        let (mut square, mut count, mut lost) = (0.0, 0.0, 0);
        for packet in &take.packets {
            let frame = decoder.decode(&packet.parse().unwrap(), packet.arrival).unwrap();
            let truth = hand_at(frame.time - 36_000.0);
            for (finger, pose) in frame.tracked_fingers() {
                let wrong = pose.tip.inv_mul(&truth.fingers[finger as usize].unwrap().tip);
                square += wrong.translation.vector.norm_squared();
                count += 3.0;
                assert!(wrong.rotation.angle() < 0.03);
            }
            lost += usize::from(!frame.fingers[2].unwrap().tracked);
        }
        let deviation = f64::sqrt(square / count);
        assert!((2.8e-4..3.8e-4).contains(&deviation), "{deviation} m: noise, tremor and a tenth of a millimetre of digits");
        assert_eq!(lost, 12, "0.2 s at 60 Hz");
        assert_eq!(take, pinch_take(&PinchOptions::default()).unwrap(), "same seed, same take");
        assert_ne!(take, pinch_take(&PinchOptions { seed: 2, ..PinchOptions::default() }).unwrap());
        assert!(pinch_take(&PinchOptions { rate: 0.0, ..PinchOptions::default() }).is_err());
    }

    #[test]
    fn the_left_take_is_the_right_one_in_a_mirror() {
        let clean = |side| {
            let take = pinch_take(&PinchOptions { noise: 0.0, tremor: 0.0, side, ..PinchOptions::default() }).unwrap();
            let mut decoder = HandDecoder::new(HandChoice::Fingertracking(side));
            take.packets.iter().map(|p| decoder.decode(&p.parse().unwrap(), p.arrival).unwrap()).collect::<Vec<_>>()
        };
        let (right, left) = (clean(Side::Right), clean(Side::Left));
        for (right, left) in right.iter().zip(&left) {
            assert_eq!(left.side, Side::Left);
            let expected = mirrored(right);
            let pairs = expected.tracked_fingers().map(|(f, pose)| (pose.tip, left.fingers[f as usize].unwrap().tip));
            for (a, b) in pairs.chain([(expected.palm.unwrap().pose, left.palm.unwrap().pose)]) {
                let wrong = a.inv_mul(&b);
                assert!(wrong.translation.vector.norm() < 3e-4 && wrong.rotation.angle() < 1e-3, "{wrong:?}");
            }
            // A mirror keeps nails and fingers: x and z of the tips are mirrored vectors.
            for (finger, pose) in right.tracked_fingers() {
                for axis in [Vec3::x(), Vec3::z()] {
                    let mirror = |v: Vec3| Vec3::new(v.x, -v.y, v.z);
                    let other = expected.fingers[finger as usize].unwrap().tip.rotation * axis;
                    assert!((mirror(pose.tip.rotation * axis) - other).norm() < 1e-12);
                }
            }
        }
    }

    /// The chain of the format page, from the tip back to the root, ends where the knuckles are.
    #[test]
    fn phalanges_reach_from_the_tip_to_the_knuckle() {
        let ry = |degrees: f64| Rot::from_scaled_axis(Vec3::y() * degrees.to_radians());
        let right = [0.0, 1.7, 2.5, 5.0].map(|t| (t, hand_at(t)));
        for (t, frame) in right.into_iter().chain(right.map(|(t, frame)| (t, mirrored(&frame)))) {
            let mirror = if frame.side == Side::Right { 1.0 } else { -1.0 };
            let hand = dtrack_hand(&frame);
            let room = crate::hands::pose_from_placement(&hand.placement);
            for (k, finger) in hand.fingers.iter().enumerate() {
                let tip = room * crate::hands::pose_from_placement(&finger.tip);
                let [lo, lm, li] = finger.lengths.map(|l| 1e-3 * l);
                let outer = tip.rotation;
                let middle = outer * ry(finger.angles[0]);
                let inner = middle * ry(finger.angles[1]);
                let root = tip.translation.vector - outer * Vec3::x() * lo - middle * Vec3::x() * lm - inner * Vec3::x() * li;
                let knuckle = (frame.palm.unwrap().pose * nalgebra::Point3::new(ROOTS[k].x, mirror * ROOTS[k].y, ROOTS[k].z)).coords;
                assert!((root - knuckle).norm() < 1e-3, "finger {k} at {t} s: {} m off", (root - knuckle).norm());
                // Flexion is negative; the last joint of a finger that presses may give way backwards a little.
                assert!(
                    finger.angles[0] < 10.0 && finger.angles[1] < 0.0 && finger.angles.iter().all(|&a| a > -120.0),
                    "{:?}",
                    finger.angles
                );
            }
        }
    }
}

//! From DTrack's packets to [`HandFrame`]s: hands of `gl`, or bodies of `6d` that are fixed to the fingers. mm become m.

use crate::body_map::{BodyMap, MappedBody};
use crate::dtrack::{Body, Columns, Hand, Packet, Placement};
use crate::error::{Error, Result};
use crate::{Finger, FingerPose, HandFrame, PalmPose, Pose, Rot, Side, Source, Vec3};
use nalgebra::{Matrix3, Rotation3};
use std::path::Path;

/// Half a day: a clock that falls back by more than this has passed midnight.
const HALF_DAY: f64 = 43_200.0;
const DAY: f64 = 86_400.0;
/// Ids of `6d` are below this.
const MOST_BODIES: u32 = 10_000;

/// The rotation nearest to nine numbers that are nearly one (printed with 4 or 6 decimals).
pub fn rotation_from_columns(columns: &Columns) -> Rot {
    let mut m = Matrix3::from_column_slice(columns);
    // Polar decomposition by Newton's iteration (Higham 1986): quadratic, so four steps take 1e-2 below rounding.
    for _ in 0..4 {
        let Some(inverse) = m.try_inverse() else { return Rot::identity() };
        m = 0.5 * (m + inverse.transpose());
    }
    Rot::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m))
}

/// Nine numbers, column after column, of a rotation.
pub fn columns_from_rotation(rotation: &Rot) -> Columns {
    let matrix = rotation.to_rotation_matrix();
    std::array::from_fn(|k| matrix.matrix().as_slice()[k])
}

/// A pose in m from a placement in mm.
pub fn pose_from_placement(placement: &Placement) -> Pose {
    let [x, y, z] = placement.position;
    Pose::from_parts(Vec3::new(1e-3 * x, 1e-3 * y, 1e-3 * z).into(), rotation_from_columns(&placement.rotation))
}

/// A placement in mm from a pose in m.
pub fn placement_from_pose(pose: &Pose) -> Placement {
    let p = 1e3 * pose.translation.vector;
    Placement { position: [p.x, p.y, p.z], rotation: columns_from_rotation(&pose.rotation) }
}

/// From DTrack's hand frame of one side to the palm frame of [`crate::hand_frame`], and back: it is its own inverse.
///
/// DTrack's +Z leaves the palm of a right hand and the back of a left one; ours leaves the back of both. Half a turn about X for the right
/// hand.
pub fn palm_from_dtrack(side: Side) -> Rot {
    match side {
        Side::Left => Rot::identity(),
        Side::Right => Rot::from_quaternion(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0)),
    }
}

/// The frame of one hand of `gl`.
pub fn frame_from_hand(hand: &Hand, time: f64, arrival: f64) -> HandFrame {
    let mut frame = HandFrame::unseen(hand.side, time, arrival, Source::DtrackHand);
    let tracked = hand.quality >= 0.0;
    let room_from_hand = pose_from_placement(&hand.placement);
    frame.palm = Some(PalmPose { pose: room_from_hand * palm_from_dtrack(hand.side), tracked });
    for (finger, slot) in hand.fingers.iter().zip(&mut frame.fingers) {
        let seen = tracked && finger.is_tracked();
        let tip = if seen { room_from_hand * pose_from_placement(&finger.tip) } else { Pose::identity() };
        *slot = Some(FingerPose { tip, pad_radius: 1e-3 * finger.tip_radius, tracked: seen });
    }
    frame
}

/// The frame of bodies that are fixed to the fingers of one hand.
pub fn frame_from_bodies(packet: &Packet, map: &BodyMap, time: f64, arrival: f64) -> Option<HandFrame> {
    let bodies = packet.bodies.as_ref()?;
    let seen = |mapped: &MappedBody| {
        let body = bodies.iter().find(|body| body.id == mapped.body && body.is_tracked())?;
        Some(pose_from_placement(&body.placement) * mapped.offset)
    };
    let mut frame = HandFrame::unseen(map.side, time, arrival, Source::DtrackBodies);
    frame.palm = map.palm.as_ref().map(|mapped| {
        let pose = seen(mapped);
        PalmPose { pose: pose.unwrap_or_default(), tracked: pose.is_some() }
    });
    for (mapped, slot) in map.fingers.iter().zip(&mut frame.fingers) {
        *slot = mapped.as_ref().map(|mapped| {
            let tip = seen(mapped);
            FingerPose { tip: tip.unwrap_or_default(), pad_radius: mapped.pad_radius, tracked: tip.is_some() }
        });
    }
    Some(frame)
}

/// Where the hand is in a packet.
#[derive(Debug, Clone, PartialEq)]
pub enum HandChoice {
    /// The hand of that side in the line `gl`; the one with the lowest id if there are several.
    Fingertracking(Side),
    /// Bodies of the line `6d`.
    Bodies(Box<BodyMap>),
}

impl HandChoice {
    /// The hand on this `side`, or the bodies that `bodies` names: a TOML file (by its ending), which names its side itself, or a text such
    /// as `thumb=0,index=1`.
    ///
    /// # Errors
    /// [`Error::File`] for a file that cannot be read; what [`BodyMap::from_toml`] and [`BodyMap::parse`] refuse.
    pub fn of(side: Side, bodies: Option<&str>) -> Result<Self> {
        let Some(text) = bodies else { return Ok(Self::Fingertracking(side)) };
        let map = if Path::new(text).extension().is_some_and(|ending| ending == "toml") {
            let hint = "give a TOML file, or a text such as thumb=0,index=1";
            let content = std::fs::read_to_string(text).map_err(|error| Error::file(text, "a readable file", error, hint))?;
            BodyMap::from_toml(&content)?
        } else {
            BodyMap::parse(text, side)?
        };
        Ok(Self::Bodies(Box::new(map)))
    }
}

/// Makes frames of one hand from the packets of one tracker.
#[derive(Debug, Clone)]
pub struct HandDecoder {
    choice: HandChoice,
    clock: TrackerClock,
}

impl HandDecoder {
    /// A decoder for one hand.
    pub fn new(choice: HandChoice) -> Self {
        Self { choice, clock: TrackerClock::default() }
    }

    /// Left or right.
    pub fn side(&self) -> Side {
        match &self.choice {
            HandChoice::Fingertracking(side) => *side,
            HandChoice::Bodies(map) => map.side,
        }
    }

    /// The hand in a packet; `arrival` in s. A hand that is not seen gives a frame in which nothing is tracked.
    /// None if the packet lacks the line in which the hand would be.
    pub fn decode(&mut self, packet: &Packet, arrival: f64) -> Option<HandFrame> {
        let time = self.clock.seconds(packet, arrival);
        match &self.choice {
            HandChoice::Bodies(map) => frame_from_bodies(packet, map, time, arrival),
            HandChoice::Fingertracking(side) => {
                // A controller that hides the empty line still counts the hands.
                if packet.hands.is_none() && packet.calibrated_hands.is_none() {
                    return None;
                }
                let hands = packet.hands.iter().flatten().filter(|hand| hand.side == *side);
                let hand = hands.min_by_key(|hand| hand.id);
                let unseen = || HandFrame::unseen(*side, time, arrival, Source::DtrackHand);
                Some(hand.map_or_else(unseen, |hand| frame_from_hand(hand, time, arrival)))
            }
        }
    }
}

/// Seconds of a tracker that never fall back at midnight.
#[derive(Debug, Clone, Copy, Default)]
pub struct TrackerClock {
    days: f64,
    last: Option<f64>,
}

impl TrackerClock {
    /// Seconds of a packet: its own stamp, without the jump of `ts` at midnight; the arrival if it has none.
    pub fn seconds(&mut self, packet: &Packet, arrival: f64) -> f64 {
        if let Some(unix) = packet.unix_time {
            return unix.seconds as f64 + 1e-6 * f64::from(unix.microseconds);
        }
        let Some(stamp) = packet.time_of_day else { return arrival };
        // A packet that was overtaken by the first of the new day belongs to the old one.
        match self.last {
            Some(last) if stamp < last - HALF_DAY => self.days += 1.0,
            Some(last) if stamp > last + HALF_DAY && self.days > 0.0 => return stamp + DAY * (self.days - 1.0),
            _ => {}
        }
        self.last = Some(stamp);
        stamp + DAY * self.days
    }
}

/// Ids of `6d` for fingertips: the same for every packet of a take, whatever it sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FingertipIds {
    /// That of the thumb of hand 0: the lowest that no body of any packet can have.
    first: u32,
    hands: u32,
}

impl FingertipIds {
    /// For these packets. Hand `h` gets the ids from `first + 5 h` on, thumb first.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if there are so many bodies and hands that an id would be over 9999.
    pub fn of<'a>(packets: impl IntoIterator<Item = &'a Packet>) -> Result<Self> {
        let (mut first, mut hands) = (0, 0);
        for packet in packets {
            let seen = packet.bodies.iter().flatten().map(|body| body.id + 1);
            first = seen.chain(packet.standard_bodies()).fold(first, u32::max);
            let seen = packet.hands.iter().flatten().map(|hand| hand.id + 1);
            hands = seen.chain(packet.calibrated_hands).fold(hands, u32::max);
        }
        let most = first.saturating_add(hands.saturating_mul(5));
        if most > MOST_BODIES {
            let got = format!("{first} bodies and {hands} hands");
            return Err(Error::value("fingertips as bodies", "ids up to 9999", got, "send this take without bodies of fingertips"));
        }
        Ok(Self { first, hands })
    }

    /// That of a finger.
    pub fn id(&self, hand: u32, finger: Finger) -> u32 {
        self.first + 5 * hand + finger as u32
    }
}

/// Each tracked fingertip of every hand as a body of `6d`, added to a packet; for systems that have bodies on the fingers.
pub fn add_fingertips_as_bodies(packet: &mut Packet, ids: &FingertipIds) {
    // A reader takes the old Flysticks and tools off this number before it counts bodies.
    packet.calibrated_bodies = Some(ids.first + 5 * ids.hands + packet.old_devices());
    let Some(hands) = packet.hands.take() else { return };
    let bodies = packet.bodies.get_or_insert_default();
    for hand in &hands {
        let frame = frame_from_hand(hand, 0.0, 0.0);
        for (finger, pose) in frame.tracked_fingers() {
            bodies.push(Body { id: ids.id(hand.id, finger), quality: 1.0, placement: placement_from_pose(&pose.tip) });
        }
    }
    packet.hands = Some(hands);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dtrack::HandFinger;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn printed_matrices_become_the_nearest_rotation(a in -3.0..3.0f64, b in -1.5..1.5f64, c in -3.0..3.0f64) {
            let rotation = Rot::from_euler_angles(a, b, c);
            let exact = columns_from_rotation(&rotation);
            for (decimals, bound) in [(1e4, 1e-4), (1e6, 1e-6)] {
                let printed = exact.map(|x| (x * decimals).round() / decimals);
                let angle = rotation_from_columns(&printed).angle_to(&rotation);
                prop_assert!(angle < bound, "{angle} rad off");
            }
        }
    }

    /// A stretched index finger: matrix diag(1, -1, -1) on a right hand, 1 on a left one. Its nail faces as the back of the hand does.
    #[test]
    fn a_stretched_finger_is_turned_like_the_palm() {
        for (side, diagonal) in [(Side::Right, [1.0, -1.0, -1.0]), (Side::Left, [1.0, 1.0, 1.0])] {
            let room = Pose::from_parts(Vec3::new(0.5, -0.1, 1.0).into(), Rot::from_euler_angles(0.3, -0.4, 0.5));
            let tip =
                Placement { position: [90.0, 0.0, 0.0], rotation: [diagonal[0], 0.0, 0.0, 0.0, diagonal[1], 0.0, 0.0, 0.0, diagonal[2]] };
            let finger = HandFinger { tip, tip_radius: 8.0, lengths: [24.0, 25.0, 41.0], angles: [0.0, 0.0] };
            let hand = Hand { id: 0, quality: 1.0, side, placement: placement_from_pose(&room), fingers: vec![finger; 3] };
            let frame = frame_from_hand(&hand, 1.0, 2.0);
            let (palm, index) = (frame.palm.unwrap(), frame.fingers[1].unwrap());
            assert!(palm.pose.rotation.angle_to(&index.tip.rotation) < 1e-12);
            assert!(
                (palm.pose.inverse_transform_point(&index.tip.translation.vector.into()).coords - Vec3::new(0.09, 0.0, 0.0)).norm() < 1e-12
            );
            assert_eq!((index.pad_radius, frame.fingers[3]), (0.008, None));
            assert_eq!(palm_from_dtrack(side) * palm_from_dtrack(side) * Vec3::y(), Vec3::y());
        }
    }

    #[test]
    fn midnight_does_not_turn_time_back() {
        let mut clock = TrackerClock::default();
        let mut at = |stamp: f64| clock.seconds(&Packet { time_of_day: Some(stamp), ..Packet::default() }, 0.0);
        assert_eq!([at(86_399.9), at(0.1), at(86_399.95), at(0.2)], [86_399.9, 86_400.1, 86_399.95, 86_400.2]);
        assert_eq!(clock.seconds(&Packet::default(), 7.0), 7.0, "without a stamp the arrival counts");
    }

    #[test]
    fn bodies_are_read_from_a_text_or_from_a_file_that_names_its_side() {
        assert_eq!(HandChoice::of(Side::Left, None).unwrap(), HandChoice::Fingertracking(Side::Left));
        let side = |choice| HandDecoder::new(choice).side();
        assert_eq!(side(HandChoice::of(Side::Left, Some("thumb=0,index=1")).unwrap()), Side::Left);
        let path = std::env::temp_dir().join(format!("quasirigid-bodies-{}.toml", std::process::id()));
        let text = path.to_str().unwrap();
        let missing = HandChoice::of(Side::Left, Some(text)).unwrap_err();
        assert!(matches!(missing, Error::File { .. }), "{missing}");
        std::fs::write(&path, "side = \"right\"\n[index]\nbody = 4\n").unwrap();
        let read = HandChoice::of(Side::Left, Some(text));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(side(read.unwrap()), Side::Right);
        assert!(HandChoice::of(Side::Left, Some("thumb")).is_err());
    }

    #[test]
    fn hidden_hands_and_missing_lines_are_told_apart() {
        let mut decoder = HandDecoder::new(HandChoice::Fingertracking(Side::Left));
        assert_eq!(decoder.decode(&Packet::default(), 0.0), None);
        let hidden = Packet { hands: Some(vec![]), ..Packet::default() };
        assert!(decoder.decode(&hidden, 0.0).is_some_and(|frame| !frame.is_tracked()));
        let counted = Packet { calibrated_hands: Some(1), ..Packet::default() };
        assert!(decoder.decode(&counted, 0.0).is_some_and(|frame| !frame.is_tracked()));
    }

    #[test]
    fn fingertips_as_bodies_are_the_same_fingertips() {
        let tip = Placement { position: [90.0, 5.0, -7.0], rotation: [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0] };
        let finger = HandFinger { tip, tip_radius: 8.0, lengths: [24.0, 25.0, 41.0], angles: [0.0, 0.0] };
        let lost = HandFinger { tip: Placement::UNTRACKED, ..finger };
        let room = Pose::from_parts(Vec3::new(0.5, -0.1, 1.0).into(), Rot::from_euler_angles(0.3, -0.4, 0.5));
        let hand =
            Hand { id: 0, quality: 1.0, side: Side::Right, placement: placement_from_pose(&room), fingers: vec![finger, finger, lost] };
        let mut packet = Packet { calibrated_bodies: Some(2), hands: Some(vec![hand]), ..Packet::default() };
        let wanted = HandDecoder::new(HandChoice::Fingertracking(Side::Right)).decode(&packet, 0.0).unwrap();
        let ids = FingertipIds::of([&packet]).unwrap();
        add_fingertips_as_bodies(&mut packet, &ids);
        assert_eq!(packet.calibrated_bodies, Some(7));
        assert_eq!(packet.bodies.as_ref().unwrap().iter().map(|b| b.id).collect::<Vec<_>>(), [2, 3], "the lost finger is not seen");
        let map = BodyMap::parse("thumb=2,index=3,middle=4", Side::Right).unwrap();
        let got = HandDecoder::new(HandChoice::Bodies(Box::new(map))).decode(&packet, 0.0).unwrap();
        for k in 0..2 {
            let (a, b) = (wanted.fingers[k].unwrap().tip, got.fingers[k].unwrap().tip);
            assert!((a.translation.vector - b.translation.vector).norm() < 1e-12 && a.rotation.angle_to(&b.rotation) < 1e-7);
        }
        assert!(!got.fingers[2].unwrap().tracked && got.palm.is_none());
    }

    #[test]
    fn a_fingertip_keeps_its_id_when_a_hand_or_a_body_is_not_seen() {
        let tip = Placement { position: [90.0, 5.0, -7.0], rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        let finger = HandFinger { tip, tip_radius: 8.0, lengths: [24.0, 25.0, 41.0], angles: [0.0, 0.0] };
        let hand = |id, side| Hand { id, quality: 1.0, side, placement: tip, fingers: vec![finger; 3] };
        let (left, right) = (hand(0, Side::Left), hand(1, Side::Right));
        let body = Body { id: 3, quality: 1.0, placement: tip };
        let packets = [
            Packet { bodies: Some(vec![body]), hands: Some(vec![left.clone(), right.clone()]), ..Packet::default() },
            Packet { bodies: Some(vec![]), hands: Some(vec![right]), ..Packet::default() },
            Packet::default(),
        ];
        let ids = FingertipIds::of(&packets).unwrap();
        let found = packets.map(|mut packet| {
            add_fingertips_as_bodies(&mut packet, &ids);
            assert_eq!(packet.calibrated_bodies, Some(14));
            packet.bodies.iter().flatten().map(|body| body.id).collect::<Vec<_>>()
        });
        assert_eq!(found, [vec![3, 4, 5, 6, 9, 10, 11], vec![9, 10, 11], vec![]]);
        // An old Flystick is among those that `6dcal` counts, and has no id of `6d`.
        let flystick = crate::dtrack::OldDevice { id: 0, quality: 1.0, buttons: 0, placement: tip };
        let mut packet = Packet {
            calibrated_bodies: Some(3),
            old_flysticks: Some(vec![flystick]),
            hands: Some(vec![left.clone()]),
            ..Packet::default()
        };
        let ids = FingertipIds::of([&packet]).unwrap();
        add_fingertips_as_bodies(&mut packet, &ids);
        assert_eq!((ids.id(0, Finger::Thumb), packet.standard_bodies(), packet.calibrated_bodies), (2, Some(7), Some(8)));
        let many = Packet { hands: Some(vec![Hand { id: 9999, ..left }]), ..Packet::default() };
        assert!(FingertipIds::of([&many]).unwrap_err().to_string().contains("9999"));
    }
}

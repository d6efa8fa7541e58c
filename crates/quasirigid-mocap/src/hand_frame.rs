//! One hand at one moment, whatever the tracker.
//!
//! # Frames
//!
//! Same for left and right hands, right-handed, m:
//!
//! - **tip**: origin in the centre of the sphere that models the pad, so the skin is `pad_radius` away from it. +X along the outstretched
//!   finger (from the outer joint to the tip), +Z out of the nail, +Y completes. The pad faces -Z.
//! - **palm**: origin in the knuckle (MCP joint) of the index finger. +X along the outstretched index finger, +Z out of the back of the
//!   hand,
//!   +Y completes: it points to the thumb's side on a right hand and to the little finger's side on a left one. A stretched finger has
//!   the orientation of the palm.
//!
//! All poses of a [`HandFrame`], tips included, are in the frame that its field `frame` names: the room of the tracker as it comes,
//! or the world of the simulation after [`HandFrame::transformed`].

use crate::Pose;
use serde::{Deserialize, Serialize};

/// Which hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Side {
    /// The left hand.
    Left,
    /// The right hand.
    Right,
}

impl Side {
    /// "left" or "right".
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Which finger; `finger as usize` is its index in [`HandFrame::fingers`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Finger {
    /// Index 0.
    Thumb,
    /// Index 1.
    Index,
    /// Index 2.
    Middle,
    /// Index 3.
    Ring,
    /// Index 4.
    Little,
}

impl Finger {
    /// All five, thumb first: the order of DTrack and of [`HandFrame::fingers`].
    pub const ALL: [Self; 5] = [Self::Thumb, Self::Index, Self::Middle, Self::Ring, Self::Little];

    /// "thumb", "index", "middle", "ring" or "little".
    pub fn name(self) -> &'static str {
        ["thumb", "index", "middle", "ring", "little"][self as usize]
    }

    /// The finger of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|finger| finger.name() == name)
    }
}

/// Where the poses are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ReferenceFrame {
    /// The room frame of the tracker.
    Tracker,
    /// The world of the simulation: a calibration was applied.
    World,
}

/// Where a frame came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// A hand of DTrack's line `gl`.
    DtrackHand,
    /// Bodies of DTrack's line `6d` that are fixed to the fingers.
    DtrackBodies,
    /// Hand joints of a WebXR device.
    WebXr,
    /// Made by a program.
    Synthetic,
}

impl Source {
    /// A short name: "dtrack-hand", "dtrack-bodies", "webxr" or "synthetic".
    pub fn name(self) -> &'static str {
        match self {
            Self::DtrackHand => "dtrack-hand",
            Self::DtrackBodies => "dtrack-bodies",
            Self::WebXr => "webxr",
            Self::Synthetic => "synthetic",
        }
    }
}

/// The palm, if the source knows of one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PalmPose {
    /// The palm frame (see the module page). Means nothing while not tracked.
    pub pose: Pose,
    /// Whether it was seen in this frame.
    pub tracked: bool,
}

/// One fingertip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FingerPose {
    /// The tip frame (see the module page). Means nothing while not tracked.
    pub tip: Pose,
    /// Radius of the sphere that models the pad, m: skin is this far from the origin of `tip`.
    pub pad_radius: f64,
    /// Whether it was seen in this frame.
    pub tracked: bool,
}

/// A hand at one moment: plain data, nothing on the heap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HandFrame {
    /// Left or right.
    pub side: Side,
    /// The palm. None if the source has none (bodies on the fingers alone).
    pub palm: Option<PalmPose>,
    /// Fingers by [`Finger`]. None if the source does not have this finger (a set of three thimbles, say).
    pub fingers: [Option<FingerPose>; 5],
    /// When it was measured, s on the tracker's clock. Its zero is the tracker's own business; differences count.
    pub time: f64,
    /// When it arrived, s on the clock of the receiver or of the take.
    pub arrival: f64,
    /// Where it came from.
    pub source: Source,
    /// The frame of all poses.
    pub frame: ReferenceFrame,
}

impl HandFrame {
    /// A hand of which nothing is seen.
    pub fn unseen(side: Side, time: f64, arrival: f64, source: Source) -> Self {
        Self { side, palm: None, fingers: [None; 5], time, arrival, source, frame: ReferenceFrame::Tracker }
    }

    /// The fingers that are seen now.
    pub fn tracked_fingers(&self) -> impl Iterator<Item = (Finger, &FingerPose)> {
        Finger::ALL.into_iter().filter_map(|finger| Some((finger, self.fingers[finger as usize].as_ref().filter(|pose| pose.tracked)?)))
    }

    /// Whether anything of the hand is seen.
    pub fn is_tracked(&self) -> bool {
        self.palm.is_some_and(|palm| palm.tracked) || self.tracked_fingers().next().is_some()
    }

    /// The same hand seen from the world: every pose becomes `world_from_tracker * pose`.
    pub fn transformed(mut self, world_from_tracker: &Pose) -> Self {
        if let Some(palm) = &mut self.palm {
            palm.pose = world_from_tracker * palm.pose;
        }
        for finger in self.fingers.iter_mut().flatten() {
            finger.tip = world_from_tracker * finger.tip;
        }
        self.frame = ReferenceFrame::World;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rot, Vec3};

    #[test]
    fn names_lead_back_to_fingers() {
        for (k, finger) in Finger::ALL.into_iter().enumerate() {
            assert_eq!(finger as usize, k);
            assert_eq!(Finger::from_name(finger.name()), Some(finger));
        }
        assert_eq!(Finger::from_name("sixth"), None);
    }

    #[test]
    fn a_transform_moves_palm_and_tips_as_one_body() {
        let mut hand = HandFrame::unseen(Side::Right, 1.0, 2.0, Source::Synthetic);
        assert!(!hand.is_tracked());
        let tip = Pose::from_parts(Vec3::new(0.1, 0.2, 0.3).into(), Rot::from_euler_angles(0.1, 0.2, 0.3));
        hand.fingers[1] = Some(FingerPose { tip, pad_radius: 0.008, tracked: true });
        hand.palm = Some(PalmPose { pose: Pose::identity(), tracked: false });
        assert_eq!(hand.tracked_fingers().map(|(finger, _)| finger).collect::<Vec<_>>(), [Finger::Index]);
        let calibration = Pose::from_parts(Vec3::new(1.0, 0.0, 0.0).into(), Rot::from_euler_angles(0.0, 0.0, 1.0));
        let moved = hand.transformed(&calibration);
        let relative = moved.palm.unwrap().pose.inverse() * moved.fingers[1].unwrap().tip;
        assert!((relative.to_homogeneous() - tip.to_homogeneous()).norm() < 1e-15);
        assert_eq!(moved.frame, ReferenceFrame::World);
    }
}

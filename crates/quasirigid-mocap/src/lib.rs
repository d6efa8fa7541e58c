//! Motion capture input: packets of a tracker in, poses of hands out. Knows nothing of the engine.
//!
//! Whatever the source (DTrack fingertracking, DTrack bodies fixed to the fingers, a recorded take, WebXR), what comes out is a
//! [`HandFrame`]: the palm and up to five fingertips, in metres.
//!
//! Units are SI: m, s, rad. DTrack's millimetres and degrees stay in [`dtrack`], which mirrors the wire.
//! Source of everything about DTrack: ART's published format, as the page `docs/mocap.md` of the repository sums it up.

pub mod body_map;
pub mod calibration;
pub mod dtrack;
pub mod endpoint;
pub mod error;
pub mod hand_frame;
pub mod hands;
mod own_thread;
pub mod receiver;
pub mod replay;
pub mod statistics;
pub mod synthetic;
pub mod take;
pub mod take_writer;
pub mod tracking;

pub use body_map::BodyMap;
pub use calibration::Calibration;
pub use endpoint::Endpoint;
pub use error::{Error, Result};
pub use hand_frame::{Finger, FingerPose, HandFrame, PalmPose, ReferenceFrame, Side, Source};
pub use hands::{HandChoice, HandDecoder};
pub use receiver::{Received, Receiver, ReceiverOptions};
pub use replay::{Replay, ReplayOptions, ReplayState};
pub use statistics::{Order, Statistics};
pub use take::{Take, TakePacket};
pub use take_writer::TakeWriter;
pub use tracking::{Delay, Dropped, HandTargets, HandTracker, Target, TargetState, TrackingOptions};

/// A pose; `pose12` is "2 in the frame of 1".
pub type Pose = nalgebra::Isometry3<f64>;
/// A point or vector, m unless its name says otherwise.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A rotation.
pub type Rot = nalgebra::UnitQuaternion<f64>;

//! What one datagram holds: a struct per kind of line, fields in the order of the wire. mm, degrees.

/// Nine numbers of a rotation matrix, column after column: the first three are the body's x axis in the outer frame.
pub type Columns = [f64; 9];

/// Where a target is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Position in the outer frame, mm.
    pub position: [f64; 3],
    /// Rotation from the target's frame to the outer frame. All zeros if not tracked.
    pub rotation: Columns,
}

impl Placement {
    /// What stands in the place of a target that is not tracked.
    pub const UNTRACKED: Self = Self { position: [0.0; 3], rotation: [0.0; 9] };
}

/// A body of `6d`, or a reference body of `6dmtr`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// From 0 on the wire; the controller's own screens count from 1.
    pub id: u32,
    /// 1 tracked, negative not tracked.
    pub quality: f64,
    /// In room coordinates.
    pub placement: Placement,
}

impl Body {
    /// Whether it is seen in this frame.
    pub fn is_tracked(&self) -> bool {
        self.quality >= 0.0
    }
}

/// Covariance of a body's pose, from `6dcov`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyCovariance {
    /// The body.
    pub id: u32,
    /// Point that the translation refers to, mm.
    pub reference: [f64; 3],
    /// Upper triangle of the 6x6 matrix, row by row; mm and rad.
    pub upper: [f64; 21],
}

/// A hybrid body (optical and inertial) of `6di`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HybridBody {
    /// From 0.
    pub id: u32,
    /// 0 lost, 1 inertial, 2 optical, 3 both.
    pub state: u32,
    /// Estimated drift, degrees.
    pub drift: f64,
    /// In room coordinates.
    pub placement: Placement,
}

/// A Flystick of `6df`, or a measurement tool of `6dmt`: the old lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OldDevice {
    /// From 0.
    pub id: u32,
    /// 1 tracked, negative not tracked.
    pub quality: f64,
    /// Bit field.
    pub buttons: u32,
    /// In room coordinates.
    pub placement: Placement,
}

/// A Flystick of `6df2`.
#[derive(Debug, Clone, PartialEq)]
pub struct Flystick {
    /// From 0.
    pub id: u32,
    /// 1 tracked, negative not tracked.
    pub quality: f64,
    /// In room coordinates.
    pub placement: Placement,
    /// How many buttons it has.
    pub button_count: u32,
    /// Bits of the buttons, 32 to a word, bit 0 first.
    pub buttons: Vec<u32>,
    /// Values of the joystick's axes, -1 to 1.
    pub joystick: Vec<f64>,
}

/// A measurement tool of `6dmt2`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tool {
    /// From 0.
    pub id: u32,
    /// 1 tracked, negative not tracked.
    pub quality: f64,
    /// Radius of the tip's sphere, mm.
    pub tip_radius: f64,
    /// In room coordinates.
    pub placement: Placement,
    /// How many buttons it has.
    pub button_count: u32,
    /// Bits of the buttons, 32 to a word, bit 0 first.
    pub buttons: Vec<u32>,
    /// Covariance of the position: s11 s12 s13 s22 s23 s33, mm^2.
    pub covariance: [f64; 6],
}

/// A loose marker of `3d`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marker {
    /// From 1.
    pub id: u32,
    /// Always 1.
    pub quality: f64,
    /// Room coordinates, mm.
    pub position: [f64; 3],
}

/// A hand of `gl`.
#[derive(Debug, Clone, PartialEq)]
pub struct Hand {
    /// From 0.
    pub id: u32,
    /// Always 1: a hidden hand is not in the line.
    pub quality: f64,
    /// Left (0 on the wire) or right (1).
    pub side: crate::Side,
    /// Origin in the knuckle of the index, +X along the stretched index, +Y to the little finger's side; room coordinates.
    /// +Z leaves the palm of a right hand and the back of a left one.
    pub placement: Placement,
    /// Thumb, index, middle, ring, little: 3 or 5 of them, at most 5.
    pub fingers: Vec<HandFinger>,
}

/// A finger of a hand of `gl`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandFinger {
    /// Centre of the sphere that models the pad, and the outer phalanx (+X along the finger, +Z out of the nail), in the frame of the HAND.
    pub tip: Placement,
    /// Radius of that sphere, mm.
    pub tip_radius: f64,
    /// Lengths of outer, middle and inner phalanx, mm.
    pub lengths: [f64; 3],
    /// Angles outer to middle and middle to inner phalanx, degrees; flexion is negative.
    pub angles: [f64; 2],
}

impl HandFinger {
    /// Whether it is seen. The line has no quality of its own for fingers; a matrix of zeros means "not tracked" everywhere in the format.
    pub fn is_tracked(&self) -> bool {
        self.tip.rotation != [0.0; 9]
    }
}

/// A person of `6dj` (ART-Human).
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// From 0.
    pub id: u32,
    /// At most 200.
    pub joints: Vec<Joint>,
}

/// A joint of a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// From 0.
    pub id: u32,
    /// 1 tracked, negative not tracked.
    pub quality: f64,
    /// In room coordinates.
    pub placement: Placement,
    /// Three angles that nobody should use any more, degrees; 0 if missing.
    pub angles: [f64; 3],
}

/// Targets that are listed, and how many are calibrated.
#[derive(Debug, Clone, PartialEq)]
pub struct Listed<T> {
    /// How many the controller knows.
    pub calibrated: u32,
    /// Those that follow in the line.
    pub items: Vec<T>,
}

/// State of the system, from `st`. Groups that are not sent are None or empty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Status {
    /// Cameras, tracked bodies, tracked markers.
    pub general: Option<[u32; 3]>,
    /// Camera errors, camera warnings, other errors, other warnings, information messages.
    pub messages: Option<[u32; 5]>,
    /// One entry for each camera. None if the group is missing.
    pub cameras: Option<Vec<CameraStatus>>,
}

/// State of one camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraStatus {
    /// From 0.
    pub id: u32,
    /// Reflections seen.
    pub reflections: u32,
    /// Reflections that were of use.
    pub used: u32,
    /// Brightest pixel, 0 to 10.
    pub max_intensity: u32,
}

/// Time stamp of DTRACK3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnixTime {
    /// Since 1970-01-01 00:00 UTC, s.
    pub seconds: u64,
    /// And this many microseconds, below 1,000,000.
    pub microseconds: u32,
    /// From the flash of the cameras to the sending of this frame, microseconds.
    pub latency: u32,
}

/// One datagram: one frame of the tracker. A line that was not sent is None.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Packet {
    /// `fr`: frame counter.
    pub frame: u32,
    /// `ts`: seconds since midnight UTC; falls back to 0 at midnight.
    pub time_of_day: Option<f64>,
    /// `ts2`.
    pub unix_time: Option<UnixTime>,
    /// `st`.
    pub status: Option<Status>,
    /// `6dcal`: calibrated bodies, those of the old `6df` and `6dmt` included.
    pub calibrated_bodies: Option<u32>,
    /// `6d`: bodies seen now.
    pub bodies: Option<Vec<Body>>,
    /// `6dcov`.
    pub covariances: Option<Vec<BodyCovariance>>,
    /// `6di`.
    pub hybrid_bodies: Option<Vec<HybridBody>>,
    /// `6df`.
    pub old_flysticks: Option<Vec<OldDevice>>,
    /// `6df2`.
    pub flysticks: Option<Listed<Flystick>>,
    /// `6dmt`.
    pub old_tools: Option<Vec<OldDevice>>,
    /// `6dmt2`.
    pub tools: Option<Listed<Tool>>,
    /// `6dmtr`.
    pub tool_references: Option<Listed<Body>>,
    /// `3d`.
    pub markers: Option<Vec<Marker>>,
    /// `glcal`: calibrated hands.
    pub calibrated_hands: Option<u32>,
    /// `gl`: hands seen now.
    pub hands: Option<Vec<Hand>>,
    /// `6dj`.
    pub people: Option<Listed<Person>>,
    /// Lines with an identifier that is not in this list; they were skipped.
    pub unknown_lines: u32,
}

impl Packet {
    /// Seconds on the tracker's clock: of `ts2` if it is there, else of `ts`.
    pub fn time(&self) -> Option<f64> {
        self.unix_time.map(|t| t.seconds as f64 + 1e-6 * f64::from(t.microseconds)).or(self.time_of_day)
    }

    /// How many standard bodies are calibrated: `6dcal` counts old Flysticks and tools as well.
    pub fn standard_bodies(&self) -> Option<u32> {
        Some(self.calibrated_bodies?.saturating_sub(self.old_devices()))
    }

    /// How many targets of the old lines `6df` and `6dmt` are among those that `6dcal` counts.
    pub fn old_devices(&self) -> u32 {
        let old = self.old_flysticks.as_ref().map_or(0, Vec::len) + self.old_tools.as_ref().map_or(0, Vec::len);
        old as u32
    }
}

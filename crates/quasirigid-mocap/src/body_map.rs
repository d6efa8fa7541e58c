//! Which DTrack body is fixed to which finger, and where on it the fingertip is. From a short text or from a TOML file.

use crate::calibration::quaternion;
use crate::error::{Error, Result, check_within};
use crate::{Finger, Pose, Side};
use serde::Deserialize;

/// Radius of a pad where none is given, m.
pub const DEFAULT_PAD_RADIUS: f64 = 0.008;

/// A body and what it stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MappedBody {
    /// Id on the wire, from 0.
    pub body: u32,
    /// Tip frame (or palm frame) in the frame of the body, see [`crate::hand_frame`]; m.
    pub offset: Pose,
    /// Radius of the pad, m; means nothing for the palm.
    pub pad_radius: f64,
}

/// Bodies of one hand.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMap {
    /// Left or right.
    pub side: Side,
    /// The body on the back of the hand, if there is one.
    pub palm: Option<MappedBody>,
    /// Bodies on the fingers, by [`Finger`].
    pub fingers: [Option<MappedBody>; 5],
}

const EXAMPLE: &str = "write for instance thumb=0,index=1,middle=2,palm=3";

impl BodyMap {
    /// From a text such as `thumb=0,index=1,middle=2,palm=3`, with the body's frame in the place of the tip's.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for anything else, for a body that is used twice and where no finger is named.
    pub fn parse(text: &str, side: Side) -> Result<Self> {
        let mut map = Self { side, palm: None, fingers: [None; 5] };
        for part in text.split(',') {
            let refuse = || Error::value("bodies", "FINGER=ID, apart by commas", format!("{part:?}"), EXAMPLE);
            let (name, id) = part.split_once('=').ok_or_else(refuse)?;
            let body = id.trim().parse().map_err(|_| refuse())?;
            map.put(name.trim(), MappedBody { body, offset: Pose::identity(), pad_radius: DEFAULT_PAD_RADIUS })?;
        }
        map.checked()
    }

    /// From TOML: `side = "right"`, and a table for each finger (and `palm`) with `body`, and if wanted `position` (m) and `quaternion` (w,
    /// x, y, z) of the tip frame in the body's frame, and `pad_radius` (m).
    ///
    /// # Errors
    /// [`Error::InvalidValue`] with what is wrong.
    pub fn from_toml(text: &str) -> Result<Self> {
        let refuse = |error: toml::de::Error| {
            Error::value("bodies", "a TOML table of fingers", error.message(), "a line [index], below it body = 1, and so on")
        };
        let file: File = toml::from_str(text).map_err(refuse)?;
        let side = match file.side.as_str() {
            "left" => Side::Left,
            "right" => Side::Right,
            other => return Err(Error::value("side", "left or right", format!("{other:?}"), "name the hand that wears the bodies")),
        };
        let mut map = Self { side, palm: None, fingers: [None; 5] };
        let entries = [file.thumb, file.index, file.middle, file.ring, file.little, file.palm];
        for (name, entry) in ["thumb", "index", "middle", "ring", "little", "palm"].into_iter().zip(entries) {
            let Some(entry) = entry else { continue };
            for x in entry.position {
                check_within("position", x, -1.0, 1.0, "m")?;
            }
            check_within("pad_radius", entry.pad_radius, 1e-4, 0.1, "m")?;
            let offset = Pose::from_parts(nalgebra::Vector3::from(entry.position).into(), quaternion(entry.quaternion)?);
            map.put(name, MappedBody { body: entry.body, offset, pad_radius: entry.pad_radius })?;
        }
        map.checked()
    }

    fn put(&mut self, name: &str, mapped: MappedBody) -> Result<()> {
        let slot = match (name, Finger::from_name(name)) {
            ("palm", _) => &mut self.palm,
            (_, Some(finger)) => &mut self.fingers[finger as usize],
            _ => return Err(Error::value("bodies", "thumb, index, middle, ring, little or palm", format!("{name:?}"), EXAMPLE)),
        };
        match slot.replace(mapped) {
            None => Ok(()),
            Some(before) => {
                Err(Error::value("bodies", "one body for each finger", format!("{name}={} and {}", before.body, mapped.body), EXAMPLE))
            }
        }
    }

    fn checked(self) -> Result<Self> {
        let mut ids: Vec<u32> = self.fingers.iter().chain([&self.palm]).flatten().map(|mapped| mapped.body).collect();
        if self.fingers.iter().all(Option::is_none) {
            return Err(Error::value("bodies", "at least one finger", "none", EXAMPLE));
        }
        ids.sort_unstable();
        match ids.windows(2).find(|pair| pair[0] == pair[1]) {
            None => Ok(self),
            Some(pair) => Err(Error::value("bodies", "every body on one finger only", format!("body {} twice", pair[0]), EXAMPLE)),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    side: String,
    thumb: Option<Entry>,
    index: Option<Entry>,
    middle: Option<Entry>,
    ring: Option<Entry>,
    little: Option<Entry>,
    palm: Option<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    body: u32,
    #[serde(default)]
    position: [f64; 3],
    #[serde(default = "no_turn")]
    quaternion: [f64; 4],
    #[serde(default = "default_pad_radius")]
    pad_radius: f64,
}

fn no_turn() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

fn default_pad_radius() -> f64 {
    DEFAULT_PAD_RADIUS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_text_and_file_say_the_same() {
        let short = BodyMap::parse("thumb=0, index=1,palm=3", Side::Right).unwrap();
        let file =
            BodyMap::from_toml("side = \"right\"\n[thumb]\nbody = 0\n[index]\nbody = 1\npad_radius = 0.008\n[palm]\nbody = 3\n").unwrap();
        assert_eq!(short, file);
        let file =
            BodyMap::from_toml("side = \"left\"\n[ring]\nbody = 7\nposition = [0.0, 0.0, -0.012]\nquaternion = [2.0, 0.0, 0.0, 0.0]\n")
                .unwrap();
        assert_eq!(file.fingers[3].unwrap().offset, Pose::translation(0.0, 0.0, -0.012));
    }

    #[test]
    fn mistakes_are_named() {
        for text in ["", "thumb", "thumb=x", "toe=1", "thumb=1,thumb=2", "thumb=1,index=1", "palm=1", "thumb=-1"] {
            let error = BodyMap::parse(text, Side::Left).unwrap_err().to_string();
            assert!(error.starts_with("bodies: expected"), "{text}: {error}");
        }
        for text in ["", "side = \"both\"", "side = \"left\"\n[thumb]\nid = 1", "side = \"left\"\n[thumb]\nbody = 1\npad_radius = nan"] {
            assert!(BodyMap::from_toml(text).is_err(), "{text}");
        }
    }
}

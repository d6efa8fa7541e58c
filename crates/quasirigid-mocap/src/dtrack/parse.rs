//! From bytes to a [`Packet`]: one function per kind of line.
//!
//! Announced counts never size anything: records are pushed one by one as they are found, so a packet costs no more memory than its own
//! length warrants.

use super::packet::*;
use super::text::{Cursor, PacketError, PacketErrorKind, Parsed, lines};
use crate::Side;

/// Counts and ids beyond this are refused; a controller has far less.
const MOST_TARGETS: u32 = 9_999;
/// Fingers of a hand.
const MOST_FINGERS: u32 = 5;
/// Radius of a fingertip's sphere, mm: more is no finger.
const LARGEST_TIP: f64 = 100.0;
/// Joints of a person.
const MOST_JOINTS: u32 = 200;
/// Buttons and axes of a device; the vendor's own limits are 16 and 8.
const MOST_BUTTONS: u32 = 256;

impl Packet {
    /// Reads the text of one datagram.
    ///
    /// # Errors
    /// [`PacketError`] with the line and the reason. Nothing of a refused packet is to be used.
    pub fn parse(data: &[u8]) -> Result<Self, PacketError> {
        if data.len() > super::MAX_DATAGRAM {
            return Err(PacketError { line: 0, kind: PacketErrorKind::TooLong });
        }
        let mut packet = Self::default();
        let mut counted = false;
        for (line, text) in lines(data) {
            let mut cursor = Cursor::new(text);
            let id = cursor.word();
            counted |= id == b"fr";
            packet.read_line(id, cursor).map_err(|kind| PacketError { line, kind })?;
        }
        if counted { Ok(packet) } else { Err(PacketError { line: 0, kind: PacketErrorKind::NoFrameCounter }) }
    }

    fn read_line(&mut self, id: &[u8], mut line: Cursor<'_>) -> Parsed<()> {
        match id {
            b"fr" => self.frame = line.count(u32::MAX)?,
            b"ts" => self.time_of_day = Some(time_of_day(&mut line)?),
            b"ts2" => self.unix_time = Some(unix_time(&mut line)?),
            b"st" => self.status = Some(status(&mut line)?),
            b"6dcal" => self.calibrated_bodies = Some(line.count(MOST_TARGETS)?),
            b"6d" => self.bodies = Some(list(&mut line, body)?),
            b"6dcov" => self.covariances = Some(list(&mut line, covariance)?),
            b"6di" => self.hybrid_bodies = Some(list(&mut line, hybrid_body)?),
            b"6df" => self.old_flysticks = Some(list(&mut line, old_device)?),
            b"6df2" => self.flysticks = Some(listed(&mut line, flystick)?),
            b"6dmt" => self.old_tools = Some(list(&mut line, old_device)?),
            b"6dmt2" => self.tools = Some(listed(&mut line, tool)?),
            b"6dmtr" => self.tool_references = Some(listed(&mut line, body)?),
            b"3d" => self.markers = Some(list(&mut line, marker)?),
            b"glcal" => self.calibrated_hands = Some(line.count(MOST_TARGETS)?),
            b"gl" => self.hands = Some(list(&mut line, hand)?),
            b"6dj" => self.people = Some(listed(&mut line, person)?),
            _ => self.unknown_lines += 1,
        }
        Ok(())
    }
}

/// `n` and then n records. Surplus records are left alone.
fn list<T>(line: &mut Cursor<'_>, record: impl Fn(&mut Cursor<'_>) -> Parsed<T>) -> Parsed<Vec<T>> {
    let count = line.count(MOST_TARGETS)?;
    let mut items = Vec::new();
    for _ in 0..count {
        items.push(record(line)?);
    }
    Ok(items)
}

/// `N n` and then n records.
fn listed<T>(line: &mut Cursor<'_>, record: impl Fn(&mut Cursor<'_>) -> Parsed<T>) -> Parsed<Listed<T>> {
    let calibrated = line.count(MOST_TARGETS)?;
    Ok(Listed { calibrated, items: list(line, record)? })
}

fn time_of_day(line: &mut Cursor<'_>) -> Parsed<f64> {
    let seconds = line.number_within(1e6)?;
    if seconds >= 0.0 { Ok(seconds) } else { Err(PacketErrorKind::OutOfRange) }
}

fn unix_time(line: &mut Cursor<'_>) -> Parsed<UnixTime> {
    // Beyond 2^33 s (the year 2242) a double cannot hold microseconds any more.
    let seconds = line.whole(1 << 33)?;
    Ok(UnixTime { seconds, microseconds: line.count(999_999)?, latency: line.count(u32::MAX)? })
}

fn body(line: &mut Cursor<'_>) -> Parsed<Body> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    Ok(Body { id, quality, placement: line.placement(quality >= 0.0)? })
}

fn covariance(line: &mut Cursor<'_>) -> Parsed<BodyCovariance> {
    let mut head = line.block()?;
    let (id, reference) = (head.count(MOST_TARGETS)?, head.position()?);
    Ok(BodyCovariance { id, reference, upper: line.block()?.numbers()? })
}

fn hybrid_body(line: &mut Cursor<'_>) -> Parsed<HybridBody> {
    let mut head = line.block()?;
    let (id, state, drift) = (head.count(MOST_TARGETS)?, head.count(3)?, head.number()?);
    Ok(HybridBody { id, state, drift, placement: line.placement(state > 0)? })
}

fn old_device(line: &mut Cursor<'_>) -> Parsed<OldDevice> {
    let mut head = line.block()?;
    let (id, quality, buttons) = (head.count(MOST_TARGETS)?, head.number()?, head.bits()?);
    Ok(OldDevice { id, quality, buttons, placement: line.placement(quality >= 0.0)? })
}

/// One word for 32 buttons.
fn button_words(block: &mut Cursor<'_>, buttons: u32) -> Parsed<Vec<u32>> {
    (0..buttons.div_ceil(32)).map(|_| block.bits()).collect()
}

fn flystick(line: &mut Cursor<'_>) -> Parsed<Flystick> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    let (button_count, axes) = (head.count(MOST_BUTTONS)?, head.count(MOST_BUTTONS)?);
    let placement = line.placement(quality >= 0.0)?;
    let mut controls = line.block()?;
    let buttons = button_words(&mut controls, button_count)?;
    let joystick = (0..axes).map(|_| controls.number()).collect::<Parsed<_>>()?;
    Ok(Flystick { id, quality, placement, button_count, buttons, joystick })
}

fn tool(line: &mut Cursor<'_>) -> Parsed<Tool> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    let (button_count, tip_radius) = (head.count(MOST_BUTTONS)?, head.number()?);
    let placement = line.placement(quality >= 0.0)?;
    let buttons = button_words(&mut line.block()?, button_count)?;
    Ok(Tool { id, quality, tip_radius, placement, button_count, buttons, covariance: line.block()?.numbers()? })
}

fn marker(line: &mut Cursor<'_>) -> Parsed<Marker> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    Ok(Marker { id, quality, position: line.block()?.position()? })
}

fn hand(line: &mut Cursor<'_>) -> Parsed<Hand> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    let side = if head.count(1)? == 0 { Side::Left } else { Side::Right };
    let count = head.count(MOST_FINGERS)?;
    let placement = line.placement(quality >= 0.0)?;
    let fingers = (0..count).map(|_| finger(line)).collect::<Parsed<_>>()?;
    Ok(Hand { id, quality, side, placement, fingers })
}

fn finger(line: &mut Cursor<'_>) -> Parsed<HandFinger> {
    let position = line.block()?.position()?;
    let rotation = line.rotation_or_zeros()?;
    let [tip_radius, outer, outer_middle, middle, middle_inner, inner] = line.block()?.numbers()?;
    if !(0.0..=LARGEST_TIP).contains(&tip_radius) {
        return Err(PacketErrorKind::OutOfRange);
    }
    let tip = Placement { position, rotation };
    Ok(HandFinger { tip, tip_radius, lengths: [outer, middle, inner], angles: [outer_middle, middle_inner] })
}

fn person(line: &mut Cursor<'_>) -> Parsed<Person> {
    let mut head = line.block()?;
    let (id, count) = (head.count(MOST_TARGETS)?, head.count(MOST_JOINTS)?);
    let joints = (0..count).map(|_| joint(line)).collect::<Parsed<_>>()?;
    Ok(Person { id, joints })
}

fn joint(line: &mut Cursor<'_>) -> Parsed<Joint> {
    let mut head = line.block()?;
    let (id, quality) = (head.count(MOST_TARGETS)?, head.number()?);
    let mut place = line.block()?;
    let position = place.position()?;
    let angles = if place.is_empty() { [0.0; 3] } else { place.numbers()? };
    Ok(Joint { id, quality, placement: Placement { position, rotation: line.rotation(quality >= 0.0)? }, angles })
}

/// Groups come in this order and each may be missing; what is behind the third is from the future.
fn status(line: &mut Cursor<'_>) -> Parsed<Status> {
    let groups = line.count(MOST_TARGETS)?;
    let mut status = Status::default();
    for _ in 0..groups {
        let mut head = line.block()?;
        match head.count(MOST_TARGETS)? {
            0 => status.general = Some(counts(&mut line.block()?)?),
            1 => status.messages = Some(counts(&mut line.block()?)?),
            2 => {
                let cameras = head.count(MOST_TARGETS)?;
                status.cameras = Some((0..cameras).map(|_| camera(line)).collect::<Parsed<_>>()?);
            }
            _ => break,
        }
    }
    Ok(status)
}

fn counts<const N: usize>(block: &mut Cursor<'_>) -> Parsed<[u32; N]> {
    let mut counts = [0; N];
    for count in &mut counts {
        *count = block.count(u32::MAX)?;
    }
    Ok(counts)
}

fn camera(line: &mut Cursor<'_>) -> Parsed<CameraStatus> {
    let [id, reflections, used, max_intensity] = counts(&mut line.block()?)?;
    Ok(CameraStatus { id, reflections, used, max_intensity })
}

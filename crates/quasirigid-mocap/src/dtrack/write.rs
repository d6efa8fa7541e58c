//! From a [`Packet`] to the bytes that a controller would send: order of lines, digits, CR LF.
//!
//! Digits as met in genuine data: positions 3 decimals, rotations 6, quality 3; inside `gl` tips 1, finger rotations 4, radius, lengths and
//! angles 1. No genuine `6dcov`, `6di`, `6dj` or joystick was at hand: their digits are our choice (covariances with an exponent, 3
//! decimals elsewhere).

use super::packet::*;
use crate::Side;
use std::fmt::Write;

impl Packet {
    /// The datagram. Lines that are None are left out; `unknown_lines` cannot be written again.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut text = String::with_capacity(2048);
        // Writing to a string cannot fail.
        let _ = self.write_to(&mut text);
        text.into_bytes()
    }

    fn write_to(&self, out: &mut String) -> std::fmt::Result {
        write!(out, "fr {}\r\n", self.frame)?;
        if let Some(seconds) = self.time_of_day {
            write!(out, "ts {seconds:.6}\r\n")?;
        }
        if let Some(t) = self.unix_time {
            write!(out, "ts2 {} {} {}\r\n", t.seconds, t.microseconds, t.latency)?;
        }
        if let Some(calibrated) = self.calibrated_bodies {
            write!(out, "6dcal {calibrated}\r\n")?;
        }
        list(out, "6d", &self.bodies, body)?;
        list(out, "6dcov", &self.covariances, covariance)?;
        list(out, "6di", &self.hybrid_bodies, hybrid_body)?;
        list(out, "6df", &self.old_flysticks, old_device)?;
        listed(out, "6df2", &self.flysticks, flystick)?;
        list(out, "6dmt", &self.old_tools, old_device)?;
        listed(out, "6dmt2", &self.tools, tool)?;
        listed(out, "6dmtr", &self.tool_references, body)?;
        list(out, "3d", &self.markers, marker)?;
        if let Some(calibrated) = self.calibrated_hands {
            write!(out, "glcal {calibrated}\r\n")?;
        }
        if self.hands.as_ref().is_some_and(Vec::is_empty) {
            out.push_str("gl 0 \r\n"); // the one line that ends with a blank in genuine data
        } else {
            list(out, "gl", &self.hands, hand)?;
        }
        listed(out, "6dj", &self.people, person)?;
        self.status.as_ref().map_or(Ok(()), |s| status(out, s))
    }
}

type Record<T> = fn(&mut String, &T) -> std::fmt::Result;

fn list<T>(out: &mut String, id: &str, items: &Option<Vec<T>>, record: Record<T>) -> std::fmt::Result {
    let Some(items) = items else { return Ok(()) };
    write!(out, "{id} {}", items.len())?;
    records(out, items, record)
}

fn listed<T>(out: &mut String, id: &str, listed: &Option<Listed<T>>, record: Record<T>) -> std::fmt::Result {
    let Some(Listed { calibrated, items }) = listed else { return Ok(()) };
    write!(out, "{id} {calibrated} {}", items.len())?;
    records(out, items, record)
}

/// A blank before each record, the blocks of one record together.
fn records<T>(out: &mut String, items: &[T], record: Record<T>) -> std::fmt::Result {
    for item in items {
        out.push(' ');
        record(out, item)?;
    }
    out.push_str("\r\n");
    Ok(())
}

/// A block of numbers with so many decimals.
fn block(out: &mut String, numbers: &[f64], decimals: usize) -> std::fmt::Result {
    out.push('[');
    for (k, number) in numbers.iter().enumerate() {
        let blank = if k > 0 { " " } else { "" };
        write!(out, "{blank}{number:.decimals$}")?;
    }
    out.push(']');
    Ok(())
}

fn placement(out: &mut String, at: &Placement) -> std::fmt::Result {
    block(out, &at.position, 3)?;
    block(out, &at.rotation, 6)
}

fn body(out: &mut String, b: &Body) -> std::fmt::Result {
    write!(out, "[{} {:.3}]", b.id, b.quality)?;
    placement(out, &b.placement)
}

fn covariance(out: &mut String, c: &BodyCovariance) -> std::fmt::Result {
    let [x, y, z] = c.reference;
    write!(out, "[{} {x:.3} {y:.3} {z:.3}][", c.id)?;
    for (k, entry) in c.upper.iter().enumerate() {
        let blank = if k > 0 { " " } else { "" };
        write!(out, "{blank}{entry:.6e}")?;
    }
    out.push(']');
    Ok(())
}

fn hybrid_body(out: &mut String, b: &HybridBody) -> std::fmt::Result {
    write!(out, "[{} {} {:.3}]", b.id, b.state, b.drift)?;
    placement(out, &b.placement)
}

fn old_device(out: &mut String, d: &OldDevice) -> std::fmt::Result {
    write!(out, "[{} {:.3} {}]", d.id, d.quality, d.buttons)?;
    placement(out, &d.placement)
}

/// Words of buttons, apart by blanks.
fn button_words(out: &mut String, words: &[u32]) -> std::fmt::Result {
    for (k, word) in words.iter().enumerate() {
        let blank = if k > 0 { " " } else { "" };
        write!(out, "{blank}{word}")?;
    }
    Ok(())
}

fn flystick(out: &mut String, f: &Flystick) -> std::fmt::Result {
    write!(out, "[{} {:.3} {} {}]", f.id, f.quality, f.button_count, f.joystick.len())?;
    placement(out, &f.placement)?;
    out.push('[');
    button_words(out, &f.buttons)?;
    for (k, value) in f.joystick.iter().enumerate() {
        let blank = if k > 0 || !f.buttons.is_empty() { " " } else { "" };
        write!(out, "{blank}{value:.3}")?;
    }
    out.push(']');
    Ok(())
}

fn tool(out: &mut String, t: &Tool) -> std::fmt::Result {
    write!(out, "[{} {:.3} {} {:.3}]", t.id, t.quality, t.button_count, t.tip_radius)?;
    placement(out, &t.placement)?;
    out.push('[');
    button_words(out, &t.buttons)?;
    out.push(']');
    block(out, &t.covariance, 6)
}

fn marker(out: &mut String, m: &Marker) -> std::fmt::Result {
    write!(out, "[{} {:.3}]", m.id, m.quality)?;
    block(out, &m.position, 3)
}

fn hand(out: &mut String, h: &Hand) -> std::fmt::Result {
    let side = u8::from(h.side == Side::Right);
    write!(out, "[{} {:.3} {side} {}]", h.id, h.quality, h.fingers.len())?;
    placement(out, &h.placement)?;
    for f in &h.fingers {
        block(out, &f.tip.position, 1)?;
        block(out, &f.tip.rotation, 4)?;
        let ([outer, middle, inner], [outer_middle, middle_inner]) = (f.lengths, f.angles);
        block(out, &[f.tip_radius, outer, outer_middle, middle, middle_inner, inner], 1)?;
    }
    Ok(())
}

fn person(out: &mut String, p: &Person) -> std::fmt::Result {
    write!(out, "[{} {}]", p.id, p.joints.len())?;
    for joint in &p.joints {
        write!(out, "[{} {:.3}]", joint.id, joint.quality)?;
        let ([x, y, z], [a, b, c]) = (joint.placement.position, joint.angles);
        block(out, &[x, y, z, a, b, c], 3)?;
        block(out, &joint.placement.rotation, 6)?;
    }
    Ok(())
}

fn status(out: &mut String, s: &Status) -> std::fmt::Result {
    let groups = [s.general.is_some(), s.messages.is_some(), s.cameras.is_some()].into_iter().filter(|sent| *sent).count();
    write!(out, "st {groups} ")?;
    if let Some([cameras, bodies, markers]) = s.general {
        write!(out, "[0 3][{cameras} {bodies} {markers}]")?;
    }
    if let Some([a, b, c, d, e]) = s.messages {
        write!(out, "[1 5][{a} {b} {c} {d} {e}]")?;
    }
    if let Some(cameras) = &s.cameras {
        write!(out, "[2 {} 3]", cameras.len())?;
        for c in cameras {
            write!(out, "[{} {} {} {}]", c.id, c.reflections, c.used, c.max_intensity)?;
        }
    }
    out.push_str("\r\n");
    Ok(())
}

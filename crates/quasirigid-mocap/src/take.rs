//! Recorded takes: the packets as they came, with their arrivals.
//!
//! A text file. Lines that start with `#` are ours, all else are packets, byte for byte:
//!
//! ```text
//! # quasirigid take 1
//! # packet 0.000000 412
//! fr 1
//! ts 36000.000000
//! ...
//! # packet 0.016672 415
//! fr 2
//! ```
//!
//! `# packet` has the arrival in s and the length of the packet in bytes. Other lines with `#` are notes. A file without any `# packet`,
//! packets put one behind the other as they were captured elsewhere, is a take too: every `fr` starts a packet, and times are those of the
//! tracker. A file that was cut loses its last packet and no more; a file that an editor has gone over (other line ends) is read by its
//! lines. Compressed (gzip) files are read as well.

use crate::dtrack::{MAX_DATAGRAM, Packet, PacketError};
use crate::error::{Error, Result};
use crate::hands::TrackerClock;
use flate2::read::GzDecoder;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// First line of a take.
pub const HEADER: &str = "# quasirigid take 1";
const MARK: &[u8] = b"# packet ";
/// Larger takes are refused, bytes after decompression: some hours of two hands.
const LARGEST: u64 = 1 << 30;
/// Arrivals from this on are refused, s: eleven days. A broken one must not make a replay wait for ever.
pub(crate) const LONGEST: f64 = 1e6;
/// Time between packets where nothing tells it, s.
const USUAL_PERIOD: f64 = 1.0 / 60.0;

/// A packet of a take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TakePacket {
    /// s; 0 is the start of the take.
    pub arrival: f64,
    /// As it came.
    pub bytes: Vec<u8>,
}

impl TakePacket {
    /// What it says.
    ///
    /// # Errors
    /// [`PacketError`] if it is none.
    pub fn parse(&self) -> std::result::Result<Packet, PacketError> {
        Packet::parse(&self.bytes)
    }
}

/// A recording of a tracker.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Take {
    /// In order of arrival.
    pub packets: Vec<TakePacket>,
    /// Lines of notes, without their `#`.
    pub notes: Vec<String>,
    /// Packets that were cut or spoilt and are left out. At least one where a compressed file is cut or spoilt: what it had is not known.
    pub damaged: usize,
}

impl Take {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be read, is over 1 GiB, or has no packet in it.
    pub fn read(path: &Path) -> Result<Self> {
        let hint = "give a take made by `quasirigid mocap record`, or packets captured elsewhere";
        let failed = |e: std::io::Error| Error::file(path.display(), "a readable take", e, hint);
        let mut bytes = Vec::new();
        File::open(path).and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes)).map_err(failed)?;
        let mut spoilt = false;
        if bytes.starts_with(&[0x1f, 0x8b]) {
            let mut plain = Vec::new();
            // A compressed file that was cut gives what was before the cut.
            let end = GzDecoder::new(&bytes[..]).take(LARGEST + 1).read_to_end(&mut plain);
            spoilt = end.is_err();
            if plain.is_empty() {
                end.map_err(failed)?;
            }
            bytes = plain;
        }
        if bytes.len() as u64 > LARGEST {
            return Err(Error::file(path.display(), "a take of at most 1 GiB", "a larger one", "cut it into pieces"));
        }
        let mut take = Self::from_bytes(&bytes);
        take.damaged = take.damaged.max(usize::from(spoilt));
        if take.packets.is_empty() {
            let got = if take.damaged > 0 { format!("{} packets that are all cut or spoilt", take.damaged) } else { "none".to_owned() };
            return Err(Error::file(path.display(), "at least one packet with a line fr", got, hint));
        }
        Ok(take)
    }

    /// Reads the contents of a file that is not compressed. Never fails: what is no packet is left out and counted.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut take = Self::default();
        let mut stamps = Vec::new();
        let mut rest = bytes;
        while !rest.is_empty() {
            if let Some((arrival, length, after)) = marked(rest) {
                let (end, complete) = packet_end(after, length);
                if complete {
                    take.keep(&after[..end], Some(arrival), &mut stamps);
                } else {
                    take.damaged += 1;
                }
                rest = &after[end..];
            } else if rest.starts_with(b"#") {
                let (line, after) = split_line(rest);
                // The first line of a take is no note, nor is the head of a packet that was cut.
                if line.trim_ascii_end() != HEADER.as_bytes() && !line.starts_with(MARK) {
                    take.notes.push(String::from_utf8_lossy(line[1..].trim_ascii()).into_owned());
                }
                rest = after;
            } else {
                let end = next_packet(rest);
                if !rest[..end].trim_ascii().is_empty() {
                    take.keep(&rest[..end], None, &mut stamps);
                }
                rest = &rest[end..];
            }
        }
        take.put_in_time(&stamps);
        take
    }

    /// Refuses what no file of a take is read as.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for arrivals that are not finite or out of order, and for packets that are none.
    pub fn check(&self) -> Result<()> {
        let mut last = 0.0;
        for (k, packet) in self.packets.iter().enumerate() {
            if !(last..f64::INFINITY).contains(&packet.arrival) {
                return Err(Error::value(
                    "arrivals",
                    "finite numbers in order (s)",
                    format!("{} after {last}", packet.arrival),
                    "sort them",
                ));
            }
            last = packet.arrival;
            packet.parse().map_err(|why| Error::value(format!("packet {k}"), "a DTrack packet", why, "leave it out"))?;
        }
        Ok(())
    }

    fn keep(&mut self, bytes: &[u8], arrival: Option<f64>, stamps: &mut Vec<Option<f64>>) {
        if Packet::parse(bytes).is_ok() {
            self.packets.push(TakePacket { arrival: 0.0, bytes: bytes.to_vec() });
            stamps.push(arrival);
        } else {
            self.damaged += 1;
        }
    }

    /// Arrivals as noted; where there are none, those of the tracker's own clock.
    fn put_in_time(&mut self, stamps: &[Option<f64>]) {
        let mut clock = TrackerClock::default();
        let (mut last, mut last_time) = (None::<f64>, None::<f64>);
        for (packet, stamp) in self.packets.iter_mut().zip(stamps) {
            let time = packet.parse().ok().filter(|p| p.time().is_some()).map(|p| clock.seconds(&p, 0.0));
            let step = match (time, last_time) {
                (Some(now), Some(before)) if (0.0..10.0).contains(&(now - before)) => now - before,
                _ => USUAL_PERIOD,
            };
            // Time never falls back: packets are sent again in the order of the file.
            packet.arrival = stamp.unwrap_or(last.map_or(0.0, |last| last + step)).max(last.unwrap_or(0.0));
            (last, last_time) = (Some(packet.arrival), time);
        }
    }

    /// From first to last arrival, s.
    pub fn duration(&self) -> f64 {
        self.packets.last().map_or(0.0, |last| last.arrival) - self.packets.first().map_or(0.0, |first| first.arrival)
    }

    /// The contents of a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = format!("{HEADER}\n").into_bytes();
        for note in &self.notes {
            bytes.extend_from_slice(note_line(note).as_bytes());
        }
        self.packets.iter().for_each(|packet| write_packet(&mut bytes, packet.arrival, &packet.bytes));
        bytes
    }

    /// Writes a file; compressed if its name ends in `.gz`.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.to_bytes();
        let compressed = path.extension().is_some_and(|ending| ending == "gz");
        let write = || {
            let mut file = File::create(path)?;
            if !compressed {
                return file.write_all(&bytes);
            }
            // No name and no date in the header: same take, same file.
            let mut out = flate2::GzBuilder::new().mtime(0).write(file, flate2::Compression::best());
            out.write_all(&bytes)?;
            out.finish().map(drop)
        };
        write().map_err(|e| cannot_write(path, e))
    }
}

pub(crate) fn cannot_write(path: &Path, error: std::io::Error) -> Error {
    Error::file(path.display(), "a place to write to", error, "choose another place")
}

pub(crate) fn write_packet(out: &mut Vec<u8>, arrival: f64, bytes: &[u8]) {
    out.extend_from_slice(format!("# packet {arrival:.6} {}\n", bytes.len()).as_bytes());
    out.extend_from_slice(bytes);
    if !bytes.ends_with(b"\n") {
        out.push(b'\n');
    }
}

/// A line of notes. One that reads like a line of ours gets another blank, which is no part of it.
pub(crate) fn note_line(note: &str) -> String {
    let line = format!("# {}\n", note.replace(['\r', '\n'], " ").trim_ascii());
    let ours = line.trim_ascii_end() == HEADER || line.as_bytes().starts_with(MARK);
    if ours { line.replacen(' ', "  ", 1) } else { line }
}

/// The line at the start, without its end, and what is behind it.
fn split_line(text: &[u8]) -> (&[u8], &[u8]) {
    match text.iter().position(|&byte| byte == b'\n') {
        Some(end) => (&text[..end], &text[end + 1..]),
        None => (text, &[]),
    }
}

/// Arrival, length, and what follows a line `# packet`.
fn marked(text: &[u8]) -> Option<(f64, usize, &[u8])> {
    if !text.starts_with(MARK) {
        return None;
    }
    let (line, after) = split_line(text);
    let mut words = std::str::from_utf8(&line[MARK.len()..]).ok()?.split_ascii_whitespace();
    let arrival: f64 = words.next()?.parse().ok()?;
    let length = words.next()?.parse().ok()?;
    (0.0..LONGEST).contains(&arrival).then_some((arrival, length, after))
}

/// Where a packet that should have so many bytes ends, and whether it is all there. If the count does not fit (the file was edited, or
/// cut), it ends where the next line with `#` starts.
fn packet_end(text: &[u8], length: usize) -> (usize, bool) {
    let fits = length <= MAX_DATAGRAM && length <= text.len();
    let after = text.get(length..).unwrap_or_default();
    let behind = after.strip_prefix(b"\n").unwrap_or(after);
    if fits && (behind.is_empty() || behind.starts_with(b"#")) {
        return (length, true);
    }
    let end = line_starts(text).find(|&at| text[at..].starts_with(b"#")).unwrap_or(text.len());
    // An editor that changes line ends takes one byte from every line. What lacks more was cut, even if it still reads like a packet.
    let lines = text[..end].split(|&byte| byte == b'\n').rev().skip(1);
    let shortened = lines.filter(|line| !line.ends_with(b"\r")).count();
    (end, text[..end].len() + shortened >= length)
}

/// Where a packet of a plain capture ends: before the next `fr` or `#`.
fn next_packet(text: &[u8]) -> usize {
    line_starts(text).find(|&at| at > 0 && (text[at..].starts_with(b"#") || text[at..].starts_with(b"fr "))).unwrap_or(text.len())
}

fn line_starts(text: &[u8]) -> impl Iterator<Item = usize> {
    std::iter::once(0).chain(text.iter().enumerate().filter(|(_, byte)| matches!(byte, b'\n' | b'\r' | 0)).map(|(at, _)| at + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::take_writer::TakeWriter;
    use proptest::prelude::*;

    fn packet(frame: u32) -> Vec<u8> {
        format!("fr {frame}\r\nts {:.6}\r\n6d 0\r\ngl 0 \r\n", 100.0 + 0.02 * f64::from(frame)).into_bytes()
    }

    fn take(n: u32) -> Take {
        let packets = (0..n).map(|k| TakePacket { arrival: 0.25 * f64::from(k), bytes: packet(k) }).collect();
        Take { packets, notes: vec!["a note".into()], damaged: 0 }
    }

    proptest! {
        #[test]
        fn a_cut_take_loses_its_last_packet_and_no_more(share in 0.0..1.0f64) {
            let whole = take(9);
            let bytes = whole.to_bytes();
            let cut = (share * bytes.len() as f64) as usize;
            let read = Take::from_bytes(&bytes[..cut]);
            let complete = (0..=9).rev().find(|&n| take(n).to_bytes().len() <= cut).unwrap_or(0) as usize;
            prop_assert_eq!(&read.packets[..], &whole.packets[..complete]);
            prop_assert!(read.damaged <= 1);
        }

        #[test]
        fn every_note_is_read_back(note in prop_oneof![
            "[ -~]{0,24}", Just(HEADER[2..].to_owned()), Just("take 1".to_owned()), Just("packet 1.0 20".to_owned()),
            Just("# a heading".to_owned()),
        ]) {
            let whole = Take { notes: vec![note.trim().to_owned()], ..take(2) };
            prop_assert_eq!(Take::from_bytes(&whole.to_bytes()), whole);
        }

        #[test]
        fn no_bytes_at_all_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), head in any::<bool>()) {
            let mut text = if head { b"# packet 1.0 20\nfr 1\r\n".to_vec() } else { Vec::new() };
            text.extend(bytes);
            let read = Take::from_bytes(&text);
            prop_assert!(read.packets.iter().all(|p| p.arrival.is_finite()));
        }
    }

    #[test]
    fn what_was_written_is_read_back() {
        let whole = take(5);
        assert_eq!(Take::from_bytes(&whole.to_bytes()), whole);
        assert_eq!(whole.duration(), 1.0);
        let dir = std::env::temp_dir().join(format!("quasirigid-take-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        for name in ["a.take", "a.take.gz"] {
            let path = dir.join(name);
            whole.write(&path).unwrap();
            assert_eq!(Take::read(&path).unwrap(), whole, "{name}");
        }
        // A compressed file that was cut still gives its beginning.
        let gz = std::fs::read(dir.join("a.take.gz")).unwrap();
        std::fs::write(dir.join("cut.gz"), &gz[..gz.len() - 12]).unwrap();
        let cut = Take::read(&dir.join("cut.gz")).unwrap();
        assert!(cut.packets.len() >= 4);
        assert_eq!(cut.damaged, 1);
        // One whose checksum is wrong, or missing, is not said to be whole.
        let mut wrong = gz.clone();
        wrong[gz.len() - 8] ^= 1;
        for (name, bytes) in [("wrong.gz", &wrong[..]), ("short.gz", &gz[..gz.len() - 8])] {
            std::fs::write(dir.join(name), bytes).unwrap();
            let read = Take::read(&dir.join(name)).unwrap();
            assert_eq!((read.packets.len(), read.damaged), (5, 1), "{name}");
        }
        assert!(TakeWriter::append(&dir.join("a.take.gz")).unwrap_err().to_string().contains("gunzip"));
        // Recording goes on behind a cut.
        let path = dir.join("b.take");
        let bytes = whole.to_bytes();
        std::fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
        let mut writer = TakeWriter::append(&path).unwrap();
        writer.note("second part").unwrap();
        writer.packet(0.5, &packet(77)).unwrap();
        for arrival in [-0.1, 1e6, f64::NAN] {
            assert!(matches!(writer.packet(arrival, &packet(78)), Err(Error::InvalidValue { .. })), "{arrival} s");
        }
        drop(writer);
        let read = Take::read(&path).unwrap();
        assert_eq!((read.packets.len(), read.damaged), (5, 1), "{read:?}");
        assert_eq!((read.packets[4].bytes.clone(), read.packets[4].arrival), (packet(77), 0.75 + 1.5));
        std::fs::remove_dir_all(&dir).unwrap();
    }

    #[test]
    fn packets_captured_elsewhere_are_a_take() {
        let plain: Vec<u8> = (0..4).flat_map(packet).collect();
        let read = Take::from_bytes(&plain);
        assert_eq!(read.packets.iter().map(|p| p.bytes.clone()).collect::<Vec<_>>(), (0..4).map(packet).collect::<Vec<_>>());
        let arrivals: Vec<f64> = read.packets.iter().map(|p| p.arrival).collect();
        assert!(arrivals.iter().zip([0.0, 0.02, 0.04, 0.06]).all(|(a, b)| (a - b).abs() < 1e-9), "{arrivals:?}");
        let edited = String::from_utf8(take(4).to_bytes()).unwrap().replace("\r\n", "\n");
        let read = Take::from_bytes(edited.as_bytes());
        assert_eq!((read.packets.len(), read.packets[3].arrival, read.damaged), (4, 0.75, 0), "other line ends");
    }

    #[test]
    fn a_file_that_is_no_take_is_refused() {
        assert!(Take::read(Path::new("/nowhere")).unwrap_err().to_string().contains("mocap record"));
        let path = std::env::temp_dir().join(format!("quasirigid-none-{}", std::process::id()));
        for bytes in [&b""[..], b"hello\nworld\n", &[0x1f, 0x8b, 1, 2, 3], b"# packet 1 2\n"] {
            std::fs::write(&path, bytes).unwrap();
            assert!(matches!(Take::read(&path), Err(Error::File { .. })), "{bytes:?}");
        }
        std::fs::remove_file(&path).unwrap();
    }
}

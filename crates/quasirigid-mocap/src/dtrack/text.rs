//! Lines, blocks in brackets, numbers: the grammar below the lines. Reads bytes, allocates nothing.

use super::packet::{Columns, Placement};
use thiserror::Error;

/// Why a packet was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("line {line}: {kind}")]
pub struct PacketError {
    /// Line of the packet, from 1; 0 if it is about the packet as a whole.
    pub line: u32,
    /// What was wrong.
    pub kind: PacketErrorKind,
}

/// What was wrong with a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PacketErrorKind {
    /// Longer than a datagram can be.
    #[error("longer than a datagram can be")]
    TooLong,
    /// No line `fr`.
    #[error("no frame counter (fr)")]
    NoFrameCounter,
    /// A number is expected, and something else or nothing stands there.
    #[error("a number is missing or is none")]
    NotANumber,
    /// NaN, infinity, or far beyond what the format means.
    #[error("a number is not finite or out of range")]
    OutOfRange,
    /// A `[` is missing: fewer blocks than announced.
    #[error("fewer blocks than announced")]
    MissingBlock,
    /// A `]` is missing.
    #[error("a block without end")]
    UnclosedBlock,
    /// The nine numbers of a tracked target are no rotation.
    #[error("a matrix that is no rotation")]
    NotARotation,
}

pub(super) type Parsed<T> = Result<T, PacketErrorKind>;

/// Coordinates beyond this are refused, mm: a kilometre.
const FARTHEST: f64 = 1e6;
/// How far a matrix may be from a rotation: largest entry of `R^T R - 1`. Finger matrices have 4 decimals; 0.01 is a broken matrix.
const NOT_ORTHONORMAL: f64 = 1e-2;

/// The lines of a packet that are not blank, with their numbers. CR, LF and NUL end a line, in any mixture.
pub(super) fn lines(data: &[u8]) -> impl Iterator<Item = (u32, &[u8])> {
    data.split(|byte| matches!(byte, b'\r' | b'\n' | 0))
        .map(<[u8]>::trim_ascii)
        .filter(|line| !line.is_empty())
        .zip(1..)
        .map(|(l, n)| (n, l))
}

/// What is left of a line, or of the inside of a block.
#[derive(Clone, Copy)]
pub(super) struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub fn new(text: &'a [u8]) -> Self {
        Self { rest: text }
    }

    /// The next word; empty at the end or in front of a bracket.
    pub fn word(&mut self) -> &'a [u8] {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(|&byte| byte.is_ascii_whitespace() || byte == b'[').unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        word
    }

    /// The inside of the next block.
    pub fn block(&mut self) -> Parsed<Cursor<'a>> {
        let text = self.rest.trim_ascii_start();
        let Some((b'[', inner)) = text.split_first() else { return Err(PacketErrorKind::MissingBlock) };
        // Never past the next opening bracket: a block that was cut must not swallow its neighbour.
        match inner.iter().position(|&byte| matches!(byte, b'[' | b']')) {
            Some(end) if inner[end] == b']' => {
                self.rest = &inner[end + 1..];
                Ok(Cursor { rest: &inner[..end] })
            }
            _ => Err(PacketErrorKind::UnclosedBlock),
        }
    }

    /// Whether nothing but blanks is left.
    pub fn is_empty(&self) -> bool {
        self.rest.trim_ascii_start().is_empty()
    }

    fn text(&mut self) -> Parsed<&'a str> {
        std::str::from_utf8(self.word()).ok().filter(|word| !word.is_empty()).ok_or(PacketErrorKind::NotANumber)
    }

    /// A whole number from 0 to `most`.
    pub fn whole(&mut self, most: u64) -> Parsed<u64> {
        let word = self.text()?;
        match word.parse::<u64>() {
            Ok(number) if number <= most => Ok(number),
            // Digits too many to hold are a range, all else (signs, decimals, letters) is no count.
            Ok(_) => Err(PacketErrorKind::OutOfRange),
            Err(_) if word.bytes().all(|byte| byte.is_ascii_digit()) => Err(PacketErrorKind::OutOfRange),
            Err(_) if word.parse::<i64>().is_ok() => Err(PacketErrorKind::OutOfRange),
            Err(_) => Err(PacketErrorKind::NotANumber),
        }
    }

    /// [`Cursor::whole`] that fits 32 bits.
    pub fn count(&mut self, most: u32) -> Parsed<u32> {
        self.whole(u64::from(most)).map(|number| number as u32)
    }

    /// 32 bits, written with or without a sign.
    pub fn bits(&mut self) -> Parsed<u32> {
        let number: i64 = self.text()?.parse().map_err(|_| PacketErrorKind::NotANumber)?;
        let range = i64::from(i32::MIN)..=i64::from(u32::MAX);
        if range.contains(&number) { Ok(number as u32) } else { Err(PacketErrorKind::OutOfRange) }
    }

    /// A finite number of at most `most` in size.
    pub fn number_within(&mut self, most: f64) -> Parsed<f64> {
        let number: f64 = self.text()?.parse().map_err(|_| PacketErrorKind::NotANumber)?;
        // Written this way round, NaN is refused too.
        if number.abs() <= most { Ok(number) } else { Err(PacketErrorKind::OutOfRange) }
    }

    /// A finite number.
    pub fn number(&mut self) -> Parsed<f64> {
        self.number_within(1e12)
    }

    /// `N` finite numbers.
    pub fn numbers<const N: usize>(&mut self) -> Parsed<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number()?;
        }
        Ok(numbers)
    }

    /// Three coordinates, mm.
    pub fn position(&mut self) -> Parsed<[f64; 3]> {
        Ok([self.number_within(FARTHEST)?, self.number_within(FARTHEST)?, self.number_within(FARTHEST)?])
    }

    /// Two blocks, `[x y z ...][b0..b8]`. The matrix must be a rotation if `tracked`.
    pub fn placement(&mut self, tracked: bool) -> Parsed<Placement> {
        let position = self.block()?.position()?;
        Ok(Placement { position, rotation: self.rotation(tracked)? })
    }

    /// A block of nine numbers; a rotation if `tracked`.
    pub fn rotation(&mut self, tracked: bool) -> Parsed<Columns> {
        let rotation = self.block()?.numbers()?;
        if tracked && !is_rotation(&rotation) { Err(PacketErrorKind::NotARotation) } else { Ok(rotation) }
    }

    /// A block of nine numbers, a rotation or all zeros (not tracked).
    pub fn rotation_or_zeros(&mut self) -> Parsed<Columns> {
        let rotation = self.rotation(false)?;
        if rotation == [0.0; 9] || is_rotation(&rotation) { Ok(rotation) } else { Err(PacketErrorKind::NotARotation) }
    }
}

/// Whether nine numbers are the columns of a rotation, nearly.
fn is_rotation(b: &Columns) -> bool {
    let column = |k: usize| nalgebra::Vector3::new(b[3 * k], b[3 * k + 1], b[3 * k + 2]);
    let (x, y, z) = (column(0), column(1), column(2));
    let off = [x.norm_squared() - 1.0, y.norm_squared() - 1.0, z.norm_squared() - 1.0, x.dot(&y), y.dot(&z), z.dot(&x)];
    off.iter().all(|entry| entry.abs() <= NOT_ORTHONORMAL) && x.cross(&y).dot(&z) > 0.0
}

//! DTrack, DTrack2 and DTRACK3 over UDP: the text of one datagram, both ways.
//!
//! [`Packet::parse`] reads, [`Packet::to_bytes`] writes what a controller writes. Everything here is as on the wire: mm, degrees, the room
//! frame of the tracker, rotation matrices column after column. [`crate::hands`] makes [`crate::HandFrame`]s of it.
//!
//! What a packet may look like is summed up in `docs/mocap.md`. Tolerant where the format is: order of lines, unknown lines, line ends
//! (CR LF, LF, CR, none at the end), blank lines, NUL at the end, surplus values in a block, surplus blocks. Strict where a mistake would
//! be taken for a pose: a packet with a missing `fr`, a number that is none or not finite, a block too few, a matrix that is no rotation is
//! refused as a whole with a [`PacketError`]. Nothing is carried over from the packet before.

mod packet;
mod parse;
mod text;
mod write;

pub use packet::*;
pub use text::{PacketError, PacketErrorKind};

/// Longest datagram that UDP over IPv4 can carry, bytes; longer input is refused.
pub const MAX_DATAGRAM: usize = 65_507;

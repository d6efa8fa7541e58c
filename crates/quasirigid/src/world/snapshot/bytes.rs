//! Snapshots as bytes: for other processes, and to keep.
//!
//! ```text
//! "quasirigid snapshot\n", then CBOR: { version, layout }, then CBOR: the record
//! ```
//!
//! Only the version that wrote them reads them. Surfaces are built again, and the
//! nodes that caches name are those of the tree that this version builds.

use super::Snapshot;
use super::check::snapshot_of;
use super::record::Record;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// How the bytes begin.
const MAGIC: &[u8] = b"quasirigid snapshot\n";

/// Stands for the fields of a record and their types: a test says which number it has to be.
pub(super) const LAYOUT: u64 = 0xb798_8047_905f_3915;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The longest name of a version that is repeated in a message.
const LONGEST_NAME: usize = 40;

#[derive(Serialize, Deserialize)]
struct Header {
    version: String,
    layout: u64,
}

fn refused(expected: impl Into<String>, got: impl Into<String>, hint: &str) -> Error {
    Error::InvalidSnapshot { what: "snapshot".into(), expected: expected.into(), got: got.into(), hint: hint.into() }
}

impl Snapshot {
    /// The snapshot as bytes. Surfaces are in them once each, by what they are built of (65 bytes a point).
    ///
    /// # Errors
    /// [`Error::InvalidSnapshot`] if the bytes cannot be written. That should not happen.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = MAGIC.to_vec();
        let failed = |error: ciborium::ser::Error<std::io::Error>| {
            refused("a state that can be written", error.to_string(), "this should not happen: please report it")
        };
        ciborium::into_writer(&Header { version: VERSION.into(), layout: LAYOUT }, &mut bytes).map_err(failed)?;
        ciborium::into_writer(&self.record(), &mut bytes).map_err(failed)?;
        Ok(bytes)
    }

    /// The snapshot that bytes of [`Snapshot::to_bytes`] hold. They may come from anywhere: a world that can be made of them
    /// can be stepped, and they make this take no more memory than a multiple of their own size, or than is free.
    ///
    /// # Errors
    /// [`Error::InvalidSnapshot`] for bytes of another version, which it names, for damaged ones and for others.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let mut rest = bytes;
        let snapshot = Self::read(&mut rest)?;
        if rest.is_empty() {
            return Ok(snapshot);
        }
        Err(damaged(format!("{} bytes behind its end", rest.len())))
    }

    /// [`Snapshot::from_bytes`] where more follows: `bytes` is moved to what does.
    ///
    /// # Errors
    /// As [`Snapshot::from_bytes`].
    pub fn read(bytes: &mut &[u8]) -> Result<Self> {
        let Some(mut rest) = bytes.strip_prefix(MAGIC) else {
            return Err(refused("bytes that Snapshot.to_bytes has written", "others", "give it those of a snapshot"));
        };
        let Header { version, layout } = read(&mut rest).map_err(damaged)?;
        if (version.as_str(), layout) != (VERSION, LAYOUT) {
            let name: String = version.chars().filter(|c| c.is_ascii_graphic()).take(LONGEST_NAME).collect();
            let expected = format!("a snapshot of quasirigid {VERSION} (layout {LAYOUT:016x})");
            let got = format!("one of quasirigid {name} (layout {layout:016x})");
            return Err(refused(expected, got, "read it with the version that has written it"));
        }
        let record: Record = read(&mut rest).map_err(damaged)?;
        let snapshot = snapshot_of(record).map_err(damaged)?;
        *bytes = rest;
        Ok(snapshot)
    }
}

fn damaged(why: String) -> Error {
    refused("a whole snapshot", why, "it is damaged: write it again")
}

fn read<T: serde::de::DeserializeOwned>(bytes: &mut &[u8]) -> std::result::Result<T, String> {
    ciborium::from_reader(bytes).map_err(|error| match error {
        ciborium::de::Error::Semantic(_, why) => why,
        ciborium::de::Error::Io(_) => "one that ends too early".into(),
        other => other.to_string(),
    })
}

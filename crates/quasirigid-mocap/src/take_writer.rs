//! Takes as they are recorded: a file that is whole after every packet.

use crate::error::{Error, Result};
use crate::take::{HEADER, LONGEST, Take, cannot_write, note_line, write_packet};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Writes a take while it is recorded. After every packet the file is whole.
#[derive(Debug)]
pub struct TakeWriter {
    file: BufWriter<File>,
    path: PathBuf,
    start: f64,
}

impl TakeWriter {
    /// A new file; what was there is overwritten.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| cannot_write(path, e))?;
        let mut writer = Self { file: BufWriter::new(file), path: path.to_owned(), start: 0.0 };
        writer.put(format!("{HEADER}\n").as_bytes())?;
        Ok(writer)
    }

    /// Goes on behind the last packet of a take that is not compressed; a new file if there is none. Arrivals go on 1 s after its last.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn append(path: &Path) -> Result<Self> {
        if !path.exists() {
            return Self::create(path);
        }
        let before = Take::read(path)?;
        let mut file = OpenOptions::new().read(true).append(true).open(path).map_err(|e| cannot_write(path, e))?;
        let mut head = [0; 2];
        if file.read(&mut head).is_ok_and(|n| n == 2) && head == [0x1f, 0x8b] {
            return Err(Error::file(path.display(), "a take that is not compressed", "a gzip file", "unpack it with gunzip first"));
        }
        let start = before.packets.last().map_or(0.0, |last| last.arrival) + 1.0;
        let mut writer = Self { file: BufWriter::new(file), path: path.to_owned(), start };
        // If the file was cut in a packet, this ends its line.
        writer.put(b"\n")?;
        Ok(writer)
    }

    /// A line of notes.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn note(&mut self, text: &str) -> Result<()> {
        self.put(note_line(text).as_bytes())
    }

    /// A packet that came at `arrival`, s since the recording started.
    ///
    /// # Errors
    /// [`Error::File`], when the disk is full for instance; [`Error::InvalidValue`] for an arrival before the start, or eleven days (1e6 s)
    /// after that of the take.
    pub fn packet(&mut self, arrival: f64, bytes: &[u8]) -> Result<()> {
        // Rounded as it is written, it must be read back.
        let last = LONGEST - 1.0 - self.start;
        if !(0.0..=last).contains(&arrival) {
            let expected = format!("a number from 0 to {last:.0} (s)");
            return Err(Error::value("arrival", expected, arrival, "count from the start of the recording, and begin another take"));
        }
        let mut text = Vec::with_capacity(bytes.len() + 40);
        write_packet(&mut text, self.start + arrival, bytes);
        self.put(&text)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).and_then(|()| self.file.flush()).map_err(|e| cannot_write(&self.path, e))
    }
}

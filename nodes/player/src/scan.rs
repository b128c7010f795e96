//! MCAP records one after the other, from a file that may be cut, damaged or hostile.
//!
//! The framing of records is read here, so that no length is believed before its bytes are there; what a chunk holds is
//! unpacked by the library, within bounds that are checked before.

use crate::chunk::Chunk;
use crate::error::PlayerError;
use crate::lengths;
use mcap::records::{Record, op};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// `[byte]` no record or chunk of a recording is larger: a file that claims more is damaged, and memory stays bounded.
pub(crate) const RECORD_BYTES_MAX: u64 = 64 << 20;
/// First and last bytes of a complete file.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// `[byte]` code and length before each record.
const HEAD_BYTES: u64 = 9;
const CUT: &str = "the file ends in the middle, as after a kill or a full disk";
const NO_END: &str = "the end mark is missing, as after a kill or a full disk";

/// How far a scan goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    /// The data: what was recorded, up to the first damage.
    Data,
    /// Every record, the summary after the data too, up to the first damage.
    Whole,
    /// Every record, passing over chunks and records of the data that cannot be read, and into a chunk that was cut.
    Salvage,
}

/// Reads records in the order of the file.
pub(crate) struct Scan {
    file: BufReader<File>,
    path: PathBuf,
    extent: Extent,
    /// Body of the record in work.
    body: Vec<u8>,
    chunk: Option<Chunk>,
    /// `[byte]` where the next record of the file begins.
    offset: u64,
    after_data: bool,
    after_footer: bool,
    ended: bool,
    complete: bool,
    damage: Option<String>,
    passed_over: u64,
}

/// What stands at a place of the file.
enum Frame {
    Record(u8),
    /// The file ends between two records.
    End,
    /// The file ends within a record of this code and length, whose first bytes are there.
    Cut(u8, u64),
    TooLarge(u64),
}

/// The first bytes of a file that is no MCAP file, and what to do with it.
fn foreign(first: &[u8]) -> (String, &'static str) {
    if first.starts_with(b"#ROSBAG") {
        return ("a ROS 1 bag".into(), "convert it with `mcap convert`");
    }
    if first.starts_with(b"SQLite ") {
        return (
            "an SQLite file, as of a ROS 2 bag before Iron".into(),
            "convert it with `ros2 bag convert` or `mcap convert`",
        );
    }
    let bytes: Vec<_> = first.iter().map(|byte| format!("{byte:02x}")).collect();
    let found =
        if bytes.is_empty() { "it is empty".into() } else { format!("it begins {}", bytes.join(" ")) };
    (found, "give an MCAP file")
}

impl Scan {
    /// The data of a file.
    pub(crate) fn open(path: &Path) -> Result<Self, PlayerError> {
        Self::through(path, Extent::Data)
    }

    /// As much of a file as `extent` says.
    pub(crate) fn through(path: &Path, extent: Extent) -> Result<Self, PlayerError> {
        let fault = |source| PlayerError::read(path, source);
        let mut file = BufReader::new(File::open(path).map_err(fault)?);
        let mut first = Vec::new();
        file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut first).map_err(fault)?;
        if first != MAGIC {
            let (found, remedy) = foreign(&first);
            return Err(PlayerError::NotMcap { path: path.to_path_buf(), found, remedy });
        }
        Ok(Self {
            file,
            path: path.to_path_buf(),
            extent,
            body: Vec::new(),
            chunk: None,
            offset: MAGIC.len() as u64,
            after_data: false,
            after_footer: false,
            ended: false,
            complete: false,
            damage: None,
            passed_over: 0,
        })
    }

    /// Goes on at `offset`, where a record must begin.
    pub(crate) fn seek(&mut self, offset: u64) -> Result<(), PlayerError> {
        self.file.seek(SeekFrom::Start(offset)).map_err(|source| PlayerError::read(&self.path, source))?;
        self.offset = offset;
        Ok(())
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Where the file ends early, after everything before it was read; the first of several damages.
    pub(crate) fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// Whether all data was passed: what may follow is an index of it.
    pub(crate) fn is_after_data(&self) -> bool {
        self.after_data
    }

    /// Whether the end of what was to be read was reached: of the data, else of the file.
    pub(crate) fn is_complete(&self) -> bool {
        self.complete
    }

    /// `[byte]` where the next record of the file begins; at the end of a cut file, its last readable place.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// Chunks and records passed over, with [`Extent::Salvage`].
    pub(crate) fn passed_over(&self) -> u64 {
        self.passed_over
    }

    /// Whether the record shown last came from a chunk that was cut, whose sum nobody can check.
    pub(crate) fn is_unverified(&self) -> bool {
        self.chunk.as_ref().is_some_and(Chunk::is_cut)
    }

    /// Shows the next record to `look`; `None` at the end or at the first damage.
    pub(crate) fn next<T>(&mut self, look: impl FnOnce(&Record) -> T) -> Option<Result<T, PlayerError>> {
        let mut look = Some(look);
        while !self.ended {
            if let Some(chunk) = &mut self.chunk {
                // At most one record is looked at: `look` stays here until then.
                let place = &mut look;
                let span_ns = chunk.is_cut().then(|| chunk.span_ns());
                let shown = chunk.next(|opcode, data| {
                    let record = parse(opcode, data)?;
                    if let (Some(span_ns), Record::Message { header, .. }) = (&span_ns, &record)
                        && !span_ns.contains(&header.log_time)
                    {
                        return Err(CUT.to_owned());
                    }
                    Ok(place.take().map(|look| look(&record)))
                });
                match shown {
                    Some(Ok(Ok(Some(value)))) => return Some(Ok(value)),
                    Some(Ok(Err(detail)) | Err(detail)) => self.leave_chunk(Some(detail)),
                    Some(Ok(Ok(None))) | None => self.leave_chunk(None),
                }
                continue;
            }
            if self.after_footer {
                return self.end_mark().err().map(Err);
            }
            match self.frame() {
                Ok(Frame::Record(op::CHUNK)) => self.enter_chunk(self.body.len() as u64),
                Ok(Frame::Record(opcode)) => {
                    self.turn(opcode);
                    if self.ended {
                        continue;
                    }
                    let body = std::mem::take(&mut self.body);
                    let shown = parse(opcode, &body).map(|record| look.take().map(|look| look(&record)));
                    self.body = body;
                    match shown {
                        Ok(value) => return value.map(Ok),
                        Err(detail) => self.stop(detail, true),
                    }
                }
                Ok(Frame::End) => self.stop(NO_END.into(), false),
                Ok(Frame::Cut(op::CHUNK, length)) if self.extent == Extent::Salvage => {
                    self.enter_chunk(length);
                }
                Ok(Frame::Cut(..)) => self.stop(CUT.into(), false),
                Ok(Frame::TooLarge(length)) => {
                    let detail =
                        format!("a record claims {length} bytes, at most {RECORD_BYTES_MAX} are read");
                    self.stop(detail, false);
                }
                Err(source) => {
                    self.ended = true;
                    return Some(Err(PlayerError::read(&self.path, source)));
                }
            }
        }
        None
    }

    /// Reads the next record of the file into `body`, as far as it is there.
    fn frame(&mut self) -> std::io::Result<Frame> {
        self.body.clear();
        let got = self.file.by_ref().take(HEAD_BYTES).read_to_end(&mut self.body)? as u64;
        if got == 0 {
            return Ok(Frame::End);
        }
        let opcode = self.body[0];
        if got < HEAD_BYTES {
            return Ok(Frame::Cut(0, 0));
        }
        let length = self.body[1..].iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
        if length > RECORD_BYTES_MAX {
            return Ok(Frame::TooLarge(length));
        }
        self.body.clear();
        // Grows with what is read: a length without bytes costs nothing.
        let got = self.file.by_ref().take(length).read_to_end(&mut self.body)? as u64;
        if got < length {
            return Ok(Frame::Cut(opcode, length));
        }
        self.offset += HEAD_BYTES + length;
        Ok(Frame::Record(opcode))
    }

    /// Takes note of the records that end something.
    fn turn(&mut self, opcode: u8) {
        let ends = matches!(opcode, op::DATA_END | op::FOOTER);
        self.after_data |= ends;
        if ends && self.extent == Extent::Data {
            (self.ended, self.complete) = (true, true);
        }
        self.after_footer |= opcode == op::FOOTER;
    }

    fn end_mark(&mut self) -> Result<(), PlayerError> {
        self.ended = true;
        let mut last = Vec::new();
        let read = self.file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut last);
        read.map_err(|source| PlayerError::read(&self.path, source))?;
        self.complete = last == MAGIC && self.damage.is_none();
        if last != MAGIC {
            self.stop(NO_END.into(), false);
        }
        Ok(())
    }

    fn enter_chunk(&mut self, length: u64) {
        match Chunk::open(&self.body, length) {
            Ok(chunk) => self.chunk = Some(chunk),
            Err(detail) => self.stop(detail, (self.body.len() as u64) == length),
        }
    }

    fn leave_chunk(&mut self, damage: Option<String>) {
        let cut = self.is_unverified();
        self.chunk = None;
        match damage {
            _ if cut => self.stop(CUT.into(), false),
            Some(detail) => self.stop(detail, true),
            None => {}
        }
    }

    /// Ends at a damage, or goes on behind it where the place of the next record is known and that is wished.
    fn stop(&mut self, detail: String, can_go_on: bool) {
        self.damage.get_or_insert(detail);
        let goes_on = can_go_on && self.extent == Extent::Salvage && !self.after_data;
        self.passed_over += u64::from(goes_on);
        self.ended = !goes_on;
    }
}

/// A record from its bytes.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    if !lengths::fit(opcode, body) {
        return Err(format!("a record of kind {opcode} is shorter than it says"));
    }
    mcap::parse_record(opcode, body).map_err(|error| error.to_string())
}

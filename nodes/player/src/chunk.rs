//! What a chunk holds, unpacked within bounds that are checked before anything is allocated.

use crate::scan::RECORD_BYTES_MAX;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::ops::RangeInclusive;

/// `[byte]` start, end, size, sum and the length of the name of the compression; after the name follows one more size.
const FIXED_BYTES: usize = 8 + 8 + 8 + 4 + 4;
/// `[byte]` code and length before each record.
const HEAD_BYTES: usize = 9;
/// Bytes that one byte of a compression may become at most: by its format lz4 255; zstd 128 KiB for a block of 4 bytes.
const RATIO_MOST: [(&str, u64); 3] = [("", 1), ("lz4", 256), ("zstd", 32 << 10)];
/// `[byte]` granted beyond the ratio, for headers of frames.
const RATIO_SLACK_BYTES: u64 = 1 << 16;

/// The lengths that a chunk says of itself.
struct Claims<'a> {
    span_ns: RangeInclusive<u64>,
    unpacked_bytes: u64,
    compression: &'a str,
    packed_bytes: u64,
    packed: &'a [u8],
}

fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte))
}

impl<'a> Claims<'a> {
    /// `None` where the chunk is shorter than its own head.
    fn read(body: &'a [u8]) -> Option<Self> {
        let name_bytes = number(body.get(28..FIXED_BYTES)?) as usize;
        let (name, rest) = body[FIXED_BYTES..].split_at_checked(name_bytes)?;
        let (packed_bytes, packed) = rest.split_at_checked(8)?;
        Some(Self {
            span_ns: number(&body[..8])..=number(&body[8..16]),
            unpacked_bytes: number(&body[16..24]),
            compression: std::str::from_utf8(name).ok()?,
            packed_bytes: number(packed_bytes),
            packed,
        })
    }

    /// Refuses what cannot be, before memory is taken for it.
    fn check(&self, is_cut: bool) -> Result<(), String> {
        let Self { unpacked_bytes, compression, packed_bytes, packed, .. } = *self;
        let Some((_, ratio)) = RATIO_MOST.iter().find(|(name, _)| *name == compression) else {
            return Err(format!("a chunk is compressed by {compression:?}, needed lz4, zstd or nothing"));
        };
        if !is_cut && packed_bytes > packed.len() as u64 {
            let there = packed.len();
            return Err(format!("a chunk of {there} bytes claims {packed_bytes}"));
        }
        let most =
            packed_bytes.saturating_mul(*ratio).saturating_add(RATIO_SLACK_BYTES).min(RECORD_BYTES_MAX);
        if unpacked_bytes > most {
            return Err(format!(
                "a chunk claims {unpacked_bytes} bytes in {packed_bytes} packed by {compression:?}, at most {most} are read"
            ));
        }
        if compression.is_empty() { self.check_records() } else { Ok(()) }
    }

    /// The records of a chunk that is not compressed must end where it ends: the library counts down without looking.
    fn check_records(&self) -> Result<(), String> {
        let mut left_bytes = self.packed_bytes;
        let mut rest = self.packed;
        while left_bytes > 0 && !rest.is_empty() {
            let Some(head) = rest.get(..HEAD_BYTES) else { break };
            let record_bytes = number(&head[1..]).saturating_add(HEAD_BYTES as u64);
            if record_bytes > left_bytes {
                return Err("a record is longer than its chunk".into());
            }
            left_bytes -= record_bytes;
            rest = rest.get(record_bytes as usize..).unwrap_or_default();
        }
        let odd = rest.len() >= left_bytes as usize && left_bytes > 0 && left_bytes < HEAD_BYTES as u64;
        if odd { Err("a chunk ends within a record".into()) } else { Ok(()) }
    }
}

/// A chunk that is being read.
pub(crate) struct Chunk {
    reader: LinearReader,
    span_ns: RangeInclusive<u64>,
    is_cut: bool,
}

impl Chunk {
    /// Opens a chunk by the body of its record, of which `length` bytes should be there. The sum of a whole chunk is
    /// checked before its first record; that of a chunk which was cut cannot be.
    pub(crate) fn open(body: &[u8], length: u64) -> Result<Self, String> {
        let is_cut = (body.len() as u64) < length;
        let claims = Claims::read(body).ok_or("a chunk is shorter than its head")?;
        claims.check(is_cut)?;
        let bound = claims.unpacked_bytes.max(claims.packed_bytes).max(length).min(RECORD_BYTES_MAX);
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(!is_cut)
            .with_record_length_limit(bound as usize);
        let mut reader = LinearReader::new_with_options(options);
        let place = reader.insert(HEAD_BYTES + body.len());
        place[0] = op::CHUNK;
        place[1..HEAD_BYTES].copy_from_slice(&length.to_le_bytes());
        place[HEAD_BYTES..HEAD_BYTES + body.len()].copy_from_slice(body);
        reader.notify_read(HEAD_BYTES + body.len());
        Ok(Self { reader, span_ns: claims.span_ns, is_cut })
    }

    /// Whether it ends before its own length.
    pub(crate) fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// `[ns]` when its first and its last message were received, by its own word.
    pub(crate) fn span_ns(&self) -> RangeInclusive<u64> {
        self.span_ns.clone()
    }

    /// Shows code and body of the next record to `look`; `None` at the end, else what is wrong.
    pub(crate) fn next<T>(&mut self, look: impl FnOnce(u8, &[u8]) -> T) -> Option<Result<T, String>> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::Record { opcode, data }) => return Some(Ok(look(opcode, data))),
                Ok(LinearReadEvent::ReadRequest(_)) => {
                    // There is no more than was given at the start.
                    self.reader.insert(0);
                    self.reader.notify_read(0);
                }
                Err(error) => return Some(Err(error.to_string())),
            }
        }
    }
}

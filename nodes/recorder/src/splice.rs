//! Chunks as they are, compressed once, behind the head of a recording that was made in memory.
//!
//! The head is a small whole file; its data section stands first, the chunks follow, and its summary is written anew with
//! an index of the chunks, so that every reader finds what it finds in a file written in one go.

use crate::frames::{Chunk, Frame, MAGIC, frames, number, opcode, record};
use std::collections::BTreeMap;
use std::io::Write;

/// Groups of a summary, in the order in which they are written.
const GROUPS: [u8; 6] = [
    opcode::SCHEMA,
    opcode::CHANNEL,
    opcode::STATISTICS,
    opcode::CHUNK_INDEX,
    opcode::ATTACHMENT_INDEX,
    opcode::METADATA_INDEX,
];

/// What the summary says of all messages.
struct Tally {
    /// Schemas, channels, attachments and metadata of the head: 14 bytes that chunks do not change.
    kinds: [u8; 14],
    chunks: u32,
    first_ns: u64,
    last_ns: u64,
    counts: BTreeMap<u16, u64>,
}

impl Tally {
    fn of(statistics: &[u8]) -> Self {
        let pairs = &statistics[46..];
        let pair = |pair: &[u8]| (u16::from_le_bytes(number(pair, 0)), u64::from_le_bytes(number(pair, 2)));
        Self {
            kinds: number(statistics, 8),
            chunks: u32::from_le_bytes(number(statistics, 22)),
            first_ns: u64::from_le_bytes(number(statistics, 26)),
            last_ns: u64::from_le_bytes(number(statistics, 34)),
            counts: pairs.chunks_exact(10).map(pair).collect(),
        }
    }

    fn messages(&self) -> u64 {
        self.counts.values().sum()
    }

    fn record(&self) -> Vec<u8> {
        let mut body = self.messages().to_le_bytes().to_vec();
        body.extend_from_slice(&self.kinds);
        body.extend_from_slice(&self.chunks.to_le_bytes());
        body.extend_from_slice(&self.first_ns.to_le_bytes());
        body.extend_from_slice(&self.last_ns.to_le_bytes());
        body.extend_from_slice(&(10 * self.counts.len() as u32).to_le_bytes());
        for (channel, count) in &self.counts {
            body.extend_from_slice(&channel.to_le_bytes());
            body.extend_from_slice(&count.to_le_bytes());
        }
        record(opcode::STATISTICS, &body)
    }

    /// Counts a chunk that stands at `offset`, and says its index record.
    fn take(&mut self, chunk: &Chunk, offset: u64) -> Vec<u8> {
        let mut parts = frames(&chunk.bytes);
        let Some(Frame { body, whole, .. }) = parts.next() else { return Vec::new() };
        let span_ns = chunk.span_ns();
        let any = self.messages() > 0;
        self.first_ns = if any { self.first_ns.min(span_ns.0) } else { span_ns.0 };
        self.last_ns = self.last_ns.max(span_ns.1);
        self.chunks += 1;
        let mut offsets = Vec::new();
        let mut place = offset + whole.len() as u64;
        for index in parts {
            let channel = u16::from_le_bytes(number(index.body, 0));
            *self.counts.entry(channel).or_insert(0) +=
                u64::from(u32::from_le_bytes(number(index.body, 2))) / 16;
            offsets.extend_from_slice(&channel.to_le_bytes());
            offsets.extend_from_slice(&place.to_le_bytes());
            place += index.whole.len() as u64;
        }
        // Body of a chunk: two times, size, checksum, name of the compression, length of the compressed records, these.
        let name_bytes = u32::from_le_bytes(number(body, 28)) as usize;
        let name = &body[28..32 + name_bytes];
        let mut entry = body[..16].to_vec();
        entry.extend_from_slice(&offset.to_le_bytes());
        entry.extend_from_slice(&(whole.len() as u64).to_le_bytes());
        entry.extend_from_slice(&(offsets.len() as u32).to_le_bytes());
        entry.extend_from_slice(&offsets);
        entry.extend_from_slice(&((chunk.bytes.len() - whole.len()) as u64).to_le_bytes());
        entry.extend_from_slice(name);
        entry.extend_from_slice(&number::<8>(body, 32 + name_bytes));
        entry.extend_from_slice(&number::<8>(body, 16));
        record(opcode::CHUNK_INDEX, &entry)
    }
}

/// Writes the recording `head`, made in memory, with `chunks` of the same channels behind it.
///
/// # Errors
/// What the stream says.
pub(crate) fn splice(
    head: &[u8],
    chunks: impl Iterator<Item = Chunk>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let mut summary: BTreeMap<u8, Vec<u8>> = BTreeMap::new();
    let mut data_end = None;
    let mut tally = None;
    for frame in frames(&head[MAGIC.len()..]) {
        match frame.opcode {
            opcode::DATA_END => data_end = Some(frame.whole.as_ptr() as usize - head.as_ptr() as usize),
            opcode::STATISTICS => tally = Some(Tally::of(frame.body)),
            kind if data_end.is_some() => summary.entry(kind).or_default().extend_from_slice(frame.whole),
            _ => {}
        }
    }
    let (Some(data_end), Some(mut tally)) = (data_end, tally) else {
        return Err(std::io::Error::other("the head of a snapshot is not whole"));
    };
    out.write_all(&head[..data_end])?;
    let mut place = data_end as u64;
    for chunk in chunks {
        let index = tally.take(&chunk, place);
        summary.entry(opcode::CHUNK_INDEX).or_default().extend(index);
        out.write_all(&chunk.bytes)?;
        place += chunk.bytes.len() as u64;
    }
    summary.insert(opcode::STATISTICS, tally.record());
    out.write_all(&ending(place, &summary))
}

/// Everything behind the data: its end, the summary, where its groups lie, the footer.
fn ending(place: u64, summary: &BTreeMap<u8, Vec<u8>>) -> Vec<u8> {
    // A checksum of 0 says that there is none.
    let mut bytes = record(opcode::DATA_END, &[0; 4]);
    let summary_at = place + bytes.len() as u64;
    let mut offsets = Vec::new();
    for kind in GROUPS {
        let Some(group) = summary.get(&kind) else { continue };
        let mut offset = vec![kind];
        offset.extend_from_slice(&(place + bytes.len() as u64).to_le_bytes());
        offset.extend_from_slice(&(group.len() as u64).to_le_bytes());
        offsets.extend(record(opcode::SUMMARY_OFFSET, &offset));
        bytes.extend_from_slice(group);
    }
    let offsets_at = place + bytes.len() as u64;
    bytes.extend(offsets);
    let mut footer = summary_at.to_le_bytes().to_vec();
    footer.extend_from_slice(&offsets_at.to_le_bytes());
    footer.extend_from_slice(&[0; 4]);
    bytes.extend(record(opcode::FOOTER, &footer));
    bytes.extend_from_slice(&MAGIC);
    bytes
}

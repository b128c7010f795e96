//! The bytes of an MCAP stream as records, so that a compressed chunk can be kept and put elsewhere as it is.
//!
//! Numbers and layouts are those of the MCAP specification (mcap.dev/spec).

/// First and last bytes of a file.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Kinds of records.
pub(crate) mod opcode {
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const ATTACHMENT_INDEX: u8 = 0x0A;
    pub(crate) const STATISTICS: u8 = 0x0B;
    pub(crate) const METADATA_INDEX: u8 = 0x0D;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0E;
    pub(crate) const DATA_END: u8 = 0x0F;
}

/// Bytes before the body of a record: what it is, and its length.
const LEAD_BYTES: usize = 9;

/// One record within a stream.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame<'a> {
    pub(crate) opcode: u8,
    pub(crate) body: &'a [u8],
    /// All its bytes.
    pub(crate) whole: &'a [u8],
}

/// The whole records at the beginning of `bytes`, one after the other.
pub(crate) fn frames(mut bytes: &[u8]) -> impl Iterator<Item = Frame<'_>> {
    std::iter::from_fn(move || {
        let length = u64::from_le_bytes(bytes.get(1..LEAD_BYTES)?.try_into().ok()?);
        let end = LEAD_BYTES.checked_add(usize::try_from(length).ok()?)?;
        let whole = bytes.get(..end)?;
        bytes = &bytes[end..];
        Some(Frame { opcode: whole[0], body: &whole[LEAD_BYTES..], whole })
    })
}

/// A record with this body.
pub(crate) fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![opcode];
    bytes.extend_from_slice(&(body.len() as u64).to_le_bytes());
    bytes.extend_from_slice(body);
    bytes
}

/// The number of `N` bytes at `offset` of a body that this program wrote itself.
pub(crate) fn number<const N: usize>(body: &[u8], offset: usize) -> [u8; N] {
    let mut bytes = [0; N];
    bytes.copy_from_slice(&body[offset..offset + N]);
    bytes
}

/// A chunk with the indexes of its messages, as they stand in a stream.
#[derive(Debug, Clone)]
pub(crate) struct Chunk {
    pub(crate) bytes: std::sync::Arc<[u8]>,
}

impl Chunk {
    /// `[ns]` log times of its first and last message.
    pub(crate) fn span_ns(&self) -> (u64, u64) {
        let body = &self.bytes[LEAD_BYTES..];
        (u64::from_le_bytes(number(body, 0)), u64::from_le_bytes(number(body, 8)))
    }
}

/// Takes the chunks out of what a stream wrote; the writer ends no call in the middle of a record.
pub(crate) fn take_chunks(written: &mut Vec<u8>) -> Vec<Chunk> {
    let mut places: Vec<std::ops::Range<usize>> = Vec::new();
    let mut place = 0;
    for frame in frames(written) {
        let end = place + frame.whole.len();
        match (frame.opcode, places.last_mut()) {
            (opcode::CHUNK, _) => places.push(place..end),
            (opcode::MESSAGE_INDEX, Some(chunk)) if chunk.end == place => chunk.end = end,
            _ => {}
        }
        place = end;
    }
    // Each in memory of its own exact size, once.
    let chunks = places.into_iter().map(|place| Chunk { bytes: written[place].into() }).collect();
    written.clear();
    chunks
}

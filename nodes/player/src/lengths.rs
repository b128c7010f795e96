//! Whether the lengths within a record fit into it: the library takes memory for a text before it looks whether it is there.

use mcap::records::op;

/// A part of a record, as far as its length matters.
#[derive(Clone, Copy)]
enum Part {
    /// So many bytes.
    Fixed(usize),
    /// A length of four bytes, and as many bytes of text.
    Text,
    /// A length of four bytes, and as many bytes of pairs of texts.
    Texts,
    /// A length of four bytes, and as many bytes of pairs of numbers.
    Numbers,
}

/// `[byte]` number of a channel and place of its index.
const PAIR_BYTES: usize = 2 + 8;

/// The parts of a record up to its last text; what follows is read number by number.
fn parts(opcode: u8) -> &'static [Part] {
    use Part::{Fixed, Numbers, Text, Texts};
    match opcode {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Fixed(2), Text, Text],
        op::CHANNEL => &[Fixed(4), Text, Text, Texts],
        op::CHUNK => &[Fixed(28), Text],
        op::CHUNK_INDEX => &[Fixed(32), Numbers, Fixed(8), Text],
        // The length of the data and their sum follow, which the library does not look for.
        op::ATTACHMENT => &[Fixed(16), Text, Text, Fixed(12)],
        op::ATTACHMENT_INDEX => &[Fixed(40), Text, Text],
        op::METADATA => &[Text, Texts],
        op::METADATA_INDEX => &[Fixed(16), Text],
        _ => &[],
    }
}

/// After a length of four bytes: as many bytes, and what follows them.
fn counted(rest: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = rest.split_first_chunk::<4>()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

/// What follows a part; `None` where it does not fit.
fn behind(part: Part, rest: &[u8]) -> Option<&[u8]> {
    match part {
        Part::Fixed(bytes) => rest.get(bytes..),
        Part::Text => counted(rest).map(|(_, rest)| rest),
        // The library reads whole pairs, beyond the end of the map if that lies within one.
        Part::Numbers => {
            counted(rest).filter(|(pairs, _)| pairs.len().is_multiple_of(PAIR_BYTES)).map(|(_, rest)| rest)
        }
        Part::Texts => {
            let (mut texts, rest) = counted(rest)?;
            while !texts.is_empty() {
                let (_, value) = counted(texts)?;
                texts = counted(value)?.1;
            }
            Some(rest)
        }
    }
}

/// Whether the texts of a record end within it.
pub(crate) fn fit(opcode: u8, body: &[u8]) -> bool {
    parts(opcode).iter().try_fold(body, |rest, part| behind(*part, rest)).is_some()
}

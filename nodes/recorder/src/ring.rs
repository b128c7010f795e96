//! The black box in memory: compressed chunks, the oldest leaving when the newest need their room.

use crate::frames::Chunk;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// A message of a rare topic by its index in the table: header and message.
pub(crate) type Rare = (usize, Arc<[u8]>);

struct Kept {
    chunk: Chunk,
    /// Rare messages within, which a file that begins after this chunk must say anew.
    rare: Vec<Rare>,
}

impl Kept {
    fn bytes(&self) -> usize {
        self.chunk.bytes.len() + self.rare.iter().map(|(_, record)| record.len()).sum::<usize>()
    }
}

/// Chunks of the last seconds, within a number of bytes.
pub(crate) struct Ring {
    kept: VecDeque<Kept>,
    bytes: usize,
    bytes_most: usize,
    /// Newest message of each rare topic from before the oldest chunk.
    standing: BTreeMap<usize, Arc<[u8]>>,
}

/// What a ring holds at a moment; the bytes are shared with it.
pub(crate) struct Contents {
    /// Rare messages that hold from before the first chunk.
    pub(crate) standing: Vec<Rare>,
    /// Oldest first.
    pub(crate) chunks: VecDeque<Chunk>,
    /// `[byte]` all chunks.
    pub(crate) bytes: usize,
    /// `[ns]` log time of the first message.
    pub(crate) begin_ns: u64,
    /// `[ns]` from the first message to the last.
    pub(crate) held_ns: u64,
}

impl Ring {
    pub(crate) fn new(bytes_most: usize) -> Self {
        Self { kept: VecDeque::new(), bytes: 0, bytes_most, standing: BTreeMap::new() }
    }

    /// Keeps chunks that were just closed; `rare` were written since the last ones.
    pub(crate) fn keep(&mut self, chunks: Vec<Chunk>, rare: &mut Vec<Rare>) {
        for chunk in chunks {
            let kept = Kept { chunk, rare: std::mem::take(rare) };
            self.bytes += kept.bytes();
            self.kept.push_back(kept);
        }
        while self.bytes > self.bytes_most {
            let Some(oldest) = self.kept.pop_front() else { break };
            self.bytes -= oldest.bytes();
            self.standing.extend(oldest.rare);
        }
    }

    /// `[ns]` log times of the first and the last message held.
    fn span_ns(&self) -> (u64, u64) {
        let first = self.kept.front().map(|kept| kept.chunk.span_ns().0);
        let last = self.kept.iter().rev().take(2).map(|kept| kept.chunk.span_ns().1).max();
        (first.unwrap_or(0), last.unwrap_or(0))
    }

    /// `[ns]` how far back the ring reaches.
    pub(crate) fn held_ns(&self) -> u64 {
        let (first, last) = self.span_ns();
        last.saturating_sub(first)
    }

    /// What it holds now.
    pub(crate) fn contents(&self) -> Contents {
        let (begin_ns, _) = self.span_ns();
        Contents {
            standing: self.standing.iter().map(|(topic, record)| (*topic, record.clone())).collect(),
            chunks: self.kept.iter().map(|kept| kept.chunk.clone()).collect(),
            bytes: self.kept.iter().map(|kept| kept.chunk.bytes.len()).sum(),
            begin_ns,
            held_ns: self.held_ns(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(first_ns: u64, last_ns: u64, bytes: usize) -> Chunk {
        let mut whole = vec![0; bytes];
        whole[9..17].copy_from_slice(&first_ns.to_le_bytes());
        whole[17..25].copy_from_slice(&last_ns.to_le_bytes());
        Chunk { bytes: whole.into() }
    }

    #[test]
    fn the_oldest_leave_and_what_they_said_for_good_still_holds() {
        let mut ring = Ring::new(1000);
        let path = |byte: u8| vec![(5, Arc::from(vec![byte; 10]))];
        ring.keep(vec![chunk(0, 90, 390)], &mut path(1));
        ring.keep(vec![chunk(100, 190, 390)], &mut path(2));
        assert_eq!((ring.held_ns(), ring.contents().standing.len()), (190, 0));
        ring.keep(vec![chunk(200, 290, 390)], &mut Vec::new());
        let contents = ring.contents();
        assert_eq!((contents.begin_ns, contents.held_ns, contents.chunks.len()), (100, 190, 2));
        assert_eq!(contents.standing, [(5, Arc::from(vec![1; 10]))]);
        for second in 3..50 {
            ring.keep(vec![chunk(100 * second, 100 * second + 90, 390)], &mut Vec::new());
            assert!(ring.bytes <= 1000, "{} bytes", ring.bytes);
        }
        assert_eq!(ring.contents().standing, [(5, Arc::from(vec![2; 10]))]);
    }
}

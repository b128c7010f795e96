//! The encoded messages that one record shows, in memory that is used again.

use super::channels::{VIEW_CHANNELS, ViewChannel};
use foxglove::Encode;
use std::ops::Range;

/// Messages by channel, one after the other.
#[derive(Default)]
pub(crate) struct Sheet {
    bytes: Vec<u8>,
    parts: Vec<(usize, Range<usize>)>,
}

impl Sheet {
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.parts.clear();
    }

    /// Adds what `fill` appends as a message of a channel.
    pub(crate) fn fill(&mut self, channel: usize, fill: impl FnOnce(&mut Vec<u8>)) {
        let from = self.bytes.len();
        fill(&mut self.bytes);
        self.parts.push((channel, from..self.bytes.len()));
    }

    /// Adds a message of a channel.
    pub(crate) fn put(&mut self, channel: usize, message: &impl Encode) {
        self.fill(channel, |bytes| {
            // A vector grows as needed, so encoding into it cannot fail.
            let _ = message.encode(bytes);
        });
    }

    pub(crate) fn parts(&self) -> impl Iterator<Item = (&'static ViewChannel, &[u8])> {
        self.parts.iter().map(|(channel, range)| (&VIEW_CHANNELS[*channel], &self.bytes[range.clone()]))
    }
}

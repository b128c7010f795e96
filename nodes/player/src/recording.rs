//! A recording as a stream of exact messages, in the order of the file or of graph time.

use crate::error::PlayerError;
use crate::message::{Decoder, Entry};
use crate::scan::Scan;
use crate::selection::Renamed;
use mcap::records::Record;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::Path;

/// `[ns]` messages that the recorder received within this span of each other are brought into order.
const ORDER_WINDOW_NS: u64 = 1_000_000_000;
/// `[byte]` messages held to be brought into order: more within a second is no recording, and memory stays bounded.
const HELD_BYTES_MAX: usize = 256 << 20;
/// Names of foreign channels that an error lists.
const NAMES_MOST: usize = 12;

/// Messages in the order in which the recorder received them.
pub struct Messages {
    scan: Scan,
    decoder: Decoder,
    failed: bool,
    other_channels: Vec<String>,
}

impl std::fmt::Debug for Messages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Messages").field("path", &self.scan.path()).finish_non_exhaustive()
    }
}

impl Messages {
    /// Opens a recording, complete or cut.
    ///
    /// # Errors
    /// [`PlayerError::Read`] or [`PlayerError::NotMcap`].
    pub fn open(path: &Path) -> Result<Self, PlayerError> {
        Self::renaming(path, Renamed::default())
    }

    /// As [`Messages::open`], with other names for some channels.
    pub(crate) fn renaming(path: &Path, renamed: Renamed) -> Result<Self, PlayerError> {
        let (scan, decoder) = (Scan::open(path)?, Decoder::renaming(renamed));
        Ok(Self { scan, decoder, failed: false, other_channels: Vec::new() })
    }

    /// After the last message: where and why the file ends early, or `None` for a complete one.
    #[must_use]
    pub fn damage(&self) -> Option<&str> {
        self.scan.damage()
    }

    fn step(&mut self) -> Option<Result<Option<Entry>, PlayerError>> {
        let path = self.scan.path().to_path_buf();
        let (decoder, others) = (&mut self.decoder, &mut self.other_channels);
        let outcome = self.scan.next(|record| match record {
            Record::Channel(channel) => {
                if others.len() < NAMES_MOST && !others.contains(&channel.topic) {
                    others.push(channel.topic.clone());
                }
                decoder.channel(channel, &path).map(|()| None)
            }
            Record::Message { header, data } => decoder.message(header, data, &path),
            _ => Ok(None),
        })?;
        Some(outcome.and_then(|decoded| decoded))
    }
}

impl Iterator for Messages {
    type Item = Result<Entry, PlayerError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.failed {
            match self.step() {
                Some(Ok(Some(entry))) => return Some(Ok(entry)),
                Some(Ok(None)) => {}
                Some(Err(error)) => {
                    self.failed = true;
                    return Some(Err(error));
                }
                None => {
                    self.failed = true;
                    if !self.decoder.knows_a_topic() {
                        let path = self.scan.path().to_path_buf();
                        let found = match self.other_channels.join(", ") {
                            none if none.is_empty() => "no channel at all".into(),
                            names => names,
                        };
                        return Some(Err(PlayerError::Foreign { path, found }));
                    }
                }
            }
        }
        None
    }
}

/// A message with its place: epoch, graph time of its step, topic of the table, incarnation, sequence.
struct Placed((u32, u64, usize, u32, u64), Entry);

impl Placed {
    fn new(entry: Entry) -> Self {
        let header = &entry.header;
        Self((header.epoch, header.now_ns, entry.topic, header.incarnation, header.sequence), entry)
    }
}

impl PartialEq for Placed {
    fn eq(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}

impl Eq for Placed {}

impl PartialOrd for Placed {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Placed {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.cmp(&other.0)
    }
}

/// Messages in the order of graph time; at the same time in the order of the topic table, then by sequence.
///
/// The recorder empties one inbox after the other, so its order is off by some milliseconds. Messages within one
/// second of receipt are ordered; memory holds no more than that second.
#[derive(Debug)]
pub struct Ordered {
    messages: Messages,
    held: BinaryHeap<Reverse<Placed>>,
    held_bytes: usize,
    newest_ns: u64,
    ended: bool,
}

fn held_bytes(entry: &Entry) -> usize {
    size_of::<Placed>() + entry.message.len()
}

impl std::fmt::Debug for Placed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl Ordered {
    /// Opens a recording, complete or cut.
    ///
    /// # Errors
    /// As [`Messages::open`].
    pub fn open(path: &Path) -> Result<Self, PlayerError> {
        Self::of(Messages::open(path)?)
    }

    /// As [`Ordered::open`], with other names for some channels.
    pub(crate) fn renaming(path: &Path, renamed: Renamed) -> Result<Self, PlayerError> {
        Self::of(Messages::renaming(path, renamed)?)
    }

    fn of(messages: Messages) -> Result<Self, PlayerError> {
        Ok(Self { messages, held: BinaryHeap::new(), held_bytes: 0, newest_ns: 0, ended: false })
    }

    /// As [`Messages::damage`].
    #[must_use]
    pub fn damage(&self) -> Option<&str> {
        self.messages.damage()
    }
}

impl Iterator for Ordered {
    type Item = Result<Entry, PlayerError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let first_logged_ns = self.held.peek().map(|Reverse(Placed(_, entry))| entry.logged_ns);
            let ripe = |logged_ns: u64| logged_ns.saturating_add(ORDER_WINDOW_NS) < self.newest_ns;
            if first_logged_ns.is_some_and(ripe) || self.ended || self.held_bytes > HELD_BYTES_MAX {
                let Reverse(Placed(_, entry)) = self.held.pop()?;
                self.held_bytes -= held_bytes(&entry);
                return Some(Ok(entry));
            }
            match self.messages.next() {
                Some(Ok(entry)) => {
                    self.newest_ns = self.newest_ns.max(entry.logged_ns);
                    self.held_bytes += held_bytes(&entry);
                    self.held.push(Reverse(Placed::new(entry)));
                }
                Some(Err(error)) => return Some(Err(error)),
                None => self.ended = true,
            }
        }
    }
}

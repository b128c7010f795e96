//! What a playback publishes: the driver's topics of a recording, read ahead of time.
//!
//! Only what a driver writes is played; the graph makes the rest anew. Decompression happens in a thread of its own,
//! a bounded number of messages ahead, so that no message is late because the disk was.

use crate::error::PlayerError;
use crate::message::Entry;
use crate::recording::Ordered;
use crate::selection::Selection;
use crossbeam::channel::{Receiver, bounded};
use sidestep_msgs::{DEPTH, ODOMETRY, PATH, RANGES, SCAN, TARGET, TOPICS};
use std::path::{Path, PathBuf};

/// The topics that are played.
pub const PLAYED: [usize; 6] =
    [DEPTH.index, SCAN.index, ODOMETRY.index, RANGES.index, PATH.index, TARGET.index];
/// Messages read ahead; the largest has 0.6 MB.
const READ_AHEAD: usize = 32;

/// The driver's messages of one pass through a recording, in order of graph time.
#[derive(Debug)]
pub struct Played {
    ordered: Ordered,
    selection: Selection,
    start_ns: Option<u64>,
    /// Newest message from before the start, for topics that are sent on demand: a path holds until the next one.
    standing: Vec<Entry>,
    first: Option<Entry>,
}

fn is_on_demand(entry: &Entry) -> bool {
    TOPICS[entry.topic].rate_hz <= 0.0
}

impl Played {
    /// Begins before the first message that is selected.
    ///
    /// # Errors
    /// As [`Ordered::open`].
    pub fn open(path: &Path, selection: &Selection) -> Result<Self, PlayerError> {
        let ordered = Ordered::renaming(path, selection.renamed())?;
        Ok(Self { ordered, selection: selection.clone(), start_ns: None, standing: Vec::new(), first: None })
    }

    /// `[ns]` graph time of the start, once a message of a steady topic came: what is sent on demand may be older than the
    /// file, at whose head it was said anew.
    fn start_ns(&mut self, entry: &Entry) -> Option<u64> {
        if self.start_ns.is_none() && !is_on_demand(entry) {
            self.start_ns = Some(entry.header.now_ns.saturating_add(self.selection.offset_ns));
        }
        self.start_ns
    }

    /// Keeps what stands from before the start; hands back what comes after it.
    fn after_start(&mut self, entry: Entry) -> Option<Entry> {
        if self.start_ns(&entry).is_some_and(|start_ns| entry.header.now_ns >= start_ns) {
            return Some(entry);
        }
        if is_on_demand(&entry) {
            self.standing.retain(|old| old.topic != entry.topic);
            self.standing.push(entry);
        }
        None
    }
}

impl Iterator for Played {
    type Item = Result<Entry, PlayerError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(entry) = self.first.take() {
            return Some(Ok(entry));
        }
        loop {
            let entry = match self.ordered.next()? {
                Ok(entry) if PLAYED.contains(&entry.topic) => entry,
                Ok(_) => continue,
                Err(error) => return Some(Err(error)),
            };
            let end_ns = self.start_ns.map(|start_ns| start_ns.saturating_add(self.selection.duration_ns));
            if end_ns.is_some_and(|end_ns| entry.header.now_ns >= end_ns) {
                return None;
            }
            if !self.selection.plays(entry.topic) {
                // Not played, but it still says where the recording begins.
                self.start_ns(&entry);
                continue;
            }
            if let Some(entry) = self.after_start(entry) {
                let Some(mut standing) = self.standing.pop() else { return Some(Ok(entry)) };
                // Said anew at the start, as whoever sent it would.
                standing.header.now_ns = entry.header.now_ns;
                self.first = Some(entry);
                return Some(Ok(standing));
            }
        }
    }
}

/// What comes next.
#[derive(Debug)]
pub enum Next {
    /// A message.
    Message(Box<Entry>),
    /// The recording begins here or begins again: graph time jumps to the stamp of the message that follows.
    Jump,
}

/// A [`Played`] that is read ahead by a thread.
#[derive(Debug)]
pub struct Feed {
    ahead: Receiver<Result<Next, PlayerError>>,
    peeked: Option<Next>,
}

impl Feed {
    /// Starts to read; `repeat` begins again at each end.
    ///
    /// # Errors
    /// As [`Ordered::open`], and [`PlayerError::Read`] where the system has no thread to give.
    pub fn start(path: &Path, selection: &Selection, repeat: bool) -> Result<Self, PlayerError> {
        let first = Played::open(path, selection)?;
        let selection = selection.clone();
        let (give, ahead) = bounded(READ_AHEAD);
        let path_again = path.to_path_buf();
        let read = move || {
            let send = |next| give.send(next).is_ok();
            let mut pass = Ok(first);
            while let Ok(played) = pass {
                let Some(any) = read_pass(played, &send) else { return };
                if !repeat || !any {
                    return;
                }
                pass = Played::open(&path_again, &selection);
            }
            let _ = pass.map_err(|error| send(Err(error)));
        };
        let thread = std::thread::Builder::new().name("player-reader".into()).spawn(read);
        thread.map_err(|source| PlayerError::Read { path: PathBuf::from(path), source })?;
        Ok(Self { ahead, peeked: None })
    }

    /// What comes next, without taking it; `None` at the end.
    ///
    /// # Errors
    /// What the reader met.
    pub fn peek(&mut self) -> Result<Option<&Next>, PlayerError> {
        if self.peeked.is_none() {
            self.peeked = self.ahead.recv().ok().transpose()?;
        }
        Ok(self.peeked.as_ref())
    }

    /// Takes what [`Feed::peek`] showed.
    pub fn take(&mut self) -> Option<Next> {
        self.peeked.take()
    }
}

/// Hands on one pass; whether there was any message, or `None` where nobody takes them any more.
fn read_pass(played: Played, send: &impl Fn(Result<Next, PlayerError>) -> bool) -> Option<bool> {
    let mut epoch = None;
    for outcome in played {
        let entry = match outcome {
            Ok(entry) => entry,
            Err(error) => {
                send(Err(error));
                return None;
            }
        };
        if epoch.replace(entry.header.epoch) != Some(entry.header.epoch) && !send(Ok(Next::Jump)) {
            return None;
        }
        if !send(Ok(Next::Message(Box::new(entry)))) {
            return None;
        }
    }
    Some(epoch.is_some())
}

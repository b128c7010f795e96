//! The black box: the last seconds in memory, written into a file of their own when something happens.
//!
//! A snapshot is written by a thread of its own that shares the chunks with the ring: neither the running file nor the
//! inboxes wait for it. One at a time; what is asked meanwhile follows.

use crate::error::RecordError;
use crate::file::DiskFile;
use crate::frames::Chunk;
use crate::name::date_time;
use crate::progress::Progress;
use crate::ring::{Contents, Rare, Ring};
use crate::space::Space;
use crate::splice::splice;
use crate::trouble::{Cause, Watch};
use crate::writer::{Origin, Writer};
use sidestep_msgs::TOPICS;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// `[ns]` a trouble is kept with this much of what follows it.
const AFTER_NS: u64 = 1_000_000_000;

/// A snapshot to be written.
#[derive(Debug, Clone, Copy)]
struct Due {
    cause: Cause,
    token: Option<u64>,
    at_ns: u64,
}

/// The last seconds, and who writes them down.
pub(crate) struct BlackBox {
    ring: Ring,
    watch: Watch,
    due: Option<Due>,
    thread: Option<JoinHandle<Result<(), RecordError>>>,
    failed: Option<RecordError>,
    folder: PathBuf,
    origin: Origin,
    space: Space,
    progress: Arc<Progress>,
}

/// Writes a snapshot and says where it lies.
fn write(path: &Path, origin: &Origin, contents: Contents) -> Result<PathBuf, RecordError> {
    let name = path.display().to_string();
    let mut head = Writer::new(Vec::new(), &name, origin)?;
    let begin_ns = contents.begin_ns.saturating_add_signed(-origin.mono_to_wall_ns);
    for (topic, record) in &contents.standing {
        head.write_record(&TOPICS[*topic], record, begin_ns)?;
    }
    let head = head.finish(&[])?;
    let mut file = DiskFile::create(path)?;
    let mut chunks = contents.chunks;
    // Each chunk is given back as soon as it is written.
    let chunks = std::iter::from_fn(|| chunks.pop_front());
    let spliced = splice(&head, chunks, &mut file).and_then(|()| file.flush());
    spliced.map_err(|error| RecordError::write(&name, &error.into()))?;
    file.complete()
}

impl BlackBox {
    pub(crate) fn new(
        mb_most: u64,
        folder: &Path,
        origin: Origin,
        space: Space,
        progress: Arc<Progress>,
    ) -> Self {
        let ring = Ring::new(mb_most as usize * 1_000_000);
        let (watch, folder) = (Watch::default(), folder.to_path_buf());
        Self { ring, watch, due: None, thread: None, failed: None, folder, origin, space, progress }
    }

    /// Looks at a record for a cause to keep what is held.
    pub(crate) fn see(&mut self, topic: usize, record: &[u8], received_ns: u64) {
        let Some(cause) = self.watch.see(topic, record, received_ns) else { return };
        let due = self.due.get_or_insert(Due { cause, token: None, at_ns: received_ns + AFTER_NS });
        if let Cause::Asked(token) = cause {
            (due.token, due.at_ns) = (Some(token), received_ns);
        }
    }

    /// Keeps chunks that were just closed.
    pub(crate) fn keep(&mut self, chunks: Vec<Chunk>, rare: &mut Vec<Rare>) {
        if !chunks.is_empty() {
            self.ring.keep(chunks, rare);
            self.progress.hold(self.ring.held_ns());
        }
    }

    /// Whether a snapshot should be written at a host time, and none is being written.
    pub(crate) fn is_due(&self, host_ns: u64) -> bool {
        let busy = self.thread.as_ref().is_some_and(|thread| !thread.is_finished());
        !busy && self.due.is_some_and(|due| host_ns >= due.at_ns)
    }

    /// Begins to write what is due; the chunk in work must be closed and kept before.
    pub(crate) fn write_due(&mut self) {
        self.join();
        let Some(Due { cause, token, .. }) = self.due.take() else { return };
        let contents = self.ring.contents();
        let mut origin = self.origin.clone();
        origin.metadata.push(("snapshot".into(), cause.to_string()));
        origin.metadata.push(("held_s".into(), format!("{:.1}", contents.held_ns as f64 * 1e-9)));
        let wall_ns = contents.begin_ns + contents.held_ns;
        let path = self.folder.join(format!("snapshot-{}.mcap", date_time(wall_ns)));
        let (space, progress) = (self.space.clone(), self.progress.clone());
        let thread = std::thread::Builder::new().name("recorder-snapshot".into()).spawn(move || {
            space.has_room_for(contents.bytes as u64, &path)?;
            let path = write(&path, &origin, contents)?;
            progress.keep_snapshot(path, token);
            Ok(())
        });
        match thread {
            Ok(thread) => self.thread = Some(thread),
            Err(error) => self.failed = Some(RecordError::Thread(error.to_string())),
        }
    }

    fn join(&mut self) {
        let ended = self.thread.take().map(JoinHandle::join);
        let failed = match ended {
            Some(Ok(Err(error))) => Some(error),
            Some(Err(_)) => Some(RecordError::Thread("of a snapshot ended by a panic".into())),
            None | Some(Ok(Ok(()))) => None,
        };
        self.failed = self.failed.take().or(failed);
    }

    /// Writes what is still due and waits for it.
    ///
    /// # Errors
    /// The first snapshot that could not be written.
    pub(crate) fn end(mut self) -> Result<(), RecordError> {
        self.write_due();
        self.join();
        self.failed.map_or(Ok(()), Err)
    }
}

//! What a node wants to know again after it was killed.

use crate::boot::Boot;
use crate::step::Step;
use std::fs;
use std::path::PathBuf;

/// `[ns]` graph time between two writings.
const KEEP_EVERY_NS: u64 = 500_000_000;

/// A node's memory in the run's shared memory, written now and then, gone with the run.
///
/// It lies in memory, not on a disk: it must outlive a process, not a machine, and a robot's flash is not for that.
#[derive(Debug)]
pub struct Keepsake {
    path: PathBuf,
    due_ns: u64,
    bytes: Vec<u8>,
}

impl Keepsake {
    /// The keepsake of this node, with room for `size` bytes.
    #[must_use]
    pub fn new(boot: &Boot, size: usize) -> Self {
        let name = format!("{}{}.keepsake", boot.domain.prefix, boot.node);
        Self { path: PathBuf::from("/dev/shm").join(name), due_ns: 0, bytes: vec![0; size] }
    }

    /// What an earlier life of this node wrote, if it lived long enough to.
    #[must_use]
    pub fn read(&self) -> Option<Vec<u8>> {
        fs::read(&self.path).ok()
    }

    /// Lets the node write, if it is time; a memory that is full costs the keepsake, never the step.
    pub fn keep(&mut self, step: &Step, write: impl FnOnce(&mut [u8]) -> usize) {
        // Due later than one period from now, it belongs to a time that a driver set back.
        if (1..=KEEP_EVERY_NS).contains(&self.due_ns.saturating_sub(step.now_ns())) {
            return;
        }
        self.due_ns = step.now_ns() + KEEP_EVERY_NS;
        let size = write(&mut self.bytes);
        // Renamed when complete: a kill in between leaves the one before.
        let draft = self.path.with_extension("draft");
        if fs::write(&draft, &self.bytes[..size]).is_ok() {
            let _ = fs::rename(&draft, &self.path);
        }
    }
}

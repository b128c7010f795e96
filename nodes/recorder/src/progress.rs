//! What the writer thread tells the thread that empties the inboxes.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// What a recorder has begun and kept so far.
#[derive(Debug, Default)]
pub struct Progress {
    files: AtomicU64,
    held_ns: AtomicU64,
    /// Number of snapshots, token of the last one that was asked for, and where the newest lies.
    snapshots: Mutex<(u64, u64, Option<PathBuf>)>,
}

impl Progress {
    pub(crate) fn begin_file(&self) {
        self.files.fetch_add(1, Ordering::AcqRel);
    }

    pub(crate) fn hold(&self, held_ns: u64) {
        self.held_ns.store(held_ns, Ordering::Release);
    }

    pub(crate) fn keep_snapshot(&self, path: PathBuf, token: Option<u64>) {
        let mut kept = self.snapshots.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = (kept.0 + 1, token.unwrap_or(kept.1), Some(path));
    }

    /// Files begun.
    #[must_use]
    pub fn files(&self) -> u64 {
        self.files.load(Ordering::Acquire)
    }

    /// `[s]` how far back the black box reaches.
    #[must_use]
    pub fn held_s(&self) -> f32 {
        self.held_ns.load(Ordering::Acquire) as f32 * 1e-9
    }

    /// Snapshots written, the token of the last one that was asked for (0 = none), and where the newest lies.
    #[must_use]
    pub fn snapshots(&self) -> (u64, u64, Option<PathBuf>) {
        self.snapshots.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

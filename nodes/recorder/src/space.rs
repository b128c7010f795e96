//! How much room the disk has left.

use crate::error::RecordError;
use std::path::{Path, PathBuf};

/// `[ns]` host time between two looks at the disk.
const LOOK_EVERY_NS: u64 = 1_000_000_000;
const MEGABYTE: u64 = 1_000_000;

/// `[byte]` what this user may still write where a path lies.
fn free_bytes(path: &Path) -> std::io::Result<u64> {
    let disk = rustix::fs::statvfs(path)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Sees to it that a recording ends before the disk is full.
#[derive(Debug, Clone)]
pub(crate) struct Space {
    folder: PathBuf,
    bytes_least: u64,
    due_ns: u64,
    /// `[byte]` written at the last look.
    looked_bytes: u64,
    /// Asks the system; a test has a disk of its own.
    pub(crate) free: fn(&Path) -> std::io::Result<u64>,
}

impl Space {
    /// Keeps `mb_least` megabytes free where `folder` lies; 0 = never looks.
    pub(crate) fn new(folder: &Path, mb_least: u64) -> Self {
        let (folder, bytes_least) = (folder.to_path_buf(), mb_least * MEGABYTE);
        Self { folder, bytes_least, due_ns: 0, looked_bytes: 0, free: free_bytes }
    }

    /// Whether `more` bytes fit on the disk.
    ///
    /// # Errors
    /// [`RecordError::Space`].
    pub(crate) fn has_room_for(&self, more: u64, path: &Path) -> Result<(), RecordError> {
        let needed = self.bytes_least + more;
        // A disk that does not tell is written to until it refuses.
        let free =
            if self.bytes_least == 0 { u64::MAX } else { (self.free)(&self.folder).unwrap_or(u64::MAX) };
        if free >= needed {
            return Ok(());
        }
        let (found_mb, needed_mb) = (free / MEGABYTE, needed.div_ceil(MEGABYTE));
        Err(RecordError::Space { path: path.to_path_buf(), found_mb, needed_mb })
    }

    /// As [`Space::has_room_for`] nothing more, once a second of host time and whenever a quarter of what must stay free was
    /// written to the file in work.
    pub(crate) fn look(&mut self, host_ns: u64, written_bytes: u64, path: &Path) -> Result<(), RecordError> {
        let much = written_bytes.abs_diff(self.looked_bytes) > self.bytes_least / 4;
        if host_ns < self.due_ns && !much {
            return Ok(());
        }
        (self.due_ns, self.looked_bytes) = (host_ns + LOOK_EVERY_NS, written_bytes);
        self.has_room_for(0, path)
    }
}

//! Why a recording could not be made or went no further.

use std::path::PathBuf;

/// Why a recording could not be made or went no further. The drive goes on without it.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file or its folder cannot be made.
    #[error("recording {path}: cannot be created: {source}; name a folder that can be written")]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Writing failed, as on a full disk.
    #[error(
        "recording {path}: ended early, {detail}; what was written is kept and can be read; free space before the next run"
    )]
    Write {
        /// The file, or the name of the stream.
        path: String,
        /// What the system said.
        detail: String,
    },
    /// The disk has less room left than the recording leaves to others.
    #[error(
        "recording {path}: ended in order before the disk is full: {found_mb} MB free, needed: {needed_mb} MB; free space, or lower recorder.free_mb_least"
    )]
    Space {
        /// The file, which is complete, or the one that was not begun.
        path: PathBuf,
        /// `[MB]` free.
        found_mb: u64,
        /// `[MB]` wanted free.
        needed_mb: u64,
    },
    /// Messages are missing.
    #[error(
        "recording {path}: is complete but for messages that were lost: {detail}; needed: none; raise recorder.queue_large and queue_small, exclude topics, or take a faster disk"
    )]
    Lost {
        /// The last file.
        path: PathBuf,
        /// Topics and counts.
        detail: String,
    },
    /// The finished file could not get its name.
    #[error("recording {path}: is complete but could not be renamed from {active}: {source}")]
    Rename {
        /// The name it should have.
        path: PathBuf,
        /// The name it has.
        active: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The writer thread could not be started or did not end in order.
    #[error("recording: the writer thread {0}")]
    Thread(String),
}

impl RecordError {
    /// The error of a failed write to `name`.
    pub(crate) fn write(name: &str, error: &mcap::McapError) -> Self {
        let detail = match error {
            mcap::McapError::Io(source) => source.to_string(),
            other => other.to_string(),
        };
        Self::Write { path: name.into(), detail }
    }
}

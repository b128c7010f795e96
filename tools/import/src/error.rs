//! Why a folder cannot be imported: path, found, needed, remedy.

use sidestep_recorder::RecordError;
use std::path::{Path, PathBuf};

/// Why a folder cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("{path}: {source}; {remedy}")]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// A file is not what it must be.
    #[error("{path}: found {found}, needed {needed}; {remedy}")]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What it holds.
        found: String,
        /// What it must hold.
        needed: String,
        /// What to do.
        remedy: &'static str,
    },
    /// An option cannot be.
    #[error("{option} is {found}, needed: {needed}")]
    Setting {
        /// The option.
        option: &'static str,
        /// Its value.
        found: f64,
        /// Its range.
        needed: &'static str,
    },
    /// The recording could not be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}

impl ImportError {
    pub(crate) fn content(
        path: &Path,
        found: impl Into<String>,
        needed: impl Into<String>,
        remedy: &'static str,
    ) -> Self {
        Self::Content { path: path.to_path_buf(), found: found.into(), needed: needed.into(), remedy }
    }
}

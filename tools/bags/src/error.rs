//! Why a bag cannot be read or written: found, needed, remedy.

use sidestep_import::ImportError;
use sidestep_player::PlayerError;
use sidestep_recorder::RecordError;
use std::path::{Path, PathBuf};

/// Why a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// A file or folder cannot be read or made.
    #[error("{path}: {source}; {remedy}")]
    Access {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// The bag does not hold what is needed.
    #[error("{path}: found {found}, needed {needed}; {remedy}")]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What it holds.
        found: String,
        /// What it must hold.
        needed: String,
        /// What to do.
        remedy: String,
    },
    /// The bag leaves a choice that an option must make.
    #[error("{path}: {found}; {remedy}")]
    Choice {
        /// The file or folder.
        path: PathBuf,
        /// What there is to choose from.
        found: String,
        /// The option, with an example.
        remedy: String,
    },
    /// A file cannot be read as MCAP.
    #[error(transparent)]
    Read(#[from] PlayerError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
}

impl BagError {
    /// Whether an option of the command, and not the bag, is what must change.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Choice { .. })
    }

    pub(crate) fn content(
        path: &Path,
        found: impl Into<String>,
        needed: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (found, needed, remedy) = (found.into(), needed.into(), remedy.into());
        Self::Content { path: path.to_path_buf(), found, needed, remedy }
    }

    pub(crate) fn choice(path: &Path, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Choice { path: path.to_path_buf(), found: found.into(), remedy: remedy.into() }
    }
}

impl From<ImportError> for BagError {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Read { path, source, remedy } => Self::Access { path, source, remedy },
            ImportError::Content { path, found, needed, remedy } => {
                Self::Content { path, found, needed, remedy: remedy.into() }
            }
            ImportError::Record(error) => Self::Write(error),
        }
    }
}

//! Why a bag cannot be read or written: found, needed, remedy.

use sidestep_import::ImportError;
use sidestep_player::PlayerError;
use sidestep_recorder::RecordError;
use std::path::{Path, PathBuf};

/// Why a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// What an import of images and bags can both meet.
    #[error(transparent)]
    Import(#[from] ImportError),
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
        matches!(self, Self::Choice { .. } | Self::Import(ImportError::Setting { .. }))
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

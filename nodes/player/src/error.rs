//! Why a recording cannot be read: what was found, what is needed, what to do.

use std::path::{Path, PathBuf};

/// Why a recording cannot be read or played.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// The file cannot be opened or read.
    #[error("recording {path}: {source}; give the path of an .mcap or .mcap.active file")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not an MCAP file.
    #[error("recording {path}: not an MCAP file ({found}); {remedy}")]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What it is instead, or its first bytes.
        found: String,
        /// What to do with it.
        remedy: &'static str,
    },
    /// No channel of the file is a topic of the table.
    #[error("recording {path}: holds no topic of sidestep, only {found}; give a recording made by sidestep")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The channels that it does hold.
        found: String,
    },
    /// A topic was recorded with another layout.
    #[error(
        "recording {path}: topic {topic} has layout {found}, this version needs {needed}; \
         use the version of sidestep that `sidestep info` names"
    )]
    Layout {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Hash in the file.
        found: String,
        /// Hash of this version.
        needed: String,
    },
    /// A message is not what its channel promises.
    #[error("recording {path}: {detail}; the file is damaged, `sidestep info` says how far it can be read")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        detail: String,
    },
    /// A setting of the playback cannot be.
    #[error("player: {key} is {found}, needed: {needed}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: f64,
        /// Its range.
        needed: &'static str,
    },
}

impl PlayerError {
    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { path: path.to_path_buf(), source }
    }

    pub(crate) fn damaged(path: &Path, detail: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_path_buf(), detail: detail.into() }
    }
}

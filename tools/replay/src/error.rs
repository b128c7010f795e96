//! Why a recording cannot be replayed: what was found, what is needed, what to do.

use sidestep_player::PlayerError;
use std::path::PathBuf;

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The recording cannot be read.
    #[error(transparent)]
    Player(#[from] PlayerError),
    /// The recording lacks what a replay begins with.
    #[error("recording {path}: holds no {what}; {remedy}")]
    Missing {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// The recording was driven by a model that is neither within nor in this program.
    #[error(
        "recording {path}: the policy was model {name} with hash {found}, this program holds {held}; \
         name the file with --model"
    )]
    Model {
        /// The file.
        path: PathBuf,
        /// The model's name in the recording.
        name: String,
        /// Its hash.
        found: String,
        /// The hash of the embedded model.
        held: String,
    },
    /// A node refuses its configuration, robot or model.
    #[error("{0}")]
    Refused(String),
    /// The system has no thread to give.
    #[error("replay: no thread to read ahead: {0}")]
    Thread(std::io::Error),
}

//! Why a recording tells nothing about the base.

use sidestep_player::PlayerError;

/// Why nothing could be identified.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The recording cannot be read.
    #[error(transparent)]
    Player(#[from] PlayerError),
    /// The sensors were a recording: no command moved them.
    #[error("{0}: its commands were open loop and moved nothing; needed: a recording of a drive")]
    OpenLoop(String),
    /// No commands, or no odometry.
    #[error("{path}: {commands} commands and {odometry} odometry messages; needed: both, of a drive")]
    Empty {
        /// The file.
        path: String,
        /// Commands found.
        commands: usize,
        /// Odometry messages found.
        odometry: usize,
    },
}

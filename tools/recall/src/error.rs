//! Why nothing could be measured.

/// Why recall could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum RecallError {
    /// The mapper refuses its configuration.
    #[error("recall: {0}")]
    Mapper(#[from] sidestep_mapper::ConfigError),
    /// The guard refuses its configuration.
    #[error("recall: {0}")]
    Guard(#[from] sidestep_guard::ConfigError),
    /// A robot that sees no depth.
    #[error(
        "recall: robot {robot} has no depth camera, needed: one to render; give --robot a file with [camera]"
    )]
    Blind {
        /// Its name.
        robot: String,
    },
    /// An option that makes no sense.
    #[error("recall: {option} is {found}, needed: {needed}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is needed.
        needed: &'static str,
    },
}

//! Why an evaluation could not be made.

use sidestep_drive::DriveError;
use sidestep_policy::ModelError;
use sidestep_report::ReportError;

/// Why an evaluation could not be made.
#[derive(Debug, thiserror::Error)]
pub enum NavigateError {
    /// A model that is refused.
    #[error("navigate: {0}")]
    Model(#[from] ModelError),
    /// A node that refuses its configuration or the robot.
    #[error("navigate: {0}")]
    Drive(#[from] DriveError),
    /// A picture that cannot be made.
    #[error("navigate: {0}")]
    Report(#[from] ReportError),
    /// Numbers that cannot be written.
    #[error("navigate: the numbers cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A ledger that cannot be read or written.
    #[error(
        "navigate: {path}: {detail}; needed: a ledger of `--suite long` in a folder that may be written; name another with --ledger"
    )]
    Ledger {
        /// The file.
        path: String,
        /// What is wrong.
        detail: String,
    },
    /// An option that makes no sense.
    #[error("navigate: {option} is {found}, needed: {needed}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is needed.
        needed: &'static str,
    },
}

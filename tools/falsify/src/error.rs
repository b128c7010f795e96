//! Why nothing could be falsified.

use crate::scenario::GENES;
use sidestep_arbiter::ConfigError;
use sidestep_report::ReportError;

/// Why a search or a replay could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FalsifyError {
    /// The arbiter refuses its configuration or the robot.
    #[error("falsify: {0}")]
    Arbiter(#[from] ConfigError),
    /// An option that makes no sense.
    #[error("falsify: {option} is {found}, needed: {needed}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is needed.
        needed: &'static str,
    },
    /// A word that is no case.
    #[error(
        "falsify: --case has {found}, needed: NAME:DIGITS with `inside` or an assumption as name and {} hexadecimal \
         digits; copy a whole case from a report of this version",
        4 * GENES
    )]
    Case {
        /// What was given.
        found: String,
    },
    /// A picture that cannot be made.
    #[error("falsify: {0}")]
    Report(#[from] ReportError),
}

//! Why recordings cannot be compared: what was found, what is needed, what to do.

use std::path::PathBuf;

/// Why recordings cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] sidestep_player::PlayerError),
    /// A proposer never spoke.
    #[error(
        "recording {path}: no {needed} in it; record a drive in which policy and expert run, \
         or play this one with --record"
    )]
    NoProposals {
        /// The file.
        path: PathBuf,
        /// The topics without a message.
        needed: String,
    },
    /// The proposers spoke, but never both of one frame and to good purpose.
    #[error(
        "recording {path}: {frames} frames with a map, none on which both proposers had work to do; \
         record a drive with a path or a target"
    )]
    NoPair {
        /// The file.
        path: PathBuf,
        /// Frames with a map.
        frames: u64,
    },
    /// The file that says what the robot is, or how it was driven, is missing or unfit.
    #[error("recording {path}: its {file} {detail}; record with `sidestep run` or `sidestep play --record`")]
    Origin {
        /// The recording.
        path: PathBuf,
        /// The file within.
        file: &'static str,
        /// What is wrong.
        detail: String,
    },
    /// Two recordings of different robots.
    #[error("{a} and {b}: recorded with robots of other limits or footprint; compare drives of one robot")]
    OtherRobot {
        /// First file.
        a: PathBuf,
        /// Second file.
        b: PathBuf,
    },
    /// Two recordings that share no frame.
    #[error(
        "{a} and {b}: {held} frames of equal number and depth stamp, on {same} of them the same map, goal and velocity; \
         needed are two replays of the same sensors"
    )]
    NoCommonFrame {
        /// First file.
        a: PathBuf,
        /// Second file.
        b: PathBuf,
        /// Frames of equal number and stamp.
        held: u64,
        /// Of these, with equal inputs.
        same: u64,
    },
    /// Nothing to read where something was named.
    #[error("{option} is {found}, needed: {needed}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        found: String,
        /// Its range.
        needed: &'static str,
    },
    /// The data set cannot be written.
    #[error(transparent)]
    Dataset(#[from] sidestep_train::TrainError),
    /// The report cannot be made.
    #[error(transparent)]
    Report(#[from] sidestep_report::ReportError),
}

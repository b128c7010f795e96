//! `sidestep recall`: how often mapper and guard know what stands in the way before it is too late to brake.

use crate::failure::Failure;
use crate::learning::threads;
use crate::manifest::robot_named;
use clap::Args;
use sidestep_recall::{CLASSES, Options, measure, speeds_m_s};
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Args)]
pub(crate) struct RecallArguments {
    /// Trials of each class at each speed.
    #[arg(long, default_value_t = 100)]
    trials: u64,
    /// Seed of places and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
    /// Threads; no influence on the numbers.
    #[arg(long)]
    threads: Option<usize>,
    /// Writes the figures.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Drives at every class of things and prints the shares.
///
/// # Errors
/// Exit code 2 for an option or a robot without a depth camera, 3 for a file.
pub(crate) fn recall(arguments: &RecallArguments) -> Result<(), Failure> {
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    let robot = robot_named(&arguments.robot)?.0;
    let options = Options {
        robot: &robot,
        classes: &CLASSES,
        speeds_m_s: &speeds_m_s(&robot),
        trials: arguments.trials,
        seed: arguments.seed,
        threads: threads(arguments.threads),
    };
    let mut progress = |line: &str| crate::output::note(line.to_owned());
    let recall = measure(&options, &mut progress).map_err(|error| Failure::usage(error.to_string()))?;
    crate::output::line(&recall.text());
    arguments.json.as_ref().map_or(Ok(()), |path| {
        let numbers = serde_json::to_value(&recall).map_err(|error| Failure::io(error.to_string()))?;
        crate::output::json(path, &numbers)
    })
}

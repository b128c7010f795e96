//! Commands of the researcher: data set, training, evaluation.

use crate::failure::Failure;
use crate::manifest::robot_named;
use clap::{Args, Subcommand};
use sidestep_train::{DatasetOptions, EvaluateOptions, TrainError, TrainOptions};
use std::path::PathBuf;

/// What to do with a data set.
#[derive(Debug, Subcommand)]
pub(crate) enum DatasetCommands {
    /// Makes artificial maps with the expert's labels.
    Make {
        /// File to write.
        out: PathBuf,
        /// Records.
        #[arg(long, default_value_t = 100_000)]
        samples: u64,
        /// Seed; held-out data need another one than training data.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Built-in robot or path of a robot file.
        #[arg(long, default_value = "loomo")]
        robot: String,
    },
    /// Says what a data set holds.
    Info {
        /// The file.
        file: PathBuf,
    },
}

/// What to train.
#[derive(Debug, Args)]
pub(crate) struct TrainArguments {
    /// Data set to learn from.
    data: PathBuf,
    /// Model file to write.
    out: PathBuf,
    /// Samples to see in all, repetitions counted.
    #[arg(long, default_value_t = 1_500_000)]
    samples: u64,
    /// File to go on from after an interruption.
    #[arg(long)]
    checkpoint: Option<PathBuf>,
    /// Seed of order, mirroring and first parameters.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
}

/// What to evaluate.
#[derive(Debug, Args)]
pub(crate) struct EvaluateArguments {
    /// Held-out data set.
    data: PathBuf,
    /// A model instead of the embedded one.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Records to use.
    #[arg(long, default_value_t = 20_000)]
    samples: u64,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
    /// Writes the figures as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn failure(error: &TrainError) -> Failure {
    match error {
        TrainError::Option { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

fn progress(line: &str) {
    crate::output::note(line.to_owned());
}

/// Makes or describes a data set.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn dataset(command: DatasetCommands) -> Result<(), Failure> {
    let header = match command {
        DatasetCommands::Make { out, samples, seed, robot } => {
            let threads = std::thread::available_parallelism().map_or(1, usize::from);
            let options = DatasetOptions { out, samples, seed, threads, robot: robot_named(&robot)?.0 };
            sidestep_train::dataset(&options, &mut progress)
        }
        DatasetCommands::Info { file } => sidestep_train::dataset_info(&file),
    };
    crate::output::line(&format!("{:#?}", header.map_err(|error| failure(&error))?));
    Ok(())
}

/// Trains a model.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn train(arguments: TrainArguments) -> Result<(), Failure> {
    let mut options = TrainOptions::standard(arguments.data, arguments.out, robot_named(&arguments.robot)?.0);
    options.samples = arguments.samples;
    options.checkpoint = arguments.checkpoint;
    options.seed = arguments.seed;
    let report = sidestep_train::train(&options, &mut progress).map_err(|error| failure(&error))?;
    crate::output::line(&format!("{report:#?}"));
    Ok(())
}

/// Compares a model with the expert's labels.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn evaluate(arguments: EvaluateArguments) -> Result<(), Failure> {
    let EvaluateArguments { data, model, samples, robot, json } = arguments;
    let options = EvaluateOptions { data, model, samples, robot: robot_named(&robot)?.0 };
    let evaluation = sidestep_train::evaluate(&options).map_err(|error| failure(&error))?;
    crate::output::line(&format!("{evaluation:#?}"));
    json.map_or(Ok(()), |path| {
        crate::output::json(&path, &serde_json::to_value(&evaluation).unwrap_or_default())
    })
}

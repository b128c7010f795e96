//! Commands of the researcher: data set, training, evaluation.

use crate::failure::Failure;
use crate::manifest::robot_named;
use clap::{Args, Subcommand, ValueEnum};
use sidestep_bus::host_ns;
use sidestep_evaluate::{EvaluateError, EvaluateOptions};
use sidestep_train::{
    Dataset, DatasetOptions, DriveProfile, Frames, Header, TrainError, TrainOptions, TrainReport,
};
use std::path::{Path, PathBuf};

/// What to do with a data set.
#[derive(Debug, Subcommand)]
pub(crate) enum DatasetCommands {
    /// Makes labelled frames: made-up maps, or drives through simulated worlds.
    Make(MakeArguments),
    /// Makes the held-out sets that published figures are measured on, and checks their hashes.
    Frozen {
        /// Folder for the files.
        folder: PathBuf,
        /// Threads; no influence on the bytes.
        #[arg(long)]
        threads: Option<usize>,
    },
    /// Says what a data set holds.
    Info {
        /// The file.
        file: PathBuf,
        /// Draws samples on a page.
        #[arg(long)]
        html: Option<PathBuf>,
        /// Samples to draw.
        #[arg(long, default_value_t = 12)]
        samples: u64,
        /// Built-in robot or path of a robot file.
        #[arg(long, default_value = "loomo")]
        robot: String,
    },
}

/// Where frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum From {
    /// Made-up maps (paper section III-E).
    Artificial,
    /// Drives of the solved expert, depth to map to command (the paper's demonstrations).
    Paper,
    /// The same, overruled now and then by random commands.
    Robust,
}

/// What to make.
#[derive(Debug, Args)]
pub(crate) struct MakeArguments {
    /// File to write.
    out: PathBuf,
    /// Where the frames come from.
    #[arg(long, default_value = "artificial")]
    from: From,
    /// A model that drives instead of the expert, which labels all the same (DAgger).
    #[arg(long)]
    model: Option<PathBuf>,
    /// Worlds to drive through in turn, as `sim.world` names them; without it offices, corridors and rooms.
    #[arg(long)]
    world: Vec<String>,
    /// Records.
    #[arg(long, default_value_t = 100_000)]
    samples: u64,
    /// Seed; held-out data need another one than training data.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; no influence on the bytes.
    #[arg(long)]
    threads: Option<usize>,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
}

/// What to train.
#[derive(Debug, Args)]
pub(crate) struct TrainArguments {
    /// Data sets to learn from; one record in twenty is left out.
    #[arg(required = true)]
    data: Vec<PathBuf>,
    /// Model file to write.
    #[arg(long)]
    out: PathBuf,
    /// Samples to see in all, repetitions counted.
    #[arg(long, default_value_t = 24_000_000)]
    samples: u64,
    /// File to go on from after an interruption.
    #[arg(long)]
    checkpoint: Option<PathBuf>,
    /// Value iterations K; 1 plans nothing.
    #[arg(long, default_value_t = 36)]
    rounds: usize,
    /// Learn the labels of 734 candidates instead of the solved ones.
    #[arg(long)]
    plain_labels: bool,
    /// Seed of order, mirroring and first parameters.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; no influence on the bytes.
    #[arg(long)]
    threads: Option<usize>,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
}

/// What to evaluate.
#[derive(Debug, Args)]
pub(crate) struct EvaluateArguments {
    /// Data sets of other worlds than those of the training.
    data: Vec<PathBuf>,
    /// Data sets that the model was trained on, a flag for each: for the error in training and of the records left out.
    #[arg(long)]
    trained_on: Vec<PathBuf>,
    /// Data sets of worlds of other origin, such as BARN: for the doubt.
    #[arg(long)]
    foreign: Vec<PathBuf>,
    /// A model instead of the embedded one.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Records to use of each set.
    #[arg(long, default_value_t = 20_000)]
    samples: u64,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
    /// Writes the report, all in one page.
    #[arg(long)]
    html: Option<PathBuf>,
    /// Writes the main pictures.
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Writes the figures.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn failure(error: &TrainError) -> Failure {
    match error {
        TrainError::Option { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

fn evaluation_failure(error: &EvaluateError) -> Failure {
    match error {
        EvaluateError::NoData => Failure::usage(error.to_string()),
        EvaluateError::Data(error) => failure(error),
        _ => Failure::io(error.to_string()),
    }
}

fn progress(line: &str) {
    crate::output::note(line.to_owned());
}

/// The bytes of a model file.
///
/// # Errors
/// Exit code 3 where it cannot be read.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|error| Failure::io(format!("{}: {error}", path.display())))
}

/// Threads asked for, or one for each core.
pub(crate) fn threads(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Makes or describes a data set.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn dataset(command: DatasetCommands) -> Result<(), Failure> {
    match command {
        DatasetCommands::Make(arguments) => make(arguments),
        DatasetCommands::Frozen { folder, threads: asked } => {
            let robot = robot_named("loomo")?.0;
            let files = sidestep_train::frozen_sets(&folder, threads(asked), &robot, &mut progress)
                .map_err(|error| failure(&error))?;
            files.iter().for_each(|file| crate::output::line(&file.display().to_string()));
            Ok(())
        }
        DatasetCommands::Info { file, html, samples, robot } => {
            let header = *Dataset::open(&file).map_err(|error| failure(&error))?.header();
            describe(&header);
            let Some(page) = html else { return Ok(()) };
            let robot = robot_named(&robot)?.0;
            let report = sidestep_evaluate::samples_report(&file, &robot, samples)
                .map_err(|error| evaluation_failure(&error))?;
            crate::output::file(&page, &report.html())
        }
    }
}

fn make(arguments: MakeArguments) -> Result<(), Failure> {
    let MakeArguments { out, from, model, world, samples, seed, threads: asked, robot } = arguments;
    if from == From::Artificial && (model.is_some() || !world.is_empty()) {
        let text = "--model and --world are for drives, needed: --from paper or --from robust";
        return Err(Failure::usage(text));
    }
    let profile = DriveProfile {
        policy: model.as_deref().map(read).transpose()?,
        worlds: world,
        bursts: from == From::Robust,
    };
    let frames = if from == From::Artificial { Frames::Artificial } else { Frames::Drives(profile) };
    let threads = threads(asked);
    let options = DatasetOptions { out, frames, samples, seed, threads, robot: robot_named(&robot)?.0 };
    let begin_ns = host_ns();
    let header = sidestep_train::dataset(&options, &mut progress).map_err(|error| failure(&error))?;
    describe(&header);
    let took_s = seconds_since(begin_ns);
    let rate = header.count as f64 / took_s;
    progress(&format!("dataset: {took_s:.0} s, {rate:.0} records/s on {threads} threads"));
    Ok(())
}

fn seconds_since(begin_ns: u64) -> f64 {
    (host_ns().saturating_sub(begin_ns) as f64 * 1e-9).max(1e-3)
}

fn describe(header: &Header) {
    let [artificial, driven] = header.by_source;
    crate::output::line(&format!(
        "records      {}: {artificial} made-up maps, {driven} frames of drives\n\
         seed         {}\nrobot        motion hash {:016x}\ncontent      {:016x}",
        header.count, header.seed, header.motion_hash, header.content_hash
    ));
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
    options.plain_labels = arguments.plain_labels;
    options.shape.rounds = arguments.rounds;
    options.threads = threads(arguments.threads);
    let mut last: Option<(u64, u64)> = None;
    let mut tell = |progress: &sidestep_train::Progress| {
        let now_ns = host_ns();
        let rate = last.map_or(String::new(), |(seen, then_ns)| {
            let took_s = (now_ns.saturating_sub(then_ns) as f64 * 1e-9).max(1e-3);
            format!(", {:.0}/s", progress.seen.saturating_sub(seen) as f64 / took_s)
        });
        last = Some((progress.seen, now_ns));
        crate::output::note(format!("train: {progress}{rate}"));
    };
    let TrainReport { samples, error, parameters, model_hash } =
        sidestep_train::train(&options, &mut tell).map_err(|error| failure(&error))?;
    crate::output::line(&format!(
        "model        {}, {model_hash:016x}, {parameters} parameters\nsamples      {samples}\n\
         error        v {:.4} m/s, w {:.4} rad/s, window 0.3 s, in training",
        options.out.display(),
        error[0],
        error[1]
    ));
    Ok(())
}

/// Compares a model with the expert's labels, by the paper's tables and figures.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn evaluate(arguments: EvaluateArguments) -> Result<(), Failure> {
    let EvaluateArguments { data, trained_on, foreign, model, samples, robot, html, svg, json } = arguments;
    [&html, &svg, &json].into_iter().flatten().try_for_each(|path| crate::output::may_write(path))?;
    let robot = robot_named(&robot)?.0;
    let options = EvaluateOptions { model, training: trained_on, held_out: data, foreign, samples, robot };
    let evaluation =
        sidestep_evaluate::evaluate(&options, &mut progress).map_err(|error| evaluation_failure(&error))?;
    crate::output::line(&evaluation.to_string());
    if let Some(path) = &html {
        let report = evaluation.report(&options.robot).map_err(|error| evaluation_failure(&error))?;
        crate::output::file(path, &report.html())?;
    }
    if let Some(path) = &svg {
        let picture = evaluation.overview(&options.robot).map_err(|error| evaluation_failure(&error))?;
        crate::output::file(path, &picture.svg())?;
    }
    json.map_or(Ok(()), |path| crate::output::json(&path, &evaluation.json()))
}

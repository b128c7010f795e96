//! The training loop: batches in a seeded order, gradients by groups, one optimiser step, checkpoints, one model file.
//!
//! A batch is cut into a fixed number of groups; threads take groups, and the groups' gradients are added in order.
//! So neither the number of threads nor an interruption changes a bit of the model.

use crate::checkpoint::{Checkpoint, Identity};
use crate::error::TrainError;
use crate::gradient::{Goal, Sums, Worker};
use crate::mixture::Mixture;
use crate::optimiser::{Adam, Schedule};
use crate::parameters::{ConvolutionSize, Shape};
use crate::random::Random;
use crate::record::Record;
use sidestep_msgs::{Robot, Twist, WINDOW_S};
use sidestep_policy::{Contract, Golden, Lanes, Policy, record_golden, to_onnx};
use std::path::PathBuf;
use std::sync::Mutex;

/// Groups per batch: as many threads find work.
const GROUPS: usize = 4;
/// Numbers of a gradient that are added up before the next ones are: they stay in the first cache.
const PART: usize = 4096;
/// Steps between two progress lines.
const REPORT_STEPS: u64 = 200;

/// What to train and how.
#[derive(Debug, Clone)]
pub struct TrainOptions {
    /// Datasets to learn from, all records alike.
    pub data: Vec<PathBuf>,
    /// Model file to write.
    pub out: PathBuf,
    /// Checkpoint to write and to go on from, if any.
    pub checkpoint: Option<PathBuf>,
    /// Samples to see in all, repetitions counted.
    pub samples: u64,
    /// Seed of order, mirroring and first parameters.
    pub seed: u64,
    /// Threads; no influence on the bytes.
    pub threads: usize,
    /// Samples per step; a multiple of 4.
    pub batch: usize,
    /// Learning rate after the warm-up.
    pub rate: f32,
    /// Weight of the doubt beside the command.
    pub doubt_weight: f32,
    /// Learn the 734-candidate labels instead of the solved ones.
    pub plain_labels: bool,
    /// Size of the network.
    pub shape: Shape,
    /// Robot; must be the dataset's.
    pub robot: Robot,
}

impl TrainOptions {
    /// The shipped recipe for a robot.
    #[must_use]
    pub fn standard(data: Vec<PathBuf>, out: PathBuf, robot: Robot) -> Self {
        Self {
            data,
            out,
            checkpoint: None,
            samples: 24_000_000,
            seed: 1,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            batch: 128,
            rate: 2e-3,
            doubt_weight: 0.02,
            plain_labels: false,
            shape: Shape::STANDARD,
            robot,
        }
    }
}

/// How far a training is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Samples seen.
    pub seen: u64,
    /// Samples to see in all.
    pub samples: u64,
    /// Loss of the command, mean of the last steps.
    pub loss: f64,
    /// Loss of the doubt.
    pub doubt_loss: f64,
    /// `[m/s, rad/s]` absolute error within the label's window.
    pub error: [f64; 2],
    /// Norm of the last gradient, before clipping.
    pub gradient: f32,
}

impl std::fmt::Display for Progress {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { seen, samples, loss, doubt_loss, error, gradient } = self;
        write!(
            out,
            "{seen} of {samples} samples, loss {loss:.4}, doubt {doubt_loss:.3}, |v| {:.4} m/s, |w| {:.4} rad/s, \
             gradient {gradient:.3}",
            error[0], error[1]
        )
    }
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainReport {
    /// Samples seen.
    pub samples: u64,
    /// `[m/s, rad/s]` mean absolute error of the last steps, within the label's window.
    pub error: [f64; 2],
    /// Parameters.
    pub parameters: usize,
    /// Fingerprint of the model file.
    pub model_hash: u64,
}

/// Trains a network and writes it as one model file.
///
/// # Errors
/// [`TrainError`] with what was found and what is needed.
pub fn train(options: &TrainOptions, progress: &mut dyn FnMut(&Progress)) -> Result<TrainReport, TrainError> {
    let data = Mixture::open(&options.data, &options.robot)?;
    check(options, &data)?;
    let identity = identity(options, &data);
    let count = options.shape.count();
    let saved = match &options.checkpoint {
        Some(path) => Checkpoint::read(path, identity, count)?,
        None => None,
    };
    let fresh = || Checkpoint {
        identity,
        seen: 0,
        parameters: options.shape.initial(options.seed),
        adam: Adam::new(count),
    };
    let mut run = Run::new(options, &data, saved.unwrap_or_else(fresh));
    let mut recent = (Sums::default(), 0.0);
    while run.state.seen < options.samples {
        let sums = run.step()?;
        if run.state.adam.steps % REPORT_STEPS == 1 {
            recent = (Sums::default(), 0.0);
        }
        recent.0.add(&sums);
        recent.1 += options.batch as f64;
        if run.state.adam.steps.is_multiple_of(REPORT_STEPS) || run.state.seen >= options.samples {
            progress(&progress_of(options, &run, &recent));
            if let Some(path) = &options.checkpoint {
                run.state.write(path)?;
            }
        }
    }
    let onnx = export(options, &data, &run.state)?;
    std::fs::write(&options.out, &onnx)
        .map_err(|source| TrainError::File { path: options.out.display().to_string(), source })?;
    let policy = Policy::load(&onnx, &options.out.display().to_string(), &options.robot)?;
    Ok(TrainReport {
        samples: run.state.seen,
        error: recent.0.error.map(|error| error / f64::max(recent.1, 1.0)),
        parameters: count,
        model_hash: policy.model_hash(),
    })
}

fn progress_of(options: &TrainOptions, run: &Run<'_>, (sums, count): &(Sums, f64)) -> Progress {
    Progress {
        seen: run.state.seen,
        samples: options.samples,
        loss: sums.loss / count,
        doubt_loss: sums.doubt_loss / count,
        error: sums.error.map(|error| error / count),
        gradient: run.norm,
    }
}

fn check(options: &TrainOptions, data: &Mixture) -> Result<(), TrainError> {
    let unfit = |option, found: String, needed| Err(TrainError::Option { option, found, needed });
    if options.batch == 0 || !options.batch.is_multiple_of(GROUPS) || options.batch > 65_536 {
        return unfit("batch", options.batch.to_string(), "a multiple of 4 up to 65536");
    }
    if (0..data.count()).all(|index| data.is_held_out(index)) {
        return unfit("data", format!("{} records, all held out", data.count()), "more records");
    }
    let shape = &options.shape;
    if !(1..=32).contains(&shape.channels) || !(1..=1000).contains(&shape.rounds) {
        return unfit("shape", format!("{shape:?}"), "1 to 32 channels, 1 to 1000 rounds");
    }
    let too_many = shape.convolutions.len() > Identity::CONVOLUTIONS;
    let fits = |size: &ConvolutionSize| (1..=256).contains(&size.outputs) && (1..=4).contains(&size.stride);
    if too_many || !shape.convolutions.iter().all(fits) {
        let found = format!("{:?}", shape.convolutions);
        return unfit("convolutions", found, "at most 4, of 1 to 256 planes, of stride 1 to 4");
    }
    if shape.hidden.iter().any(|size| !(1..=4096).contains(size)) {
        return unfit("hidden", format!("{:?}", shape.hidden), "1 to 4096 each");
    }
    if !(options.rate > 0.0
        && options.rate < 1.0
        && options.doubt_weight >= 0.0
        && options.doubt_weight < 10.0)
    {
        return unfit(
            "rate",
            format!("{} and {}", options.rate, options.doubt_weight),
            "0 to 1, doubt weight 0 to 10",
        );
    }
    Ok(())
}

fn identity(options: &TrainOptions, data: &Mixture) -> Identity {
    let shape = options.shape;
    let mut convolutions = [[0; 2]; Identity::CONVOLUTIONS];
    for (place, size) in convolutions.iter_mut().zip(shape.convolutions) {
        *place = [size.outputs, size.stride].map(|size| size as u32);
    }
    let sizes = [shape.channels, shape.rounds, shape.hidden[0], shape.hidden[1], options.batch];
    Identity {
        magic: Identity::MAGIC,
        dataset: data.content_hash(),
        robot: options.robot.motion_hash(),
        seed: options.seed,
        samples: options.samples,
        shape: sizes.map(|size| size as u32),
        convolutions,
        options: [options.rate, options.doubt_weight, f32::from(u8::from(options.plain_labels))],
    }
}

struct Run<'a> {
    options: &'a TrainOptions,
    data: &'a Mixture,
    state: Checkpoint,
    schedule: Schedule,
    goal: Goal,
    workers: Vec<Worker>,
    gradients: Vec<Vec<f32>>,
    batch: Vec<Record>,
    /// The records to learn from.
    kept: Vec<u32>,
    order: Vec<u32>,
    epoch: Option<u64>,
    norm: f32,
}

impl<'a> Run<'a> {
    fn new(options: &'a TrainOptions, data: &'a Mixture, state: Checkpoint) -> Self {
        Self {
            options,
            data,
            schedule: Schedule { rate: options.rate, warm_up_steps: 200, samples: options.samples },
            goal: Goal {
                limits: options.robot.limits,
                doubt_weight: options.doubt_weight,
                plain_labels: options.plain_labels,
            },
            workers: vec![Worker::new(options.shape, Lanes::detect()); options.threads.clamp(1, GROUPS)],
            gradients: vec![vec![0.0; options.shape.count()]; GROUPS],
            batch: Vec::with_capacity(options.batch),
            kept: (0..data.count() as u32).filter(|index| !data.is_held_out(u64::from(*index))).collect(),
            order: Vec::new(),
            epoch: None,
            norm: 0.0,
            state,
        }
    }

    /// Sample number `seen` of the run: an epoch's own order, and its own choice of side.
    fn sample(&mut self, seen: u64) -> Result<Record, TrainError> {
        let count = self.kept.len().max(1) as u64;
        let epoch = seen / count;
        if self.epoch != Some(epoch) {
            self.order.clone_from(&self.kept);
            let mut random = Random::new(self.options.seed, 0x4f52_4445_5200 + epoch);
            for last in (1..self.order.len()).rev() {
                self.order.swap(last, random.below(last + 1));
            }
            self.epoch = Some(epoch);
        }
        let record = self.data.read(u64::from(self.order[(seen % count) as usize]))?;
        let mirror = Random::new(self.options.seed, 0x4d49_5252_0000_0000 + seen).chance(0.5);
        Ok(if mirror { record.mirrored() } else { record })
    }

    fn step(&mut self) -> Result<Sums, TrainError> {
        self.batch.clear();
        for offset in 0..self.options.batch as u64 {
            let record = self.sample(self.state.seen + offset)?;
            self.batch.push(record);
        }
        let size = self.options.batch / GROUPS;
        let (parameters, goal) = (&self.state.parameters, &self.goal);
        let mut group_sums = [Sums::default(); GROUPS];
        let work = self.batch.chunks(size).zip(&mut self.gradients).zip(&mut group_sums);
        let work = Mutex::new(work);
        std::thread::scope(|scope| {
            for worker in &mut self.workers {
                scope.spawn(|| {
                    worker.load(parameters);
                    loop {
                        let next = work.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
                        let Some(((records, gradient), sums)) = next else { break };
                        gradient.fill(0.0);
                        *sums = worker.group(goal, records, gradient);
                    }
                });
            }
        });
        let mut sums = Sums::default();
        group_sums.iter().for_each(|group| sums.add(group));
        let [total, others @ ..] = self.gradients.as_mut_slice() else { return Ok(sums) };
        let scale = 1.0 / self.options.batch as f32;
        for (index, total) in total.chunks_mut(PART).enumerate() {
            for other in &*others {
                total.iter_mut().zip(&other[index * PART..]).for_each(|(total, part)| *total += *part);
            }
            total.iter_mut().for_each(|value| *value *= scale);
        }
        if !sums.loss.is_finite() || !total.iter().all(|value| value.is_finite()) {
            return Err(TrainError::Diverged { samples: self.state.seen });
        }
        let rate = self.schedule.rate_at(self.state.adam.steps, self.state.seen);
        self.norm = self.state.adam.step(&mut self.state.parameters, total, rate);
        self.state.seen += self.options.batch as u64;
        Ok(sums)
    }
}

/// The model file of a run: the network, its contract and its answer to the dataset's first record.
fn export(options: &TrainOptions, data: &Mixture, state: &Checkpoint) -> Result<Vec<u8>, TrainError> {
    let record = data.read(0)?;
    let network = options.shape.network(&state.parameters, &options.robot.limits);
    let mut contract = Contract {
        rounds: options.shape.rounds,
        robot: options.robot.name.clone(),
        robot_hash: options.robot.hash(),
        motion_hash: options.robot.motion_hash(),
        window_s: WINDOW_S,
        dataset_hash: data.content_hash(),
        samples_seen: state.seen,
        golden: Golden {
            planning_cost: record.planning_cost,
            goal_cell: usize::from(record.goal_cell),
            velocity: Twist::new(record.velocity[0], record.velocity[1]),
            command: [0.0; 2],
            doubt: [0.0; 2],
        },
    };
    contract.golden = record_golden(&to_onnx(&network, &contract), contract.golden)?;
    Ok(to_onnx(&network, &contract))
}

//! Makes a dataset: scenes from their own seeds, labels from the expert, the same bytes for any number of threads.

use crate::artificial::scene;
use crate::error::TrainError;
use crate::record::{Dataset, DatasetWriter, Header, Record, Source};
use bytemuck::Zeroable;
use sidestep_expert::{Mode, Planner, Weights};
use sidestep_msgs::Robot;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Candidates of the paper's demonstrator.
pub(crate) const CANDIDATES: usize = 734;
/// Records written at once.
const BLOCK: usize = 4096;
/// Records made by one thread at once.
const SHARE: usize = 64;

/// What to make.
#[derive(Debug, Clone)]
pub struct DatasetOptions {
    /// File to write.
    pub out: PathBuf,
    /// Records.
    pub samples: u64,
    /// Seed; test data need another one than training data.
    pub seed: u64,
    /// Threads; no influence on the bytes.
    pub threads: usize,
    /// Robot that the labels are for.
    pub robot: Robot,
}

/// Makes a dataset file; `progress` gets a line now and then.
///
/// # Errors
/// [`TrainError`] where the file cannot be written or an option makes no sense.
pub fn dataset(options: &DatasetOptions, progress: &mut dyn FnMut(&str)) -> Result<Header, TrainError> {
    if options.samples == 0 {
        return Err(TrainError::Option { option: "samples", found: "0".into(), needed: "at least 1" });
    }
    let mut writer = DatasetWriter::create(&options.out, options.seed, options.robot.motion_hash())?;
    let mut block = vec![Record::zeroed(); BLOCK];
    let mut made = 0;
    while made < options.samples {
        let count = (options.samples - made).min(BLOCK as u64) as usize;
        fill(options, made, &mut block[..count]);
        writer.append(&block[..count])?;
        made += count as u64;
        progress(&format!("dataset: {made} of {} records", options.samples));
    }
    writer.finish()
}

/// What a dataset file says of itself.
///
/// # Errors
/// [`TrainError`] where the file is no dataset.
pub fn dataset_info(path: &Path) -> Result<Header, TrainError> {
    Ok(*Dataset::open(path)?.header())
}

fn fill(options: &DatasetOptions, first: u64, records: &mut [Record]) {
    let shares = Mutex::new(records.chunks_mut(SHARE).enumerate());
    std::thread::scope(|scope| {
        for _ in 0..options.threads.max(1) {
            scope.spawn(|| {
                let mut planner = Planner::new(&options.robot.limits, &Weights::STANDARD, CANDIDATES);
                loop {
                    let next = shares.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
                    let Some((index, share)) = next else { break };
                    for (offset, record) in share.iter_mut().enumerate() {
                        *record = label(options, &mut planner, first + (index * SHARE + offset) as u64);
                    }
                }
            });
        }
    });
}

/// Record `stream`: a scene and what the expert would do in it, at once and after thinking.
fn label(options: &DatasetOptions, planner: &mut Planner, stream: u64) -> Record {
    let robot = &options.robot;
    let scene = scene(options.seed, stream, &robot.limits, robot.half_width_m());
    let plain = planner.plan(&scene.planning_cost, scene.goal_cell, scene.twist, Mode::Plain);
    let solved = planner.plan(&scene.planning_cost, scene.goal_cell, scene.twist, Mode::Solved);
    Record {
        planning_cost: scene.planning_cost,
        goal_cell: scene.goal_cell as u16,
        source: Source::Artificial as u8,
        kind: scene.kind,
        world: stream as u32,
        goal_x_m: scene.goal_m[0],
        goal_y_m: scene.goal_m[1],
        velocity: [scene.twist.v_m_s, scene.twist.w_rad_s],
        label_734: [plain.twist.v_m_s, plain.twist.w_rad_s],
        cost_734: plain.cost,
        label_solved: [solved.twist.v_m_s, solved.twist.w_rad_s],
        cost_solved: solved.cost,
        stream,
        reserved: [0; 8],
    }
}

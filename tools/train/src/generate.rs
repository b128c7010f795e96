//! Makes a dataset: maps or drives from their own seeds, labels from the expert, the same bytes for any number of threads.

use crate::artificial::scene;
use crate::drives::{DriveProfile, drive};
use crate::error::TrainError;
use crate::label::Labeller;
use crate::record::{DatasetWriter, Header, Record, Source};
use bytemuck::Zeroable;
use sidestep_crew::in_order;
use sidestep_msgs::Robot;
use std::path::PathBuf;

/// Records of a part of artificial maps.
const SHARE: usize = 64;
/// Parts that are made before they are written, per thread: so many may wait for a slower one.
const AHEAD: usize = 8;

/// Where the frames come from.
#[derive(Debug, Clone)]
pub enum Frames {
    /// Made-up maps (paper section III-E).
    Artificial,
    /// Drives through simulated worlds.
    Drives(DriveProfile),
}

/// What to make.
#[derive(Debug, Clone)]
pub struct DatasetOptions {
    /// File to write.
    pub out: PathBuf,
    /// Where the frames come from.
    pub frames: Frames,
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
/// [`TrainError`] where the file cannot be written, an option makes no sense or a drive cannot begin.
pub fn dataset(options: &DatasetOptions, progress: &mut dyn FnMut(&str)) -> Result<Header, TrainError> {
    if options.samples == 0 {
        return Err(TrainError::Option { option: "samples", found: "0".into(), needed: "at least 1" });
    }
    let mut writer = DatasetWriter::create(&options.out, options.seed, options.robot.motion_hash())?;
    let mut made = 0;
    let mut number = 0;
    let threads = options.threads.max(1);
    while made < options.samples {
        let hire = || Ok(Labeller::new(&options.robot));
        let job = |labeller: &mut Labeller, index: usize| make(options, number + index as u64, labeller);
        // A drive gives more than a share as a rule: few parts where few records are wanted, all the same ones.
        let left = (options.samples - made).div_ceil(SHARE as u64);
        let parts = left.min((threads * AHEAD) as u64);
        for part in in_order(parts as usize, threads, hire, job, &mut |_| ())? {
            let count = part.len().min((options.samples - made) as usize);
            writer.append(&part[..count])?;
            made += count as u64;
        }
        number += parts;
        progress(&format!("dataset: {made} of {} records", options.samples));
    }
    writer.finish()
}

/// Part `number` of a dataset: its own for each number, whoever makes it and when.
fn make(options: &DatasetOptions, number: u64, labeller: &mut Labeller) -> Result<Vec<Record>, TrainError> {
    let mut records: Vec<Record> = match &options.frames {
        Frames::Artificial => {
            let first = number * SHARE as u64;
            (first..first + SHARE as u64).map(|stream| artificial(options, stream)).collect()
        }
        Frames::Drives(profile) => drive(&options.robot, options.seed, number, profile)?
            .iter()
            .map(|(kind, frame)| frame.record(*kind))
            .collect(),
    };
    records.iter_mut().for_each(|record| labeller.label(record));
    Ok(records)
}

/// The made-up map `stream`, without its labels.
fn artificial(options: &DatasetOptions, stream: u64) -> Record {
    let scene = scene(options.seed, stream, &options.robot);
    Record {
        planning_cost: scene.planning_cost,
        goal_cell: scene.goal_cell as u16,
        source: Source::Artificial as u8,
        kind: scene.kind,
        world: stream as u32,
        goal_x_m: scene.goal_m[0],
        goal_y_m: scene.goal_m[1],
        velocity: [scene.twist.v_m_s, scene.twist.w_rad_s],
        stream,
        ..Record::zeroed()
    }
}

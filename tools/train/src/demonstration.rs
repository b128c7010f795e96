//! Frames of drives as training samples: the same records as artificial ones, labelled by the same expert.

use crate::error::TrainError;
use crate::label::Labeller;
use crate::record::{DatasetWriter, Header, PARTLY_UNKNOWN, Record, Source};
use bytemuck::Zeroable;
use sidestep_msgs::{LOCAL_CELLS, Robot, Twist};
use std::path::Path;

/// [`Record::kind`] of a frame of a recording.
const RECORDED: u8 = 4;

/// One frame of a drive: what policy and expert saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demonstration {
    /// `[1/255]` planning cost, as `LocalMap` has it.
    pub planning_cost: [u8; LOCAL_CELLS],
    /// Cell of the goal or of its projection.
    pub goal_cell: u16,
    /// `[m]` goal before projection, x and y in `base`.
    pub goal_m: [f32; 2],
    /// u'.
    pub velocity: Twist,
    /// Whether some cells were never seen.
    pub partly_unknown: bool,
    /// Source frame, where it comes from within its run.
    pub frame: u64,
    /// Number of the run.
    pub run: u64,
}

/// Writes frames as a dataset, labelled for `robot`; a file of that name is never written over.
///
/// # Errors
/// [`TrainError`] where there is no frame, the file exists or cannot be written.
pub fn demonstrations(out: &Path, robot: &Robot, frames: &[Demonstration]) -> Result<Header, TrainError> {
    let Some(first) = frames.first() else {
        return Err(TrainError::Option { option: "mine", found: "no frame".into(), needed: "at least 1" });
    };
    let mut writer = DatasetWriter::create_fresh(out, first.run, robot.motion_hash())?;
    let mut labeller = Labeller::new(robot);
    for frame in frames {
        let mut record = frame.record(RECORDED);
        labeller.label(&mut record);
        writer.append(&[record])?;
    }
    writer.finish()
}

impl Demonstration {
    /// The record without its labels.
    pub(crate) fn record(&self, kind: u8) -> Record {
        Record {
            planning_cost: self.planning_cost,
            goal_cell: self.goal_cell,
            source: Source::Demonstration as u8,
            kind: kind | if self.partly_unknown { PARTLY_UNKNOWN } else { 0 },
            world: self.run as u32,
            goal_x_m: self.goal_m[0],
            goal_y_m: self.goal_m[1],
            velocity: [self.velocity.v_m_s, self.velocity.w_rad_s],
            stream: self.frame,
            ..Record::zeroed()
        }
    }
}

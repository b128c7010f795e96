//! Frames of drives as training samples: the same records as artificial ones, labelled by the same expert.

use crate::error::TrainError;
use crate::generate::CANDIDATES;
use crate::record::{DatasetWriter, Header, Record, Source};
use sidestep_expert::{Mode, Planner, Weights};
use sidestep_msgs::{LOCAL_CELLS, Robot, Twist};
use std::path::Path;

/// [`Record::kind`] of a frame of a drive.
const DRIVE: u8 = 4;
/// Added to the kind where parts of the map are unknown.
const PARTLY_UNKNOWN: u8 = 128;

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
    let mut planner = Planner::new(&robot.limits, &Weights::STANDARD, CANDIDATES);
    for frame in frames {
        writer.append(&[label(frame, &mut planner)])?;
    }
    writer.finish()
}

fn label(frame: &Demonstration, planner: &mut Planner) -> Record {
    let cell = usize::from(frame.goal_cell);
    let mut answer = |mode| planner.plan(&frame.planning_cost, cell, frame.velocity, mode);
    let (plain, solved) = (answer(Mode::Plain), answer(Mode::Solved));
    Record {
        planning_cost: frame.planning_cost,
        goal_cell: frame.goal_cell,
        source: Source::Demonstration as u8,
        kind: DRIVE + if frame.partly_unknown { PARTLY_UNKNOWN } else { 0 },
        world: frame.run as u32,
        goal_x_m: frame.goal_m[0],
        goal_y_m: frame.goal_m[1],
        velocity: [frame.velocity.v_m_s, frame.velocity.w_rad_s],
        label_734: [plain.twist.v_m_s, plain.twist.w_rad_s],
        cost_734: plain.cost,
        label_solved: [solved.twist.v_m_s, solved.twist.w_rad_s],
        cost_solved: solved.cost,
        stream: frame.frame,
        reserved: [0; 8],
    }
}

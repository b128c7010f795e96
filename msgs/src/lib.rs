//! The vocabulary of sidestep: messages, units, frames, the one table of topics, the robot, and the little geometry
//! that gives a message its meaning.
//!
//! Everything here is plain bytes of fixed size: what crosses shared memory, what a recording keeps and what a
//! replay compares are the same bytes. SI units and radians; REP-103 axes (x forward, y left, yaw counter-clockwise).
//! Frames: `odom` (continuous, z up), `base` (on the floor below the axle, level), `body` (base turned by roll and
//! pitch about the axle), `camera` (optical: x right, y down, z forward).

mod clock;
mod command;
mod depth;
mod geometry;
mod goal;
mod header;
mod health;
mod layout;
mod map;
mod odometry;
mod operator;
mod proposal;
mod recording;
mod robot;
mod scan;
mod state;
mod task;
mod topics;
mod truth;

pub use clock::{Clock, ClockMode};
pub use command::{Command, NO_CELL, Reason, VALID_FOR_NS, Winner};
pub use depth::{DEPTH_PIXELS, DepthFrame, NEAR_SECTORS, NearField};
pub use geometry::{Isometry, Pose2, Twist, wrap_angle};
pub use goal::{GoalKind, LocalGoal};
pub use header::{Header, INPUTS_MAX, STAGES, Stage, StageStamp, Status, Taken};
pub use health::{Health, NodeState};
pub use layout::{Code, Field, Message, Primitive, layout_hash};
pub use map::{
    AGE_NEVER, AGE_OLDER, FREE_BELOW, Grid, LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, LocalMap, OBSTACLE_FROM,
    SAFETY_CELLS, SAFETY_GRID, SAFETY_SIDE, STILL, SafetyMap, age_code, probability_code, safety_frame,
};
pub use odometry::{Odometry, RANGES_MAX, Range, Ranges};
pub use operator::{Estop, EstopAction, Teleop};
pub use proposal::{Proposal, TRAJECTORY_MAX, WINDOW_S, clamp_to_window};
pub use recording::{
    DEPTH_REST_BYTES, DEPTH_REST_CHANNEL, LAYOUT_ENCODING, LAYOUT_HASH_KEY, LOST_RECORD, MONO_TO_WALL_KEY,
    ORIGIN_RECORD, RAW_ENCODING, Recording, Snapshot,
};
pub use robot::{Actuator, Camera, Footprint, Lidar, Limits, Robot, RobotError, Start, Ultrasonic};
pub use scan::{SCAN_BEAMS, Scan};
pub use state::{
    ARBITER_STATE_BYTES, ArbiterState, GOAL_STATE_BYTES, GoalState, MAPPER_STATE_BYTES, MapperState,
};
pub use task::{PATH_POINTS, Path, PathPoint, Target, TargetState};
pub use topics::*;
pub use truth::{PEOPLE_MAX, Person, Truth};

//! The user header of every topic: who wrote this, when in graph time, from what, and how long each stage took.

use crate::layout::{ZeroCopySend, codes, record};

/// Most input topics that one step can name.
pub const INPUTS_MAX: usize = 24;
/// Stages whose stamps travel with a frame.
pub const STAGES: usize = 6;

codes! {
    /// The stages that a frame passes, in order.
    pub enum Stage {
        /// The driver (camera, simulator or player): `send` is the intended time of the frame where it has one.
        Depth = 0 "depth",
        /// `mapper`.
        Mapper = 1 "mapper",
        /// `goal`.
        Goal = 2 "goal",
        /// `policy`.
        Policy = 3 "policy",
        /// `expert`.
        Expert = 4 "expert",
        /// `arbiter`.
        Arbiter = 5 "arbiter",
    }
}

codes! {
    /// Whether a step could do its work, and if not, why. Every step publishes, whatever its status.
    pub enum Status {
        /// The work was done.
        Ok = 0 "ok",
        /// Depth or scan of a size, scale or intrinsics that cannot be.
        RefusedShape = 1 "refused: wrong size or intrinsics",
        /// No pixel carries a measurement.
        RefusedEmpty = 2 "refused: no valid pixel",
        /// All pixels at the largest value: the sensor is saturated or covered.
        RefusedSaturated = 3 "refused: saturated",
        /// The stamp repeats or runs backward.
        RefusedStamp = 4 "refused: repeated or backward stamp",
        /// Not-finite pose or camera pose.
        RefusedPose = 5 "refused: not-finite pose",
        /// No odometry within 20 ms of the capture stamp.
        RefusedOdometry = 6 "refused: no odometry at the capture stamp",
        /// No map to work on, or the map's step was refused.
        NoMap = 7 "no map",
        /// Neither path nor target.
        NoGoal = 8 "no goal",
        /// At the goal.
        Arrived = 9 "arrived",
        /// The operator or the task holds the robot.
        Hold = 10 "hold",
        /// The target is lost.
        Lost = 11 "target lost",
        /// No admissible solution.
        Infeasible = 12 "infeasible",
        /// A number that must be finite is not, or an internal check failed.
        Fault = 13 "fault",
    }
}

record! {
    /// The messages of one topic that a step took since its previous step.
    pub struct Taken {
        /// Sequence of the first one taken.
        pub first: u64,
        /// Sequence of the last one taken.
        pub last: u64,
        /// How many of them were taken.
        pub count: u32,
        /// Incarnation of their writer.
        pub incarnation: u32,
        /// Index in the topic table.
        pub topic: u32,
        /// Zero.
        pub _pad: u32,
    }
}

record! {
    /// Host-time stamps (CLOCK_MONOTONIC) of one stage; for latency only, never for decisions.
    pub struct StageStamp {
        /// `[ns]` host time right after the input was received; 0 = stage not passed.
        pub receive_ns: u64,
        /// `[ns]` host time right before the output was sent; 0 = stage not passed.
        pub send_ns: u64,
    }
}

record! {
    /// User header of every topic.
    pub struct Header("sidestep/Header/1") {
        /// Number of the run, drawn by the launcher.
        pub run: u64,
        /// Sequence of this message in its topic, from 1, per incarnation of the writer.
        pub sequence: u64,
        /// Sequence of the depth frame (or scan) that this is about, the join key; 0 = none.
        pub source_frame: u64,
        /// `[ns]` graph time that the step read as its only time.
        pub now_ns: u64,
        /// Raised when playback loops or seeks; every node resets.
        pub epoch: u32,
        /// Restarts of the writer, given by the launcher.
        pub incarnation: u32,
        /// [`Status`] of the step.
        pub status: u32,
        /// Entries used in `inputs`.
        pub input_count: u32,
        /// Inputs taken since the previous step, in the order of the topic table.
        pub inputs: [Taken; INPUTS_MAX],
        /// Stamps by [`Stage`].
        pub stages: [StageStamp; STAGES],
    }
}

const _: () = assert!(size_of::<Header>() == 48 + 32 * INPUTS_MAX + 16 * STAGES);

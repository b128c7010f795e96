//! The one table of view channels: name and schema.

use super::flat;
use foxglove::messages::{
    CameraCalibration, FrameTransforms, Grid, LaserScan, Log, PoseInFrame, PosesInFrame, SceneUpdate,
};
use foxglove::{Encode, Schema};

/// A channel that shows something.
#[derive(Debug, Clone, Copy)]
pub struct ViewChannel {
    /// Position in the table.
    pub index: usize,
    /// Name in recordings and in the live view.
    pub name: &'static str,
    schema: fn() -> Schema,
}

impl ViewChannel {
    /// Name, encoding and descriptors of its messages.
    #[must_use]
    pub fn schema(&self) -> Schema {
        (self.schema)()
    }

    /// Encoding of its messages.
    #[must_use]
    pub fn encoding(&self) -> &'static str {
        "protobuf"
    }
}

/// The schema of a well-known message.
pub(crate) fn known<M: Encode>() -> Schema {
    // Every message of the crate has a schema; one without would show as bytes.
    M::get_schema().unwrap_or_else(|| Schema::new("", "", Vec::new()))
}

macro_rules! channels {
    ($($(#[$meta:meta])* $key:ident = $index:literal $name:literal shows $schema:expr;)*) => {
        $($(#[$meta])* pub(crate) const $key: usize = $index;)*

        /// All view channels; the index of a channel is its position.
        pub static VIEW_CHANNELS: &[ViewChannel] =
            &[$(ViewChannel { index: $index, name: $name, schema: $schema }),*];
    };
}

channels! {
    /// `world` to `odom` (simulation only), `odom` to `base`, `base` to `body`, `body` to `camera`.
    TF = 0 "/view/tf" shows known::<FrameTransforms>;
    /// Intrinsics of the image on `depth`.
    CAMERA = 1 "/view/camera" shows known::<CameraCalibration>;
    /// Occupancy, planning cost and age of the map to plan on.
    LOCAL = 2 "/view/local_map" shows known::<Grid>;
    /// Occupancy and age of the map to be safe with.
    SAFETY = 3 "/view/safety_map" shows known::<Grid>;
    /// The point to head for.
    GOAL = 4 "/view/local_goal" shows known::<PoseInFrame>;
    /// The path to follow.
    ROUTE = 5 "/view/path" shows known::<PosesInFrame>;
    /// Beams of a lidar.
    BEAMS = 6 "/view/scan" shows known::<LaserScan>;
    /// Outline of the robot, arrows of the command and of the wish behind it.
    ROBOT = 7 "/view/robot" shows known::<SceneUpdate>;
    /// Trajectory and arrow of the policy.
    POLICY_PLAN = 8 "/view/policy/plan" shows known::<SceneUpdate>;
    /// Trajectory and arrow of the expert.
    EXPERT_PLAN = 9 "/view/expert/plan" shows known::<SceneUpdate>;
    /// Curves that the expert weighs.
    CANDIDATES = 10 "/view/expert/candidates" shows known::<SceneUpdate>;
    /// People and contact, as the simulator knows them.
    TRUE_WORLD = 11 "/view/truth" shows known::<SceneUpdate>;
    /// The command in numbers.
    COMMAND_FIGURES = 12 "/view/command" shows || flat::COMMAND.schema();
    /// The policy's proposal in numbers.
    POLICY_FIGURES = 13 "/view/policy" shows || flat::PROPOSAL.schema();
    /// The expert's proposal in numbers.
    EXPERT_FIGURES = 14 "/view/expert" shows || flat::PROPOSAL.schema();
    /// Pose and velocity in numbers.
    ODOMETRY_FIGURES = 15 "/view/odometry" shows || flat::ODOMETRY.schema();
    /// Time per stage of each answered frame.
    LATENCY = 16 "/view/latency" shows || flat::LATENCY.schema();
    /// Reasons of the arbiter, statuses and lives of the nodes, as they change.
    LOG = 17 "/view/log" shows known::<Log>;
    /// Heartbeat of `sim` in numbers.
    SIM_HEALTH = 18 "/view/health/sim" shows || flat::HEALTH.schema();
    /// Heartbeat of `player`.
    PLAYER_HEALTH = 19 "/view/health/player" shows || flat::HEALTH.schema();
    /// Heartbeat of another driver.
    DRIVER_HEALTH = 20 "/view/health/driver" shows || flat::HEALTH.schema();
    /// Heartbeat of `mapper`.
    MAPPER_HEALTH = 21 "/view/health/mapper" shows || flat::HEALTH.schema();
    /// Heartbeat of `goal`.
    GOAL_HEALTH = 22 "/view/health/goal" shows || flat::HEALTH.schema();
    /// Heartbeat of `policy`.
    POLICY_HEALTH = 23 "/view/health/policy" shows || flat::HEALTH.schema();
    /// Heartbeat of `expert`.
    EXPERT_HEALTH = 24 "/view/health/expert" shows || flat::HEALTH.schema();
    /// Heartbeat of `arbiter`.
    ARBITER_HEALTH = 25 "/view/health/arbiter" shows || flat::HEALTH.schema();
    /// Heartbeat of `recorder`.
    RECORDER_HEALTH = 26 "/view/health/recorder" shows || flat::HEALTH.schema();
    /// Heartbeat of `guard`.
    GUARD_HEALTH = 27 "/view/health/guard" shows || flat::HEALTH.schema();
}

/// Heartbeats in the order of the topic table.
pub(crate) const HEALTHS: [usize; 10] = [
    SIM_HEALTH,
    PLAYER_HEALTH,
    DRIVER_HEALTH,
    MAPPER_HEALTH,
    GOAL_HEALTH,
    POLICY_HEALTH,
    EXPERT_HEALTH,
    ARBITER_HEALTH,
    RECORDER_HEALTH,
    GUARD_HEALTH,
];

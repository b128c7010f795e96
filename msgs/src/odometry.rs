//! Where the robot believes it is, and what its ultrasonic sensors see.

use crate::geometry::{Pose2, Twist};
use crate::layout::{ZeroCopySend, record};

/// Most ultrasonic sensors.
pub const RANGES_MAX: usize = 8;

record! {
    /// Pose and velocity of the base, 100 Hz.
    ///
    /// Frame: pose of `base` in `odom`; roll and pitch of `body` in `base`. Writer: the base driver.
    /// Readers: `mapper`, `goal`, `arbiter`.
    pub struct Odometry("sidestep/Odometry/1") {
        /// `[ns]` graph time of the measurement.
        pub stamp_ns: u64,
        /// Pose of `base` in `odom`.
        pub pose: Pose2,
        /// Velocity in `base`.
        pub twist: Twist,
        /// `[rad]` roll of `body`, right side down positive (REP-103: about x).
        pub roll_rad: f32,
        /// `[rad]` pitch of `body`, nose down positive (REP-103: about y).
        pub pitch_rad: f32,
        /// `[m^2, m^2, rad^2]` variances of x, y and yaw since the start.
        pub variance: [f32; 3],
        /// `[0, 1]` 1 = the wheels slip and the twist cannot be trusted.
        pub slip: u32,
        /// Raised at each jump of the pose; what was placed in an earlier epoch is void.
        pub pose_epoch: u32,
        /// Zero.
        pub _pad: u32,
    }
}

record! {
    /// One ultrasonic reading with its mounting.
    pub struct Range {
        /// `[m]` mounting along x of `base`.
        pub x_m: f32,
        /// `[m]` mounting along y of `base`.
        pub y_m: f32,
        /// `[rad]` bearing of the cone's axis in `base`.
        pub yaw_rad: f32,
        /// `[rad]` full opening of the cone.
        pub field_of_view_rad: f32,
        /// `[m]` nearest distance that can be measured.
        pub near_m: f32,
        /// `[m]` farthest distance that can be measured.
        pub far_m: f32,
        /// `[m]` distance to the nearest thing in the cone; infinite = nothing, NaN = no measurement.
        pub range_m: f32,
        /// Zero.
        pub _pad: u32,
    }
}

record! {
    /// All ultrasonic sensors at one time.
    ///
    /// Frame: `base`. Writer: the base driver. Readers: `mapper`, `arbiter`.
    pub struct Ranges("sidestep/Ranges/1") {
        /// `[ns]` graph time of the measurement.
        pub stamp_ns: u64,
        /// `[0, 8]` sensors used.
        pub count: u32,
        /// Zero.
        pub _pad: u32,
        /// The sensors.
        pub sensors: [Range; RANGES_MAX],
    }
}

//! Where to go: a path to follow, or a person.

use crate::layout::{ZeroCopySend, codes, record};

/// Room for points of a path.
pub const PATH_POINTS: usize = 1024;

record! {
    /// One waypoint.
    pub struct PathPoint {
        /// `[m]` along x of `odom`.
        pub x_m: f32,
        /// `[m]` along y of `odom`.
        pub y_m: f32,
    }
}

record! {
    /// A path to follow, republished by whoever localises at each correction of map to odom.
    ///
    /// Frame: `odom`. Writer: the path driver. Reader: `goal`.
    pub struct Path("sidestep/Path/1") {
        /// Names the path; a new number starts progress afresh, the same number keeps it.
        pub id: u64,
        /// `[0, 1024]` points used; 0 = no path.
        pub count: u32,
        /// Pose epoch of the odometry in which the points hold.
        pub pose_epoch: u32,
        /// The points, in order.
        pub points: [PathPoint; PATH_POINTS],
    }
}

codes! {
    /// What a tracker says of its target.
    pub enum TargetState {
        /// No target.
        None = 0 "none",
        /// Seen.
        Tracked = 1 "tracked",
        /// Not seen now.
        Lost = 2 "lost",
    }
}

record! {
    /// A person to follow.
    ///
    /// Frame: `odom`. Writer: the tracker. Reader: `goal`.
    pub struct Target("sidestep/Target/1") {
        /// `[ns]` graph time of the observation.
        pub stamp_ns: u64,
        /// `[m]` along x.
        pub x_m: f32,
        /// `[m]` along y.
        pub y_m: f32,
        /// `[m/s]` velocity along x.
        pub vx_m_s: f32,
        /// `[m/s]` velocity along y.
        pub vy_m_s: f32,
        /// `[1]` `[0, 1]` trust of the tracker.
        pub confidence: f32,
        /// [`TargetState`].
        pub state: u32,
    }
}

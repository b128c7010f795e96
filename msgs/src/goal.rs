//! The point to head for now, and the one state that policy and expert may use.

use crate::geometry::{Pose2, Twist};
use crate::layout::{ZeroCopySend, codes, record};

codes! {
    /// What the local goal is.
    pub enum GoalKind {
        /// Nothing to do: no path and no target.
        None = 0 "none",
        /// A waypoint of a path.
        Path = 1 "path",
        /// A point behind a person.
        Standby = 2 "standby",
        /// Stay here.
        Hold = 3 "hold",
    }
}

record! {
    /// The local goal p_g of paper eq. (1), with the velocity u' of eq. (2).
    ///
    /// Frame: `base` at `capture_ns`. Writer: `goal`, one per local map. Readers: `policy`, `expert`, `arbiter`.
    /// Policy and expert read nothing else than this and the map that it names, so both see the same state.
    pub struct LocalGoal("sidestep/LocalGoal/1") {
        /// `[ns]` graph time of the map that this belongs to.
        pub capture_ns: u64,
        /// Sequence of that map.
        pub map_sequence: u64,
        /// Sequence of the odometry that `twist` was taken from.
        pub odometry_sequence: u64,
        /// Pose of `base` in `odom` at `capture_ns`, as the map has it.
        pub pose: Pose2,
        /// u': the velocity to be used for this frame.
        pub twist: Twist,
        /// `[m]` the goal, x; may lie outside the map.
        pub x_m: f32,
        /// `[m]` the goal, y.
        pub y_m: f32,
        /// `[m]` centre of `cell`, x: the goal as the network sees it and the expert plans on it (paper eq. 3).
        pub cell_x_m: f32,
        /// `[m]` centre of `cell`, y.
        pub cell_y_m: f32,
        /// Index of the cell of the local map that holds the goal, or of its projection to the border.
        pub cell: u32,
        /// [`GoalKind`].
        pub kind: u32,
        /// `[m]` path left to the goal; NaN where there is none.
        pub remaining_m: f32,
        /// `[m]` path driven.
        pub progress_m: f32,
    }
}

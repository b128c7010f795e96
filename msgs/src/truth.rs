//! What a simulator knows; for the recorder, the launcher and tools, never for a node that drives.

use crate::geometry::{Pose2, Twist};
use crate::layout::{ZeroCopySend, record};

/// Most people named.
pub const PEOPLE_MAX: usize = 16;

record! {
    /// A person in the simulated world.
    pub struct Person {
        /// `[m]` along x of the world.
        pub x_m: f32,
        /// `[m]` along y of the world.
        pub y_m: f32,
        /// `[m/s]` velocity along x.
        pub vx_m_s: f32,
        /// `[m/s]` velocity along y.
        pub vy_m_s: f32,
    }
}

record! {
    /// The state of the simulated world.
    ///
    /// Frame: the world. Writer: `sim`. Readers: recorder, launcher, tools.
    pub struct Truth("sidestep/Truth/1") {
        /// `[ns]` graph time.
        pub stamp_ns: u64,
        /// Pose of `base` in the world.
        pub pose: Pose2,
        /// True velocity.
        pub twist: Twist,
        /// `[m]` driven so far.
        pub distance_m: f64,
        /// `[m]` from the footprint to the nearest thing; 0 or less = contact.
        pub clearance_m: f32,
        /// `[m]` smallest clearance so far.
        pub min_clearance_m: f32,
        /// 1 while in contact.
        pub contact: u32,
        /// Contacts begun while moving, so far.
        pub collisions: u32,
        /// Goals reached so far.
        pub arrivals: u32,
        /// `[0, 16]` people used.
        pub people_count: u32,
        /// The people.
        pub people: [Person; PEOPLE_MAX],
    }
}

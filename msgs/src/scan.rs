//! Planar lidar scans.

use crate::geometry::Pose2;
use crate::layout::{ZeroCopySend, record};

/// Room for beams.
pub const SCAN_BEAMS: usize = 1440;

record! {
    /// One sweep of a planar lidar, mapped by the same mapper as depth.
    ///
    /// Frame: beams in the sensor, the sensor in `base`. Writer: the lidar driver. Reader: `mapper`.
    pub struct Scan("sidestep/Scan/1") {
        /// `[ns]` graph time of the sweep's middle.
        pub capture_ns: u64,
        /// Pose of the sensor in `base`.
        pub sensor: Pose2,
        /// `[rad]` bearing of beam 0 in the sensor.
        pub first_rad: f32,
        /// `[rad]` bearing from one beam to the next, counter-clockwise.
        pub step_rad: f32,
        /// `[m]` nearest range that can be measured.
        pub near_m: f32,
        /// `[m]` farthest range that can be measured.
        pub far_m: f32,
        /// `[m]` height of the scan plane above the floor.
        pub height_m: f32,
        /// `[1, 1440]` beams used.
        pub count: u32,
        /// `[m]` range per beam; infinite = nothing up to `far_m`, NaN = no measurement.
        pub range_m: [f32; SCAN_BEAMS],
    }
}

const _: () = assert!(size_of::<Scan>() == 56 + 4 * SCAN_BEAMS);

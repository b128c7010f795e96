//! Depth frames and the nearest ranges taken straight from them.

use crate::geometry::Isometry;
use crate::layout::{ZeroCopySend, record};

/// Room for pixels: 640 x 480.
pub const DEPTH_PIXELS: usize = 640 * 480;
/// Sectors of the depth guard.
pub const NEAR_SECTORS: usize = 64;

record! {
    /// One depth image with everything needed to place it in the world.
    ///
    /// Frame: pixels in `camera` (optical), the camera in `body`. Writer: the depth driver. Readers: `mapper`, `guard`.
    pub struct DepthFrame("sidestep/DepthFrame/1") {
        /// `[ns]` graph time of the exposure; a driver that stamps on arrival subtracts its capture latency first.
        pub capture_ns: u64,
        /// `[px]` `[16, 640]` columns used.
        pub width: u32,
        /// `[px]` `[16, 480]` rows used.
        pub height: u32,
        /// `[m]` (0, 0.1] metres per unit of a pixel.
        pub metres_per_unit: f32,
        /// `[px]` focal length along x.
        pub fx_px: f32,
        /// `[px]` focal length along y.
        pub fy_px: f32,
        /// `[px]` principal point, column.
        pub cx_px: f32,
        /// `[px]` principal point, row.
        pub cy_px: f32,
        /// `[s]` part of the capture stamp that is an estimate of the driver; 0 = stamped by the sensor.
        pub capture_latency_s: f32,
        /// Pose of `camera` in `body` at the capture stamp.
        pub camera: Isometry,
        /// `[metres_per_unit]` row by row, `width` per row; 0 = no measurement, 65535 = saturated; rest of the array zero.
        pub pixels: [u16; DEPTH_PIXELS],
    }
}

const _: () = assert!(size_of::<DepthFrame>() == 72 + 2 * DEPTH_PIXELS);

record! {
    /// Nearest obstacle per bearing, straight from a depth frame, without map or memory.
    ///
    /// Frame: `base`. Writer: `guard`. Reader: `arbiter`.
    pub struct NearField("sidestep/NearField/1") {
        /// `[ns]` graph time of the exposure; 0 = the frame was refused and nothing was seen.
        pub capture_ns: u64,
        /// `[m]` nearest range per sector, sector 0 at the left edge of the view; infinite = nothing, NaN = not seen.
        pub range_m: [f32; NEAR_SECTORS],
        /// `[rad]` bearing of the left edge of sector 0.
        pub left_rad: f32,
        /// `[rad]` width of one sector.
        pub sector_rad: f32,
    }
}

impl DepthFrame {
    /// Pixels in use; empty where width and height cannot be.
    #[must_use]
    pub fn used_pixels(&self) -> &[u16] {
        let count = self.width as usize * self.height as usize;
        self.pixels.get(..count).unwrap_or(&[])
    }
}

//! From pixels to counts per cell: every pixel of a frame is placed in the window and counted as floor, as obstacle in
//! one of three height bands, or not at all.
//!
//! Along an image row the direction of a ray is affine in the column, so that the place of a pixel costs three multiply-
//! adds. All arithmetic is in `f32` without fused operations: the wide variant gives the same bits as the plain one.

use crate::config::Config;
use crate::grid::{BANDS, CELL_M, Moment, SIDE};
use crate::history::Sample;
use nalgebra::{Matrix3, Rotation3, Vector3};
use sidestep_msgs::DepthFrame;

/// Counters per cell: floor and [`BANDS`] bands of obstacle.
pub(crate) const CLASSES: usize = BANDS + 1;
/// Counters, a power of two, so that a masked index needs no check.
const COUNTERS: usize = 1 << 18;
/// First counter of those that take pixels which count for nothing, one per column.
const DUMP: u32 = (SIDE * SIDE * CLASSES) as u32;
/// Widest row.
pub(crate) const COLUMNS_MAX: usize = 640;
/// 2^23: a float in [0, 2^22) plus this carries its rounded value in the low bits.
const MAGIC: f32 = 8_388_608.0;

/// Pixels per cell of the window and class.
pub(crate) type Counts = [u32; COUNTERS];

/// Counters at zero.
pub(crate) fn new_counts() -> Box<Counts> {
    // A boxed slice of this length always converts.
    vec![0; COUNTERS].into_boxed_slice().try_into().unwrap_or_else(|_| unreachable!())
}

/// A frame's camera, placed in the window: x and y in cells, height in metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens {
    /// Rotation from optical axes to `odom`, metres.
    rotation: Matrix3<f32>,
    /// Camera in the window: cells, cells, metres.
    pub(crate) eye: [f32; 3],
    fx_px: f32,
    fy_px: f32,
    cx_px: f32,
    cy_px: f32,
    width: usize,
    height: usize,
    metres_per_unit: f32,
    /// `[m]` standard deviation of depth at 1 m; grows with the square of depth.
    pub(crate) sigma_at_1_m: f32,
    /// When this was seen.
    pub(crate) now: Moment,
}

impl Lens {
    /// Places the camera of a frame, given the body at the capture stamp and its base in window cells.
    pub(crate) fn new(
        frame: &DepthFrame,
        body: &Sample,
        base: [f32; 2],
        disparity_m_px: f32,
        now: Moment,
    ) -> Self {
        // disparity_m_px = sigma_d / baseline; sigma(z) = z^2 sigma_d / (f B).
        let turn = |axis: Vector3<f32>| Rotation3::new(axis).into_inner();
        let tilt = turn(Vector3::y() * body.pitch_rad) * turn(Vector3::x() * body.roll_rad);
        let world = turn(Vector3::z() * body.pose.yaw_rad as f32) * tilt;
        let mount = frame.camera.rotation();
        let mount = Matrix3::from_fn(|row, col| mount[row][col]);
        let eye_m = world * Vector3::from(frame.camera.translation_m);
        let cells = 1.0 / CELL_M as f32;
        Self {
            rotation: world * mount,
            eye: [base[0] + eye_m.x * cells, base[1] + eye_m.y * cells, eye_m.z],
            fx_px: frame.fx_px,
            fy_px: frame.fy_px,
            cx_px: frame.cx_px,
            cy_px: frame.cy_px,
            width: frame.width as usize,
            height: frame.height as usize,
            metres_per_unit: frame.metres_per_unit,
            sigma_at_1_m: disparity_m_px / frame.fx_px,
            now,
        }
    }

    /// Direction of a pixel's ray per metre of depth: cells, cells, metres.
    fn ray(&self, column_px: f32, row_px: f32) -> [f32; 3] {
        let x = (column_px - self.cx_px) / self.fx_px;
        let y = (row_px - self.cy_px) / self.fy_px;
        let ray = self.rotation * Vector3::new(x, y, 1.0);
        let cells = 1.0 / CELL_M as f32;
        [ray.x * cells, ray.y * cells, ray.z]
    }

    /// `[m]` depth along the optical axis of a point given in window cells and metres of height.
    #[inline]
    pub(crate) fn depth_m(&self, x: f32, y: f32, height_m: f32) -> f32 {
        let cell_m = CELL_M as f32;
        let (dx, dy, dz) = ((x - self.eye[0]) * cell_m, (y - self.eye[1]) * cell_m, height_m - self.eye[2]);
        self.rotation[(0, 2)] * dx + self.rotation[(1, 2)] * dy + self.rotation[(2, 2)] * dz
    }

    /// `[m]` depth of a raw pixel.
    #[inline]
    pub(crate) fn metres(&self, raw: u16) -> f32 {
        f32::from(raw) * self.metres_per_unit
    }

    /// Pixels on which a square of this side, facing the camera at 1 m, is seen.
    pub(crate) fn pixels_at_1_m(&self, side_m: f32) -> f32 {
        side_m * side_m * self.fx_px * self.fy_px
    }

    /// Index of the pixel that sees a point, with the point's depth; `None` outside the image or behind the camera.
    #[inline]
    pub(crate) fn pixel(&self, x: f32, y: f32, height_m: f32) -> Option<(usize, f32)> {
        let cell_m = CELL_M as f32;
        let (dx, dy, dz) = ((x - self.eye[0]) * cell_m, (y - self.eye[1]) * cell_m, height_m - self.eye[2]);
        let r = &self.rotation;
        let depth_m = r[(0, 2)] * dx + r[(1, 2)] * dy + r[(2, 2)] * dz;
        if depth_m < 0.05 {
            return None;
        }
        let across = r[(0, 0)] * dx + r[(1, 0)] * dy + r[(2, 0)] * dz;
        let down = r[(0, 1)] * dx + r[(1, 1)] * dy + r[(2, 1)] * dz;
        let column = self.cx_px + self.fx_px * across / depth_m + 0.5;
        let row = self.cy_px + self.fy_px * down / depth_m + 0.5;
        let inside = column >= 0.0 && column < self.width as f32 && row >= 0.0 && row < self.height as f32;
        inside.then(|| (row as usize * self.width + column as usize, depth_m))
    }

    /// Smallest box of window cells that holds everything nearer than a depth: x from, x to, y from, y to, ends excluded.
    pub(crate) fn reach(&self, far_m: f32) -> [usize; 4] {
        let mut bounds = [self.eye[0], self.eye[0], self.eye[1], self.eye[1]];
        for column in [-1.0, self.width as f32] {
            for row in [-1.0, self.height as f32] {
                let ray = self.ray(column, row);
                let (x, y) = (self.eye[0] + far_m * ray[0], self.eye[1] + far_m * ray[1]);
                bounds = [bounds[0].min(x), bounds[1].max(x), bounds[2].min(y), bounds[3].max(y)];
            }
        }
        let side = SIDE as f32;
        let from = |edge: f32| (edge - 1.0).clamp(0.0, side) as usize;
        let to = |edge: f32| (edge + 2.0).clamp(0.0, side) as usize;
        [from(bounds[0]), to(bounds[1]), from(bounds[2]), to(bounds[3])]
    }
}

/// One image row: where a pixel lies is `eye + raw * (start + column * step)`, and so is its height above the cuts.
struct Row {
    eye: [f32; 3],
    start: [f32; 3],
    step: [f32; 3],
    near: u16,
    far: u16,
    floor_cut_m: f32,
    hole_cut_m: f32,
    bands_m: [f32; BANDS],
}

/// What belongs to the columns of a frame and does not change from row to row.
#[derive(Debug)]
pub(crate) struct Columns {
    /// `[px]` column minus principal point.
    offset_px: [f32; COLUMNS_MAX],
    /// `[m/unit]` growth of the cuts with the raw depth.
    cut: [f32; COLUMNS_MAX],
    /// Counter of each pixel of a row.
    counter: [u32; COLUMNS_MAX],
    wide: bool,
}

impl Columns {
    pub(crate) fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        let wide = std::is_x86_feature_detected!("avx2");
        #[cfg(not(target_arch = "x86_64"))]
        let wide = false;
        Self { offset_px: [0.0; COLUMNS_MAX], cut: [0.0; COLUMNS_MAX], counter: [0; COLUMNS_MAX], wide }
    }

    /// Uses the plain variant whatever the processor has.
    #[cfg(test)]
    pub(crate) fn narrow() -> Self {
        Self { wide: false, ..Self::new() }
    }

    /// Counts every pixel of a frame; `counts` must be zero where the frame reaches.
    pub(crate) fn count(&mut self, frame: &DepthFrame, lens: &Lens, config: &Config, counts: &mut Counts) {
        for (column, (offset, cut)) in self.offset_px.iter_mut().zip(&mut self.cut).enumerate() {
            *offset = column as f32 - lens.cx_px;
            let across = *offset / lens.fx_px;
            let range_per_depth = (1.0 + across * across).sqrt();
            *cut = config.floor_cut_per_m * lens.metres_per_unit * range_per_depth;
        }
        let units = |metres: f32| (metres / lens.metres_per_unit).min(65534.0) as u16;
        let cells = lens.ray(lens.cx_px + 1.0, lens.cy_px);
        let axis = lens.ray(lens.cx_px, lens.cy_px);
        let scale = lens.metres_per_unit;
        let mut row = Row {
            // Half a cell less, since the conversion to integers rounds to the nearest.
            eye: [lens.eye[0] - 0.5, lens.eye[1] - 0.5, lens.eye[2]],
            start: [0.0; 3],
            step: [0, 1, 2].map(|k| (cells[k] - axis[k]) * scale),
            near: units(config.near_m).max(1),
            far: units(config.far_m),
            floor_cut_m: config.floor_cut_m,
            hole_cut_m: config.hole_cut_m,
            bands_m: [1.0, 2.0, 3.0].map(|third| third * config.band_top_m / BANDS as f32),
        };
        for (number, raw) in frame.used_pixels().chunks_exact(lens.width).enumerate() {
            row.start = lens.ray(lens.cx_px, number as f32).map(|part| part * scale);
            let holes = self.classify(&row, raw);
            tally(&self.counter[..raw.len()], counts);
            if holes {
                self.tally_holes(&row, raw, counts);
            }
        }
        counts[DUMP as usize..][..COLUMNS_MAX].fill(0);
    }

    fn classify(&mut self, row: &Row, raw: &[u16]) -> bool {
        #[cfg(target_arch = "x86_64")]
        if self.wide {
            #[allow(unsafe_code, reason = "the processor was asked for AVX2 when `wide` was set")]
            // SAFETY: AVX2 is there.
            return unsafe { classify_wide(row, raw, &self.offset_px, &self.cut, &mut self.counter) };
        }
        classify(row, raw, &self.offset_px, &self.cut, &mut self.counter)
    }

    /// Counts each pixel below the floor as an obstacle where its ray passes the floor: there the floor is missing.
    #[cold]
    fn tally_holes(&self, row: &Row, raw: &[u16], counts: &mut Counts) {
        for (column, &raw) in raw.iter().enumerate() {
            if raw < row.near || raw > row.far {
                continue;
            }
            let depth = f32::from(raw);
            let at = |k: usize| row.start[k] + self.offset_px[column] * row.step[k];
            let height_m = row.eye[2] + depth * at(2);
            if height_m >= -(row.hole_cut_m + depth * self.cut[column]) {
                continue;
            }
            let crossing = depth * row.eye[2] / (row.eye[2] - height_m);
            let (x, y) = (row.eye[0] + crossing * at(0), row.eye[1] + crossing * at(1));
            let side = SIDE as f32 - 0.5;
            if x >= -0.5 && x < side && y >= -0.5 && y < side {
                let cell = (y + 0.5) as usize * SIDE + (x + 0.5) as usize;
                counts[cell * CLASSES + 1] += 1;
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn classify_wide(row: &Row, raw: &[u16], offset_px: &[f32], cut: &[f32], counter: &mut [u32]) -> bool {
    classify(row, raw, offset_px, cut, counter)
}

/// Finds the counter of each pixel of a row; true when some pixel lies in a hole.
#[inline(always)]
fn classify(row: &Row, raw: &[u16], offset_px: &[f32], cut: &[f32], counter: &mut [u32]) -> bool {
    let side = SIDE as f32 - 0.5;
    let mut holes = 0u32;
    let columns = offset_px.iter().zip(cut).zip(raw).zip(counter).enumerate();
    for (column, (((offset, cut), &raw), counter)) in columns {
        let depth = f32::from(raw);
        let x = row.eye[0] + depth * (row.start[0] + offset * row.step[0]);
        let y = row.eye[1] + depth * (row.start[1] + offset * row.step[1]);
        let height_m = row.eye[2] + depth * (row.start[2] + offset * row.step[2]);
        let rise_m = depth * cut;
        let measured = (raw >= row.near) & (raw <= row.far);
        let hole = height_m < -(row.hole_cut_m + rise_m);
        let inside = (x >= -0.5) & (x < side) & (y >= -0.5) & (y < side);
        let obstacle = f32::from(u8::from(height_m > row.floor_cut_m + rise_m));
        let middle = f32::from(u8::from(height_m > row.bands_m[0]));
        let high = f32::from(u8::from(height_m > row.bands_m[1]));
        let class = obstacle * (1.0 + middle + high);
        let cell = ((y + MAGIC) - MAGIC) * SIDE as f32 + ((x + MAGIC) - MAGIC);
        let place = (cell * CLASSES as f32 + class + MAGIC).to_bits() & 0x007f_ffff;
        let counts = measured & inside & !hole & (height_m <= row.bands_m[2]);
        holes |= u32::from(measured & hole);
        *counter = if counts { place } else { DUMP + column as u32 };
    }
    holes != 0
}

/// Adds one to each counter. Neighbouring pixels often share a counter; four places of the row in turn keep one
/// addition from waiting for the other.
fn tally(counters: &[u32], counts: &mut Counts) {
    let quarter = counters.len() / 4;
    let (first, rest) = counters.split_at(quarter);
    let (second, rest) = rest.split_at(quarter);
    let (third, fourth) = rest.split_at(quarter);
    let mut add = |counter: u32| counts[counter as usize & (COUNTERS - 1)] += 1;
    for (((a, b), c), d) in first.iter().zip(second).zip(third).zip(fourth) {
        add(*a);
        add(*b);
        add(*c);
        add(*d);
    }
    fourth[quarter..].iter().for_each(|counter| add(*counter));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hilly random frame with holes and losses, counted by both variants.
    #[test]
    fn the_wide_variant_counts_the_same_as_the_plain_one() {
        let mut frame: Box<DepthFrame> = Box::default();
        (frame.width, frame.height, frame.metres_per_unit) = (637, 479, 0.001);
        (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px) = (606.97, 600.1, 311.7, 250.2);
        frame.camera = sidestep_msgs::Isometry::camera(0.1, 0.02, 0.55, 0.2);
        let mut state = 7u64;
        for pixel in frame.pixels[..637 * 479].iter_mut() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *pixel = if state >> 62 == 0 { (state >> 40) as u16 } else { (state >> 52) as u16 };
        }
        let pose = sidestep_msgs::Pose2::new(0.0, 0.0, 0.7);
        let twist = sidestep_msgs::Twist::STOP;
        let body = Sample { stamp_ns: 1, pose, twist, roll_rad: 0.03, pitch_rad: -0.02 };
        let lens = Lens::new(&frame, &body, [96.3, 95.8], 2.86, Moment { tick: 1, drift_m: 0.0 });
        let [wide, narrow] = [Columns::new(), Columns::narrow()].map(|mut columns| {
            let mut counts = new_counts();
            columns.count(&frame, &lens, &Config::shipped(), &mut counts);
            counts
        });
        assert!(wide == narrow);
        assert!(wide.iter().sum::<u32>() > 50_000);
    }

    /// A camera looks along x from the middle of the window; a point goes to its pixel and its depth comes back.
    #[test]
    fn a_point_projects_to_the_pixel_that_sees_it() {
        let mut frame: Box<DepthFrame> = Box::default();
        (frame.width, frame.height, frame.metres_per_unit) = (640, 480, 0.001);
        (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px) = (600.0, 600.0, 320.0, 240.0);
        frame.camera = sidestep_msgs::Isometry::camera(0.0, 0.0, 0.5, 0.0);
        let pose = sidestep_msgs::Pose2::ORIGIN;
        let body =
            Sample { stamp_ns: 1, pose, twist: sidestep_msgs::Twist::STOP, roll_rad: 0.0, pitch_rad: 0.0 };
        let lens = Lens::new(&frame, &body, [96.0, 96.0], 0.0, Moment { tick: 1, drift_m: 0.0 });
        // 2 m ahead, 0.4 m left, 0.2 m below the camera: u = 320 - 600 * 0.4 / 2, v = 240 + 600 * 0.2 / 2.
        let (pixel, depth_m) = lens.pixel(96.0 + 40.0, 96.0 + 8.0, 0.3).unwrap();
        assert_eq!((pixel % 640, pixel / 640), (200, 300));
        assert!((depth_m - 2.0).abs() < 1e-4, "{depth_m}");
        assert_eq!(lens.pixel(96.0 - 40.0, 96.0, 0.3), None, "behind");
        assert_eq!(lens.pixel(96.0 + 40.0, 96.0 + 40.0, 0.3), None, "beside");
    }
}

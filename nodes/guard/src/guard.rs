//! The step: every pixel looked at is placed in `base` as if the robot stood level, and counted if it is in the way.
//!
//! The guard reads no odometry, so it does not know how far the body leans. A self-balancing base leans with its
//! acceleration, and a lean of d turns the floor at range r into something d r high. The floor cut therefore grows with
//! range by the greatest lean that the robot file allows.

use crate::config::{Config, ConfigError};
use crate::fan::{Fan, LANES};
use crate::frame::{Lens, refusal};
use crate::tally::{Support, Tally};
use sidestep_msgs::{DepthFrame, NEAR_SECTORS, NearField, Robot, Status};
use wide::f32x4;

/// `[px]` columns that are looked at at least, where the frame has them: four per sector.
const COLUMNS_MIN: u32 = 4 * NEAR_SECTORS as u32;

/// The guard: all memory is taken at construction.
#[derive(Debug)]
pub struct Guard {
    config: Config,
    /// `[m/m]` growth of the floor cut with range.
    floor_per_m: f32,
    /// `[m px]` standard deviation of the disparity over the baseline of the stereo camera.
    noise_m_px: f32,
    fan: Fan,
    tally: Tally,
}

impl Guard {
    /// A guard for a robot.
    ///
    /// # Errors
    /// The first value of the configuration that is out of its range.
    pub fn new(config: &Config, robot: &Robot) -> Result<Self, ConfigError> {
        config.check()?;
        let hardest_m_s2 = robot.limits.accelerate_m_s2.max(robot.actuator.brake_max_m_s2);
        let lean_rad = (robot.actuator.pitch_rad_per_m_s2 * hardest_m_s2).clamp(0.0, 0.5);
        Ok(Self {
            config: *config,
            floor_per_m: config.floor_cut_per_m + libm::tanf(lean_rad),
            noise_m_px: robot.camera.map_or(0.0, |camera| camera.disparity_sigma_px / camera.baseline_m),
            fan: Fan::new(),
            tally: Tally::new(),
        })
    }

    /// Takes the nearest ranges of a frame, or refuses it.
    pub fn step(&mut self, frame: &DepthFrame, out: &mut NearField) -> Status {
        let status = refusal(frame, self.config.valid_part_min);
        if status != Status::Ok {
            // Nothing was measured: a look all the same, at what may be too near. Whether it may be is the mapper's to judge.
            let is_empty = status == Status::RefusedEmpty;
            *out = NearField {
                capture_ns: if is_empty { frame.capture_ns } else { 0 },
                range_m: [f32::NAN; NEAR_SECTORS],
                left_rad: 0.0,
                sector_rad: 0.0,
            };
            return status;
        }
        let (config, lens) = (&self.config, Lens::new(frame));
        let size_px = [frame.width as f32, frame.height as f32];
        self.fan.span(&lens, size_px, [config.near_m, config.far_m]);
        let stride = (config.stride_px).min(frame.width / COLUMNS_MIN).max(1) as usize;
        let looked_at = 1.0 / (stride * stride) as f32;
        let side2 = config.support_side_m * config.support_side_m;
        self.tally.begin(&Support {
            pixels_at_1_m: side2 * frame.fx_px * frame.fy_px * looked_at,
            pixels_min: config.support_min_px as f32,
            depth_m: config.support_depth_m,
            sigma_at_1_m: self.noise_m_px / frame.fx_px,
        });
        self.count(frame, &lens, stride);
        let share = size_px[0] * size_px[1] * looked_at / NEAR_SECTORS as f32;
        let measured_min = (self.config.seen_part_min * share).max(1.0);
        out.capture_ns = frame.capture_ns;
        out.left_rad = self.fan.left_rad;
        out.sector_rad = self.fan.sector_rad;
        for (sector, range_m) in out.range_m.iter_mut().enumerate() {
            *range_m = self.tally.nearest_m(sector, measured_min);
        }
        Status::Ok
    }

    fn count(&mut self, frame: &DepthFrame, lens: &Lens, stride: usize) {
        let of = f32x4::splat;
        let Config { near_m, far_m, floor_cut_m, band_top_m, .. } = self.config;
        let step = lens.per_column().map(|part| of(part * stride as f32));
        let rows = frame.used_pixels().chunks_exact(frame.width as usize);
        for (row, pixels) in rows.enumerate().step_by(stride) {
            let first = lens.ray(0.0, row as f32).map(of);
            let mut column = f32x4::new([0.0, 1.0, 2.0, 3.0]);
            for four in pixels.chunks(LANES * stride) {
                // What is missing at the end of a row is no measurement.
                let mut raw = [0.0; LANES];
                raw.iter_mut()
                    .zip(four.iter().step_by(stride))
                    .for_each(|(raw, pixel)| *raw = f32::from(*pixel));
                let raw = f32x4::new(raw);
                let depth_m = raw * of(frame.metres_per_unit);
                let at = |axis: usize| of(lens.eye_m[axis]) + depth_m * (first[axis] + column * step[axis]);
                let (x_m, y_m, z_m) = (at(0), at(1), at(2));
                column += of(LANES as f32);
                // 0 is no measurement and nearer than any limit.
                let seen = raw.simd_lt(of(f32::from(u16::MAX))) & depth_m.simd_ge(of(near_m));
                let range_m = (x_m * x_m + y_m * y_m).sqrt();
                let floor_m = of(floor_cut_m) + of(self.floor_per_m) * range_m;
                let is_high = z_m.simd_gt(floor_m) & z_m.simd_lt(of(band_top_m));
                let (seen, blocks) =
                    (seen.to_bitmask(), (seen & is_high & depth_m.simd_le(of(far_m))).to_bitmask());
                for (lane, sector) in self.fan.sectors(x_m, y_m).into_iter().enumerate() {
                    if seen >> lane & 1 == 1 {
                        self.tally.see(sector);
                    }
                    if blocks >> lane & 1 == 1 {
                        self.tally.block(sector, range_m.as_array()[lane]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::Isometry;

    /// Frames of every width and stride, pixels at random, some of them not measured or saturated, some at the end of a row.
    #[test]
    fn pixels_side_by_side_are_counted_as_each_alone() {
        let text = include_str!("../../../launch/robots/loomo.toml");
        let robot = Robot::from_toml("loomo.toml", text).unwrap();
        let mut frame: Box<DepthFrame> = Box::default();
        (frame.height, frame.metres_per_unit, frame.capture_ns) = (60, 0.001, 1);
        (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px) = (76.0, 77.0, 41.0, 29.5);
        frame.camera = Isometry::camera(0.1, 0.02, 0.55, 0.17);
        let mut state = 1_u64;
        for (width, stride) in (80..92).flat_map(|width| (1..4).map(move |stride| (width, stride))) {
            frame.width = width;
            for pixel in &mut frame.pixels[..60 * width as usize] {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                *pixel = [0, u16::MAX, (state >> 48) as u16 % 4000, 1200][(state >> 40) as usize % 4];
            }
            let mut guard = Guard::new(&Config::STANDARD, &robot).unwrap();
            let _ = guard.step(&frame, &mut NearField::default());
            let support = Support { pixels_at_1_m: 9.0, pixels_min: 4.0, depth_m: 0.06, sigma_at_1_m: 0.0 };
            guard.tally.begin(&support);
            let lens = Lens::new(&frame);
            guard.count(&frame, &lens, stride);
            let mut alone = Tally::new();
            alone.begin(&support);
            for row in (0..60).step_by(stride) {
                for column in (0..width as usize).step_by(stride) {
                    let raw = frame.pixels[row * width as usize + column];
                    let depth_m = f32::from(raw) * 0.001;
                    if raw == u16::MAX || depth_m < 0.35 {
                        continue;
                    }
                    let (first, step) = (lens.ray(0.0, row as f32), lens.per_column());
                    let steps = (column / stride) as f32;
                    let [x_m, y_m, z_m] = [0, 1, 2].map(|axis| {
                        lens.eye_m[axis] + depth_m * (first[axis] + steps * (step[axis] * stride as f32))
                    });
                    let [sector, ..] = guard.fan.sectors(f32x4::splat(x_m), f32x4::splat(y_m));
                    alone.see(sector);
                    let range_m = (x_m * x_m + y_m * y_m).sqrt();
                    let floor_m = 0.05 + guard.floor_per_m * range_m;
                    if z_m > floor_m && z_m < 0.9 && depth_m <= 3.5 {
                        alone.block(sector, range_m);
                    }
                }
            }
            assert!(guard.tally == alone, "{width} by {stride}");
        }
    }
}

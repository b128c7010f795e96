//! The step: every pixel looked at is placed in `base` as if the robot stood level, and counted if it is in the way.
//!
//! The guard reads no odometry, so it does not know how far the body leans. A self-balancing base leans with its
//! acceleration, and a lean of d turns the floor at range r into something d r high. The floor cut therefore grows with
//! range by the greatest lean that the robot file allows.

use crate::config::{Config, ConfigError};
use crate::fan::Fan;
use crate::frame::{Lens, refusal};
use crate::tally::{Support, Tally};
use sidestep_msgs::{DepthFrame, NEAR_SECTORS, NearField, Robot, Status};

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
            *out = NearField {
                capture_ns: 0,
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
        let config = &self.config;
        let unit_m = frame.metres_per_unit;
        let step = lens.per_column().map(|part| part * stride as f32);
        let rows = frame.used_pixels().chunks_exact(frame.width as usize);
        for (row, pixels) in rows.enumerate().step_by(stride) {
            let first = lens.ray(0.0, row as f32);
            for (index, &raw) in pixels.iter().step_by(stride).enumerate() {
                let depth_m = f32::from(raw) * unit_m;
                // 0 is no measurement and nearer than any limit.
                if raw == u16::MAX || depth_m < config.near_m {
                    continue;
                }
                let column = index as f32;
                let at = |axis: usize| lens.eye_m[axis] + depth_m * (first[axis] + column * step[axis]);
                let (x_m, y_m, z_m) = (at(0), at(1), at(2));
                let sector = self.fan.sector(x_m, y_m);
                self.tally.see(sector);
                let range_m = (x_m * x_m + y_m * y_m).sqrt();
                let floor_m = config.floor_cut_m + self.floor_per_m * range_m;
                if z_m > floor_m && z_m < config.band_top_m && depth_m <= config.far_m {
                    self.tally.block(sector, range_m);
                }
            }
        }
    }
}

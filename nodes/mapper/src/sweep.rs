//! Lidar sweeps: each beam is walked cell by cell through the window, free up to its end and occupied there.
//!
//! A cell is judged once per sweep: the end of any beam in it outweighs all beams that pass.

use crate::config::Config;
use crate::grid::{ALL_BANDS, CELL_M, CELLS, Grid, Moment, SIDE};
use sidestep_msgs::{Pose2, SCAN_BEAMS, Scan};

const PASSED: u8 = 1;
const ENDED: u8 = 2;

/// Working memory of a sweep.
#[derive(Debug)]
pub(crate) struct Sweep {
    touch: Vec<u8>,
    /// Cells touched, the first `count` of them; one more than there are cells, for the next to be written.
    touched: Vec<u32>,
    count: usize,
}

/// Whether the numbers of a sweep can be: beams in use, finite geometry.
pub(crate) fn is_shaped(scan: &Scan) -> bool {
    let count = scan.count as usize;
    let angles = scan.first_rad.is_finite() && scan.step_rad.is_finite();
    (1..=SCAN_BEAMS).contains(&count)
        && angles
        && scan.first_rad.abs() < 10.0
        && scan.step_rad.abs() > 1e-5
        && scan.step_rad.abs() * count as f32 <= 6.4
        && scan.near_m >= 0.0
        && scan.far_m > scan.near_m
        && scan.far_m < 1e4
        && scan.height_m.is_finite()
}

impl Sweep {
    pub(crate) fn new() -> Self {
        Self { touch: vec![0; CELLS], touched: vec![0; CELLS + 1], count: 0 }
    }

    /// Takes one sweep, with the robot at `pose`, into the grid.
    pub(crate) fn take(&mut self, scan: &Scan, pose: &Pose2, config: &Config, now: &Moment, grid: &mut Grid) {
        let sensor = pose.compose(&scan.sensor);
        let from = grid.window(sensor.x_m, sensor.y_m);
        for (beam, &range_m) in scan.range_m[..scan.count as usize].iter().enumerate() {
            // Readings below the near limit are no measurement.
            if range_m.is_nan() || range_m < scan.near_m {
                continue;
            }
            let bearing = sensor.yaw_rad as f32 + scan.first_rad + beam as f32 * scan.step_rad;
            let (sin, cos) = libm::sincosf(bearing);
            let ends = range_m <= scan.far_m;
            let length = range_m.min(scan.far_m) / CELL_M as f32;
            self.walk(from, [cos, sin], length, ends, config.scan_sees_band);
        }
        for &cell in &self.touched[..std::mem::take(&mut self.count)] {
            let touch = std::mem::take(&mut self.touch[cell as usize]);
            let index = grid.index(cell as usize % SIDE, cell as usize / SIDE);
            if touch >= ENDED {
                let bands = if config.scan_sees_band { ALL_BANDS } else { band_of(scan.height_m, config) };
                grid.add(index, config.strong_hit_log_odds, bands, now);
            } else {
                grid.add(index, -config.miss_log_odds, 0, now);
            }
        }
    }

    /// Walks from a point along a direction over all cells on the way (Amanatides and Woo), inside the window.
    fn walk(&mut self, from: [f32; 2], along: [f32; 2], length: f32, ends: bool, clears: bool) {
        let side = SIDE as f32;
        if !from.iter().all(|&part| part >= 0.0 && part < side) {
            return;
        }
        let mut reach = length;
        for k in 0..2 {
            let room = if along[k] < 0.0 { from[k] } else { side - from[k] };
            reach = reach.min(room / along[k].abs().max(1e-9));
        }
        let cell = |part: f32| libm::floorf(part).clamp(0.0, side - 1.0);
        let first = from.map(cell);
        let last = [0, 1].map(|k| cell(from[k] + reach * along[k]));
        let gap = along.map(|part| 1.0 / part.abs().max(1e-9));
        let edge = |k: usize| if along[k] < 0.0 { from[k] - first[k] } else { first[k] + 1.0 - from[k] };
        let (mut next_x, mut next_y) = (edge(0) * gap[0], edge(1) * gap[1]);
        let step_x = if along[0] < 0.0 { usize::MAX } else { 1 };
        let step_y = if along[1] < 0.0 { SIDE.wrapping_neg() } else { SIDE };
        let crossings = (last[0] - first[0]).abs() + (last[1] - first[1]).abs();
        let mut index = first[1] as usize * SIDE + first[0] as usize;
        if clears {
            for _ in 0..crossings as usize {
                self.mark(index, PASSED);
                let across = next_x < next_y;
                index = index.wrapping_add(if across { step_x } else { step_y });
                next_x += if across { gap[0] } else { 0.0 };
                next_y += if across { 0.0 } else { gap[1] };
            }
        }
        if ends && reach >= length {
            self.mark(last[1] as usize * SIDE + last[0] as usize, ENDED);
        }
    }

    /// Notes a cell; rounding may lead a walk one cell out of the window, which is passed over.
    fn mark(&mut self, index: usize, touch: u8) {
        let Some(cell) = self.touch.get_mut(index) else { return };
        self.touched[self.count] = index as u32;
        self.count += usize::from(*cell == 0);
        *cell |= touch;
    }
}

fn band_of(height_m: f32, config: &Config) -> u8 {
    let third = (3.0 * height_m / config.band_top_m).clamp(0.0, 2.0) as u32;
    1 << third
}

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
    touched: Vec<u32>,
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
        Self { touch: vec![0; CELLS], touched: Vec::with_capacity(CELLS) }
    }

    /// Takes one sweep, with the robot at `pose`, into the grid.
    pub(crate) fn take(&mut self, scan: &Scan, pose: &Pose2, config: &Config, now: &Moment, grid: &mut Grid) {
        let sensor = pose.compose(&scan.sensor);
        let from = grid.window(sensor.x_m, sensor.y_m);
        for (beam, &range_m) in scan.range_m[..scan.count as usize].iter().enumerate() {
            // NaN and readings below the near limit are no measurement.
            if !(range_m >= scan.near_m) {
                continue;
            }
            let bearing = sensor.yaw_rad as f32 + scan.first_rad + beam as f32 * scan.step_rad;
            let (sin, cos) = libm::sincosf(bearing);
            let ends = range_m <= scan.far_m;
            let length = range_m.min(scan.far_m) / CELL_M as f32;
            self.walk(from, [cos, sin], length, ends, config.scan_sees_band);
        }
        for cell in self.touched.drain(..) {
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

    /// Walks from a point along a direction over all cells on the way (Amanatides and Woo).
    fn walk(&mut self, from: [f32; 2], along: [f32; 2], length: f32, ends: bool, clears: bool) {
        let mut cell = [libm::floorf(from[0]) as i32, libm::floorf(from[1]) as i32];
        let end = [0, 1].map(|k| libm::floorf(from[k] + length * along[k]).clamp(-1e6, 1e6) as i32);
        let step = along.map(|part| if part < 0.0 { -1 } else { 1 });
        let gap = along.map(|part| 1.0 / part.abs().max(1e-9));
        let mut next = [0, 1].map(|k| {
            let edge = cell[k] as f32 + if step[k] > 0 { 1.0 } else { 0.0 };
            (edge - from[k]).abs() * gap[k]
        });
        // At most one step per crossed edge, and never more than the window is wide both ways.
        for _ in 0..2 * SIDE {
            let inside = cell.iter().all(|&part| (0..SIDE as i32).contains(&part));
            if !inside {
                return;
            }
            let at_end = cell == end || next[0].min(next[1]) >= length;
            if at_end {
                break;
            }
            if clears {
                self.mark(cell, PASSED);
            }
            let axis = usize::from(next[1] < next[0]);
            cell[axis] += step[axis];
            next[axis] += gap[axis];
        }
        let inside = cell.iter().all(|&part| (0..SIDE as i32).contains(&part));
        if ends && inside && (cell[0] - end[0]).abs() <= 1 && (cell[1] - end[1]).abs() <= 1 {
            self.mark(cell, ENDED);
        }
    }

    fn mark(&mut self, cell: [i32; 2], touch: u8) {
        let index = cell[1] as usize * SIDE + cell[0] as usize;
        if self.touch[index] == 0 {
            self.touched.push(index as u32);
        }
        self.touch[index] |= touch;
    }
}

fn band_of(height_m: f32, config: &Config) -> u8 {
    let third = (3.0 * height_m / config.band_top_m).clamp(0.0, 2.0) as u32;
    1 << third
}

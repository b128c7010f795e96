//! What the grid looks like from the robot: occupancy and age as bytes round it, and the two maps sampled from them.
//!
//! The bytes are made once per step, in axes of `odom`; both maps then turn them into `base`. The safety map takes the
//! largest occupancy and the oldest age of every grid cell that a cell of the map overlaps, never less.

use crate::grid::{CELL_M, Grid, Moment, SIDE};
use sidestep_msgs::{
    AGE_NEVER, AGE_OLDER, LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Pose2, SAFETY_CELLS, SAFETY_GRID, SAFETY_SIDE,
};

/// Cells along a side of the view: 6.4 m, which holds both maps at any heading.
pub(crate) const VIEW: usize = 128;
/// First window cell of the view, both ways.
const FIRST: usize = (SIDE - VIEW) / 2;
/// Occupancy of a cell that was never seen.
const UNKNOWN: u8 = 128;
/// Occupancy of a cell that an ultrasonic sensor marks.
const SONAR: u8 = 230;
/// Steps of the log-odds table per unit.
const STEPS: f32 = 36.0;
/// Samples along a side of a cell of the local map: closer than grid cells, so that none is missed, and even, so that
/// none lies on the edge of a grid cell when both grids are aligned.
const SAMPLES: usize = 4;
/// [cells] added to the half-extent of a safety cell for the rounding of `f32`.
const SLACK: f32 = 1e-3;

/// Occupancy and age of one cell.
type Pair = [u8; 2];

/// The bytes round the robot.
#[derive(Debug)]
pub(crate) struct View {
    /// Place of the robot in the view, in cells, and its heading.
    at: [f32; 2],
    heading: [f32; 2],
    cells: Vec<Pair>,
    /// Largest of a cell and its three neighbours above, right and both.
    pooled: Vec<Pair>,
    probability: [u8; 256],
}

impl View {
    pub(crate) fn new() -> Self {
        let probability = std::array::from_fn(|step| {
            let log_odds = (step as f32 - 128.0) / STEPS;
            (255.0 / (1.0 + libm::expf(-log_odds)) + 0.5) as u8
        });
        let unknown = vec![[UNKNOWN, AGE_NEVER]; VIEW * VIEW];
        Self { at: [64.0; 2], heading: [1.0, 0.0], cells: unknown.clone(), pooled: unknown, probability }
    }

    /// Nothing was ever seen.
    pub(crate) fn reset(&mut self) {
        self.cells.fill([UNKNOWN, AGE_NEVER]);
        self.pooled.fill([UNKNOWN, AGE_NEVER]);
    }

    /// Makes the bytes from the grid, as seen from `pose` at `now`; `sonar_ticks` is how long ultrasonic marks hold.
    pub(crate) fn refresh(&mut self, grid: &Grid, pose: &Pose2, now: &Moment, sonar_ticks: u32) {
        let at = grid.window(pose.x_m, pose.y_m);
        self.at = at.map(|part| part - FIRST as f32);
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        self.heading = [cos as f32, sin as f32];
        for y in 0..VIEW {
            // A row of the view is one or two runs of the torus.
            let start = grid.index(FIRST, FIRST + y);
            let run = (SIDE - start % SIDE).min(VIEW);
            let row = &mut self.cells[y * VIEW..][..VIEW];
            let (left, right) = row.split_at_mut(run);
            convert(grid, start, left, now, sonar_ticks, &self.probability);
            convert(grid, start / SIDE * SIDE, right, now, sonar_ticks, &self.probability);
        }
        self.pool();
    }

    fn pool(&mut self) {
        for y in 0..VIEW - 1 {
            let rows = &self.cells[y * VIEW..][..2 * VIEW];
            let (below, above) = rows.as_flattened().split_at(2 * VIEW);
            let out = self.pooled[y * VIEW..][..VIEW].as_flattened_mut();
            let last = out.len() - 2;
            for (k, out) in out[..last].iter_mut().enumerate() {
                *out = below[k].max(below[k + 2]).max(above[k]).max(above[k + 2]);
            }
        }
    }

    /// A point of `base` in cells of the view.
    fn place(&self, x_m: f32, y_m: f32) -> [f32; 2] {
        let (x, y) = (x_m / CELL_M as f32, y_m / CELL_M as f32);
        let [cos, sin] = self.heading;
        [self.at[0] + cos * x - sin * y, self.at[1] + sin * x + cos * y]
    }

    /// Occupancy and age of the local map: each cell takes sixteen samples. Its occupancy is the largest that is known, its
    /// age the youngest; it is known where most samples are, or where one is occupied.
    pub(crate) fn local(&self, occupancy: &mut [u8; LOCAL_CELLS], age: &mut [u8; LOCAL_CELLS]) {
        let part = LOCAL_GRID.cell_m / SAMPLES as f32;
        let offset = |k: usize| (k as f32 - 0.5 * (SAMPLES - 1) as f32) * part;
        for index in 0..LOCAL_CELLS {
            let (x_m, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
            let (mut most, mut youngest, mut known) = (0, AGE_NEVER, 0);
            for sample in 0..SAMPLES * SAMPLES {
                let [x, y] = self.place(x_m + offset(sample / SAMPLES), y_m + offset(sample % SAMPLES));
                let cell = (y as usize).min(VIEW - 1) * VIEW + (x as usize).min(VIEW - 1);
                let [occupied, seen] = self.cells[cell];
                if seen != AGE_NEVER {
                    most = most.max(occupied);
                    youngest = youngest.min(seen);
                    known += 1;
                }
            }
            let is_known = known > SAMPLES * SAMPLES / 2 || most >= UNKNOWN;
            occupancy[index] = if is_known { most } else { UNKNOWN };
            age[index] = if is_known { youngest } else { AGE_NEVER };
        }
    }

    /// Occupancy and age of the safety map.
    pub(crate) fn safety(&self, occupancy: &mut [u8; SAFETY_CELLS], age: &mut [u8; SAFETY_CELLS]) {
        let half = 0.5 * SAFETY_GRID.cell_m / CELL_M as f32;
        // Half the box round a turned cell.
        let extent = half * (self.heading[0].abs() + self.heading[1].abs()) + SLACK;
        let mut corners = [[[0u8; 2]; SAFETY_SIDE]; 4];
        for row in 0..SAFETY_SIDE {
            for col in 0..SAFETY_SIDE {
                let (x_m, y_m) = SAFETY_GRID.centre(row, col);
                let [x, y] = self.place(x_m, y_m);
                let bound = |part: f32| (part as usize).min(VIEW - 2);
                let (x0, x1) = (bound(x - extent), bound(x + extent - 1.0));
                let (y0, y1) = (bound(y - extent), bound(y + extent - 1.0));
                corners[0][col] = self.pooled[y0 * VIEW + x0];
                corners[1][col] = self.pooled[y0 * VIEW + x1];
                corners[2][col] = self.pooled[y1 * VIEW + x0];
                corners[3][col] = self.pooled[y1 * VIEW + x1];
            }
            let out = occupancy[row * SAFETY_SIDE..].iter_mut().zip(&mut age[row * SAFETY_SIDE..]);
            for (col, (occupancy, age)) in out.take(SAFETY_SIDE).enumerate() {
                let largest = |k: usize| corners.iter().fold(0, |most, corner| most.max(corner[col][k]));
                *occupancy = largest(0);
                *age = largest(1);
            }
        }
    }
}

/// Makes the bytes of a run of grid cells.
fn convert(grid: &Grid, start: usize, out: &mut [Pair], now: &Moment, sonar_ticks: u32, table: &[u8; 256]) {
    let run = start..start + out.len();
    let memory = grid.log_odds[run.clone()].iter().zip(&grid.seen_tick[run.clone()]);
    let memory = memory.zip(&grid.drift_m[run.clone()]).zip(&grid.sonar_tick[run]);
    for (out, (((&log_odds, &seen), &drift_m), &sonar)) in out.iter_mut().zip(memory) {
        let ticks = now.tick.saturating_sub(seen);
        let left = grid.trust.left(log_odds, ticks as f32, now.drift_m - drift_m);
        let step = (log_odds * left * STEPS + 128.5).clamp(0.0, 255.0) as u8;
        let tenths = (ticks / 10).min(u32::from(AGE_OLDER)) as u8;
        let known = seen != 0 && left > 0.0;
        let mut pair = if known { [table[usize::from(step)], tenths] } else { [UNKNOWN, AGE_NEVER] };
        let sonar_age = now.tick.saturating_sub(sonar);
        if sonar != 0 && sonar_age <= sonar_ticks {
            let age = (sonar_age / 10).min(u32::from(AGE_OLDER)) as u8;
            pair = [pair[0].max(SONAR), pair[1].min(age)];
        }
        *out = pair;
    }
}

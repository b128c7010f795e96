//! What the grid looks like from the robot: occupancy, age and stillness as bytes round it, and the two maps made of
//! them.
//!
//! The bytes are made once per step, in axes of `odom`. The safety map is a part of them as they are; the local map turns
//! them into `base`.

use crate::grid::{CELL_M, Grid, Moment, SIDE};
use sidestep_msgs::{
    AGE_NEVER, AGE_OLDER, LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Pose2, SAFETY_CELLS, SAFETY_SIDE, STILL,
    safety_frame,
};

/// Cells along a side of the view: 6.4 m, which holds both maps at any heading.
pub(crate) const VIEW: usize = 128;
/// First window cell of the view, both ways.
const FIRST: usize = (SIDE - VIEW) / 2;
/// Cells of the view, a power of two, so that a masked index needs no check.
const CELLS: usize = VIEW * VIEW;
/// Occupancy of a cell that was never seen, in the maps.
const UNKNOWN: u8 = 128;
/// 2^23: a float in [0, 2^22) plus this carries its rounded value in the low bits.
const MAGIC: f32 = 8_388_608.0;
/// Occupancy of a cell that an ultrasonic sensor marks.
const SONAR: u8 = 230;
/// Steps of the log-odds table per unit.
const STEPS: f32 = 36.0;
/// Samples along a side of a cell of the local map: closer than grid cells, so that none is missed, and even, so that
/// none lies on the edge of a grid cell when both grids are aligned.
const SAMPLES: usize = 4;
/// Occupancy, age and stillness of one cell, and a zero that makes it a word.
type Look = [u8; 4];
const NEVER: Look = [0, AGE_NEVER, STILL, 0];

/// The bytes round the robot.
#[derive(Debug)]
pub(crate) struct View {
    /// Place of the robot in the view, in cells, and its heading.
    at: [f32; 2],
    /// First cell of the view along each axis beyond the origin of the safety map.
    middle: [usize; 2],
    heading: [f32; 2],
    cells: Box<[Look; CELLS]>,
    probability: [u8; 256],
}

impl View {
    pub(crate) fn new() -> Self {
        let probability = std::array::from_fn(|step| {
            let log_odds = (step as f32 - 128.0) / STEPS;
            (255.0 / (1.0 + libm::expf(-log_odds)) + 0.5) as u8
        });
        Self {
            at: [64.0; 2],
            middle: [VIEW / 2; 2],
            heading: [1.0, 0.0],
            cells: Box::new([NEVER; CELLS]),
            probability,
        }
    }

    /// Nothing was ever seen.
    pub(crate) fn reset(&mut self) {
        self.cells.fill(NEVER);
    }

    /// Makes the bytes from the grid, as seen from `pose` at `now`; `sonar_ticks` is how long ultrasonic marks hold.
    pub(crate) fn refresh(&mut self, grid: &Grid, pose: &Pose2, now: &Moment, sonar_ticks: u32) {
        let at = grid.window(pose.x_m, pose.y_m);
        self.at = at.map(|part| part - FIRST as f32);
        let frame = safety_frame(pose);
        // Whole numbers but for rounding.
        self.middle = grid.window(frame.x_m, frame.y_m).map(|part| (part + 0.5) as usize + VIEW - FIRST);
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
    }

    /// Fills `looks` with the cells under points of `base`: the first at `(x_m, y_m)`, each next one `step_m` to the
    /// right.
    #[inline(always)]
    fn sample(&self, x_m: f32, y_m: f32, step_m: f32, looks: &mut [Look]) {
        let [cos, sin] = self.heading.map(|part| part / CELL_M as f32);
        // Half a cell less, since the conversion to integers rounds to the nearest.
        let x0 = self.at[0] + cos * x_m - sin * y_m - 0.5;
        let y0 = self.at[1] + sin * x_m + cos * y_m - 0.5;
        let (dx, dy) = (sin * step_m, -cos * step_m);
        for (count, look) in looks.iter_mut().enumerate() {
            let count = count as f32;
            let x = (x0 + count * dx + MAGIC).to_bits() as usize % VIEW;
            let y = (y0 + count * dy + MAGIC).to_bits() as usize % VIEW;
            *look = self.cells[y * VIEW + x];
        }
    }

    /// Occupancy and age of the local map: each cell takes sixteen samples. Its occupancy is the largest that is known,
    /// its age the youngest; it is known where most samples are. An occupied grid cell counts where its centre lies, and
    /// nowhere else: what stands there is never missed, and a gap shrinks by no more than it must.
    pub(crate) fn local(&self, occupancy: &mut [u8; LOCAL_CELLS], age: &mut [u8; LOCAL_CELLS]) {
        let part = LOCAL_GRID.cell_m / SAMPLES as f32;
        let offset = |k: usize| (k as f32 - 0.5 * (SAMPLES - 1) as f32) * part;
        let mut looks = [NEVER; LOCAL_SIDE];
        let rows = occupancy.chunks_exact_mut(LOCAL_SIDE).zip(age.chunks_exact_mut(LOCAL_SIDE)).enumerate();
        for (row, (occupancy, age)) in rows {
            let (x_m, y_m) = LOCAL_GRID.centre(row, 0);
            let mut known = [0u8; LOCAL_SIDE];
            occupancy.fill(0);
            age.fill(AGE_NEVER);
            for sample in 0..SAMPLES * SAMPLES {
                let (x_m, y_m) = (x_m + offset(sample / SAMPLES), y_m + offset(sample % SAMPLES));
                self.sample(x_m, y_m, LOCAL_GRID.cell_m, &mut looks);
                for (col, [occupied, seen, ..]) in looks.iter().enumerate() {
                    let free = if *occupied < UNKNOWN { *occupied } else { 0 };
                    occupancy[col] = occupancy[col].max(free);
                    age[col] = age[col].min(*seen);
                    known[col] += u8::from(*seen != AGE_NEVER);
                }
            }
            for ((occupancy, age), known) in occupancy.iter_mut().zip(age).zip(known) {
                let is_known = usize::from(known) > SAMPLES * SAMPLES / 2;
                (*occupancy, *age) = if is_known { (*occupancy, *age) } else { (UNKNOWN, AGE_NEVER) };
            }
        }
        self.place_obstacles(occupancy, age);
    }

    /// Puts every occupied grid cell into the cell of the local map that holds its centre.
    fn place_obstacles(&self, occupancy: &mut [u8; LOCAL_CELLS], age: &mut [u8; LOCAL_CELLS]) {
        let [cos, sin] = self.heading.map(|part| part * CELL_M as f32);
        for (y, row) in self.cells.chunks_exact(VIEW).enumerate() {
            for (x, [occupied, seen, ..]) in row.iter().enumerate() {
                if *occupied < UNKNOWN {
                    continue;
                }
                let (dx, dy) = (x as f32 + 0.5 - self.at[0], y as f32 + 0.5 - self.at[1]);
                if let Some(cell) = LOCAL_GRID.index(cos * dx + sin * dy, cos * dy - sin * dx) {
                    occupancy[cell] = occupancy[cell].max(*occupied);
                    age[cell] = age[cell].min(*seen);
                }
            }
        }
    }

    /// Occupancy, age and stillness of the safety map: the cells round the corner that is nearest to the robot.
    pub(crate) fn safety(
        &self,
        occupancy: &mut [u8; SAFETY_CELLS],
        age: &mut [u8; SAFETY_CELLS],
        still: &mut [u8; SAFETY_CELLS],
    ) {
        let [last_x, last_y] = self.middle.map(|part| part + SAFETY_SIDE / 2 - 1);
        for index in 0..SAFETY_CELLS {
            let (x, y) = (last_x - index / SAFETY_SIDE, last_y - index % SAFETY_SIDE);
            let [occupied, seen, stood, _] = self.cells[y % VIEW * VIEW + x % VIEW];
            occupancy[index] = if seen == AGE_NEVER { UNKNOWN.max(occupied) } else { occupied };
            age[index] = seen;
            still[index] = stood;
        }
    }
}

/// Makes the bytes of a run of grid cells.
fn convert(grid: &Grid, start: usize, out: &mut [Look], now: &Moment, sonar_ticks: u32, table: &[u8; 256]) {
    let run = start..start + out.len();
    let memory = grid.log_odds[run.clone()].iter().zip(&grid.seen_tick[run.clone()]);
    let memory = memory.zip(&grid.drift_m[run.clone()]).zip(&grid.sonar_tick[run.clone()]);
    let memory = memory.zip(&grid.changed_tick[run]);
    for (out, ((((&log_odds, &seen), &drift_m), &sonar), &changed)) in out.iter_mut().zip(memory) {
        let ticks = now.tick.saturating_sub(seen);
        let left = grid.trust.left(log_odds, ticks as f32, now.drift_m - drift_m);
        let step = (log_odds * left * STEPS + 128.5).clamp(0.0, 255.0) as u8;
        let tenths = (ticks / 10).min(u32::from(AGE_OLDER)) as u8;
        let known = seen != 0 && left > 0.0;
        let stood = (now.tick.saturating_sub(changed) / 10).min(u32::from(STILL)) as u8;
        let stood = if log_odds >= 0.0 { stood } else { STILL };
        let mut look = if known { [table[usize::from(step)], tenths, stood, 0] } else { NEVER };
        let sonar_age = now.tick.saturating_sub(sonar);
        if sonar != 0 && sonar_age <= sonar_ticks {
            let age = (sonar_age / 10).min(u32::from(AGE_OLDER)) as u8;
            (look[0], look[1]) = (look[0].max(SONAR), look[1].min(age));
        }
        *out = look;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use proptest::prelude::*;
    use sidestep_msgs::SAFETY_GRID;

    proptest! {
        /// Random memory, random pose, half of them where the nearest corner changes or one bit beside: a cell of the map is
        /// the cell of the grid that holds its centre.
        #[test]
        fn the_safety_map_shows_the_cells_of_the_grid(
            x_m in -50.0f64..50.0, y_m in -50.0f64..50.0, yaw_rad in -3.2f64..3.2, seed in any::<u64>(), beside in 0u32..6
        ) {
            let mut grid = Grid::new(&Config::shipped());
            let edge = |position_m: f64| {
                let edge_m = (libm::round(position_m / 0.05) + 0.5) * 0.05;
                [position_m, position_m, position_m, edge_m, edge_m.next_up(), edge_m.next_down()][beside as usize]
            };
            let pose = Pose2::new(edge(x_m), edge(y_m), yaw_rad);
            grid.recentre(&pose);
            let mut state = seed;
            for index in 0..SIDE * SIDE {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                if state >> 61 != 0 {
                    let seen = Moment { tick: 1 + (state >> 50) as u32 % 300, drift_m: 0.0 };
                    grid.add(index, ((state >> 32) as u8 as f32 - 220.0) / 60.0, 0, &seen);
                }
            }
            let now = Moment { tick: 400, drift_m: 0.01 };
            let mut view = View::new();
            view.refresh(&grid, &pose, &now, 0);
            let [mut occupancy, mut age, mut still] = [[0; SAFETY_CELLS]; 3];
            view.safety(&mut occupancy, &mut age, &mut still);
            let frame = safety_frame(&pose);
            for index in (0..SAFETY_CELLS).step_by(7) {
                let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
                let (x_m, y_m) = frame.transform(x.into(), y.into());
                let [x, y] = grid.window(x_m, y_m);
                let cell = view.cells[(y as usize - FIRST) * VIEW + x as usize - FIRST];
                let known = cell[1] != AGE_NEVER;
                prop_assert_eq!(occupancy[index], if known { cell[0] } else { UNKNOWN.max(cell[0]) });
                prop_assert_eq!([age[index], still[index]], [cell[1], cell[2]]);
            }
        }
    }
}

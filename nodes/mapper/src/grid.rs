//! The memory: a square of cells fixed in `odom` that rolls with the robot.
//!
//! Storage is a torus: a cell keeps its place while the window moves, and what enters at one edge takes the place of
//! what left at the other, reset to unknown. Certainty decays when it is read: a cell stores the log-odds, the time and
//! the pose drift at which it was last seen, so that standing still costs nothing and nothing is ever decayed twice.

use crate::config::Config;
use sidestep_msgs::Pose2;

/// Cells along a side of the window: 9.6 m.
pub const SIDE: usize = 192;
/// `[m]` side of a cell.
pub const CELL_M: f64 = 0.05;
/// Cells of the window.
pub(crate) const CELLS: usize = SIDE * SIDE;
/// Height bands of an obstacle, as bits: lowest, middle and highest third of the band.
pub(crate) const BANDS: usize = 3;
/// Every height band.
pub(crate) const ALL_BANDS: u8 = 0b111;
/// Beside the bands: in some look only what is above the lowest band was seen, as of a table top.
pub(crate) const OVERHANG: u8 = 0b1000;

/// When and after how much drift something was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moment {
    /// `[10 ms]` since the first stamp, from 1.
    pub(crate) tick: u32,
    /// `[m]` pose drift expected since the start.
    pub(crate) drift_m: f32,
}

/// How fast certainty is lost, and where it saturates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Trust {
    /// `[1/tick]` part of a free cell's certainty lost.
    pub(crate) free_per_tick: f32,
    /// `[1/tick]` part of an occupied cell's certainty lost.
    pub(crate) occupied_per_tick: f32,
    /// `[1/m]` part lost per metre of drift.
    pub(crate) per_drift_m: f32,
    most: f32,
    least: f32,
}

impl Trust {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            free_per_tick: 0.01 / config.forget_free_s,
            occupied_per_tick: 0.01 / config.forget_occupied_s,
            per_drift_m: 1.0 / config.forget_drift_m,
            most: config.log_odds_max,
            least: -config.log_odds_free_max,
        }
    }

    /// Part of a cell's certainty that is left: 1 when just seen, 0 or less when forgotten.
    #[inline(always)]
    pub(crate) fn left(&self, log_odds: f32, ticks: f32, drift_m: f32) -> f32 {
        let per_tick = if log_odds < 0.0 { self.free_per_tick } else { self.occupied_per_tick };
        1.0 - ticks * per_tick - drift_m * self.per_drift_m
    }
}

/// The cells. All arrays are indexed by [`Grid::index`].
#[derive(Debug)]
pub(crate) struct Grid {
    /// Cell in `odom` of window cell (0, 0).
    origin: [i32; 2],
    /// Place of the origin in the arrays.
    phase: [usize; 2],
    /// Log-odds of occupied when last seen.
    pub(crate) log_odds: Vec<f32>,
    /// `[10 ms]` when last seen; 0 = never.
    pub(crate) seen_tick: Vec<u32>,
    /// `[m]` drift when last seen.
    pub(crate) drift_m: Vec<f32>,
    /// Height bands in which an obstacle was seen since the cell was last free, and [`OVERHANG`].
    pub(crate) bands: Vec<u8>,
    /// `[10 ms]` when what stands here was first seen, since the cell was last free; 0 = never anything.
    pub(crate) changed_tick: Vec<u32>,
    /// `[10 ms]` when an ultrasonic sensor last marked the cell; 0 = not marked.
    pub(crate) sonar_tick: Vec<u32>,
    /// Decay and saturation.
    pub(crate) trust: Trust,
}

/// The cells of the window within `reach` cells of a point along both axes, row by row.
pub(crate) fn cells_near(centre: [f32; 2], reach: f32) -> impl Iterator<Item = [usize; 2]> + Clone {
    let bound = |edge: f32| edge.clamp(0.0, SIDE as f32) as usize;
    let [xs, ys] = centre.map(|part| bound(part - reach)..bound(part + reach + 1.0));
    ys.flat_map(move |y| xs.clone().map(move |x| [x, y]))
}

fn phase(origin: i32) -> usize {
    origin.rem_euclid(SIDE as i32) as usize
}

impl Grid {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            origin: [0, 0],
            phase: [0, 0],
            log_odds: vec![0.0; CELLS],
            seen_tick: vec![0; CELLS],
            drift_m: vec![0.0; CELLS],
            bands: vec![0; CELLS],
            changed_tick: vec![0; CELLS],
            sonar_tick: vec![0; CELLS],
            trust: Trust::new(config),
        }
    }

    /// Forgets everything.
    pub(crate) fn reset(&mut self) {
        self.log_odds.fill(0.0);
        self.seen_tick.fill(0);
        self.drift_m.fill(0.0);
        self.bands.fill(0);
        self.changed_tick.fill(0);
        self.sonar_tick.fill(0);
    }

    /// Place in the arrays of a window cell; both coordinates below [`SIDE`].
    #[inline(always)]
    pub(crate) fn index(&self, x: usize, y: usize) -> usize {
        debug_assert!(x < SIDE && y < SIDE);
        let wrap = |sum: usize| if sum >= SIDE { sum - SIDE } else { sum };
        wrap(self.phase[1] + y) * SIDE + wrap(self.phase[0] + x)
    }

    /// A point of `odom` in cells of the window.
    pub(crate) fn window(&self, x_m: f64, y_m: f64) -> [f32; 2] {
        [(x_m / CELL_M - f64::from(self.origin[0])) as f32, (y_m / CELL_M - f64::from(self.origin[1])) as f32]
    }

    /// Rolls the window so that the pose lies in its middle cell.
    pub(crate) fn recentre(&mut self, pose: &Pose2) {
        let corner = |position_m: f64| libm::floor(position_m / CELL_M) as i32 - SIDE as i32 / 2;
        let target = [corner(pose.x_m), corner(pose.y_m)];
        let shift = [target[0].abs_diff(self.origin[0]), target[1].abs_diff(self.origin[1])];
        if shift[0] as usize >= SIDE || shift[1] as usize >= SIDE {
            self.reset();
            self.place(target);
            return;
        }
        // A storage column or row changes owner where the old and the new window do not overlap.
        let first = [target[0].min(self.origin[0]), target[1].min(self.origin[1])];
        for step in 0..shift[0] as i32 {
            let column = phase(first[0] + step);
            (0..SIDE).for_each(|row| self.forget(row * SIDE + column));
        }
        for step in 0..shift[1] as i32 {
            let row = phase(first[1] + step);
            (0..SIDE).for_each(|column| self.forget(row * SIDE + column));
        }
        self.place(target);
    }

    /// Puts the window's corner at a cell of `odom`, whatever the arrays hold.
    pub(crate) fn place(&mut self, origin: [i32; 2]) {
        self.origin = origin;
        self.phase = origin.map(phase);
    }

    /// Cell in `odom` of window cell (0, 0).
    pub(crate) fn origin(&self) -> [i32; 2] {
        self.origin
    }

    fn forget(&mut self, index: usize) {
        self.log_odds[index] = 0.0;
        self.seen_tick[index] = 0;
        self.drift_m[index] = 0.0;
        self.bands[index] = 0;
        self.changed_tick[index] = 0;
        self.sonar_tick[index] = 0;
    }

    /// Log-odds that are left of a cell now, or `None` where it is unknown.
    #[inline]
    pub(crate) fn log_odds_now(&self, index: usize, now: &Moment) -> Option<f32> {
        let seen = self.seen_tick[index];
        if seen == 0 {
            return None;
        }
        let ticks = now.tick.saturating_sub(seen) as f32;
        let log_odds = self.log_odds[index];
        let left = self.trust.left(log_odds, ticks, now.drift_m - self.drift_m[index]);
        (left > 0.0).then_some(log_odds * left)
    }

    /// Adds evidence to what is left of a cell; `bands` are the heights of an obstacle, 0 for free space.
    #[inline]
    pub(crate) fn add(&mut self, index: usize, delta: f32, bands: u8, now: &Moment) {
        let left = self.log_odds_now(index, now);
        let log_odds = (left.unwrap_or(0.0) + delta).clamp(self.trust.least, self.trust.most);
        if log_odds >= 0.0 && left.is_none_or(|left| left < 0.0) {
            self.changed_tick[index] = now.tick;
        }
        let held = if left.is_some() { self.bands[index] } else { 0 };
        self.bands[index] = if log_odds < 0.0 { 0 } else { held | bands };
        self.log_odds[index] = log_odds;
        self.seen_tick[index] = now.tick;
        self.drift_m[index] = now.drift_m;
    }

    /// A turn moves what is nearer than the lever less than `turned_m`, its drift there: those cells are spared the difference.
    pub(crate) fn spare(&mut self, pose: &Pose2, turned_m: f32, lever_m: f32, now: &Moment) {
        if !(turned_m > 0.0 && lever_m > 0.0) {
            return;
        }
        let [near_x, near_y] = self.window(pose.x_m, pose.y_m);
        let reach = lever_m / CELL_M as f32;
        for [x, y] in cells_near([near_x, near_y], reach) {
            let (dx, dy) = (x as f32 + 0.5 - near_x, y as f32 + 0.5 - near_y);
            let spared = 1.0 - (dx * dx + dy * dy).sqrt() / reach;
            let index = self.index(x, y);
            if spared > 0.0 {
                self.drift_m[index] = (self.drift_m[index] + spared * turned_m).min(now.drift_m);
            }
        }
    }

    /// Makes a cell free to saturation, as granted or as proven by the robot standing on it.
    pub(crate) fn set_free(&mut self, index: usize, now: &Moment) {
        self.log_odds[index] = self.trust.least;
        self.seen_tick[index] = now.tick;
        self.drift_m[index] = now.drift_m;
        self.bands[index] = 0;
        self.sonar_tick[index] = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NOW: Moment = Moment { tick: 5, drift_m: 0.0 };

    proptest! {
        /// Walks the window at random with marks set at every stop; a mark is there exactly while its cell has never left.
        #[test]
        fn what_leaves_the_window_is_forgotten_and_what_stays_is_kept(
            steps in proptest::collection::vec((-9.0f64..9.0, -9.0f64..9.0), 1..12)
        ) {
            let mut grid = Grid::new(&Config::shipped());
            let mut marks: Vec<[i32; 2]> = Vec::new();
            let (mut x_m, mut y_m) = (0.0, 0.0);
            for (dx_m, dy_m) in steps {
                x_m += dx_m;
                y_m += dy_m;
                grid.recentre(&Pose2::new(x_m, y_m, 0.0));
                let side = SIDE as i32;
                let inside = |m: &[i32; 2]| (0..2).all(|k| (0..side).contains(&(m[k] - grid.origin[k])));
                marks.retain(inside);
                let seen = grid.seen_tick.iter().filter(|&&tick| tick != 0).count();
                prop_assert_eq!(seen, marks.len());
                for mark in &marks {
                    let (x, y) = ((mark[0] - grid.origin[0]) as usize, (mark[1] - grid.origin[1]) as usize);
                    prop_assert_eq!(grid.seen_tick[grid.index(x, y)], NOW.tick);
                }
                for corner in [[0, 0], [side - 1, side - 1], [side / 2, 7]] {
                    let mark = [grid.origin[0] + corner[0], grid.origin[1] + corner[1]];
                    grid.add(grid.index(corner[0] as usize, corner[1] as usize), 1.0, 1, &NOW);
                    if !marks.contains(&mark) {
                        marks.push(mark);
                    }
                }
            }
        }
    }

    /// Turns on the spot: what is at the feet keeps its certainty, what is at the lever or beyond loses all that the turn says.
    #[test]
    fn a_turn_costs_a_cell_as_much_as_it_moves_it() {
        let mut grid = Grid::new(&Config::shipped());
        grid.recentre(&Pose2::ORIGIN);
        let cells = [0.0, 0.5, 1.0, 2.0].map(|x_m| {
            let [x, y] = grid.window(x_m, 0.0);
            grid.index(x as usize, y as usize)
        });
        cells.iter().for_each(|index| grid.add(*index, -2.0, 0, &NOW));
        let mut now = NOW;
        for _ in 0..10 {
            now.drift_m += 0.012;
            grid.spare(&Pose2::ORIGIN, 0.01, 1.0, &now);
        }
        // 0.12 m of drift, 0.1 m of them by turning; a cell's middle is up to 3.5 cm farther off.
        for (index, cost_m) in cells.iter().zip([0.0235, 0.0725, 0.12, 0.12]) {
            let cost = now.drift_m - grid.drift_m[*index];
            assert!((cost - cost_m).abs() < 0.002, "{cost} {cost_m}");
        }
        grid.spare(&Pose2::ORIGIN, 9.0, 1.0, &now);
        assert!(grid.drift_m.iter().all(|drift_m| *drift_m <= now.drift_m));
    }

    /// Reads a free and an occupied cell at growing time and drift: certainty only falls, never crosses zero.
    #[test]
    fn decay_goes_to_unknown_and_never_to_the_other_side() {
        let config = Config::shipped();
        for delta in [-2.0, 3.0] {
            let mut grid = Grid::new(&config);
            grid.add(0, delta, 1, &NOW);
            let mut last = f32::INFINITY;
            for step in 0..200_000u32 {
                let now = Moment { tick: NOW.tick + step, drift_m: step as f32 * 1e-7 };
                let Some(log_odds) = grid.log_odds_now(0, &now) else { break };
                assert!(log_odds * delta > 0.0 && log_odds.abs() <= last, "at {step}: {log_odds}");
                last = log_odds.abs();
            }
            let long_after = Moment { tick: 400_000, drift_m: 0.0 };
            assert_eq!(grid.log_odds_now(0, &long_after), None);
            let far_after = Moment { tick: NOW.tick, drift_m: config.forget_drift_m };
            assert_eq!(grid.log_odds_now(0, &far_after), None);
        }
    }
}

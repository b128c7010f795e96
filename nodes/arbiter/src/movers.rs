//! Where something that moves may be at a time: what was seen to move, and what the camera's sector hides or does not
//! reach, grown at the speed of the fastest mover, round what stands still.
//!
//! The promise is passive safety inside the sector (G2): the swept footprint stays clear of all that a mover could reach
//! by then, so whatever comes at the robot finds it at rest. What was seen to move is minded wherever it went meanwhile;
//! what may hide outside the sector is not.

use crate::clearance::{Heading, Rows};
use crate::config::Config;
use sidestep_msgs::{NO_CELL, Robot, SAFETY_GRID, SAFETY_SIDE};

/// Most steps of growth: 3.2 m. What could be farther off than that by then forbids the motion.
const GROWTH_MOST: usize = 64;
/// Cells added to the growth: what stands still is drawn up to a cell larger than it is, so a way round it is shorter.
const SLACK_CELLS: usize = 1;
/// sqrt(2) - 1: this part of the steps spreads over corners too, so that the octagon holds the disc.
const CORNER_PART: f32 = 0.414_213_57;
const ALL: u128 = (1 << SAFETY_SIDE) - 1;

/// `[rad]` between the lines of sight that are followed, and `[m]` between the points asked on them: two thirds of a cell,
/// at the edge of the map. A cell that none of them meets lies between some that they do, and the slack reaches it.
const LINE_RAD: f32 = 0.012;
const POINT_M: f32 = 0.033;
/// Points on a line: no point of the map is 3.2 m from the camera.
const POINTS: usize = 97;

/// A line of sight, in `base`.
#[derive(Debug, Clone, Copy)]
struct Line {
    cos: f32,
    sin: f32,
    /// Number of the first point where the floor is seen.
    far: usize,
}

/// Where the camera looks from, and along which lines; a scanner looks from the axle.
#[derive(Debug, Clone)]
struct Eye {
    forward_m: f32,
    /// Number of the first point that is seen.
    near: usize,
    lines: Vec<Line>,
}

impl Eye {
    fn new(robot: &Robot) -> Self {
        let (forward_m, near_m) = robot.camera.map_or((0.0, 0.0), |camera| (camera.forward_m, camera.near_m));
        let (half_rad, blind_m) = (robot.half_view_rad(), robot.blind_m());
        let gaps = libm::ceilf(2.0 * half_rad / LINE_RAD).max(1.0);
        let line = |number: usize| {
            let (sin, cos) = libm::sincosf(half_rad * (2.0 * number as f32 / gaps - 1.0));
            let from_axle_m = |point: usize| {
                let range_m = point as f32 * POINT_M;
                libm::hypotf(forward_m + range_m * cos, range_m * sin)
            };
            let far = (0..POINTS).find(|point| from_axle_m(*point) >= blind_m).unwrap_or(POINTS);
            Line { cos, sin, far }
        };
        let near = libm::ceilf(near_m / POINT_M) as usize;
        Self { forward_m, near, lines: (0..=gaps as usize).map(line).collect() }
    }
}

/// What the movers' part of a map needs of one cell row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    /// Something is there.
    pub(crate) taken: Rows,
    /// What is there was not there long enough to count as standing still.
    pub(crate) fresh: Rows,
    /// Never seen, forgotten, or not seen lately.
    pub(crate) unseen: Rows,
}

/// The growth of what may move, for the newest map.
#[derive(Debug, Clone)]
pub(crate) struct Movers {
    /// `[m/s]` of the fastest mover; 0 = a static world, nothing is computed.
    speed_m_s: f32,
    eye: Eye,
    /// Where movers are or hide.
    pub(crate) sources: Rows,
    /// What stands still.
    pub(crate) fixed: Rows,
    /// `reached[k]`: cells that a mover can have touched after the way of k cells.
    reached: Vec<Rows>,
}

impl Movers {
    pub(crate) fn new(config: &Config, robot: &Robot) -> Self {
        let speed_m_s = robot.start.mover_m_s;
        let none = [0; SAFETY_SIDE];
        let mut movers =
            Self { speed_m_s, eye: Eye::new(robot), sources: none, fixed: none, reached: Vec::new() };
        if speed_m_s > 0.0 {
            let way_m = speed_m_s * longest_s(config, robot);
            let steps = libm::ceilf(way_m / SAFETY_GRID.cell_m) as usize + SLACK_CELLS + 1;
            movers.reached = vec![none; steps.min(GROWTH_MOST) + 1];
        }
        movers
    }

    /// `[m/s]` how fast the reach of movers grows; 0 where none are minded.
    pub(crate) fn speed_m_s(&self) -> f32 {
        self.speed_m_s
    }

    /// Takes what a map shows to a robot at `at`.
    pub(crate) fn take(&mut self, sight: &Sight, at: &Heading) {
        for row in 0..SAFETY_SIDE {
            self.fixed[row] = sight.taken[row] & !sight.fresh[row];
        }
        self.sources = self.unwatched(sight, at);
        for row in 0..SAFETY_SIDE {
            self.sources[row] = (self.sources[row] | sight.fresh[row]) & !self.fixed[row];
        }
        self.grow();
    }

    /// The cells of the sector where a mover could be unseen: those that were not seen lately, where the floor is seen or
    /// something taken hides them, and the edge of the map. Nearer than the floor is seen, what stands in the open is seen
    /// all the same, and only the floor is not.
    fn unwatched(&self, sight: &Sight, at: &Heading) -> Rows {
        let mut unwatched = [0; SAFETY_SIDE];
        let eye = &self.eye;
        let in_cells = |part_m: f32, from_m: f32| (part_m - from_m) / SAFETY_GRID.cell_m;
        let from = [
            in_cells(at.x_m + at.cos * eye.forward_m, SAFETY_GRID.rear_m),
            in_cells(at.y_m + at.sin * eye.forward_m, SAFETY_GRID.right_m),
        ];
        for Line { cos, sin, far } in &eye.lines {
            let along = [at.cos * cos - at.sin * sin, at.sin * cos + at.cos * sin];
            let along = along.map(|part| part * POINT_M / SAFETY_GRID.cell_m);
            let mut hidden = false;
            for point in 0..POINTS {
                let [row, bit] = [0, 1].map(|k| (from[k] + point as f32 * along[k]) as usize % SAFETY_SIDE);
                let is = |rows: &Rows| rows[row] >> bit & 1 == 1;
                let edge = row == 0 || bit == 0 || row == SAFETY_SIDE - 1 || bit == SAFETY_SIDE - 1;
                if edge || point >= eye.near && (point >= *far || hidden) && is(&sight.unseen) {
                    unwatched[row] |= 1 << bit;
                }
                if edge {
                    break;
                }
                hidden |= is(&sight.taken);
            }
        }
        unwatched
    }

    /// Nothing is known: a mover may be anywhere.
    pub(crate) fn clear(&mut self) {
        (self.sources, self.fixed) = ([ALL; SAFETY_SIDE], [0; SAFETY_SIDE]);
        self.grow();
    }

    /// Lets movers go, cell by cell, wherever nothing stands still. Steps to the four neighbours and to all eight take
    /// turns, so that what is reached holds the disc of that radius and little more.
    pub(crate) fn grow(&mut self) {
        let Self { reached, sources, fixed, .. } = self;
        let Some(first) = reached.first_mut() else { return };
        *first = *sources;
        for step in 1..reached.len() {
            let (before, after) = reached.split_at_mut(step);
            let (from, to) = (&before[step - 1], &mut after[0]);
            let corners = |step: usize| libm::ceilf(CORNER_PART * step as f32);
            let square = corners(step) > corners(step - 1);
            let across = |row: u128| row | row << 1 | row >> 1;
            for row in 0..SAFETY_SIDE {
                let below = row.checked_sub(1).map_or(0, |row| from[row]);
                let above = from.get(row + 1).copied().unwrap_or(0);
                let aside = if square { across(below | above) } else { below | above };
                to[row] = (across(from[row]) | aside) & !fixed[row] & ALL;
            }
        }
    }

    /// `[m]` how much nearer movers and footprint, a disc of `radius_m` round (x, y), may come to each other once the
    /// movers have gone `gone_m`, up to `most_m`; `None` where it is not known from one look to be `least_m`.
    pub(crate) fn slack_m(
        &self,
        [x_m, y_m]: [f32; 2],
        radius_m: f32,
        gone_m: f32,
        [least_m, most_m]: [f32; 2],
    ) -> Option<f32> {
        let (row, bit) = place(x_m, y_m);
        let is_clear = |rows: &Rows| rows[row] >> bit & 1 == 0;
        let between_m = |clear: usize| {
            clear.saturating_sub(1 + SLACK_CELLS) as f32 * SAFETY_GRID.cell_m - radius_m - gone_m
        };
        // A step more or less than those that matter, whatever is rounded.
        let steps = |slack_m: f32| ((slack_m + radius_m + gone_m) / SAFETY_GRID.cell_m) as usize;
        let [mut clear, mut not] = [steps(least_m) + SLACK_CELLS, steps(most_m) + SLACK_CELLS + 3]
            .map(|clear| clear.min(self.reached.len()));
        // By hand, since the processor guesses these branches well; a search of the library has none to guess.
        while clear < not {
            let middle = usize::midpoint(clear, not);
            if is_clear(&self.reached[middle]) {
                clear = middle + 1;
            } else {
                not = middle;
            }
        }
        let slack_m = between_m(clear);
        (slack_m >= least_m).then_some(slack_m.min(most_m))
    }

    /// The cells that movers can have touched once they have gone `gone_m`.
    ///
    /// # Errors
    /// [`NO_CELL`] where that is farther than is computed.
    pub(crate) fn reached(&self, gone_m: f32) -> Result<&Rows, u32> {
        let cells = libm::ceilf(gone_m / SAFETY_GRID.cell_m).max(0.0) as usize + SLACK_CELLS;
        self.reached.get(cells).ok_or(NO_CELL)
    }
}

/// `[s]` from a map's capture to the rest of a robot that brakes from its highest speed.
fn longest_s(config: &Config, robot: &Robot) -> f32 {
    let a = &robot.actuator;
    let brake_m_s2 = a.brake_min_m_s2.min(robot.limits.brake_m_s2);
    let braking_s = robot.limits.forward_m_s / brake_m_s2 + 5.0 * a.lag_s;
    config.map_age_s + config.odometry_age_s + a.dead_time_max_s + config.hold_s + braking_s
}

/// Row and bit of a point; of the nearest cell where it lies outside the map.
fn place(x_m: f32, y_m: f32) -> (usize, u32) {
    let most = (SAFETY_SIDE - 1) as f32;
    // Not negative, so the cast rounds down.
    let number =
        |part_m: f32, from_m: f32| ((part_m - from_m) / SAFETY_GRID.cell_m).clamp(0.0, most) as usize;
    (number(x_m, SAFETY_GRID.rear_m), number(y_m, SAFETY_GRID.right_m) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;

    fn movers() -> Movers {
        let mut robot = loomo();
        robot.start.mover_m_s = 0.5;
        Movers::new(&Config::STANDARD, &robot)
    }

    const NONE: Rows = [0; SAFETY_SIDE];
    const MIDDLE: Heading = Heading { x_m: 0.0, y_m: 0.0, cos: 1.0, sin: 0.0 };

    fn set(rows: &mut Rows, x_m: f32, y_m: f32) {
        let (row, bit) = place(x_m, y_m);
        rows[row] |= 1 << bit;
    }

    fn is_set(rows: &Rows, x_m: f32, y_m: f32) -> bool {
        let (row, bit) = place(x_m, y_m);
        rows[row] >> bit & 1 == 1
    }

    /// From one cell in the open: every cell within so many cells is reached, none that is a tenth and a cell farther.
    #[test]
    fn the_growth_holds_the_disc_and_little_more() {
        let mut movers = movers();
        movers.sources[40] = 1 << 40;
        movers.grow();
        for (steps, reached) in movers.reached.iter().enumerate() {
            for (row, bits) in reached.iter().enumerate() {
                for bit in 0..SAFETY_SIDE {
                    let cells = libm::hypotf(row as f32 - 40.0, bit as f32 - 40.0);
                    let is = bits >> bit & 1 == 1;
                    assert!(is || cells > steps as f32, "{row} {bit} after {steps}");
                    assert!(!is || cells <= 1.1 * steps as f32 + 1.0, "{row} {bit} after {steps}");
                }
            }
        }
    }

    #[test]
    fn where_nothing_is_known_movers_may_be_anywhere() {
        let mut robot = loomo();
        robot.start.mover_m_s = 0.5;
        let mut space = crate::clearance::FreeSpace::new(&Config::STANDARD, &robot);
        let is_free = |movers: &Movers| movers.slack_m([0.0, 0.0], 0.3, 0.0, [0.0, 0.5]).is_some();
        assert!(!is_free(&space.movers));
        space.movers.take(&Sight { taken: NONE, fresh: NONE, unseen: NONE }, &MIDDLE);
        assert!(is_free(&space.movers));
        assert_eq!(space.movers.reached(9.0), Err(NO_CELL), "farther than is computed");
        space.clear();
        assert!(!is_free(&space.movers));
    }

    /// Floor nearer than it can be seen hides somebody behind a thing and nobody in the open; farther off it does both.
    #[test]
    fn a_thing_hides_what_is_behind_it() {
        let (near_m, far_m) = (0.8, 1.5);
        for (thing_m, at_m, hides) in [
            (None, near_m, false),
            (None, far_m, true),
            (Some(0.6), near_m, true),
            (Some(1.2), near_m, false),
        ] {
            let mut sight = Sight { taken: NONE, fresh: NONE, unseen: NONE };
            set(&mut sight.unseen, at_m, 0.0);
            if let Some(thing_m) = thing_m {
                set(&mut sight.taken, thing_m, 0.0);
            }
            let mut movers = movers();
            movers.take(&sight, &MIDDLE);
            assert_eq!(is_set(&movers.sources, at_m, 0.0), hides, "{thing_m:?} {at_m}");
        }
        // Turned to the left, beside the middle: it is ahead of the robot that somebody hides.
        let at = Heading { x_m: 0.02, y_m: -0.03, cos: 0.0, sin: 1.0 };
        for (x_m, y_m, hides) in [(0.0, far_m, true), (far_m, 0.0, false), (0.0, -far_m, false)] {
            let mut sight = Sight { taken: NONE, fresh: NONE, unseen: NONE };
            set(&mut sight.unseen, x_m, y_m);
            let mut movers = movers();
            movers.take(&sight, &at);
            assert_eq!(is_set(&movers.sources, x_m, y_m), hides, "{x_m} {y_m}");
        }
        // Beside the sector nobody is said to hide; what was seen to move is minded there too.
        let mut sight = Sight { taken: NONE, fresh: NONE, unseen: NONE };
        set(&mut sight.unseen, 0.0, 1.5);
        set(&mut sight.fresh, 0.0, -1.5);
        let mut movers = movers();
        movers.take(&sight, &MIDDLE);
        assert!(!is_set(&movers.sources, 0.0, 1.5) && is_set(&movers.sources, 0.0, -1.5));
    }
}

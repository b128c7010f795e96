//! Where something that moves may be at a time: what was seen to move, and what the camera's sector hides or does not
//! reach, grown at the speed of the fastest mover, round what stands still.
//!
//! The promise is passive safety inside the sector (G2): the swept footprint stays clear of all that a mover could reach
//! by then, so whatever comes at the robot finds it at rest. What was seen to move is minded wherever it went meanwhile;
//! what may hide outside the sector is not.

use crate::clearance::{Rows, cell_index};
use crate::config::Config;
use sidestep_msgs::{NO_CELL, Robot, SAFETY_GRID, SAFETY_SIDE};

/// Most steps of growth: 3.2 m. What could be farther off than that by then forbids the motion.
const GROWTH_MOST: usize = 64;
/// Cells added to the growth: what stands still is drawn up to a cell larger than it is, so a way round it is shorter.
const SLACK_CELLS: usize = 1;
/// sqrt(2) - 1: this part of the steps spreads over corners too, so that the octagon holds the disc.
const CORNER_PART: f32 = 0.414_213_57;
const ALL: u128 = (1 << SAFETY_SIDE) - 1;

/// A cell of the sector, and the one before it on the way from the camera; row and bit as in [`Rows`].
#[derive(Debug, Clone, Copy)]
struct Ray {
    cell: (usize, u32),
    before: (usize, u32),
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
    /// Cells that the camera looks at.
    sector: Rows,
    /// Those of them where it sees the floor.
    far: Rows,
    /// Those of them at the edge of the map.
    edge: Rows,
    /// The cells of the sector, nearest first.
    rays: Vec<Ray>,
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
        let mut movers = Self {
            speed_m_s,
            sector: [0; SAFETY_SIDE],
            far: [0; SAFETY_SIDE],
            edge: [0; SAFETY_SIDE],
            rays: Vec::new(),
            sources: [0; SAFETY_SIDE],
            fixed: [0; SAFETY_SIDE],
            reached: Vec::new(),
        };
        if speed_m_s > 0.0 {
            let way_m = speed_m_s * longest_s(config, robot);
            let steps = libm::ceilf(way_m / SAFETY_GRID.cell_m) as usize + SLACK_CELLS + 1;
            movers.reached = vec![[0; SAFETY_SIDE]; steps.min(GROWTH_MOST) + 1];
            movers.look(robot);
        }
        movers
    }

    /// Finds the cells of the sector and their order.
    fn look(&mut self, robot: &Robot) {
        let (from_m, near_m) = robot.camera.map_or((0.0, 0.0), |camera| (camera.forward_m, camera.near_m));
        let blind_m = robot.blind_m();
        let mut cells = Vec::new();
        for row in 0..SAFETY_SIDE {
            for bit in 0..SAFETY_SIDE as u32 {
                let (x_m, y_m) = centre(row, bit);
                let ahead_m = x_m - from_m;
                let range_m = libm::hypotf(ahead_m, y_m);
                if range_m < near_m || !robot.looks_at(x_m, y_m) {
                    continue;
                }
                let mask = 1 << bit;
                self.sector[row] |= mask;
                if libm::hypotf(x_m, y_m) >= blind_m {
                    self.far[row] |= mask;
                }
                let inner = 1..SAFETY_SIDE - 1;
                if !(inner.contains(&row) && inner.contains(&(bit as usize))) {
                    self.edge[row] |= mask;
                }
                let part = (range_m - SAFETY_GRID.cell_m).max(0.0) / range_m.max(1e-6);
                let before = place(from_m + part * ahead_m, part * y_m);
                cells.push((range_m, Ray { cell: (row, bit), before }));
            }
        }
        cells.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.rays = cells.into_iter().map(|(_, ray)| ray).collect();
    }

    /// `[m/s]` how fast the reach of movers grows; 0 where none are minded.
    pub(crate) fn speed_m_s(&self) -> f32 {
        self.speed_m_s
    }

    /// Takes what a map shows.
    pub(crate) fn take(&mut self, sight: &Sight) {
        let mut hidden = [0u128; SAFETY_SIDE];
        for Ray { cell: (row, bit), before: (back, aside) } in &self.rays {
            let behind = (sight.taken[*back] | hidden[*back]) >> aside & 1;
            hidden[*row] |= behind << bit;
        }
        for (row, hidden) in hidden.into_iter().enumerate() {
            self.fixed[row] = sight.taken[row] & !sight.fresh[row];
            // Nearer than the floor is seen, what stands in the open is seen all the same, and only the floor is not.
            let unwatched = sight.unseen[row] & (self.far[row] | hidden) | self.edge[row];
            self.sources[row] = (sight.fresh[row] | unwatched & self.sector[row]) & !self.fixed[row];
        }
        self.grow();
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
    /// movers have gone `gone_m`; negative where that is not known from one look.
    pub(crate) fn slack_m(&self, x_m: f32, y_m: f32, radius_m: f32, gone_m: f32) -> f32 {
        let (row, bit) = place(x_m, y_m);
        let is_clear = |rows: &Rows| rows[row] >> bit & 1 == 0;
        let clear = self.reached.partition_point(is_clear);
        clear.saturating_sub(1 + SLACK_CELLS) as f32 * SAFETY_GRID.cell_m - radius_m - gone_m
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

/// Centre of a cell.
fn centre(row: usize, bit: u32) -> (f32, f32) {
    let cell = cell_index(row, bit as usize) as usize;
    SAFETY_GRID.centre(cell / SAFETY_SIDE, cell % SAFETY_SIDE)
}

/// Row and bit of a point; of the nearest cell where it lies outside the map.
fn place(x_m: f32, y_m: f32) -> (usize, u32) {
    let most = (SAFETY_SIDE - 1) as f32;
    let number = |part_m: f32, from_m: f32| {
        libm::floorf((part_m - from_m) / SAFETY_GRID.cell_m).clamp(0.0, most) as usize
    };
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
            movers.take(&sight);
            assert_eq!(is_set(&movers.sources, at_m, 0.0), hides, "{thing_m:?} {at_m}");
        }
        // Beside the sector nobody is said to hide; what was seen to move is minded there too.
        let mut sight = Sight { taken: NONE, fresh: NONE, unseen: NONE };
        set(&mut sight.unseen, 0.0, 1.5);
        set(&mut sight.fresh, 0.0, -1.5);
        let mut movers = movers();
        movers.take(&sight);
        assert!(!is_set(&movers.sources, 0.0, 1.5) && is_set(&movers.sources, 0.0, -1.5));
    }
}

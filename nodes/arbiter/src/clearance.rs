//! Where the footprint may stand: known-free cells as bits, and the exact question whether a footprint covers others.
//!
//! A row of the safety map is one 128-bit word, so that a whole row of the footprint is asked for at once. Around
//! the robot's centre, sixteen dilated copies answer most questions without a look at the outline.

use crate::config::{Config, ConfigError};
use crate::movers::{Movers, Sight};
use sidestep_msgs::{AGE_NEVER, NO_CELL, Pose2, Robot, SAFETY_SIDE, SafetyMap, probability_code};

/// Rows of bits: row = cells along x from the map's edge on, bit = cells along y.
pub(crate) type Rows = [u128; SAFETY_SIDE];
/// Dilated copies: the farthest distance known from one look is this many cells.
const LEVELS: usize = 16;
const CELLS_PER_M: f32 = 20.0;
const HALF: f32 = 40.0;
/// Cells that rounding may take between two corners.
const HAIR: f32 = 0.01;
const ALL: u128 = (1 << SAFETY_SIDE) - 1;
/// Widest footprint in rows.
const SPAN: usize = 44;
/// Most corners of a footprint.
const CORNERS: usize = 8;

/// A pose in the frame of the safety map, with the heading as a vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Heading {
    pub(crate) x_m: f32,
    pub(crate) y_m: f32,
    pub(crate) cos: f32,
    pub(crate) sin: f32,
}

/// A pose in a map whose frame lies at `frame`.
pub(crate) fn heading(frame: &Pose2, pose: &Pose2) -> Heading {
    let relative = frame.relative(pose);
    let (sin, cos) = libm::sincos(relative.yaw_rad);
    Heading { x_m: relative.x_m as f32, y_m: relative.y_m as f32, cos: cos as f32, sin: sin as f32 }
}

/// The outline of the robot, widened by any margin.
#[derive(Debug, Clone)]
pub(crate) struct Outline {
    corners: [[f32; 2]; CORNERS],
    /// Motion of each corner per metre of margin: the outline keeps sharp corners.
    outward: [[f32; 2]; CORNERS],
    /// Outward normal of the edge from each corner on.
    normals: [[f32; 2]; CORNERS],
    count: usize,
    radius_m: f32,
    outward_most: f32,
    /// `[m]` farthest point ahead.
    pub(crate) front_m: f32,
    /// `[m]` farthest point behind, positive.
    pub(crate) rear_m: f32,
    /// `[m]` half of the width.
    pub(crate) half_width_m: f32,
}

impl Outline {
    /// # Errors
    /// Not convex, not counter-clockwise, or too large for the safety map.
    pub(crate) fn new(robot: &Robot) -> Result<Self, ConfigError> {
        let polygon = &robot.footprint.polygon_m;
        let count = polygon.len();
        let refused = |needed| ConfigError { key: "footprint.polygon_m", found: count as f64, needed };
        if !(3..=CORNERS).contains(&count) {
            return Err(refused("3 to 8 corners"));
        }
        let mut outline = Self {
            corners: [[0.0; 2]; CORNERS],
            outward: [[0.0; 2]; CORNERS],
            normals: [[0.0; 2]; CORNERS],
            count,
            radius_m: robot.radius_m(),
            outward_most: 0.0,
            front_m: polygon.iter().fold(0.0, |most, corner| most.max(corner[0])),
            rear_m: polygon.iter().fold(0.0, |most, corner| most.max(-corner[0])),
            half_width_m: robot.half_width_m(),
        };
        if !(outline.radius_m > 0.1 && outline.radius_m <= 0.9) {
            let found = f64::from(outline.radius_m);
            return Err(ConfigError { key: "footprint radius", found, needed: "0.1 to 0.9 m" });
        }
        for i in 0..count {
            let (before, here, after) =
                (polygon[(i + count - 1) % count], polygon[i], polygon[(i + 1) % count]);
            let (a, b) = (normal(before, here), normal(here, after));
            let bend = a[0] * b[1] - a[1] * b[0];
            // Parallel or clockwise edges, and spikes whose sharp corner would run far out.
            if !(bend > 1e-3 && a[0] * b[0] + a[1] * b[1] > -0.75) {
                return Err(refused("corners of a convex polygon, counter-clockwise, no spikes"));
            }
            let scale = 1.0 / (1.0 + a[0] * b[0] + a[1] * b[1]);
            outline.corners[i] = here;
            outline.normals[i] = b;
            outline.outward[i] = [(a[0] + b[0]) * scale, (a[1] + b[1]) * scale];
            let reach = libm::hypotf(outline.outward[i][0], outline.outward[i][1]);
            outline.outward_most = outline.outward_most.max(reach);
        }
        Ok(outline)
    }

    /// `[m]` radius round the axle that holds the outline widened by `margin_m`.
    pub(crate) fn radius_m(&self, margin_m: f32) -> f32 {
        self.radius_m + self.outward_most * margin_m.max(0.0)
    }

    /// The corners in cells of the map; `None` where one lies outside, or nowhere.
    fn placed(&self, at: &Heading, margin_m: f32) -> Option<Placed> {
        let mut placed =
            Placed { points: [[0.0; 2]; CORNERS], lowest: [f32::MAX; 2], highest: [f32::MIN; 2] };
        let mut total = 0.0;
        for (point, (corner, outward)) in
            placed.points.iter_mut().zip(self.corners.iter().zip(&self.outward)).take(self.count)
        {
            let px = corner[0] + margin_m * outward[0];
            let py = corner[1] + margin_m * outward[1];
            let x = (at.x_m + (at.cos * px - at.sin * py)) * CELLS_PER_M;
            let y = (at.y_m + (at.sin * px + at.cos * py)) * CELLS_PER_M;
            *point = [x + HALF, y];
            let [x, y] = *point;
            placed.lowest = [lesser(placed.lowest[0], x), lesser(placed.lowest[1], y)];
            placed.highest = [greater(placed.highest[0], x), greater(placed.highest[1], y)];
            total += point[0] + point[1];
        }
        let Placed { lowest, highest, .. } = placed;
        // What is not finite is outside; minimum and maximum alone would pass over NaN.
        let is_inside = total.is_finite()
            && lowest[0] >= 0.0
            && highest[0] < SAFETY_SIDE as f32
            && highest[0] - lowest[0] < (SPAN - 2) as f32
            && lowest[1] >= HAIR - HALF
            && highest[1] <= HALF - HAIR;
        is_inside.then_some(placed)
    }

    /// The cells under the outline, row by row: `visit(row, bits)` until it returns a value.
    fn rows<T>(&self, placed: &Placed, mut visit: impl FnMut(usize, u128) -> Option<T>) -> Option<T> {
        let Placed { points, lowest, highest } = placed;
        let base = lowest[0] as usize;
        let last = highest[0] as usize - base;
        let mut right = [f32::MAX; SPAN];
        let mut left = [f32::MIN; SPAN];
        let mut widen = |row: usize, y: f32| {
            right[row] = lesser(right[row], y);
            left[row] = greater(left[row], y);
        };
        for i in 0..self.count {
            let (a, b) = (points[i], points[(i + 1) % self.count]);
            let (a, b) = if a[0] <= b[0] { (a, b) } else { (b, a) };
            widen(a[0] as usize - base, a[1]);
            widen(b[0] as usize - base, b[1]);
            let (first, end) = (a[0] as usize + 1, b[0] as usize);
            if first > end {
                continue;
            }
            let slope = (b[1] - a[1]) / (b[0] - a[0]);
            for border in first..=end {
                let y = a[1] + (border as f32 - a[0]) * slope;
                widen(border - 1 - base, y);
                widen(border - base, y);
            }
        }
        (0..=last).find_map(|row| visit(base + row, span(right[row], left[row])))
    }

    /// Index of a cell of the safety map under the widened outline that is set in `blocked`; [`NO_CELL`] where the
    /// outline leaves the map; `None` where it stands free.
    pub(crate) fn blocked(&self, at: &Heading, margin_m: f32, blocked: &Rows) -> Option<u32> {
        let Some(placed) = self.placed(at, margin_m) else { return Some(NO_CELL) };
        if placed.is_clear(blocked) {
            return None;
        }
        self.rows(&placed, |row, bits| {
            let hit = blocked[row] & bits;
            (hit != 0).then(|| cell_index(row, hit.trailing_zeros() as usize))
        })
    }

    /// The cells set in `rows` that the widened outline overlaps.
    pub(crate) fn overlapped(&self, at: &Heading, margin_m: f32, rows: &Rows) -> Rows {
        let mut overlapped = [0; SAFETY_SIDE];
        if let Some(placed) = self.placed(at, margin_m) {
            self.rows::<()>(&placed, |row, bits| {
                overlapped[row] = rows[row] & bits;
                None
            });
        }
        overlapped
    }

    /// Clears in `rows` the cells of `which` whose centre the bare outline covers: the robot stands there.
    pub(crate) fn exempt(&self, at: &Heading, which: &Rows, rows: &mut Rows) {
        let Some(placed) = self.placed(at, 0.0) else { return };
        self.rows::<()>(&placed, |row, bits| {
            let mut hit = which[row] & bits & rows[row];
            while hit != 0 {
                let bit = hit.trailing_zeros();
                hit &= hit - 1;
                let x = (row as f32 + 0.5 - HALF) / CELLS_PER_M - at.x_m;
                let y = (bit as f32 + 0.5 - HALF) / CELLS_PER_M - at.y_m;
                if self.holds(at.cos * x + at.sin * y, at.cos * y - at.sin * x) {
                    rows[row] &= !(1 << bit);
                }
            }
            None
        });
    }

    /// `[m]` the widening with which the outline at a pose would reach each point of the map; negative where it covers it.
    pub(crate) fn beyond_m<const N: usize>(&self, at: &Heading, x_m: &[f32; N], y_m: &[f32; N]) -> [f32; N] {
        let mut beyond = [f32::MIN; N];
        for edge in 0..self.count {
            let [nx, ny] = self.normals[edge];
            let [cx, cy] = self.corners[edge];
            // The normal in the axes of the map, and how far the edge lies along it.
            let (mx, my) = (at.cos * nx - at.sin * ny, at.sin * nx + at.cos * ny);
            let edge_m = nx * cx + ny * cy + mx * at.x_m + my * at.y_m;
            for ((beyond, x_m), y_m) in beyond.iter_mut().zip(x_m).zip(y_m) {
                *beyond = beyond.max(mx * x_m + my * y_m - edge_m);
            }
        }
        beyond
    }

    /// Whether a point of `base` lies inside the bare outline.
    pub(crate) fn holds(&self, x_m: f32, y_m: f32) -> bool {
        (0..self.count).all(|i| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.count]);
            (b[0] - a[0]) * (y_m - a[1]) - (b[1] - a[1]) * (x_m - a[0]) >= 0.0
        })
    }
}

/// The corners of a widened outline, and their box, in cells: x from the map's edge on, y from its middle.
struct Placed {
    points: [[f32; 2]; CORNERS],
    lowest: [f32; 2],
    highest: [f32; 2],
}

impl Placed {
    /// Whether the box round the outline is clear, which is asked sooner than the outline.
    fn is_clear(&self, blocked: &Rows) -> bool {
        let bits = span(self.lowest[1], self.highest[1]);
        let (first, last) = (self.lowest[0] as usize, self.highest[0] as usize);
        blocked[first..=last].iter().fold(0, |any, row| any | row) & bits == 0
    }
}

/// The bits of a row between two points, in cells from the middle: so a mirrored outline covers mirrored cells.
fn span(right: f32, left: f32) -> u128 {
    let half = HALF as i32;
    // Truncated towards zero, then put right: a call to the library takes longer than all the rest.
    let (low, high) = (right as i32, left as i32);
    let low = low - i32::from(low as f32 > right) + half;
    let high = high + i32::from((high as f32) < left) - 1 + half;
    (u128::MAX >> (127 - (high.max(low) - low))) << low
}

/// The lesser of two numbers, neither NaN.
fn lesser(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

fn greater(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Outward normal of the edge of a counter-clockwise polygon.
fn normal(from: [f32; 2], to: [f32; 2]) -> [f32; 2] {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = libm::hypotf(dx, dy).max(1e-9);
    [dy / length, -dx / length]
}

pub(crate) fn cell_index(row: usize, bit: usize) -> u32 {
    ((SAFETY_SIDE - 1 - row) * SAFETY_SIDE + SAFETY_SIDE - 1 - bit) as u32
}

/// The columns of a row of the map for which something holds, as bits: column 0 is farthest left, the highest bit.
fn line(holds: impl Fn(usize) -> bool) -> u128 {
    (0..SAFETY_SIDE).fold(0, |bits, col| bits << 1 | u128::from(holds(col)))
}

/// What the newest safety map says, as bits.
#[derive(Debug, Clone)]
pub(crate) struct FreeSpace {
    /// Cells that are not known free.
    pub(crate) blocked: Rows,
    /// Cells that are not known free, or were not seen lately.
    pub(crate) old: Rows,
    /// Cells that are not known free because nobody saw them, not because something is there.
    pub(crate) unknown: Rows,
    /// Cells that the camera does not see now: waiting shows no more of them.
    unwatched: Rows,
    /// `near[k]`: cells within k cells (chessboard distance) of one that is not known free, or of the border.
    near: Box<[Rows; LEVELS]>,
    /// Where movers may be.
    pub(crate) movers: Movers,
    codes: Codes,
}

/// The limits of a configuration, as the map's bytes have them.
#[derive(Debug, Clone, Copy)]
struct Codes {
    /// Occupancy below this is free.
    free: u8,
    /// Seen up to this age, a cell may be crossed backward.
    old: u8,
    /// Seen up to this age, nothing that moves has come there unseen.
    seen: u8,
    /// From this on, what is there stands still.
    still: u8,
}

impl FreeSpace {
    /// Nothing is known.
    pub(crate) fn new(config: &Config, robot: &Robot) -> Self {
        let tenths = |span_s: f32| (span_s * 10.0 + 0.5) as u8;
        let codes = Codes {
            free: probability_code(config.free_below),
            old: tenths(config.back_up_age_s),
            seen: tenths(config.seen_s),
            still: tenths(config.still_s),
        };
        let mut space = Self {
            blocked: [ALL; SAFETY_SIDE],
            old: [ALL; SAFETY_SIDE],
            unknown: [ALL; SAFETY_SIDE],
            unwatched: [ALL; SAFETY_SIDE],
            near: Box::new([[ALL; SAFETY_SIDE]; LEVELS]),
            movers: Movers::new(config, robot),
            codes,
        };
        space.clear();
        space
    }

    /// Takes a map.
    pub(crate) fn take(&mut self, map: &SafetyMap) {
        let codes = self.codes;
        let lines =
            map.occupancy.as_chunks::<SAFETY_SIDE>().0.iter().zip(map.age.as_chunks::<SAFETY_SIDE>().0);
        for (index, (occupancy, age)) in lines.enumerate() {
            let row = SAFETY_SIDE - 1 - index;
            let (mut blocked, mut old, mut unknown, mut unwatched) = (0u128, 0u128, 0u128, 0u128);
            for col in 0..SAFETY_SIDE {
                let seen = age[col] != AGE_NEVER;
                let free = seen && occupancy[col] < codes.free;
                // Column 0 is farthest left: the highest bit.
                blocked = blocked << 1 | u128::from(!free);
                old = old << 1 | u128::from(!free || age[col] > codes.old);
                unwatched = unwatched << 1 | u128::from(age[col] > codes.seen);
                unknown = unknown << 1 | u128::from(!free && (!seen || occupancy[col] <= 140));
            }
            self.blocked[row] = blocked;
            self.old[row] = old;
            self.unknown[row] = unknown;
            self.unwatched[row] = unwatched;
        }
        self.dilate();
        if self.movers.speed_m_s() > 0.0 {
            let at = heading(&map.frame(), &map.base);
            self.movers.take(&self.sight(map), &at);
        }
    }

    /// What a map, whose free cells are known already, shows of movers.
    fn sight(&self, map: &SafetyMap) -> Sight {
        let none = [0; SAFETY_SIDE];
        let mut sight = Sight { taken: none, fresh: none, unseen: none };
        let lines = map.age.as_chunks::<SAFETY_SIDE>().0.iter().zip(map.still.as_chunks::<SAFETY_SIDE>().0);
        for (index, (age, still)) in lines.enumerate() {
            let row = SAFETY_SIDE - 1 - index;
            sight.taken[row] = self.blocked[row] & !self.unknown[row];
            sight.fresh[row] = sight.taken[row] & line(|col| still[col] < self.codes.still);
            sight.unseen[row] = self.unknown[row] | line(|col| age[col] > self.codes.seen);
        }
        sight
    }

    /// Whether the camera does not see a cell of the safety map now.
    pub(crate) fn is_unwatched(&self, cell: u32) -> bool {
        let (row, col) = (cell as usize / SAFETY_SIDE, cell as usize % SAFETY_SIDE);
        row < SAFETY_SIDE && self.unwatched[SAFETY_SIDE - 1 - row] >> (SAFETY_SIDE - 1 - col) & 1 == 1
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.blocked = [ALL; SAFETY_SIDE];
        self.old = [ALL; SAFETY_SIDE];
        self.unknown = [ALL; SAFETY_SIDE];
        self.unwatched = [ALL; SAFETY_SIDE];
        self.dilate();
        self.movers.clear();
    }

    /// Rebuilds the dilated copies from `blocked`.
    pub(crate) fn dilate(&mut self) {
        self.near[0] = self.blocked;
        for level in 1..LEVELS {
            let (smaller, larger) = self.near.split_at_mut(level);
            let (from, to) = (&smaller[level - 1], &mut larger[0]);
            // Beyond the border nothing is known.
            let across = |row: u128| row | row << 1 | row >> 1 | 1 | 1 << (SAFETY_SIDE - 1);
            let mut below = ALL;
            let mut here = across(from[0]);
            for (row, to) in to.iter_mut().enumerate() {
                let above = from.get(row + 1).map_or(ALL, |row| across(*row));
                *to = (below | here | above) & ALL;
                below = here;
                here = above;
            }
        }
    }

    /// `[m]` every point nearer than this to (x, y) is known free; 0 where not even its own cell is.
    pub(crate) fn clearance_m(&self, x_m: f32, y_m: f32) -> f32 {
        let (row, bit) = (x_m * CELLS_PER_M + HALF, y_m * CELLS_PER_M + HALF);
        let side = SAFETY_SIDE as f32;
        if !(row >= 0.0 && row < side && bit >= 0.0 && bit < side) {
            return 0.0;
        }
        let (row, bit) = (row as usize, bit as u32);
        let (mut free, mut not) = (0, LEVELS);
        while free < not {
            let level = usize::midpoint(free, not);
            if self.near[level][row] >> bit & 1 == 0 {
                free = level + 1;
            } else {
                not = level;
            }
        }
        free.saturating_sub(1) as f32 / CELLS_PER_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;
    use proptest::prelude::*;

    proptest! {
        /// What is asked of the box first is what is asked of the outline; outside the map nothing is free.
        #[test]
        fn the_box_answers_as_the_outline(
            (x_m, y_m, yaw_rad) in (-2.1f32..2.1, -2.1f32..2.1, -3.2f32..3.2),
            margin_m in -0.06f32..0.05,
            seed in any::<u64>(),
        ) {
            let outline = Outline::new(&loomo()).unwrap();
            let mut state = seed | 1;
            let rows: Rows = std::array::from_fn(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                if state >> 61 == 0 { 1 << (state >> 20 & 63) } else { 0 }
            });
            let (sin, cos) = libm::sincosf(yaw_rad);
            let at = Heading { x_m, y_m, cos, sin };
            let found = outline.blocked(&at, margin_m, &rows);
            if outline.placed(&at, margin_m).is_none() {
                prop_assert_eq!(found, Some(NO_CELL));
                prop_assert!(x_m.abs().max(y_m.abs()) > 1.6, "{} {}", x_m, y_m);
            } else {
                let covered = outline.overlapped(&at, margin_m, &rows);
                prop_assert_eq!(found.is_some(), covered.iter().any(|row| *row != 0));
            }
        }
    }
}

//! Places and headings as bits, and in which of them a footprint stands free.
//!
//! Places are the middles of the safety map's cells within 1.6 m of the robot. A word is a row of them, so that a shift, or a
//! copy, moves 64 places at once.

use crate::clearance::{Heading, Outline, Rows};
use sidestep_msgs::{SAFETY_GRID, SAFETY_SIDE};

/// Headings in which straights lead, and with those between them, which a turn passes.
pub(crate) const HEADINGS: usize = 16;
pub(crate) const PASSED: usize = 2 * HEADINGS;
/// Cells from place to place along each heading.
pub(crate) const STEPS: [[i32; 2]; HEADINGS] = [
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
];
/// The steps as vectors of length 1: a root takes too long to be asked for at each place.
const DIRECTIONS: [[f32; 2]; HEADINGS] = [
    [1.0, 0.0],
    [LONG, SHORT],
    [HALF, HALF],
    [SHORT, LONG],
    [0.0, 1.0],
    [-SHORT, LONG],
    [-HALF, HALF],
    [-LONG, SHORT],
    [-1.0, 0.0],
    [-LONG, -SHORT],
    [-HALF, -HALF],
    [-SHORT, -LONG],
    [0.0, -1.0],
    [SHORT, -LONG],
    [HALF, -HALF],
    [LONG, -SHORT],
];
const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;
const LONG: f32 = 0.948_683_26;
const SHORT: f32 = 0.316_227_76;
/// Rows, and places in a row.
pub(crate) const SIDE: usize = 64;
/// First row and bit of the safety map.
const FIRST: usize = (SAFETY_SIDE - SIDE) / 2;
pub(crate) const CELL_M: f32 = SAFETY_GRID.cell_m;
pub(crate) const HALF_MAP: f32 = (SAFETY_SIDE / 2) as f32;

/// A bit for each place.
pub(crate) type Window = [u64; SIDE];
/// The same in each heading.
pub(crate) type Layer = [Window; HEADINGS];

/// A heading, a row and a bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    pub(crate) heading: usize,
    pub(crate) row: usize,
    pub(crate) bit: usize,
}

/// The window of a map's rows.
pub(crate) fn window(rows: &Rows) -> Window {
    std::array::from_fn(|row| (rows[row + FIRST] >> FIRST) as u64)
}

/// `[m]` the middle of a row, or of a bit, in the frame of the safety map.
pub(crate) fn middle_m(index: usize) -> f32 {
    ((index + FIRST) as f32 + 0.5 - HALF_MAP) * CELL_M
}

/// The row, or bit, that holds a coordinate; `None` outside the window.
pub(crate) fn index(m: f32) -> Option<usize> {
    let cell = m / CELL_M + HALF_MAP;
    // Not negative, so the cast rounds down.
    (FIRST as f32..(FIRST + SIDE) as f32).contains(&cell).then(|| cell as usize - FIRST)
}

/// The direction of a heading, as a vector of length 1.
pub(crate) fn direction(heading: usize) -> [f32; 2] {
    DIRECTIONS[heading % HEADINGS]
}

fn unit(x: f32, y: f32) -> [f32; 2] {
    let length = libm::hypotf(x, y).max(1e-6);
    [x / length, y / length]
}

/// Joins a window moved by rows and bits; zeros come in.
pub(crate) fn join_moved(into: &mut Window, other: &Window, rows_on: i32, bits_on: i32) {
    let by = (rows_on.unsigned_abs() as usize).min(SIDE);
    let (into, from) = if rows_on >= 0 {
        (&mut into[by..], &other[..SIDE - by])
    } else {
        (&mut into[..SIDE - by], &other[by..])
    };
    let bits = bits_on.unsigned_abs();
    // One loop for each side, so that several words are shifted at once; out of the window there is nothing.
    match bits_on {
        _ if bits >= u64::BITS => {}
        0.. => into.iter_mut().zip(from).for_each(|(into, from)| *into |= from << bits),
        _ => into.iter_mut().zip(from).for_each(|(into, from)| *into |= from >> bits),
    }
}

/// Which places in a row begin a run of cells that one is blocked in: of every length that a footprint may have.
#[derive(Debug, Clone)]
pub(crate) struct Runs {
    /// Those of one cell first.
    of: Box<[Window; SIDE]>,
}

impl Runs {
    pub(crate) fn new() -> Self {
        Self { of: Box::new([[0; SIDE]; SIDE]) }
    }

    /// Takes what is blocked, for the runs of some stencils.
    pub(crate) fn take(&mut self, blocked: &Window, stencils: &[Stencils]) {
        let longest = stencils.iter().map(|stencils| stencils.longest).max().unwrap_or(0);
        self.of[0] = *blocked;
        for cells in 1..longest {
            let (shorter, longer) = self.of.split_at_mut(cells);
            for ((longer, shorter), blocked) in longer[0].iter_mut().zip(&shorter[cells - 1]).zip(blocked) {
                *longer = shorter | blocked >> cells;
            }
        }
    }
}

/// The cells under a footprint: rows from its place on, the first and last bit of each from it on. None: it is too large.
type Stencil = Vec<(i32, i32, i32)>;

/// The cells under the widened footprint, for each heading and those between, and the places where all of them lie inside the
/// window.
#[derive(Debug, Clone)]
pub(crate) struct Stencils {
    passed: Vec<(Stencil, Window)>,
    /// Cells of the longest run, up to those of a row: one that is longer lies inside the window nowhere.
    longest: usize,
}

/// Where a way begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Beginning {
    pub(crate) heading: usize,
    /// How far off the robot it is; 0 where it stands.
    pub(crate) off: usize,
    /// Words of the rows from `row` on.
    pub(crate) words: [u64; 2 * RINGS + 1],
    pub(crate) row: usize,
}

/// Rings of places round the robot from which a way may begin.
const RINGS: usize = 2;
/// Headings by how near they are to the robot's, and rings, in the order in which they are tried.
const TRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (1, 2)];

impl Stencils {
    pub(crate) fn new(outline: &Outline, margin_m: f32) -> Self {
        let all: Rows = [u128::MAX; SAFETY_SIDE];
        let half = (SAFETY_SIDE / 2) as i32;
        let stencil = |passed: usize| {
            let ([ax, ay], [bx, by]) = (direction(passed / 2), direction(passed.div_ceil(2)));
            let [cos, sin] = unit(ax + bx, ay + by);
            let at = Heading { x_m: 0.5 * CELL_M, y_m: 0.5 * CELL_M, cos, sin };
            let rows = outline.overlapped(&at, margin_m, &all);
            let covered = rows.iter().enumerate().filter(|(_, bits)| **bits != 0);
            let run = |(row, bits): (usize, &u128)| {
                let (low, high) = (bits.trailing_zeros() as i32, 127 - bits.leading_zeros() as i32);
                (row as i32 - half, low - half, high - half)
            };
            let stencil: Stencil = covered.map(run).collect();
            let inside = inside(&stencil);
            (stencil, inside)
        };
        let passed: Vec<_> = (0..PASSED).map(stencil).collect();
        let lengths = passed.iter().flat_map(|(stencil, _)| stencil.iter().map(length));
        let longest = lengths.max().unwrap_or(1);
        Self { passed, longest }
    }

    /// Places where the footprint stands free, and inside the window, in heading number `passed`.
    pub(crate) fn free(&self, passed: usize, runs: &Runs) -> Window {
        let (stencil, inside) = &self.passed[passed];
        let mut taken = [0; SIDE];
        for run @ (rows_on, low, _) in stencil {
            join_moved(&mut taken, &runs.of[length(run) - 1], -rows_on, -low);
        }
        std::array::from_fn(|row| inside[row] & !taken[row])
    }

    /// Of the two headings nearest to the robot's, and of the places round it, those of the first ring that has free ones.
    pub(crate) fn beginning(&self, runs: &Runs, at: &Heading) -> Option<Beginning> {
        let (row, bit) = (index(at.x_m)?, index(at.y_m)?);
        let along = |heading: &usize| {
            let [x, y] = direction(*heading);
            x * at.cos + y * at.sin
        };
        let nearest = |but: usize| {
            let others = (0..HEADINGS).filter(|heading| *heading != but);
            others.max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(0)
        };
        let first = nearest(HEADINGS);
        let headings = [first, nearest(first)];
        let free = headings.map(|heading| self.free(2 * heading, runs));
        let near = |index: usize, ring: usize| index.saturating_sub(ring)..=(index + ring).min(SIDE - 1);
        TRIES.iter().enumerate().find_map(|(off, (heading, ring))| {
            let bits = near(bit, *ring).fold(0, |bits, bit| bits | 1_u64 << bit);
            let first = row.saturating_sub(RINGS);
            let words = std::array::from_fn(|index| {
                let here = near(row, *ring).contains(&(first + index));
                if here { bits & free[*heading][first + index] } else { 0 }
            });
            let begins = Beginning { heading: headings[*heading], off, words, row: first };
            words.iter().any(|word| *word != 0).then_some(begins)
        })
    }
}

/// Cells of a run of a stencil, up to those of a row.
fn length((_, low, high): &(i32, i32, i32)) -> usize {
    ((high - low + 1).max(1) as usize).min(SIDE)
}

/// Places from which all cells of a stencil lie inside the window; none for one without cells.
fn inside(stencil: &Stencil) -> Window {
    let mut inside = [if stencil.is_empty() { 0 } else { u64::MAX }; SIDE];
    for (rows_on, low, high) in stencil {
        for bits_on in [*low, *high] {
            let mut within = [0; SIDE];
            join_moved(&mut within, &[u64::MAX; SIDE], -rows_on, -bits_on);
            inside.iter_mut().zip(within).for_each(|(inside, within)| *inside &= within);
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table against the roots.
    #[test]
    fn a_direction_is_its_step_of_length_1() {
        for (heading, step) in STEPS.iter().enumerate() {
            let [x, y] = step.map(|step| step as f32);
            assert_eq!(direction(heading).map(f32::to_bits), unit(x, y).map(f32::to_bits), "{heading}");
        }
    }
}

//! The cells that are nearer to the robot than its margin, and those that it stands in. A thing that touches a corner of a
//! cell takes all of it, so a robot that touches nothing may be as near, or overlap some. It comes no nearer to any part of
//! them than it is: wherever in them the thing stands, and however far the pose is off, it is not met.

use crate::clearance::{Heading, Outline, Rows, cell_index};
use sidestep_msgs::{SAFETY_GRID, SAFETY_SIDE};

/// Points along a side of a cell: 1 cm apart.
const SIDE: usize = 5;
const POINTS: usize = SIDE * SIDE;
/// Most cells kept; a robot in the midst of more stands still.
const MOST: usize = 160;
/// `[m]` deeper inside the outline nothing is asked: the robot is there.
const DEEP_M: f32 = 0.02;
/// `[m]` that rounding may take.
const ROUNDING_M: f32 = 1e-5;

/// A cell: row and bit, and how far beyond the outline each of its points stays.
#[derive(Debug, Clone, Copy)]
struct Cell {
    place: [u32; 2],
    least_m: [f32; POINTS],
}

/// The cells, each part with the distance that is kept from it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Held {
    cells: [Cell; MOST],
    count: usize,
}

impl Held {
    /// No cell is held.
    pub(crate) const NONE: Self =
        Self { cells: [Cell { place: [0; 2], least_m: [0.0; POINTS] }; MOST], count: 0 };

    /// Takes out of `rows` what lies nearer to the outline than `margin_m`; `None` where that is more than can be kept.
    pub(crate) fn take(outline: &Outline, at: &Heading, margin_m: f32, rows: &mut Rows) -> Option<Self> {
        let mut held = Self::NONE;
        for (row, bits) in outline.overlapped(at, margin_m, rows).into_iter().enumerate() {
            rows[row] &= !bits;
            let mut left = bits;
            while left != 0 {
                *held.cells.get_mut(held.count)? =
                    Cell::new(outline, at, margin_m, [row as u32, left.trailing_zeros()]);
                held.count += 1;
                left &= left - 1;
            }
        }
        Some(held)
    }

    /// Whether any cell is held.
    pub(crate) fn is_any(&self) -> bool {
        self.count > 0
    }

    /// The cell to a part of which a pose would come nearer than it may, by more than `error_m`.
    pub(crate) fn approached(&self, outline: &Outline, at: &Heading, error_m: f32) -> Option<u32> {
        let nearer = |cell: &&Cell| {
            let beyond = beyond_m(outline, at, cell.place);
            beyond.iter().zip(&cell.least_m).any(|(is, least)| *is < least - error_m)
        };
        let cell = self.cells[..self.count].iter().find(nearer)?;
        Some(cell_index(cell.place[0] as usize, cell.place[1] as usize))
    }
}

impl Cell {
    fn new(outline: &Outline, at: &Heading, margin_m: f32, place: [u32; 2]) -> Self {
        let least =
            |beyond_m: f32| if beyond_m < -DEEP_M { f32::MIN } else { beyond_m.min(margin_m) - ROUNDING_M };
        Self { place, least_m: beyond_m(outline, at, place).map(least) }
    }
}

/// `[m]` how far beyond the outline at a pose the points of a cell lie.
fn beyond_m(outline: &Outline, at: &Heading, place: [u32; 2]) -> [f32; POINTS] {
    let part_m = SAFETY_GRID.cell_m / SIDE as f32;
    let [x_m, y_m] =
        place.map(|cell| (cell as f32 - 0.5 * SAFETY_SIDE as f32) * SAFETY_GRID.cell_m + 0.5 * part_m);
    let x_m = std::array::from_fn(|point| x_m + part_m * (point / SIDE) as f32);
    let y_m = std::array::from_fn(|point| y_m + part_m * (point % SIDE) as f32);
    outline.beyond_m(at, &x_m, &y_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;

    const HERE: Heading = Heading { x_m: 0.0, y_m: 0.0, cos: 1.0, sin: 0.0 };

    fn set(rows: &mut Rows, x_m: f32, y_m: f32) -> (usize, u32) {
        let number = |part_m: f32| (libm::floorf(part_m / SAFETY_GRID.cell_m) + 40.0) as usize;
        let (row, bit) = (number(x_m), number(y_m) as u32);
        rows[row] |= 1 << bit;
        (row, bit)
    }

    /// A cell under the left flank, or just beside it: it may be slid along and left, not turned or moved towards. One
    /// farther off stays as it is.
    #[test]
    fn nothing_that_is_held_is_approached() {
        let outline = Outline::new(&loomo()).unwrap();
        for at in [HERE, Heading { y_m: 0.005, ..HERE }, Heading { y_m: -0.015, ..HERE }] {
            let mut rows = [0; SAFETY_SIDE];
            let (row, bit) = set(&mut rows, 0.0, 0.30 - 0.01);
            let (other, beside) = set(&mut rows, 0.0, 0.36);
            let held = Held::take(&outline, &at, 0.015, &mut rows).unwrap();
            assert!(held.is_any() && rows[row] >> bit & 1 == 0 && rows[other] >> beside & 1 == 1);
            let nearer = |pose: &Heading| held.approached(&outline, pose, 0.0).is_some();
            for (x_m, y_m, expected) in
                [(0.0, 0.0, false), (0.1, 0.0, false), (0.0, -0.02, false), (0.0, 0.002, true)]
            {
                assert_eq!(
                    nearer(&Heading { x_m, y_m: at.y_m + y_m, ..at }),
                    expected,
                    "{} {x_m} {y_m}",
                    at.y_m
                );
            }
            // Where errors are granted something, so much nearer and no more.
            for (y_m, expected) in [(0.002, false), (0.004, true)] {
                let pose = Heading { y_m: at.y_m + y_m, ..at };
                assert_eq!(held.approached(&outline, &pose, 0.003).is_some(), expected, "{} {y_m}", at.y_m);
            }
            let (sin, cos) = libm::sincosf(0.02);
            assert!(nearer(&Heading { sin, cos, ..at }));
        }
    }

    #[test]
    fn a_robot_near_nothing_holds_nothing_and_one_in_the_midst_of_too_much_is_not_said_to_be_safe() {
        let outline = Outline::new(&loomo()).unwrap();
        let held = Held::take(&outline, &HERE, 0.015, &mut [0; SAFETY_SIDE]).unwrap();
        assert!(!held.is_any() && held.approached(&outline, &HERE, 0.0).is_none());
        assert!(Held::take(&outline, &HERE, 0.3, &mut [u128::MAX; SAFETY_SIDE]).is_none());
    }

    /// Ahead, beside and within: the widening with which the outline reaches a point.
    #[test]
    fn how_far_a_point_lies_beyond_the_outline_is_told_in_metres() {
        let outline = Outline::new(&loomo()).unwrap();
        let (sin, cos) = libm::sincosf(0.7);
        let at = Heading { x_m: 0.11, y_m: -0.07, cos, sin };
        let ahead = [at.x_m + cos * (outline.front_m + 0.2), at.y_m + sin * (outline.front_m + 0.2)];
        let left = [at.x_m - sin * (outline.half_width_m + 0.1), at.y_m + cos * (outline.half_width_m + 0.1)];
        let within = [at.x_m + cos * (outline.front_m - 0.01), at.y_m + sin * (outline.front_m - 0.01)];
        let [x_m, y_m] = [0, 1].map(|axis| [ahead[axis], left[axis], within[axis]]);
        let found = outline.beyond_m(&at, &x_m, &y_m);
        for (found, expected) in found.into_iter().zip([0.2, 0.1, -0.01]) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }
}

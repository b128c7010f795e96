//! The cells that the robot already stands in. A thing that touches a corner of a cell takes all of it, and a map drawn
//! anew from a turned robot draws other cells: so a robot that touches nothing overlaps some now and then. What it covers
//! of such a cell is free, since it is there; no more of it is entered.

use crate::clearance::{Heading, Outline, Rows};
use sidestep_msgs::{SAFETY_GRID, SAFETY_SIDE};

/// Points along a side of a cell: 6 mm apart.
const POINTS: usize = 8;
/// Most points kept; a robot in the midst of more stands still.
const MOST: usize = 1024;

/// Points of the cells that the robot stands in which it does not cover, in the frame of the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Held {
    points: [[f32; 2]; MOST],
    count: usize,
}

impl Held {
    /// No cell is held.
    pub(crate) const NONE: Self = Self { points: [[0.0; 2]; MOST], count: 0 };

    /// Takes out of `rows` what the bare outline overlaps; `None` where that is more than can be kept.
    pub(crate) fn take(outline: &Outline, at: &Heading, rows: &mut Rows) -> Option<Self> {
        let mut held = Self::NONE;
        for (row, bits) in outline.overlapped(at, rows).into_iter().enumerate() {
            rows[row] &= !bits;
            let mut left = bits;
            while left != 0 {
                held.hold(outline, at, row, left.trailing_zeros())?;
                left &= left - 1;
            }
        }
        Some(held)
    }

    /// Keeps the points of a cell that are not covered.
    fn hold(&mut self, outline: &Outline, at: &Heading, row: usize, bit: u32) -> Option<()> {
        let part_m = SAFETY_GRID.cell_m / POINTS as f32;
        let middle = 0.5 * SAFETY_SIDE as f32;
        let along = |cell: usize, point: usize| {
            (cell as f32 - middle) * SAFETY_GRID.cell_m + (point as f32 + 0.5) * part_m
        };
        for point in 0..POINTS * POINTS {
            let place = [along(row, point / POINTS), along(bit as usize, point % POINTS)];
            if !outline.covers(at, place) {
                *self.points.get_mut(self.count)? = place;
                self.count += 1;
            }
        }
        Some(())
    }

    /// Whether any cell is held.
    pub(crate) fn is_any(&self) -> bool {
        self.count > 0
    }

    /// The cell of which a pose would cover more.
    pub(crate) fn entered(&self, outline: &Outline, at: &Heading) -> Option<u32> {
        let entered = self.points[..self.count].iter().find(|point| outline.covers(at, **point))?;
        SAFETY_GRID.index(entered[0], entered[1]).map(|cell| cell as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;

    const HERE: Heading = Heading { x_m: 0.0, y_m: 0.0, cos: 1.0, sin: 0.0 };

    fn cell(rows: &mut Rows, x_m: f32, y_m: f32) -> (usize, u32) {
        let number = |part_m: f32| (libm::floorf(part_m / SAFETY_GRID.cell_m) + 40.0) as usize;
        let (row, bit) = (number(x_m), number(y_m) as u32);
        rows[row] |= 1 << bit;
        (row, bit)
    }

    /// A cell under the left flank: it may be slid along and left, not turned or moved into; a cell beside it stays taken.
    #[test]
    fn no_more_of_a_cell_is_entered_than_is_covered() {
        let outline = Outline::new(&loomo()).unwrap();
        let mut rows = [0; SAFETY_SIDE];
        let (row, bit) = cell(&mut rows, 0.0, outline.half_width_m - 0.01);
        let (other, beside) = cell(&mut rows, 0.0, outline.half_width_m + 0.06);
        let held = Held::take(&outline, &HERE, &mut rows).unwrap();
        assert!(held.is_any() && rows[row] >> bit & 1 == 0 && rows[other] >> beside & 1 == 1);
        let enters = |at: &Heading| held.entered(&outline, at).is_some();
        for (x_m, y_m, expected) in [(0.0, 0.0, false), (0.1, 0.0, false), (0.0, -0.02, false), (0.0, 0.02, true)] {
            assert_eq!(enters(&Heading { x_m, y_m, ..HERE }), expected, "{x_m} {y_m}");
        }
        let (sin, cos) = libm::sincosf(0.1);
        assert!(enters(&Heading { sin, cos, ..HERE }));
    }

    #[test]
    fn a_robot_that_stands_in_none_holds_none_and_one_in_the_midst_of_many_is_not_said_to_be_safe() {
        let outline = Outline::new(&loomo()).unwrap();
        let held = Held::take(&outline, &HERE, &mut [0; SAFETY_SIDE]).unwrap();
        assert!(!held.is_any() && held.entered(&outline, &HERE).is_none());
        // All round the edge of the outline, turned across the cells.
        let turned = Heading { cos: 0.8, sin: 0.6, ..HERE };
        assert!(Held::take(&outline, &turned, &mut [u128::MAX; SAFETY_SIDE]).is_none());
    }
}

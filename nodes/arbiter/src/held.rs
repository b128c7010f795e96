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

//! The independent fusion: all points of the last images in cells by height, nothing weighed, nothing remembered.

use sidestep_msgs::{DepthFrame, Pose2};
use std::collections::VecDeque;

/// `[m]` side of a cell, aligned with odom.
pub(crate) const CELL_M: f64 = 0.05;
/// Cells along a side: 50 m.
const SIDE: usize = 1000;
/// Images fused.
const WINDOW: usize = 40;
/// `[m]` points used: within what the mapper uses, with a margin for what lies on its limits.
const RANGE_M: std::ops::Range<f64> = 0.45..3.3;
/// Images in which an obstacle must show for the cell to count.
const OBSTACLE_IMAGES: u16 = 4;
/// Images in which the floor must show for the cell to count as free.
const FLOOR_IMAGES: u16 = 3;
/// Points of one image in one cell that are no speckle.
const POINTS_MIN: u16 = 12;

/// What the fusion says of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seen {
    /// Points of several images stand here between the floor cut and the top of the band.
    Occupied,
    /// The floor was seen here in several images, and never anything above it.
    Free,
    /// Neither.
    Unsure,
}

/// Points of one image in one cell.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    floor: u16,
    obstacle: u16,
    above_floor: u16,
}

/// Images of the window in which a cell showed floor, an obstacle, or anything at all above the floor.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    floor: u16,
    obstacle: u16,
    above_floor: u16,
}

/// The fusion.
pub(crate) struct Batch {
    cells: Vec<Cell>,
    /// Per image of the window, the cells it touched.
    images: VecDeque<Vec<(u32, Count)>>,
}

fn index(x_m: f64, y_m: f64) -> Option<usize> {
    let place = |m: f64| (m / CELL_M).floor() + SIDE as f64 / 2.0;
    let (x, y) = (place(x_m), place(y_m));
    let inside = |place: f64| place >= 0.0 && place < SIDE as f64;
    (inside(x) && inside(y)).then(|| y as usize * SIDE + x as usize)
}

impl Batch {
    pub(crate) fn new() -> Self {
        Self { cells: vec![Cell::default(); SIDE * SIDE], images: VecDeque::new() }
    }

    fn weigh(&mut self, image: &[(u32, Count)], add: bool) {
        for (cell, count) in image {
            let cell = &mut self.cells[*cell as usize];
            let change = |total: &mut u16, seen: bool| {
                if add { *total += u16::from(seen) } else { *total -= u16::from(seen) }
            };
            change(&mut cell.floor, count.floor >= POINTS_MIN && count.above_floor == 0);
            change(&mut cell.obstacle, count.obstacle >= POINTS_MIN);
            change(&mut cell.above_floor, count.above_floor > 0);
        }
    }

    /// Adds an image, and drops the oldest of a full window.
    pub(crate) fn add(&mut self, frame: &DepthFrame, base: &Pose2) {
        let mut counts = std::collections::BTreeMap::<u32, Count>::new();
        let rotation = frame.camera.rotation().map(|row| row.map(f64::from));
        let eye = frame.camera.translation_m.map(f64::from);
        for (place, &raw) in frame.used_pixels().iter().enumerate() {
            let z = f64::from(raw) * f64::from(frame.metres_per_unit);
            if raw == u16::MAX || !RANGE_M.contains(&z) {
                continue;
            }
            let (u, v) = (place % frame.width as usize, place / frame.width as usize);
            let x = (u as f64 - f64::from(frame.cx_px)) / f64::from(frame.fx_px) * z;
            let y = (v as f64 - f64::from(frame.cy_px)) / f64::from(frame.fy_px) * z;
            let body =
                [0, 1, 2].map(|i| rotation[i][0] * x + rotation[i][1] * y + rotation[i][2] * z + eye[i]);
            let (odom_x, odom_y) = base.transform(body[0], body[1]);
            let range_m = (body[0] * body[0] + body[1] * body[1]).sqrt();
            // SPEC section 4: the height classes of the mapper.
            let cut_m = 0.05 + 0.0175 * range_m;
            let Some(cell) = index(odom_x, odom_y) else { continue };
            let count = counts.entry(cell as u32).or_default();
            count.floor += u16::from(body[2].abs() < cut_m);
            count.obstacle += u16::from((cut_m..0.9).contains(&body[2]));
            count.above_floor += u16::from((cut_m..0.95).contains(&body[2]));
        }
        let image: Vec<_> = counts.into_iter().collect();
        self.weigh(&image, true);
        self.images.push_back(image);
        if self.images.len() > WINDOW
            && let Some(oldest) = self.images.pop_front()
        {
            self.weigh(&oldest, false);
        }
    }

    /// Every cell that says something, with its centre in odom.
    pub(crate) fn cells(&self) -> impl Iterator<Item = (Seen, f64, f64)> {
        let centre = |place: usize| (place as f64 + 0.5 - SIDE as f64 / 2.0) * CELL_M;
        self.cells.iter().enumerate().filter_map(move |(index, cell)| {
            let seen = if cell.obstacle >= OBSTACLE_IMAGES {
                Seen::Occupied
            } else if cell.floor >= FLOOR_IMAGES && cell.above_floor == 0 {
                Seen::Free
            } else {
                Seen::Unsure
            };
            (seen != Seen::Unsure).then(|| (seen, centre(index % SIDE), centre(index / SIDE)))
        })
    }
}

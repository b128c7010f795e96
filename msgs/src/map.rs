//! The robot's view of what is around it: one map to plan on, one to be safe with.

use crate::geometry::Pose2;
use crate::layout::{ZeroCopySend, record};

/// Cells along a side of the local map.
pub const LOCAL_SIDE: usize = 28;
/// Cells of the local map.
pub const LOCAL_CELLS: usize = LOCAL_SIDE * LOCAL_SIDE;
/// Cells along a side of the safety map.
pub const SAFETY_SIDE: usize = 80;
/// Cells of the safety map.
pub const SAFETY_CELLS: usize = SAFETY_SIDE * SAFETY_SIDE;
/// `[1]` probability of being occupied below which a cell that was seen counts as free to drive on, unless configured
/// otherwise; the unknown is 0.5.
pub const FREE_BELOW: f32 = 0.45;
/// Occupancy code from which on (0.5) something counts as standing in a cell. Between this and [`FREE_BELOW`] a cell is in doubt,
/// as a free one is that lost its certainty with motion: nothing was ever seen to stand there.
pub const OBSTACLE_FROM: u8 = 128;
/// Age code: the cell was never seen; the only mark of unknown.
pub const AGE_NEVER: u8 = 255;
/// Age code: seen longer ago than 25.3 s.
pub const AGE_OLDER: u8 = 254;
/// Stillness code: something has been standing here for longer than 25.3 s, or nothing is here.
pub const STILL: u8 = 254;

/// The geometry of a map: square cells in the map's frame, row 0 farthest along x, column 0 farthest along y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Cells along a side.
    pub side: usize,
    /// `[m]` side of a cell.
    pub cell_m: f32,
    /// `[m]` x of the rear edge.
    pub rear_m: f32,
    /// `[m]` y of the right edge.
    pub right_m: f32,
}

/// 28 x 28 cells of 0.1 m: x in [-0.4, 2.4), y in [-1.4, 1.4) (paper section IV-A and the ticks of Fig. 8).
pub const LOCAL_GRID: Grid = Grid { side: LOCAL_SIDE, cell_m: 0.1, rear_m: -0.4, right_m: -1.4 };
/// 80 x 80 cells of 0.05 m, the robot within a cell of the middle.
pub const SAFETY_GRID: Grid = Grid { side: SAFETY_SIDE, cell_m: 0.05, rear_m: -2.0, right_m: -2.0 };

impl Grid {
    /// Row and column of a point, or `None` outside.
    #[must_use]
    pub fn row_col(&self, x_m: f32, y_m: f32) -> Option<(usize, usize)> {
        let forward = libm::floorf((x_m - self.rear_m) / self.cell_m);
        let left = libm::floorf((y_m - self.right_m) / self.cell_m);
        let side = self.side as f32;
        // NaN fails every comparison and is outside.
        let inside = forward >= 0.0 && forward < side && left >= 0.0 && left < side;
        inside.then(|| (self.side - 1 - forward as usize, self.side - 1 - left as usize))
    }

    /// Index of a point's cell, or `None` outside.
    #[must_use]
    pub fn index(&self, x_m: f32, y_m: f32) -> Option<usize> {
        self.row_col(x_m, y_m).map(|(row, col)| row * self.side + col)
    }

    /// Centre of a cell in the map's frame.
    #[must_use]
    pub fn centre(&self, row: usize, col: usize) -> (f32, f32) {
        let forward = (self.side - 1 - row) as f32 + 0.5;
        let left = (self.side - 1 - col) as f32 + 0.5;
        (self.rear_m + forward * self.cell_m, self.right_m + left * self.cell_m)
    }

    /// `[m]` x of the front edge.
    #[must_use]
    pub fn front_m(&self) -> f32 {
        self.rear_m + self.side as f32 * self.cell_m
    }

    /// `[m]` y of the left edge.
    #[must_use]
    pub fn left_m(&self) -> f32 {
        self.right_m + self.side as f32 * self.cell_m
    }
}

/// The age code of a time span: tenths of a second, rounded down, [`AGE_OLDER`] beyond 25.3 s.
#[must_use]
pub fn age_code(age_ns: u64) -> u8 {
    u8::try_from(age_ns / 100_000_000).map_or(AGE_OLDER, |tenths| tenths.min(AGE_OLDER))
}

/// The byte `[1/255]` of a probability, rounded down.
#[must_use]
pub const fn probability_code(probability: f32) -> u8 {
    (probability * 255.0) as u8
}

/// The frame of a safety map made at a pose of `base`: its axes are those of `odom`, its origin is the corner of the cells of
/// 0.05 m there that is nearest to the robot.
#[must_use]
pub fn safety_frame(base: &Pose2) -> Pose2 {
    const CELL_M: f64 = 0.05;
    let corner = |position_m: f64| libm::floor(position_m / CELL_M + 0.5) * CELL_M;
    Pose2::new(corner(base.x_m), corner(base.y_m), 0.0)
}

record! {
    /// Egocentric occupancy: the only view of obstacles that policy and expert have (paper section IV-A).
    ///
    /// Frame: `base` at `capture_ns`; geometry [`LOCAL_GRID`]. Writer: `mapper`, one per depth frame.
    /// Readers: `goal`, `policy`, `expert`.
    pub struct LocalMap("sidestep/LocalMap/1") {
        /// `[ns]` graph time at which the camera saw this.
        pub capture_ns: u64,
        /// Pose of `base` in `odom` used for this map.
        pub pose: Pose2,
        /// Pose epoch of that pose.
        pub pose_epoch: u32,
        /// Frames refused since the mapper started.
        pub refused: u32,
        /// `[1/255]` `[0, 255]` probability that a cell is occupied; 128 where unknown.
        pub occupancy: [u8; LOCAL_CELLS],
        /// `[1/255]` `[0, 255]` m_o of eq. (3): occupancy widened by the robot's half-width; so are, as 0.5, cells not known
        /// free that lie too near for the camera to see.
        pub planning_cost: [u8; LOCAL_CELLS],
        /// `[0.1 s]` `[0, 253]` time since the cell was seen; 254 older, 255 never.
        pub age: [u8; LOCAL_CELLS],
    }
}

const _: () = assert!(size_of::<LocalMap>() == 40 + 3 * LOCAL_CELLS);

record! {
    /// The map that decides whether a motion is safe: conservative, finer, all round the robot.
    ///
    /// Frame: [`SafetyMap::frame`], with the axes of `odom` and its origin on the corner of the mapper's cells that is
    /// nearest to the robot; geometry [`SAFETY_GRID`]. So its cells are those of the mapper, and stay what they are while
    /// the robot turns and moves. Writer: `mapper`. Reader: `arbiter`, nothing else.
    pub struct SafetyMap("sidestep/SafetyMap/4") {
        /// `[ns]` graph time at which the camera saw this.
        pub capture_ns: u64,
        /// Pose of `base` in `odom` used for this map.
        pub base: Pose2,
        /// Pose epoch of that pose.
        pub pose_epoch: u32,
        /// Frames refused since the mapper started.
        pub refused: u32,
        /// `[1/255]` `[0, 255]` probability that a cell is occupied.
        pub occupancy: [u8; SAFETY_CELLS],
        /// `[0.1 s]` `[0, 253]` time since the cell was seen; 254 older, 255 never.
        pub age: [u8; SAFETY_CELLS],
        /// `[0.1 s]` `[0, 253]` time since what stands here was first seen here; 254 longer, or nothing is here.
        pub still: [u8; SAFETY_CELLS],
    }
}

const _: () = assert!(size_of::<SafetyMap>() == 40 + 3 * SAFETY_CELLS);

impl SafetyMap {
    /// Pose of the map's frame in `odom`; its yaw is 0.
    #[must_use]
    pub fn frame(&self) -> Pose2 {
        safety_frame(&self.base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_stands_on_the_corner_of_four_cells() {
        // SPEC: row = 27 - floor((x + 0.4)/0.1), col = 27 - floor((y + 1.4)/0.1).
        assert_eq!(LOCAL_GRID.row_col(0.05, 0.05), Some((23, 13)));
        assert_eq!(LOCAL_GRID.row_col(-0.05, -0.05), Some((24, 14)));
        assert_eq!(LOCAL_GRID.row_col(2.35, 1.35), Some((0, 0)));
        assert_eq!(LOCAL_GRID.row_col(2.45, 0.0), None);
        assert_eq!(LOCAL_GRID.row_col(f32::NAN, 0.0), None);
    }

    #[test]
    fn every_cell_centre_lies_in_its_cell() {
        for grid in [LOCAL_GRID, SAFETY_GRID] {
            for index in 0..grid.side * grid.side {
                let (x, y) = grid.centre(index / grid.side, index % grid.side);
                assert_eq!(grid.index(x, y), Some(index));
            }
        }
    }

    #[test]
    fn ages_saturate_below_never() {
        assert_eq!(age_code(0), 0);
        assert_eq!(age_code(25_399_999_999), 253);
        assert_eq!(age_code(25_400_000_000), AGE_OLDER);
        assert_eq!(age_code(u64::MAX), AGE_OLDER);
    }
}

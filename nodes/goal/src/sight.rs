//! What of the world is free for the footprint, as the planning cost has it.

use sidestep_msgs::{LOCAL_GRID, LOCAL_SIDE, LocalMap};

/// `[1]` planning cost outside the map: unknown.
const UNKNOWN: f32 = 0.3;
/// `[m]` between points of a line of sight.
const STRIDE_M: f32 = 0.05;
/// `[m]` round the robot a line of sight is not looked at: where the robot stands, it can start.
const OWN_M: f32 = 0.2;

/// A map to look at.
pub(crate) struct Sight<'a> {
    pub(crate) map: &'a LocalMap,
    /// `[1]` planning cost from which a point is not free.
    pub(crate) limit: f32,
}

impl Sight<'_> {
    fn cell(&self, forward: i32, left: i32) -> f32 {
        let side = LOCAL_SIDE as i32;
        if !(0..side).contains(&forward) || !(0..side).contains(&left) {
            return UNKNOWN;
        }
        let index = (side - 1 - forward) * side + side - 1 - left;
        f32::from(self.map.planning_cost[index as usize]) * (1.0 / 255.0)
    }

    /// `[1]` planning cost at a point of `base`, bilinear between cell centres.
    pub(crate) fn cost(&self, x_m: f32, y_m: f32) -> f32 {
        let forward = (x_m - LOCAL_GRID.rear_m) / LOCAL_GRID.cell_m - 0.5;
        let left = (y_m - LOCAL_GRID.right_m) / LOCAL_GRID.cell_m - 0.5;
        let (row, col) = (libm::floorf(forward), libm::floorf(left));
        let (part_x, part_y) = (forward - row, left - col);
        // The cast saturates; far outside is outside.
        let (i, j) = ((row as i32).clamp(-9, 99), (col as i32).clamp(-9, 99));
        let behind = self.cell(i, j) + part_y * (self.cell(i, j + 1) - self.cell(i, j));
        let ahead = self.cell(i + 1, j) + part_y * (self.cell(i + 1, j + 1) - self.cell(i + 1, j));
        behind + part_x * (ahead - behind)
    }

    /// Whether the footprint fits at a point of `base`.
    pub(crate) fn is_free(&self, x_m: f32, y_m: f32) -> bool {
        self.cost(x_m, y_m) < self.limit
    }

    /// Whether the footprint fits all along the straight line from the robot to a point; beyond the map it ends.
    pub(crate) fn is_visible(&self, x_m: f32, y_m: f32) -> bool {
        let range_m = libm::hypotf(x_m, y_m);
        let reach_m = range_m.min(LOCAL_GRID.front_m() + LOCAL_GRID.left_m());
        let count = (reach_m / STRIDE_M) as usize;
        let first = (OWN_M / STRIDE_M) as usize;
        (first..=count).all(|step| {
            let part = step as f32 * STRIDE_M / range_m.max(STRIDE_M);
            self.is_free(x_m * part, y_m * part)
        }) && self.is_free(x_m, y_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> LocalMap {
        let mut map = LocalMap::default();
        // A block of 0.2 m a side, 1 m ahead.
        for (row, col) in [(13, 13), (13, 14), (12, 13), (12, 14)] {
            map.planning_cost[row * LOCAL_SIDE + col] = 255;
        }
        map
    }

    #[test]
    fn the_cost_is_that_of_the_cell_at_its_centre_and_unknown_outside() {
        let map = map();
        let sight = Sight { map: &map, limit: 0.4 };
        for index in 0..LOCAL_SIDE * LOCAL_SIDE {
            let (x_m, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
            assert!((sight.cost(x_m, y_m) - f32::from(map.planning_cost[index]) / 255.0).abs() < 1e-4);
        }
        for (x_m, y_m) in [(9.0, 0.0), (0.0, 1e30), (-1e30, 0.0)] {
            assert!((sight.cost(x_m, y_m) - UNKNOWN).abs() < 1e-4);
        }
    }

    #[test]
    fn an_obstacle_hides_what_is_behind_it_and_nothing_else() {
        let map = map();
        let sight = Sight { map: &map, limit: 0.4 };
        for (x_m, y_m, visible) in [
            (2.0, 0.0, false),
            (0.8, 0.0, true),
            (2.0, 1.0, true),
            (1.1, 0.0, false),
            (5.0, 0.0, false),
            (-3.0, 0.0, true),
        ] {
            assert_eq!(sight.is_visible(x_m, y_m), visible, "{x_m} {y_m}");
        }
    }
}

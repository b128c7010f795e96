//! What map and guard know of a thing: by the arbiter's rules, and early enough to stop before it.

use crate::reach::margin_m;
use sidestep_arbiter::Config;
use sidestep_msgs::{
    AGE_NEVER, NearField, Pose2, Robot, SAFETY_GRID, SAFETY_SIDE, SafetyMap, probability_code,
};
use sidestep_sim::Solid;

/// Occupancy of a cell that was never seen; a thing seen in part of such a cell has more.
const UNKNOWN: u8 = 128;
/// `[m]` error of a range that the guard's own measurement allows beside two sigma of the stereo noise (its README).
const GUARD_ERROR_M: f64 = 0.05;

/// What there is to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    /// The outline of the thing in the world; `None` where the floor is free.
    pub(crate) solid: Option<Solid>,
    /// `[m]` its near edge along the way, or the end of the tube.
    pub(crate) near_m: f64,
    /// True pose of the robot when the newest frame was taken.
    pub(crate) seen_from: Pose2,
}

/// The arbiter's rules.
#[derive(Debug, Clone)]
pub(crate) struct Judge {
    /// Least occupancy of a cell that is not free.
    free_code: u8,
    /// `[m]` the footprint's front and half width, and by how much it is widened.
    front_m: f64,
    half_width_m: f64,
    margin_m: f64,
    /// `[m]` half width within which a range of the guard counts.
    guarded_m: f64,
    /// `[1/m]` standard deviation of stereo depth over its square.
    sigma_per_m: f64,
}

impl Judge {
    pub(crate) fn new(robot: &Robot, config: &Config) -> Self {
        let front = robot.footprint.polygon_m.iter().fold(0.0_f32, |most, corner| most.max(corner[0]));
        let noise = robot.camera.map_or(0.0, |c| c.disparity_sigma_px / (c.focal_px * c.baseline_m));
        Self {
            free_code: probability_code(config.free_below),
            front_m: f64::from(front),
            half_width_m: f64::from(robot.half_width_m()),
            margin_m: margin_m(config),
            guarded_m: f64::from(robot.half_width_m() + config.margin_m),
            sigma_per_m: f64::from(noise),
        }
    }

    /// `[m]` the farthest point of the robot ahead of its axle.
    pub(crate) fn front_m(&self) -> f64 {
        self.front_m
    }

    /// Whether the map marks the target, and whether it knows all of it to be free.
    ///
    /// Only cells count that stop the robot in time: under the swept width, within the arbiter's margin of the thing, and
    /// not beginning farther behind its near edge than a cell: finer the map is not, and an edge within a cell is told by
    /// the next one.
    pub(crate) fn map(&self, map: &SafetyMap, target: &Target) -> (bool, bool) {
        let (mut is_marked, mut is_free) = (false, true);
        for index in 0..SAFETY_SIDE * SAFETY_SIDE {
            let (occupancy, age) = (map.occupancy[index], map.age[index]);
            let free = age != AGE_NEVER && occupancy < self.free_code;
            if free || !self.concerns(map, index, target) {
                continue;
            }
            is_free = false;
            is_marked |= age != AGE_NEVER || occupancy > UNKNOWN;
        }
        (is_marked, is_free)
    }

    /// Whether a cell lies in the way and belongs to the target.
    fn concerns(&self, map: &SafetyMap, index: usize, target: &Target) -> bool {
        let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        let (x, y) = map.frame().transform(x.into(), y.into());
        let (x, y) = map.base.inverse_transform(x, y);
        let half = 0.5 * f64::from(SAFETY_GRID.cell_m);
        if y.abs() - half > self.half_width_m + self.margin_m {
            return false;
        }
        let near_m = target.near_m - target.seen_from.x_m;
        let Some(solid) = &target.solid else {
            return x - half > self.front_m && x - half <= near_m;
        };
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[dx, dy]| {
            let (x, y) = target.seen_from.transform(x + dx, y + dy);
            [x, y]
        });
        x - half <= near_m + 2.0 * half && solid.gap_m(&corners) <= self.margin_m
    }

    /// Whether the guard's nearest range in the way is that of the thing; of free floor, whether anything is nearer than
    /// the end of the tube.
    pub(crate) fn guard(&self, field: &NearField, target: &Target) -> bool {
        let mut nearest_m = f64::INFINITY;
        for (sector, range_m) in field.range_m.iter().enumerate() {
            let bearing = field.left_rad - (sector as f32 + 0.5) * field.sector_rad;
            let (sin, cos) = libm::sincos(f64::from(bearing));
            let range_m = f64::from(*range_m);
            // As `nodes/arbiter/src/ahead.rs`: NaN fails the comparison, what was not seen is no word.
            if (range_m * sin).abs() <= self.guarded_m && cos > 0.0 {
                nearest_m = nearest_m.min(range_m * cos);
            }
        }
        let near_m = target.near_m - target.seen_from.x_m;
        if target.solid.is_none() {
            return nearest_m <= near_m;
        }
        let tolerance_m = GUARD_ERROR_M + 2.0 * self.sigma_per_m * near_m * near_m;
        (nearest_m - near_m).abs() <= tolerance_m
    }
}

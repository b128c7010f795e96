//! Ultrasonic readings: near ones mark the arc on which something stands, beside the memory of the camera.
//!
//! A cone in one plane sees neither low nor high things, so that it never proves a cell free. What it marks is kept apart
//! from the camera's memory: when the sensor sees past a marked cell, or has not confirmed it for a while, the mark goes
//! and what the camera knew is there again.

use crate::config::Config;
use crate::grid::{CELL_M, Grid, Moment, SIDE};
use sidestep_msgs::{Pose2, RANGES_MAX, Range, Ranges};

/// `[m]` what the sensor must see past a mark.
const SEES_PAST_M: f32 = 0.1;

/// Takes all sensors of one message, with the robot at `pose`.
pub(crate) fn take(ranges: &Ranges, pose: &Pose2, config: &Config, now: &Moment, grid: &mut Grid) {
    let count = (ranges.count as usize).min(RANGES_MAX);
    for range in &ranges.sensors[..count] {
        let mount = [range.x_m, range.y_m, range.yaw_rad, range.field_of_view_rad];
        let mounted = mount.iter().all(|part| part.is_finite())
            && range.x_m.abs() < 2.0
            && range.y_m.abs() < 2.0
            && range.yaw_rad.abs() < 10.0
            && range.field_of_view_rad > 0.0
            && range.field_of_view_rad < 3.0;
        // NaN and negative readings are no measurement; infinite means nothing up to the far limit.
        if mounted && range.range_m >= 0.0 {
            mark(range, pose, config, now, grid);
        }
    }
}

fn mark(range: &Range, pose: &Pose2, config: &Config, now: &Moment, grid: &mut Grid) {
    let sensor = pose.compose(&Pose2::new(range.x_m.into(), range.y_m.into(), range.yaw_rad.into()));
    let [sx, sy] = grid.window(sensor.x_m, sensor.y_m);
    let (sin, cos) = libm::sincosf(sensor.yaw_rad as f32);
    let cell_m = CELL_M as f32;
    let marks = range.range_m < config.sonar_below_m;
    let past_m = range.range_m.min(range.far_m.max(0.0)).min(3.0) - SEES_PAST_M;
    let reach = (config.sonar_below_m + 2.0 * cell_m) / cell_m;
    let (edge_sin, edge_cos) = libm::sincosf(0.5 * range.field_of_view_rad);
    let bound = |edge: f32| edge.clamp(0.0, SIDE as f32) as usize;
    for y in bound(sy - reach)..bound(sy + reach + 1.0) {
        for x in bound(sx - reach)..bound(sx + reach + 1.0) {
            let (dx, dy) = ((x as f32 + 0.5 - sx) * cell_m, (y as f32 + 0.5 - sy) * cell_m);
            let distance_m = (dx * dx + dy * dy).sqrt();
            let (ahead, aside) = (dx * cos + dy * sin, (dy * cos - dx * sin).abs());
            // Half a cell more on both sides of the cone, so that the arc has no gaps.
            let in_cone = ahead > 0.0 && aside * edge_cos - ahead * edge_sin <= 0.5 * cell_m;
            let index = grid.index(x, y);
            if in_cone && marks && (distance_m - range.range_m).abs() <= cell_m {
                grid.sonar_tick[index] = now.tick;
            } else if in_cone && distance_m < past_m {
                grid.sonar_tick[index] = 0;
            }
        }
    }
}

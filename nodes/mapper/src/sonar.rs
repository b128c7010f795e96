//! Ultrasonic readings: near ones mark the arc on which something stands, beside the memory of the camera.
//!
//! An echo says how far, but not where in its cone: where the camera's memory holds something there at that range, as high
//! as the beam, that is what was heard, and the rest of the arc is not marked for it.
//!
//! A cone in one plane sees neither low nor high things, so that it never proves a cell free. What it marks is kept apart
//! from the camera's memory: when the sensor sees past a marked cell, or has not confirmed it for a while, the mark goes
//! and what the camera knew is there again.

use crate::config::Config;
use crate::grid::{ALL_BANDS, CELL_M, Grid, Moment, cells_near};
use sidestep_msgs::{Camera, Pose2, RANGES_MAX, Range, Ranges};

/// `[m]` what the sensor must see past a mark.
const SEES_PAST_M: f32 = 0.1;
/// `[m]` how far beside a reading what made it may be held: half a cell's diagonal, and the drift since it was seen.
const HEARD_M: f32 = 0.075;
/// The middle band, which a beam meets, and the ones above and below it: of what is seen in one of these only, it may miss all.
const MIDDLE: u8 = 0b010;
const BESIDE: u8 = ALL_BANDS & !MIDDLE;

/// Cosine of the angle up to which a sensor looks where the camera looks.
const ALONG: f32 = 0.9;
/// `[m]` beyond what the camera is too near to, within which an echo may come from what fills its view.
const BEYOND_M: f32 = 0.05;

/// Takes all sensors of one message, with the robot at `pose`.
pub(crate) fn take(ranges: &Ranges, pose: &Pose2, config: &Config, now: &Moment, grid: &mut Grid) {
    measured(ranges).for_each(|range| mark(range, pose, config, now, grid));
}

/// Whether a sensor that looks along the camera hears something that the camera is too near to measure.
pub(crate) fn is_faced(ranges: &Ranges, camera: &Camera) -> bool {
    let blind_m = camera.forward_m + camera.near_m + BEYOND_M;
    measured(ranges).any(|range| libm::cosf(range.yaw_rad) > ALONG && range.x_m + range.range_m < blind_m)
}

/// The sensors that measured something, mounted where one can be.
fn measured(ranges: &Ranges) -> impl Iterator<Item = &Range> {
    let count = (ranges.count as usize).min(RANGES_MAX);
    ranges.sensors[..count].iter().filter(|range| {
        let mount = [range.x_m, range.y_m, range.yaw_rad, range.field_of_view_rad];
        let mounted = mount.iter().all(|part| part.is_finite())
            && range.x_m.abs() < 2.0
            && range.y_m.abs() < 2.0
            && range.yaw_rad.abs() < 10.0
            && range.field_of_view_rad > 0.0
            && range.field_of_view_rad < 3.0;
        // NaN and negative readings are no measurement; infinite means nothing up to the far limit.
        mounted && range.range_m >= 0.0
    })
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
    // Every cell whose middle lies in the cone, with its distance. Half a cell more on both sides, so that the arc has no gaps.
    let in_cone = cells_near([sx, sy], reach).filter_map(|[x, y]| {
        let (dx, dy) = ((x as f32 + 0.5 - sx) * cell_m, (y as f32 + 0.5 - sy) * cell_m);
        let (ahead, aside) = (dx * cos + dy * sin, (dy * cos - dx * sin).abs());
        let is_in = ahead > 0.0 && aside * edge_cos - ahead * edge_sin <= 0.5 * cell_m;
        is_in.then(|| ([x, y], (dx * dx + dy * dy).sqrt()))
    });
    let off_m = |distance_m: f32| (distance_m - range.range_m).abs();
    let is_held = |[x, y]: [usize; 2]| {
        let index = grid.index(x, y);
        let bands = grid.bands[index];
        let is_met = bands & MIDDLE != 0 || bands & BESIDE == BESIDE;
        is_met && grid.log_odds_now(index, now).is_some_and(|odds| odds > 0.0)
    };
    // At its near limit a sensor says that something is there or nearer.
    let says_where = marks && range.range_m > range.near_m;
    let is_known =
        says_where && in_cone.clone().any(|(cell, distance_m)| off_m(distance_m) <= HEARD_M && is_held(cell));
    let hold = (config.sonar_hold_s * 100.0) as u32;
    for ([x, y], distance_m) in in_cone {
        let index = grid.index(x, y);
        if marks && off_m(distance_m) <= cell_m {
            // What was marked before the camera knew of anything may be something else.
            let marked = grid.sonar_tick[index];
            let is_marked = marked != 0 && now.tick.saturating_sub(marked) <= hold;
            if !is_known || is_marked {
                grid.sonar_tick[index] = now.tick;
            }
        } else if distance_m < past_m {
            grid.sonar_tick[index] = 0;
        }
    }
}

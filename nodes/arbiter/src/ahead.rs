//! The fastest speed that what the ultrasonic sensors and the depth guard see ahead allows, without map or memory.

use crate::clearance::Outline;
use crate::config::Config;
use crate::inputs::Inputs;
use sidestep_msgs::Robot;

/// A sensor that looks more than 60 degrees aside says nothing of the way ahead.
const AHEAD_COS: f32 = 0.5;

/// What the direct sensors allow along one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ahead {
    /// `[m/s]` fastest speed from which the robot still stops, all delays counted.
    pub(crate) speed_m_s: f32,
    /// Whether the robot could not stop any more even if it braked at once.
    pub(crate) emergency: bool,
}

/// `[m]` free distance from the outline to the nearest thing ahead (`sign` = 1) or behind (-1), and its age `[s]`.
fn gap(inputs: &Inputs, config: &Config, outline: &Outline, now_ns: u64, sign: f32) -> Option<(f32, f32)> {
    let edge_m = if sign > 0.0 { outline.front_m } else { outline.rear_m };
    let mut nearest: Option<(f32, f32)> = None;
    let mut see = |gap_m: f32, age_s: f32| {
        if nearest.is_none_or(|(known_m, _)| gap_m < known_m) {
            nearest = Some((gap_m, age_s));
        }
    };
    if inputs.ranges_stamps.is_fresh(now_ns, config.ranges_age_s) {
        let age_s = inputs.ranges_stamps.age_s(now_ns);
        for sensor in inputs.sensors.iter().take(inputs.sensor_count as usize) {
            let along = sign * libm::cosf(sensor.yaw_rad);
            // NaN fails the comparisons: no measurement, no word.
            if along >= AHEAD_COS && sensor.range_m <= sensor.far_m {
                let range_m = if sensor.range_m <= sensor.near_m { 0.0 } else { sensor.range_m };
                see((sign * sensor.x_m + range_m * along - edge_m).max(0.0), age_s);
            }
        }
    }
    if inputs.near_stamps.is_fresh(now_ns, config.near_field_age_s) {
        let age_s = inputs.near_stamps.age_s(now_ns);
        for (index, range_m) in inputs.near_m.iter().enumerate() {
            let bearing = inputs.near_left_rad - (index as f32 + 0.5) * inputs.near_sector_rad;
            let (sin, cos) = libm::sincosf(bearing);
            let inside = (range_m * sin).abs() <= outline.half_width_m + config.margin_m;
            if inside && sign * cos > 0.0 && *range_m >= 0.0 {
                see((sign * range_m * cos - edge_m).max(0.0), age_s);
            }
        }
    }
    nearest
}

/// What may be driven forward (`sign` = 1) or backward (-1) at the measured speed `v_m_s`.
pub(crate) fn ahead(
    inputs: &Inputs,
    config: &Config,
    robot: &Robot,
    outline: &Outline,
    now_ns: u64,
    sign: f32,
) -> Option<Ahead> {
    let (gap_m, age_s) = gap(inputs, config, outline, now_ns, sign)?;
    let a = &robot.actuator;
    let gap_m = (gap_m - config.margin_m).max(0.0);
    let brake = a.brake_min_m_s2.min(robot.limits.brake_m_s2);
    let delay_s = a.dead_time_max_s + a.lag_s + config.hold_s + age_s;
    // v^2 / 2b + v T = gap, solved for v.
    let speed_m_s = libm::sqrtf(brake * brake * delay_s * delay_s + 2.0 * brake * gap_m) - brake * delay_s;
    let v = sign * inputs.odometry.twist.v_m_s;
    let emergency = v > 0.05 && v * v > 2.0 * robot.limits.brake_m_s2 * gap_m;
    Some(Ahead { speed_m_s: speed_m_s.max(0.0), emergency })
}

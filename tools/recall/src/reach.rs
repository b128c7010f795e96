//! How far ahead of the robot the arbiter's tube reaches: what it does not cover is too late to brake for.

use sidestep_arbiter::Config;
use sidestep_msgs::Robot;

/// `[m]` from the robot's front to the end of the longest tube of a robot that drives straight at `speed_m_s`.
///
/// The delays are those of `nodes/arbiter/src/ahead.rs`: the longest dead time, the lag, and the time for which a command
/// is assumed to hold; with them the oldest map on which the arbiter drives (`map_age_s`), since what came into view
/// later is not in it. Braking is the weakest of the base and of the commands. As in `member.rs`, speed may be higher by the
/// tracking error, and the outline of such a base is wider by margin and half the gap between two poses.
#[must_use]
pub fn reach_m(robot: &Robot, config: &Config, speed_m_s: f64) -> f64 {
    let actuator = &robot.actuator;
    let delay_s = f64::from(actuator.dead_time_max_s + actuator.lag_s + config.hold_s + config.map_age_s);
    let brake_m_s2 = f64::from(actuator.brake_min_m_s2.min(robot.limits.brake_m_s2));
    let error_m_s = f64::from(actuator.tracking_m_s);
    let braking_s = speed_m_s / brake_m_s2;
    (speed_m_s + error_m_s) * delay_s + (0.5 * speed_m_s + error_m_s) * braking_s + margin_m(config)
}

/// `[m]` by which the arbiter widens the footprint.
pub(crate) fn margin_m(config: &Config) -> f64 {
    f64::from(config.margin_m + 0.5 * config.gap_m)
}

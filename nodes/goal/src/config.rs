//! Parameters of the goal.

use serde::Deserialize;

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("goal: {key} is {found}, needed: {needed}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// The value.
    pub found: f64,
    /// The range.
    pub needed: &'static str,
}

/// Configuration of the node.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// `[m]` along the path, how far ahead the waypoint may lie.
    pub look_ahead_m: f32,
    /// `[m]` along the path, how far ahead a point behind an obstacle is looked for.
    pub past_obstacle_m: f32,
    /// `[m]` along the path, how far progress may move in one step; loops longer than this cannot be cut.
    pub search_ahead_m: f32,
    /// `[m]` from the end of the path, or from the standby point: arrived.
    pub arrive_m: f32,
    /// `[1]` planning cost from which a point is not free: above the 0.5 of cells that nobody can see from here, which hold
    /// planners off but do not make a path blocked.
    pub limit: f32,
    /// `[m]` from the person to the standby point.
    pub standby_m: f32,
    /// `[m/s]` a person faster than this moves, and the standby point lies behind.
    pub person_moves_m_s: f32,
    /// `[1]` trust of the tracker below which the person counts as not seen.
    pub confidence_least: f32,
    /// `[s]` without observation after which the person counts as not seen.
    pub target_stale_s: f32,
    /// `[s]` how long the standby point is held for a person not seen.
    pub lost_hold_s: f32,
    /// `[rad]` from straight behind, within which a goal keeps its side.
    pub side_rad: f32,
    /// `[rad]` bearing up to which a goal stays where it is; beyond, it is drawn near until the edge of the view.
    pub ahead_rad: f32,
    /// `[m]` distance of a goal at the edge of the view and beyond: the robot turns before it drives.
    pub turn_m: f32,
}

impl Config {
    /// The shipped configuration.
    pub const STANDARD: Self = Self {
        look_ahead_m: 2.2,
        past_obstacle_m: 4.0,
        search_ahead_m: 1.5,
        arrive_m: 0.3,
        limit: 0.52,
        standby_m: 1.2,
        person_moves_m_s: 0.3,
        confidence_least: 0.3,
        target_stale_s: 0.5,
        lost_hold_s: 3.0,
        side_rad: 0.35,
        ahead_rad: 0.2,
        turn_m: 0.3,
    };

    /// Checks every range.
    ///
    /// # Errors
    /// The first key out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let ranges = [
            ("look_ahead_m", self.look_ahead_m, 0.2, 10.0, "0.2 to 10"),
            ("past_obstacle_m", self.past_obstacle_m, self.look_ahead_m, 20.0, "look_ahead_m to 20"),
            ("search_ahead_m", self.search_ahead_m, 0.2, 10.0, "0.2 to 10"),
            ("arrive_m", self.arrive_m, 0.05, 2.0, "0.05 to 2"),
            ("limit", self.limit, 0.0, 1.0, "0 to 1"),
            ("standby_m", self.standby_m, 0.3, 5.0, "0.3 to 5"),
            ("person_moves_m_s", self.person_moves_m_s, 0.0, 2.0, "0 to 2"),
            ("confidence_least", self.confidence_least, 0.0, 1.0, "0 to 1"),
            ("target_stale_s", self.target_stale_s, 0.0, 10.0, "0 to 10"),
            ("lost_hold_s", self.lost_hold_s, 0.0, 60.0, "0 to 60"),
            ("side_rad", self.side_rad, 0.0, 1.5, "0 to 1.5"),
            ("ahead_rad", self.ahead_rad, 0.0, 3.2, "0 to 3.2"),
            ("turn_m", self.turn_m, 0.1, 10.0, "0.1 to 10"),
        ];
        for (key, found, least, most, needed) in ranges {
            // NaN fails the comparison.
            if !(found >= least && found <= most) {
                return Err(ConfigError { key, found: f64::from(found), needed });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_configuration_passes_and_every_range_is_watched() {
        assert_eq!(Config::STANDARD.check(), Ok(()));
        let error = Config { past_obstacle_m: 1.0, ..Config::STANDARD }.check().unwrap_err();
        assert_eq!(error.to_string(), "goal: past_obstacle_m is 1, needed: look_ahead_m to 20");
        assert_eq!(Config { limit: f32::NAN, ..Config::STANDARD }.check().unwrap_err().key, "limit");
    }
}

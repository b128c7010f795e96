//! Look before you go: a goal outside the view is drawn near, so that the robot turns to it before it drives there.
//!
//! A camera sees the floor from about a metre ahead on, within its angle of view. Whoever swings round in a wide arc
//! arrives beside cells that nobody saw, too near to be seen any more, and the arbiter lets nobody cross them. A near
//! goal has the planners of eq. (6) turn almost on the spot: what lies between is seen from where it can be seen.
//!
//! Where nothing of the map is unseen there is nothing to look for, and the goal stays: drawn near, it would hold back
//! whoever has turned away from it to go round an obstacle. (Measured with `sidestep navigate --rooms 300`: of 300 rooms on
//! maps that are wholly known, solved plans stood still in 8 with the goal always drawn near, in none with this rule.
//! To ask only for what lies between robot and goal, hidden cells excepted, costs an eighth of the goals in offices.)

use crate::config::Config;
use sidestep_msgs::{AGE_NEVER, LocalMap, Robot};

/// `[rad]` least distance between the bearing from which a goal is drawn near and that from which it is nearest.
const RAMP_RAD: f32 = 1e-3;

/// How near a goal is drawn, by its bearing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facing {
    /// `[rad]` bearing up to which a goal stays where it is.
    ahead_rad: f32,
    /// `[rad]` bearing of the edge of the view.
    edge_rad: f32,
    /// `[m]` distance of a goal at the edge of the view and beyond.
    turn_m: f32,
}

impl Facing {
    pub(crate) fn new(config: &Config, robot: &Robot) -> Self {
        let edge_rad = robot.half_view_rad().max(config.ahead_rad + RAMP_RAD);
        Self { ahead_rad: config.ahead_rad, edge_rad, turn_m: config.turn_m }
    }

    /// The goal to head for, on the same bearing.
    pub(crate) fn draw_near(&self, x_m: f32, y_m: f32, map: &LocalMap) -> (f32, f32) {
        let range_m = libm::hypotf(x_m, y_m);
        let beyond_rad = libm::atan2f(y_m, x_m).abs() - self.ahead_rad;
        if range_m <= self.turn_m || beyond_rad <= 0.0 || !map.age.contains(&AGE_NEVER) {
            return (x_m, y_m);
        }
        let part = (beyond_rad / (self.edge_rad - self.ahead_rad)).min(1.0);
        let scale = 1.0 + (self.turn_m / range_m - 1.0) * part;
        (x_m * scale, y_m * scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::LOCAL_CELLS;

    /// A map that nobody saw anything of.
    fn unseen() -> LocalMap {
        LocalMap { age: [AGE_NEVER; LOCAL_CELLS], ..LocalMap::default() }
    }

    fn facing(robot: &str) -> Facing {
        let robot = match robot {
            "loomo" => Robot::from_toml("loomo", include_str!("../../../launch/robots/loomo.toml")),
            _ => Robot::from_toml("jackal", include_str!("../../../launch/robots/jackal.toml")),
        };
        Facing::new(&Config::STANDARD, &robot.unwrap())
    }

    /// Goals 2 m away, all round: the bearing stays, the distance falls from 2 m to 0.3 m between 0.2 rad and the edge.
    #[test]
    fn a_goal_keeps_its_bearing_and_is_nearest_outside_the_view() {
        let (facing, map) = (facing("loomo"), unseen());
        let mut last_m = 2.0;
        for step in 0..=314 {
            let bearing = step as f32 * 0.01;
            let (x_m, y_m) = facing.draw_near(2.0 * libm::cosf(bearing), 2.0 * libm::sinf(bearing), &map);
            let range_m = libm::hypotf(x_m, y_m);
            assert!((libm::atan2f(y_m, x_m) - bearing).abs() < 1e-4, "{bearing}");
            assert!(range_m <= last_m + 1e-5, "{bearing}: {range_m}");
            assert!((range_m - 2.0).abs() < 1e-5 || bearing > 0.2, "{bearing}: {range_m}");
            assert!((range_m - 0.3).abs() < 1e-5 || bearing < 0.486, "{bearing}: {range_m}");
            let mirrored = facing.draw_near(2.0 * libm::cosf(bearing), -2.0 * libm::sinf(bearing), &map);
            assert!((mirrored.0 - x_m).abs() < 1e-6 && (mirrored.1 + y_m).abs() < 1e-6);
            last_m = range_m;
        }
    }

    #[test]
    fn a_near_goal_stays_and_a_scanner_that_sees_the_side_draws_its_goals_less() {
        let map = unseen();
        assert_eq!(facing("loomo").draw_near(0.0, -0.25, &map), (0.0, -0.25));
        assert_eq!(facing("loomo").draw_near(0.0, 0.0, &map), (0.0, 0.0));
        let (_, y_m) = facing("jackal").draw_near(0.0, 2.0, &map);
        assert!(y_m > 0.7, "{y_m}");
    }

    #[test]
    fn a_goal_stays_where_nothing_of_the_map_is_unseen() {
        let map = LocalMap::default();
        for (x_m, y_m) in [(1.0, 1.0), (0.0, -1.3), (-1.0, 2.0)] {
            assert_eq!(facing("loomo").draw_near(x_m, y_m, &map), (x_m, y_m));
        }
        let mut age = [0; LOCAL_CELLS];
        age[777] = AGE_NEVER;
        let map = LocalMap { age, ..map };
        assert!(facing("loomo").draw_near(1.0, 1.0, &map).0 < 0.3);
    }
}

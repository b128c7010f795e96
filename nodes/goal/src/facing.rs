//! Look before you go: a goal outside the view is drawn near, so that the robot turns to it before it drives there.
//!
//! A camera sees the floor from about a metre ahead on, within its angle of view. Whoever swings round in a wide arc
//! arrives beside cells that nobody saw, too near to be seen any more, and the arbiter lets nobody cross them. A near
//! goal has the planners of eq. (6) turn almost on the spot: what lies between is seen from where it can be seen.
//!
//! Only where somewhere on the way nobody saw the floor: drawn near for nothing, a goal holds back whoever has turned away from
//! it to go round an obstacle, and turns him back and forth. What hides behind an obstacle is no reason either, since a look
//! from here does not show it.

use crate::config::Config;
use sidestep_msgs::{AGE_NEVER, LOCAL_GRID, LocalMap, OBSTACLE_FROM, Robot};

/// `[rad]` least distance between the bearing from which a goal is drawn near and that from which it is nearest.
const RAMP_RAD: f32 = 1e-3;
/// Part of the half-width at which a line beside the middle one looks for unseen floor. (Measured in rooms through the whole
/// chain: with the full half-width plans turn to look at what they pass beside, with the middle line alone they pass too near.)
const ASIDE_PART: f32 = 0.5;
/// `[m]` between the points looked at on a line, and where the first one lies.
const STRIDE_M: f32 = 0.05;

/// How near a goal is drawn, by its bearing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facing {
    /// `[rad]` bearing up to which a goal stays where it is.
    ahead_rad: f32,
    /// `[rad]` bearing of the edge of the view.
    edge_rad: f32,
    /// `[m]` distance of a goal at the edge of the view and beyond.
    turn_m: f32,
    /// `[m]` how far beside the middle line two others look for unseen floor.
    aside_m: f32,
}

impl Facing {
    pub(crate) fn new(config: &Config, robot: &Robot) -> Self {
        let edge_rad = robot.half_view_rad().max(config.ahead_rad + RAMP_RAD);
        Self {
            ahead_rad: config.ahead_rad,
            edge_rad,
            turn_m: config.turn_m,
            aside_m: ASIDE_PART * robot.half_width_m(),
        }
    }

    /// The goal to head for, on the same bearing.
    pub(crate) fn draw_near(&self, x_m: f32, y_m: f32, map: &LocalMap) -> (f32, f32) {
        let range_m = libm::hypotf(x_m, y_m);
        let beyond_rad = libm::atan2f(y_m, x_m).abs() - self.ahead_rad;
        if range_m <= self.turn_m || beyond_rad <= 0.0 || !self.is_unseen((x_m, y_m), range_m, map) {
            return (x_m, y_m);
        }
        let part = (beyond_rad / (self.edge_rad - self.ahead_rad)).min(1.0);
        let scale = 1.0 + (self.turn_m / range_m - 1.0) * part;
        (x_m * scale, y_m * scale)
    }

    /// Whether floor on the straight way to a place was never seen: on any of three lines, before what stands there and
    /// before the border of the map.
    fn is_unseen(&self, (x_m, y_m): (f32, f32), range_m: f32, map: &LocalMap) -> bool {
        let (ux, uy) = (x_m / range_m, y_m / range_m);
        // Farther than across the map no line leads.
        let count = (range_m.min(LOCAL_GRID.front_m() + LOCAL_GRID.left_m()) / STRIDE_M) as usize;
        [0.0, self.aside_m, -self.aside_m].into_iter().any(|aside_m| {
            let cells = (1..=count).map_while(|step| {
                let on_m = step as f32 * STRIDE_M;
                LOCAL_GRID.index(on_m * ux - aside_m * uy, on_m * uy + aside_m * ux)
            });
            let seen_over =
                |index: &usize| map.age[*index] == AGE_NEVER || map.occupancy[*index] < OBSTACLE_FROM;
            cells.take_while(seen_over).any(|index| map.age[index] == AGE_NEVER)
        })
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

    /// A map in which one cell was never seen, and one is taken.
    fn with(unseen_m: (f32, f32), taken_m: Option<(f32, f32)>) -> LocalMap {
        let mut map = LocalMap::default();
        map.age[LOCAL_GRID.index(unseen_m.0, unseen_m.1).unwrap()] = AGE_NEVER;
        if let Some((x_m, y_m)) = taken_m {
            map.occupancy[LOCAL_GRID.index(x_m, y_m).unwrap()] = 255;
        }
        map
    }

    /// A goal 1.4 m away at 45 degrees: floor that nobody saw counts on the way to it and a little beside, not behind what
    /// stands there, nor beside the way or beyond the goal.
    #[test]
    fn a_goal_is_drawn_near_only_where_the_way_to_it_is_unseen() {
        let is_drawn = |map: &LocalMap| facing("loomo").draw_near(1.0, 1.0, map).0 < 0.9;
        assert!(!is_drawn(&LocalMap::default()));
        for (unseen_m, drawn) in
            [((0.75, 0.75), true), ((0.85, 0.65), true), ((1.15, 0.45), false), ((1.25, 1.25), false)]
        {
            assert_eq!(is_drawn(&with(unseen_m, None)), drawn, "{unseen_m:?}");
        }
        assert!(!is_drawn(&with((0.75, 0.75), Some((0.45, 0.45)))));
        assert!(is_drawn(&with((0.45, 0.45), Some((0.75, 0.75)))));
    }

    #[test]
    fn a_goal_beyond_the_map_is_looked_for_as_far_as_the_map_goes() {
        let facing = facing("loomo");
        assert_eq!(facing.draw_near(4.0, 4.0, &LocalMap::default()), (4.0, 4.0));
        assert!(facing.draw_near(4.0, 4.0, &with((1.35, 1.35), None)).0 < 1.0);
        assert!(facing.draw_near(1e6, 1e6, &unseen()).0 < 1.0);
    }
}

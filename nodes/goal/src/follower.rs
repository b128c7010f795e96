//! Path following: the waypoint to head for now (paper section III: "on the remaining global path free of obstacles").
//!
//! The farthest point in look-ahead that the robot sees over free ground. Where the path runs into an obstacle, a free
//! point of the path behind it, seen or not: the planner goes round. Where the path only turns out of sight, the turn.
//!
//! The shortest path cuts corners, where the planners of eq. (6) pay for every step and nobody sees the floor in time. So
//! each point is taken where there is room beside it.

use crate::config::Config;
use crate::sight::Sight;
use crate::track::Track;
use sidestep_msgs::Pose2;

/// `[m]` between points of the path looked at.
const STRIDE_M: f64 = 0.1;
/// Points after the last visible one in which an obstacle on the path is looked for; beyond, a turn hides it.
const NEAR_POINTS: usize = 3;

/// `[m]` how far beside the path there may be more room, and in which steps it is looked for.
const BESIDE_M: f32 = 0.35;
const BESIDE_STEP_M: f32 = 0.05;
/// `[1]` planning cost below which a point has room enough, and `[1/m]` cost of leaving the path.
const ROOMY: f32 = 0.1;
const LEAVING_PER_M: f32 = 0.5;
/// Prices per 1.0 that count as different; closer ones are told apart by rounding only.
const PRICES: f32 = 1000.0;
/// `[m]` half of the piece of path that gives its direction.
const PIECE_M: f64 = 0.15;
/// `[m]` this near to its end a path is kept to: there it says where to be.
const END_M: f64 = 0.2;

/// A point of the path, or beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Waypoint {
    /// `[m]` along the path.
    pub(crate) along_m: f64,
    /// `[m]` in `base`.
    pub(crate) x_m: f32,
    /// `[m]` in `base`.
    pub(crate) y_m: f32,
}

/// The path ahead, in steps of 0.1 m from the robot's progress to the end.
struct Ahead<'a> {
    track: &'a Track,
    sight: &'a Sight<'a>,
    pose: &'a Pose2,
    progress_m: f64,
}

impl Ahead<'_> {
    fn waypoint(&self, number: usize) -> Waypoint {
        let along_m = (self.progress_m + number as f64 * STRIDE_M).min(self.track.length_m());
        let (x_m, y_m) = self.in_base(along_m);
        if along_m > self.track.length_m() - END_M || self.sight.cost(x_m, y_m) <= ROOMY {
            return Waypoint { along_m, x_m, y_m };
        }
        let (from_x_m, from_y_m) = self.in_base((along_m - PIECE_M).max(0.0));
        let (to_x_m, to_y_m) = self.in_base(along_m + PIECE_M);
        let (dx_m, dy_m) = (to_x_m - from_x_m, to_y_m - from_y_m);
        let piece_m = libm::hypotf(dx_m, dy_m).max(1e-6);
        let beside = |left_m: f32| (x_m - left_m * dy_m / piece_m, y_m + left_m * dx_m / piece_m);
        let steps = (BESIDE_M / BESIDE_STEP_M) as i32;
        let places = (-steps..=steps).map(|step| {
            let left_m = step as f32 * BESIDE_STEP_M;
            let (x_m, y_m) = beside(left_m);
            let price = self.sight.cost(x_m, y_m).max(ROOMY) + LEAVING_PER_M * left_m.abs();
            (price, Waypoint { along_m, x_m, y_m })
        });
        // Equally dear on both sides: the side nearer to the robot's own axis, so that a mirrored world is answered mirrored.
        let worth = |(price, waypoint): &(f32, Waypoint)| (libm::roundf(price * PRICES), waypoint.y_m.abs());
        let cheapest = places.min_by(|a, b| {
            let (a, b) = (worth(a), worth(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        cheapest.map_or(Waypoint { along_m, x_m, y_m }, |(_, waypoint)| waypoint)
    }

    /// `[m]` a point of the path in `base`.
    fn in_base(&self, along_m: f64) -> (f32, f32) {
        let (x_m, y_m) = self.track.at(along_m.min(self.track.length_m()));
        let (x_m, y_m) = self.pose.inverse_transform(x_m, y_m);
        (x_m as f32, y_m as f32)
    }

    /// Number of the last point within a distance along the path; the end itself is a point.
    fn last_within(&self, distance_m: f32) -> usize {
        let left = (self.track.length_m() - self.progress_m).max(0.0) / STRIDE_M;
        // The small part undoes the rounding of a distance like 2.2 m.
        let within = libm::floor(f64::from(distance_m) / STRIDE_M + 1e-3);
        libm::ceil(left).min(within) as usize
    }

    fn is_free(&self, number: usize) -> bool {
        let point = self.waypoint(number);
        self.sight.is_free(point.x_m, point.y_m)
    }

    fn is_visible(&self, number: usize) -> bool {
        let point = self.waypoint(number);
        self.sight.is_visible(point.x_m, point.y_m)
    }
}

/// The waypoint for a robot at `pose` that is `progress_m` along the path; `None` where none is free.
pub(crate) fn choose(
    track: &Track,
    sight: &Sight<'_>,
    pose: &Pose2,
    progress_m: f64,
    config: &Config,
) -> Option<Waypoint> {
    let ahead = Ahead { track, sight, pose, progress_m };
    let last = ahead.last_within(config.look_ahead_m);
    let visible = (0..=last).rev().find(|&number| ahead.is_visible(number));
    if visible == Some(last) {
        return Some(ahead.waypoint(last));
    }
    let next = visible.map_or(0, |number| number + 1);
    let near = next..(next + NEAR_POINTS).min(last + 1);
    if visible.is_some() && near.clone().all(|number| ahead.is_free(number)) {
        return visible.map(|number| ahead.waypoint(number));
    }
    let beyond = ahead.last_within(config.past_obstacle_m);
    let first_taken = near.clone().find(|&number| !ahead.is_free(number)).unwrap_or(next);
    (first_taken..=last)
        .rev()
        .find(|&number| ahead.is_free(number))
        .or_else(|| (last + 1..=beyond).find(|&number| ahead.is_free(number)))
        .or(visible)
        .map(|number| ahead.waypoint(number))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::path;
    use sidestep_msgs::{LOCAL_GRID, LOCAL_SIDE, LocalMap};

    /// A map with cost 1 where `taken` says so.
    fn map(taken: impl Fn(f32, f32) -> bool) -> LocalMap {
        let mut map = LocalMap::default();
        for (index, cell) in map.planning_cost.iter_mut().enumerate() {
            let (x_m, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
            *cell = if taken(x_m, y_m) { 255 } else { 0 };
        }
        map
    }

    fn chosen(points: &[(f32, f32)], map: &LocalMap) -> Option<Waypoint> {
        let mut track = Track::new();
        track.measure(&path(1, points));
        let sight = Sight { map, limit: 0.4 };
        choose(&track, &sight, &Pose2::ORIGIN, 0.0, &Config::STANDARD)
    }

    #[test]
    fn over_free_ground_the_waypoint_lies_at_the_look_ahead_or_at_the_end() {
        let free = map(|_, _| false);
        assert!((chosen(&[(0.0, 0.0), (9.0, 0.0)], &free).unwrap().x_m - 2.2).abs() < 1e-6);
        assert!((chosen(&[(0.0, 0.0), (1.23, 0.0)], &free).unwrap().x_m - 1.23).abs() < 1e-6);
    }

    #[test]
    fn an_obstacle_on_the_path_moves_the_waypoint_behind_it() {
        for (from_m, to_m, x_m) in [(0.9, 1.3, 2.2), (0.9, 2.1, 2.2), (1.2, 2.5, 2.6), (0.5, 1.0, 2.2)] {
            let blocked = map(|x, y| x > from_m && x < to_m && y.abs() < 0.6);
            let waypoint = chosen(&[(0.0, 0.0), (9.0, 0.0)], &blocked).unwrap();
            assert!((waypoint.x_m - x_m).abs() < 0.15, "{from_m} to {to_m}: {waypoint:?}");
        }
    }

    /// A path with a right angle round a block: the block hides the second leg but does not lie on the path.
    #[test]
    fn a_turn_out_of_sight_keeps_the_waypoint_at_the_turn() {
        let corner = map(|x, y| x < 0.7 && y > 0.5);
        let waypoint = chosen(&[(0.0, 0.0), (1.1, 0.0), (1.1, 9.0)], &corner).unwrap();
        assert!(waypoint.x_m > 1.0 && waypoint.y_m > 0.3 && waypoint.y_m < 1.0, "{waypoint:?}");
    }

    /// On the left it is dear, as beside a wall: the waypoint moves to the right. Where it is dear everywhere, it stays.
    #[test]
    fn beside_a_wall_the_waypoint_lies_where_there_is_room() {
        let dear = |dear: fn(f32) -> bool| {
            let mut map = map(|_, _| false);
            for (index, cell) in map.planning_cost.iter_mut().enumerate() {
                let (_, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
                *cell = if dear(y_m) { 90 } else { 0 };
            }
            map
        };
        let left = dear(|y_m| y_m > 0.0);
        let waypoint = chosen(&[(0.0, 0.1), (9.0, 0.1)], &left).unwrap();
        assert!((2.1..2.3).contains(&waypoint.x_m) && (-0.1..0.0).contains(&waypoint.y_m), "{waypoint:?}");
        let waypoint = chosen(&[(0.0, 0.1), (9.0, 0.1)], &dear(|_| true)).unwrap();
        assert!((waypoint.y_m - 0.1).abs() < 1e-6, "{waypoint:?}");
        // Its end is where the path says.
        let waypoint = chosen(&[(0.0, 0.1), (2.0, 0.1)], &left).unwrap();
        assert!((waypoint.y_m - 0.1).abs() < 1e-6, "{waypoint:?}");
    }

    /// A dear strip along the path, its sides equally far: the one nearer to the robot's axis, left or right of it.
    #[test]
    fn of_two_sides_that_are_equally_dear_the_nearer_one_is_taken() {
        for side in [1.0_f32, -1.0] {
            let mut map = map(|_, _| false);
            for (index, cell) in map.planning_cost.iter_mut().enumerate() {
                let (_, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
                *cell = if (y_m - 0.45 * side).abs() < 0.02 { 90 } else { 0 };
            }
            let y_m = 0.45 * side;
            let waypoint = chosen(&[(0.0, y_m), (9.0, y_m)], &map).unwrap();
            let off = waypoint.y_m * side;
            assert!((0.2..0.44).contains(&off), "{waypoint:?}");
        }
    }

    #[test]
    fn an_end_in_an_obstacle_is_approached_as_far_as_it_is_free() {
        let end = map(|x, _| x > 1.5);
        let waypoint = chosen(&[(0.0, 0.0), (2.0, 0.0)], &end).unwrap();
        assert!(waypoint.x_m > 1.2 && waypoint.x_m < 1.5, "{waypoint:?}");
    }

    #[test]
    fn where_nothing_is_free_there_is_no_waypoint() {
        assert_eq!(chosen(&[(0.0, 0.0), (2.0, 0.0)], &map(|_, _| true)), None);
    }

    #[test]
    fn a_waypoint_never_lies_in_an_obstacle() {
        let sieve = map(|x, y| (x * 3.7 + y * 1.3).fract().abs() < 0.4);
        let sight = Sight { map: &sieve, limit: 0.4 };
        for step in 0..60 {
            let angle = step as f32 * 0.1;
            let end = (9.0 * libm::cosf(angle), 9.0 * libm::sinf(angle));
            let waypoint = chosen(&[(0.0, 0.0), end], &sieve).unwrap();
            assert!(sight.is_free(waypoint.x_m, waypoint.y_m), "{waypoint:?}");
        }
    }
}

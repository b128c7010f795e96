//! Person following: the point behind the person where the robot waits (paper section III).

use crate::config::Config;
use crate::sight::Sight;
use sidestep_msgs::{Code, Pose2, Target, TargetState};

/// `[s]` most time for which a person's motion is carried on from its stamp.
const PREDICT_S: f64 = 0.5;
/// A person that moves counts as moving down to this part of the threshold.
const STILL_PART: f32 = 0.5;
/// `[m]` coordinates beyond this are garbage.
const FARTHEST_M: f32 = 1e6;
/// `[m]` changes of the distance tried where the standby point is not free, the smallest first.
const SHIFTS_M: [f64; 11] = [0.0, -0.1, 0.1, -0.2, 0.2, -0.3, 0.3, -0.4, 0.4, 0.6, 0.8];

/// Where the person stands and which way behind is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Standby {
    /// `[m]` the point, in `odom`.
    pub(crate) x_m: f64,
    /// `[m]` the point, in `odom`.
    pub(crate) y_m: f64,
    /// `[m]` from the robot to the person.
    pub(crate) person_m: f64,
    /// Whether the person moves.
    pub(crate) moves: bool,
}

/// Whether the target names a person at all, seen or lost.
pub(crate) fn is_named(target: &Target) -> bool {
    matches!(TargetState::from_code(target.state), Some(TargetState::Tracked | TargetState::Lost))
}

/// Whether the person is seen well enough to be followed at this time.
pub(crate) fn is_seen(target: &Target, capture_ns: u64, config: &Config) -> bool {
    let age_s = capture_ns.saturating_sub(target.stamp_ns) as f64 * 1e-9;
    let sane = |number: f32| number.abs() <= FARTHEST_M;
    target.state == TargetState::Tracked.code()
        && target.confidence >= config.confidence_least
        && age_s <= f64::from(config.target_stale_s)
        && sane(target.x_m)
        && sane(target.y_m)
        && sane(target.vx_m_s)
        && sane(target.vy_m_s)
}

/// The standby point of a person seen: behind the motion, or between robot and person where the person stands.
pub(crate) fn find(
    target: &Target,
    capture_ns: u64,
    pose: &Pose2,
    moved: bool,
    sight: &Sight<'_>,
    config: &Config,
) -> Standby {
    let speed_m_s = libm::hypotf(target.vx_m_s, target.vy_m_s);
    let threshold_m_s = config.person_moves_m_s * if moved { STILL_PART } else { 1.0 };
    let moves = speed_m_s > threshold_m_s;
    let age_s = (capture_ns.saturating_sub(target.stamp_ns) as f64 * 1e-9).min(PREDICT_S);
    let (vx, vy) = (f64::from(target.vx_m_s), f64::from(target.vy_m_s));
    let person = (f64::from(target.x_m) + vx * age_s, f64::from(target.y_m) + vy * age_s);
    let (to_robot_x, to_robot_y) = (pose.x_m - person.0, pose.y_m - person.1);
    let person_m = libm::hypot(to_robot_x, to_robot_y);
    let speed = f64::from(speed_m_s);
    let behind = if moves {
        (-vx / speed, -vy / speed)
    } else if person_m > 1e-6 {
        (to_robot_x / person_m, to_robot_y / person_m)
    } else {
        (0.0, 0.0)
    };
    // A person who stands is not backed away from.
    let standby_m = f64::from(config.standby_m);
    let distance_m = if moves { standby_m } else { standby_m.min(person_m) };
    let at = |shift_m: f64| {
        let from_person_m = distance_m + shift_m;
        (person.0 + behind.0 * from_person_m, person.1 + behind.1 * from_person_m)
    };
    let is_free = |shift_m: &f64| {
        let (x_m, y_m) = at(*shift_m);
        let (x_m, y_m) = pose.inverse_transform(x_m, y_m);
        sight.is_free(x_m as f32, y_m as f32)
    };
    let (x_m, y_m) = at(SHIFTS_M.into_iter().find(is_free).unwrap_or(0.0));
    Standby { x_m, y_m, person_m, moves }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::LocalMap;

    fn person(x_m: f32, y_m: f32, vx_m_s: f32, vy_m_s: f32) -> Target {
        let state = TargetState::Tracked.code();
        Target { stamp_ns: 1_000_000_000, x_m, y_m, vx_m_s, vy_m_s, confidence: 1.0, state }
    }

    fn standby(target: &Target, map: &LocalMap) -> Standby {
        let sight = Sight { map, limit: 0.4 };
        find(target, 1_000_000_000, &Pose2::ORIGIN, false, &sight, &Config::STANDARD)
    }

    #[test]
    fn the_point_lies_behind_a_walker_and_before_one_who_stands() {
        let free = LocalMap::default();
        let walker = standby(&person(3.0, 1.0, 0.0, 1.0), &free);
        assert!((walker.x_m - 3.0).abs() < 1e-6 && (walker.y_m + 0.2).abs() < 1e-6, "{walker:?}");
        let standing = standby(&person(3.0, 4.0, 0.0, 0.1), &free);
        assert!((standing.x_m - 3.8 * 0.6).abs() < 1e-6 && (standing.y_m - 3.8 * 0.8).abs() < 1e-6);
    }

    #[test]
    fn a_person_who_stands_near_is_not_backed_away_from() {
        let near = standby(&person(0.8, 0.0, 0.0, 0.0), &LocalMap::default());
        assert!(near.x_m.abs() < 1e-9 && near.y_m.abs() < 1e-9 && !near.moves);
        let on_top = standby(&person(0.0, 0.0, 0.0, 0.0), &LocalMap::default());
        assert!(on_top.x_m.abs() < 1e-9 && on_top.y_m.abs() < 1e-9);
    }

    #[test]
    fn a_point_in_an_obstacle_gives_way_along_the_line() {
        let mut map = LocalMap::default();
        // Rows 13 to 15: x from 0.8 to 1.1 m, where 1.2 m behind the person lies.
        map.planning_cost[13 * 28..16 * 28].fill(255);
        let moved = standby(&person(2.2, 0.0, 1.0, 0.0), &map);
        assert!((0.1..0.5).contains(&(moved.x_m - 1.0).abs()) && moved.y_m.abs() < 1e-9, "{moved:?}");
    }

    #[test]
    fn motion_is_carried_on_from_the_stamp() {
        let free = LocalMap::default();
        let sight = Sight { map: &free, limit: 0.4 };
        let target = person(3.0, 0.0, 1.0, 0.0);
        let later = find(&target, 1_200_000_000, &Pose2::ORIGIN, false, &sight, &Config::STANDARD);
        assert!((later.x_m - 2.0).abs() < 1e-6, "{later:?}");
    }

    #[test]
    fn who_is_untrusted_stale_or_not_finite_is_not_seen() {
        let good = person(1.0, 0.0, 0.0, 0.0);
        let seen = |target: Target, capture_ns| is_seen(&target, capture_ns, &Config::STANDARD);
        assert!(seen(good, 1_100_000_000));
        assert!(!seen(good, 1_600_000_000));
        assert!(!seen(Target { confidence: f32::NAN, ..good }, 1_100_000_000));
        assert!(!seen(Target { vx_m_s: f32::NAN, ..good }, 1_100_000_000));
        assert!(!seen(Target { x_m: f32::INFINITY, ..good }, 1_100_000_000));
        assert!(!seen(Target { state: 77, ..good }, 1_100_000_000));
    }
}

//! Promises of the whole step.

use crate::track::path;
use crate::{Config, Goal};
use proptest::prelude::*;
use sidestep_msgs::{
    GOAL_STATE_BYTES, GoalKind, LOCAL_CELLS, LocalGoal, LocalMap, Odometry, Path, PathPoint, Pose2, Robot,
    Status, Target, TargetState, Twist,
};

fn goal() -> Goal {
    let robot = Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap();
    let mut goal = Goal::new(&Config::STANDARD, &robot).unwrap();
    goal.odometry(&Odometry::default(), 1);
    goal
}

fn map(x_m: f64, y_m: f64, yaw_rad: f64) -> LocalMap {
    LocalMap { capture_ns: 1_000_000_000, pose: Pose2::new(x_m, y_m, yaw_rad), ..LocalMap::default() }
}

fn step(goal: &mut Goal, map: &LocalMap) -> (Status, LocalGoal) {
    let mut out = LocalGoal::default();
    let status = goal.step(map, 5, Status::Ok, &mut out);
    assert!(out.x_m.is_finite() && out.y_m.is_finite() && out.twist.is_finite() && out.pose.is_finite());
    assert!(out.cell_x_m.is_finite() && out.cell_y_m.is_finite() && out.progress_m.is_finite());
    assert!((out.cell as usize) < LOCAL_CELLS);
    (status, out)
}

fn walker(state: TargetState, x_m: f32, y_m: f32, vx_m_s: f32) -> Target {
    Target { stamp_ns: 1_000_000_000, x_m, y_m, vx_m_s, vy_m_s: 0.0, confidence: 0.9, state: state as u32 }
}

const LINE: [(f32, f32); 2] = [(0.0, 0.0), (10.0, 0.0)];

#[test]
fn a_path_is_followed_to_its_end_and_arrived_at_for_good() {
    let mut goal = goal();
    goal.path(&path(3, &LINE));
    let mut last_m = 0.0;
    for tenth in 0..=97 {
        let (status, out) = step(&mut goal, &map(f64::from(tenth) * 0.1, 0.05, 0.0));
        assert_eq!((status, out.kind), (Status::Ok, GoalKind::Path as u32), "{tenth}");
        assert!(out.progress_m >= last_m && (out.progress_m + out.remaining_m - 10.0).abs() < 1e-4);
        last_m = out.progress_m;
    }
    assert_eq!(step(&mut goal, &map(9.75, 0.0, 0.0)).0, Status::Arrived);
    assert_eq!(step(&mut goal, &map(9.0, 1.0, 0.0)).0, Status::Arrived);
    goal.path(&path(3, &LINE));
    assert_eq!(step(&mut goal, &map(9.0, 1.0, 0.0)).0, Status::Arrived);
    goal.path(&path(4, &[(9.0, 1.0), (0.0, 1.0)]));
    assert_eq!(step(&mut goal, &map(9.0, 1.0, 0.0)).0, Status::Ok);
}

/// The end of a path lies where nobody can look any more; the robot is half a metre before it. Then something stands there.
#[test]
fn cells_too_near_to_be_seen_do_not_block_a_path_and_what_stands_there_does() {
    for (cost, expected) in [(128, Status::Ok), (200, Status::Hold)] {
        let mut goal = goal();
        goal.path(&path(3, &[(0.0, 0.0), (0.6, 0.0)]));
        let mut map = map(0.0, 0.0, 0.0);
        map.planning_cost = [cost; LOCAL_CELLS];
        assert_eq!(step(&mut goal, &map).0, expected, "cost {cost}");
    }
}

#[test]
fn progress_survives_a_correction_of_the_path_and_a_robot_pushed_back() {
    let mut goal = goal();
    goal.path(&path(3, &LINE));
    for tenth in 0..50 {
        step(&mut goal, &map(f64::from(tenth) * 0.1, 0.0, 0.0));
    }
    let before = step(&mut goal, &map(5.0, 0.0, 0.0)).1.progress_m;
    goal.path(&path(3, &[(0.0, 0.1), (10.0, 0.2)]));
    assert!(step(&mut goal, &map(2.0, 0.0, 0.0)).1.progress_m >= before);
    goal.path(&path(4, &LINE));
    assert!(step(&mut goal, &map(0.0, 0.0, 0.0)).1.progress_m < 0.1);
}

#[test]
fn a_loop_does_not_arrive_at_its_start() {
    let mut goal = goal();
    goal.path(&path(1, &[(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0)]));
    let (status, out) = step(&mut goal, &map(0.0, 0.0, 0.0));
    assert_eq!(status, Status::Ok);
    assert!(out.x_m > 2.0 && out.y_m.abs() < 0.01);
}

#[test]
fn the_goal_names_map_odometry_and_pose() {
    let mut goal = goal();
    goal.path(&path(1, &LINE));
    goal.odometry(&Odometry { twist: Twist::new(0.4, -0.2), ..Odometry::default() }, 77);
    let (_, out) = step(&mut goal, &map(1.0, 0.0, 0.5));
    assert_eq!((out.map_sequence, out.odometry_sequence, out.capture_ns), (5, 77, 1_000_000_000));
    assert_eq!((out.twist, out.pose), (Twist::new(0.4, -0.2), Pose2::new(1.0, 0.0, 0.5)));
}

#[test]
fn without_the_means_there_is_no_goal_and_the_reason_is_told() {
    let mut goal = goal();
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::NoGoal);
    goal.path(&path(1, &[(0.0, 0.0), (f32::NAN, 1.0)]));
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::NoGoal);
    goal.path(&path(1, &LINE));
    let mut out = LocalGoal::default();
    for status in [Status::RefusedEmpty, Status::RefusedStamp, Status::Fault, Status::NoMap] {
        assert_eq!(goal.step(&map(0.0, 0.0, 0.0), 5, status, &mut out), Status::NoMap);
        assert_eq!(out.kind, GoalKind::Hold as u32);
    }
    assert_eq!(step(&mut goal, &map(f64::NAN, 0.0, 0.0)).0, Status::Fault);
    goal.odometry(&Odometry { twist: Twist::new(f32::NAN, 0.0), ..Odometry::default() }, 2);
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::Fault);
    goal.reset();
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::RefusedOdometry);
}

#[test]
fn what_was_placed_in_another_pose_epoch_is_void() {
    let mut goal = goal();
    goal.path(&path(1, &LINE));
    goal.odometry(&Odometry { pose_epoch: 1, ..Odometry::default() }, 2);
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::NoMap);
    let new_map = LocalMap { pose_epoch: 1, ..map(0.0, 0.0, 0.0) };
    let (status, out) = step(&mut goal, &new_map);
    assert_eq!((status, out.kind), (Status::NoGoal, GoalKind::Hold as u32));
    goal.path(&Path { pose_epoch: 1, ..path(1, &LINE) });
    assert_eq!(step(&mut goal, &new_map).0, Status::Ok);
    goal.target(&walker(TargetState::Tracked, 4.0, 0.0, 1.0));
    assert_eq!(step(&mut goal, &new_map).1.kind, GoalKind::Standby as u32);
    goal.odometry(&Odometry { pose_epoch: 2, ..Odometry::default() }, 3);
    let newer_map = LocalMap { pose_epoch: 2, ..map(0.0, 0.0, 0.0) };
    assert_eq!(step(&mut goal, &newer_map).0, Status::NoGoal);
}

#[test]
fn a_person_is_followed_waited_for_held_and_given_up() {
    let mut goal = goal();
    goal.target(&walker(TargetState::Tracked, 4.0, 0.0, 1.0));
    let (status, out) = step(&mut goal, &map(0.0, 0.0, 0.0));
    assert_eq!((status, out.kind), (Status::Ok, GoalKind::Standby as u32));
    assert!((out.x_m - 2.8).abs() < 1e-5 && out.remaining_m.is_nan());
    // Standing 1.3 m ahead: 1.2 m is kept, the robot is there.
    goal.target(&walker(TargetState::Tracked, 1.3, 0.0, 0.0));
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::Arrived);
    goal.target(&walker(TargetState::Tracked, 4.0, 0.0, 1.0));
    step(&mut goal, &map(0.0, 0.0, 0.0));
    goal.target(&walker(TargetState::Lost, 0.0, 0.0, 0.0));
    for (after_ms, needed) in [(500, Status::Ok), (2900, Status::Ok), (3100, Status::Lost)] {
        let later = LocalMap { capture_ns: 1_000_000_000 + after_ms * 1_000_000, ..map(0.5, 0.0, 0.0) };
        let (status, out) = step(&mut goal, &later);
        assert_eq!(status, needed, "{after_ms}");
        assert!(status == Status::Lost || (out.x_m - 2.3).abs() < 1e-5, "{out:?}");
    }
    let there = LocalMap { capture_ns: 2_000_000_000, ..map(2.7, 0.0, 0.0) };
    assert_eq!(step(&mut goal, &there).0, Status::Hold);
    goal.target(&Target::default());
    assert_eq!(step(&mut goal, &map(0.0, 0.0, 0.0)).0, Status::NoGoal);
}

#[test]
fn a_blocked_path_without_anything_behind_is_a_hold() {
    let mut goal = goal();
    goal.path(&path(1, &[(0.0, 0.0), (1.5, 0.0)]));
    let blocked = LocalMap { planning_cost: [255; LOCAL_CELLS], ..map(0.0, 0.0, 0.0) };
    let (status, out) = step(&mut goal, &blocked);
    assert_eq!((status, out.kind), (Status::Hold, GoalKind::Hold as u32));
}

/// The robot turns on the spot, to the left, with its goal straight behind: the goal stays left all the way.
#[test]
fn a_goal_straight_behind_stays_on_its_side_while_the_robot_sways() {
    let mut goal = goal();
    goal.path(&path(1, &[(-5.0, 0.0), (-9.0, 0.0)]));
    let first = step(&mut goal, &map(0.0, 0.0, 0.05)).1.cell_y_m;
    for sway in [-0.1, 0.1, -0.2, 0.2, 0.0] {
        let (_, out) = step(&mut goal, &map(0.0, 0.0, sway));
        assert!(out.cell_y_m * first > 0.0 && out.cell_x_m < 0.0, "{sway}: {out:?}");
    }
}

#[test]
fn the_state_carries_on_where_it_was_written() {
    let mut one = goal();
    one.path(&path(3, &LINE));
    for tenth in 0..30 {
        step(&mut one, &map(f64::from(tenth) * 0.1, 0.0, 0.0));
    }
    let mut bytes = vec![0_u8; GOAL_STATE_BYTES];
    let size = one.state(&mut bytes);
    let mut other = goal();
    assert!(size > 0 && other.restore(&bytes[..size]));
    for tenth in 30..99 {
        let map = map(f64::from(tenth) * 0.1, 0.0, 0.0);
        let ((status, a), (other_status, b)) = (step(&mut one, &map), step(&mut other, &map));
        assert_eq!((status, bytemuck::bytes_of(&a)), (other_status, bytemuck::bytes_of(&b)));
    }
    assert!(!other.restore(&bytes[..size - 1]) && !other.restore(&[]));
    assert!(!other.restore(&vec![0xff; size]));
    assert_eq!(one.state(&mut [0; 8]), 0);
}

fn mirrored_path(path: &Path) -> Path {
    Path { points: path.points.map(|point| PathPoint { y_m: -point.y_m, ..point }), ..*path }
}

fn mirrored_map(map: &LocalMap) -> LocalMap {
    let mirror = |index: usize| index / 28 * 28 + 27 - index % 28;
    LocalMap {
        pose: Pose2::new(map.pose.x_m, -map.pose.y_m, -map.pose.yaw_rad),
        planning_cost: std::array::from_fn(|index| map.planning_cost[mirror(index)]),
        ..*map
    }
}

proptest! {
    #[test]
    fn a_mirrored_world_gives_the_mirrored_goal(
        points in prop::collection::vec((-4.0_f32..4.0, -4.0_f32..4.0), 1..8),
        yaw in -3.0_f64..3.0,
        block in 0_usize..600,
    ) {
        let (mut one, mut other) = (goal(), goal());
        let path = path(1, &points);
        let mut map = map(0.1, 0.2, yaw);
        for row in 0..4 {
            map.planning_cost[block + 28 * row..block + 28 * row + 4].fill(255);
        }
        one.path(&path);
        other.path(&mirrored_path(&path));
        let ((status, a), (other_status, b)) = (step(&mut one, &map), step(&mut other, &mirrored_map(&map)));
        prop_assert_eq!(status, other_status);
        prop_assert!((a.x_m - b.x_m).abs() < 1e-5 && (a.y_m + b.y_m).abs() < 1e-5, "{:?} {:?}", a, b);
        if a.kind == GoalKind::Path as u32 {
            prop_assert_eq!((a.cell / 28, a.cell % 28), (b.cell / 28, 27 - b.cell % 28));
        }
    }

    #[test]
    fn any_bytes_give_a_finite_goal(seed in any::<u64>()) {
        let mut random = seed;
        let mut bytes = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 56) as u8
        };
        let (mut path, mut target, mut odometry, mut map) =
            (Path::default(), Target::default(), Odometry::default(), LocalMap::default());
        for part in [
            bytemuck::bytes_of_mut(&mut path),
            bytemuck::bytes_of_mut(&mut target),
            bytemuck::bytes_of_mut(&mut odometry),
            bytemuck::bytes_of_mut(&mut map),
        ] {
            part.fill_with(&mut bytes);
        }
        let mut goal = goal();
        goal.odometry(&odometry, 1);
        goal.path(&path);
        goal.target(&Target { state: u32::from(seed as u8 % 3), ..target });
        step(&mut goal, &map);
        (map.pose, odometry.twist) = (Pose2::new(1e5, -1e300, 0.3), Twist::STOP);
        goal.odometry(&odometry, 2);
        map.pose_epoch = odometry.pose_epoch;
        goal.path(&Path { count: path.count % 1025, pose_epoch: odometry.pose_epoch, ..path });
        step(&mut goal, &map);
    }
}

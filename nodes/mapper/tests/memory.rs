//! What the memory keeps, what it lets go and what it refuses.

#![allow(clippy::unwrap_used, reason = "a test may unwrap")]

mod scene;

use scene::{Scene, View, frame, loomo};
use sidestep_mapper::{CLEAR_BELOW, Config, Mapper};
use sidestep_msgs::{
    AGE_NEVER, AGE_OLDER, DepthFrame, LocalMap, MAPPER_STATE_BYTES, Odometry, Pose2, Range, Ranges,
    SAFETY_GRID, STILL, SafetyMap, Status,
};

const PERIOD_NS: u64 = 33_333_333;

fn mapper(grant_start_disc: bool) -> Mapper {
    let mut robot = loomo();
    robot.start.disc_m = 0.75;
    Mapper::new(&Config { grant_start_disc, ..Config::shipped() }, &robot).unwrap()
}

fn look(mapper: &mut Mapper, scene: &Scene, view: &View, count: u64) -> Status {
    let mut frame = frame(2);
    scene.render(view, PERIOD_NS * count, &mut frame);
    mapper.odometry(&view.odometry(PERIOD_NS * count));
    mapper.depth(&frame)
}

fn safety(mapper: &Mapper) -> Box<SafetyMap> {
    let mut map = Box::<SafetyMap>::default();
    mapper.write_safety(&mut map);
    map
}

fn local(mapper: &Mapper) -> Box<LocalMap> {
    let mut map = Box::<LocalMap>::default();
    mapper.write_local(&mut map);
    map
}

/// Occupancy and age at a point of `odom`.
fn at(map: &SafetyMap, x_m: f64, y_m: f64) -> (u8, u8) {
    let (x, y) = map.frame().inverse_transform(x_m, y_m);
    let index = SAFETY_GRID.index(x as f32, y as f32).unwrap();
    (map.occupancy[index], map.age[index])
}

fn is_free((occupancy, age): (u8, u8)) -> bool {
    occupancy < CLEAR_BELOW && age != AGE_NEVER
}

/// Boxes of 0.1, 0.3 and 0.5 m before a far wall, approached from 2.6 m until the bumper stands 5 cm before them.
#[test]
fn a_box_stays_occupied_until_it_is_below_the_view_and_after() {
    for height_m in [0.1, 0.3, 0.5] {
        let scene =
            Scene::default().stand([3.0, 3.3], [-0.2, 0.2], height_m).stand([4.5, 4.6], [-4.0, 4.0], 2.0);
        let mut mapper = mapper(true);
        let mut marked = false;
        for count in 1..=120u64 {
            let view = View::level(Pose2::new(0.4 + 0.02 * count as f64, 0.0, 0.0));
            assert_eq!(look(&mut mapper, &scene, &view, count), Status::Ok);
            if view.pose.x_m < 1.15 {
                continue;
            }
            let map = safety(&mapper);
            let row: Vec<u8> = (0..8).map(|k| at(&map, 3.02, -0.175 + 0.05 * f64::from(k)).0).collect();
            let occupied = row.iter().all(|&occupancy| occupancy > 166);
            assert!(occupied || !marked, "box {height_m} m at {:.2} m: {row:?}", 3.0 - view.pose.x_m);
            marked |= occupied;
            assert!(marked || 3.0 - view.pose.x_m > 1.5, "box {height_m} m not seen by 1.5 m: {row:?}");
        }
        assert!(marked, "box {height_m} m");
    }
}

/// A table top at 0.7 m, seen from afar, approached until only the floor under it is in view: its edge stays.
#[test]
fn a_ray_under_a_stored_table_top_never_clears_it() {
    let scene = Scene::default().hang([3.0, 3.6], [-0.6, 0.6], [0.7, 0.74]);
    let mut mapper = mapper(true);
    for count in 1..=115u64 {
        let view = View::level(Pose2::new(0.4 + 0.02 * count as f64, 0.0, 0.0));
        look(&mut mapper, &scene, &view, count);
        if view.pose.x_m > 1.3 {
            let map = safety(&mapper);
            let edge = (0..20).map(|k| at(&map, 3.02, -0.475 + 0.05 * f64::from(k)).0);
            assert!(
                edge.clone().all(|occupancy| occupancy > 166),
                "at {} m: {:?}",
                view.pose.x_m,
                edge.min()
            );
        }
    }
}

/// A person comes, stands, goes and comes back before a wall that was always there.
#[test]
fn what_has_just_come_is_told_from_what_has_stood() {
    let wall = Scene::default().stand([3.0, 3.2], [-3.0, 3.0], 2.0);
    let person = wall.clone().stand([1.75, 1.98], [-0.15, 0.15], 1.7);
    let (mut mapper, view) = (mapper(true), View::level(Pose2::ORIGIN));
    let mut see = |scene: &Scene, frames: std::ops::RangeInclusive<u64>| {
        frames.for_each(|count| assert_eq!(look(&mut mapper, scene, &view, count), Status::Ok));
        let map = safety(&mapper);
        map.still[SAFETY_GRID.index(1.78, 0.0).unwrap()]
    };
    assert_eq!(see(&wall, 1..=60), STILL, "nothing stands there");
    assert!(see(&person, 61..=66) <= 2, "just come");
    assert!((11..=16).contains(&see(&person, 67..=105)), "stands for 1.5 s");
    assert_eq!(see(&wall, 106..=130), STILL, "gone");
    assert!(see(&person, 131..=136) <= 2, "just come back");
}

/// A person-high obstacle goes away: the floor and the rays to the wall behind clear its cells within 20 frames.
#[test]
fn what_is_gone_is_cleared_by_what_is_seen_behind_it() {
    let wall = Scene::default().stand([3.0, 3.2], [-3.0, 3.0], 2.0);
    let person = wall.clone().stand([1.75, 1.98], [-0.15, 0.15], 1.7);
    let (mut mapper, view) = (mapper(true), View::level(Pose2::ORIGIN));
    (1..=30).for_each(|count| assert_eq!(look(&mut mapper, &person, &view, count), Status::Ok));
    assert!(at(&safety(&mapper), 1.78, 0.0).0 > 230);
    (31..=50).for_each(|count| assert_eq!(look(&mut mapper, &wall, &view, count), Status::Ok));
    let map = safety(&mapper);
    for y_m in [-0.12, 0.0, 0.12] {
        let cell = at(&map, 1.78, y_m);
        assert!(is_free(cell), "at y {y_m}: {cell:?}");
    }
}

/// Stands for five minutes at 2 frames per second: what was granted and seen before is still free, with its true age.
#[test]
fn standing_for_five_minutes_does_not_lock_the_robot_in() {
    let scene = Scene::default().stand([3.0, 3.2], [-3.0, 3.0], 2.0);
    let mut mapper = mapper(true);
    for count in 1..=100u64 {
        let view = View::level(Pose2::new(0.01 * count as f64, 0.0, 0.0));
        look(&mut mapper, &scene, &view, count);
    }
    let view = View::level(Pose2::new(1.0, 0.0, 0.0));
    let mut still = frame(2);
    scene.render(&view, 0, &mut still);
    for count in 1..=600u64 {
        still.capture_ns = 100 * PERIOD_NS + count * 500_000_000;
        mapper.odometry(&view.odometry(still.capture_ns));
        assert_eq!(mapper.depth(&still), Status::Ok);
    }
    let map = safety(&mapper);
    for k in 0..30 {
        // From the tail of the granted disc to the floor still in view.
        let x_m = 0.35 + 0.05 * f64::from(k);
        assert!(is_free(at(&map, x_m, 0.0)), "at {x_m}: {:?}", at(&map, x_m, 0.0));
    }
    assert_eq!(at(&map, 1.25, 0.0).1, AGE_OLDER, "the blind metre is old");
    assert_eq!(at(&map, 1.0, 0.0).1, 0, "the robot stands on free floor now");
    assert!(at(&map, 2.2, 0.0).1 < 5, "the floor in view is fresh");
}

/// The start disc is granted once, only where configured, only to cells never seen, and a jump takes it.
#[test]
fn the_start_disc_is_granted_once_and_lost_with_the_pose() {
    let scene = Scene::default();
    let view = View::level(Pose2::new(5.0, 5.0, 1.0));
    for grant in [true, false] {
        let mut mapper = mapper(grant);
        look(&mut mapper, &scene, &view, 1);
        let map = safety(&mapper);
        assert_eq!(is_free(at(&map, 4.5, 5.0)), grant);
        assert_eq!(at(&map, 4.0, 5.0).1, AGE_NEVER);
        mapper.odometry(&Odometry { pose_epoch: 1, ..view.odometry(2 * PERIOD_NS) });
        let gone = safety(&mapper);
        assert!(gone.age.iter().all(|&age| age == AGE_NEVER));
        let mut next = frame(2);
        scene.render(&view, 2 * PERIOD_NS, &mut next);
        assert_eq!(mapper.depth(&next), Status::Ok);
        let map = safety(&mapper);
        assert_eq!((at(&map, 4.5, 5.0).1, map.pose_epoch), (AGE_NEVER, 1));
    }
}

/// Wanders off and comes back to where nothing is left in the window: the maps equal those of a fresh mapper.
#[test]
fn a_window_that_rolled_away_remembers_nothing() {
    let scene = Scene::default().stand([11.5, 11.9], [6.2, 6.6], 0.6);
    let mut far = mapper(false);
    let mut count = 0;
    for step in 0..30u64 {
        count += 1;
        let pose = Pose2::new(10.0 - step as f64, 6.0 + 0.7 * step as f64, 0.3 * step as f64);
        let stamp_ns = 1_000_000_000 * count;
        let mut seen = frame(4);
        scene.render(&View::level(pose), stamp_ns, &mut seen);
        far.odometry(&View::level(pose).odometry(stamp_ns));
        assert_eq!(far.depth(&seen), Status::Ok);
    }
    let mut fresh = mapper(false);
    for _ in 0..4 {
        count += 1;
        let view = View::level(Pose2::new(10.0, 6.0, 0.2));
        let mut seen = frame(2);
        scene.render(&view, 5_000_000_000 * count, &mut seen);
        for mapper in [&mut far, &mut fresh] {
            mapper.odometry(&view.odometry(5_000_000_000 * count));
            assert_eq!(mapper.depth(&seen), Status::Ok);
        }
    }
    let (far_safety, fresh_safety) = (safety(&far), safety(&fresh));
    assert_eq!(far_safety.occupancy, fresh_safety.occupancy);
    assert_eq!(far_safety.age, fresh_safety.age);
    assert_eq!(local(&far).planning_cost, local(&fresh).planning_cost);
}

/// Every kind of unusable frame has its status, is counted, and leaves map and stamp as they were.
#[test]
fn unusable_frames_are_refused_by_status_and_change_nothing() {
    let scene = Scene::default().stand([2.0, 2.2], [-1.0, 1.0], 1.0);
    let view = View::level(Pose2::ORIGIN);
    let mut mapper = mapper(true);
    look(&mut mapper, &scene, &view, 1);
    let before = local(&mapper);
    let mut good = frame(2);
    scene.render(&view, 2 * PERIOD_NS, &mut good);
    let spoil = |change: &dyn Fn(&mut DepthFrame)| {
        let mut frame = good.clone();
        change(&mut frame);
        frame
    };
    let nan = f32::NAN;
    let cases = [
        (Status::RefusedShape, spoil(&|f| f.width = 0)),
        (Status::RefusedShape, spoil(&|f| f.width = 641)),
        (Status::RefusedShape, spoil(&|f| f.height = u32::MAX)),
        (Status::RefusedShape, spoil(&|f| f.metres_per_unit = nan)),
        (Status::RefusedShape, spoil(&|f| f.fx_px = 0.0)),
        (Status::RefusedShape, spoil(&|f| f.cy_px = f32::INFINITY)),
        (Status::RefusedPose, spoil(&|f| f.camera.rotation_xyzw = [0.0; 4])),
        (Status::RefusedPose, spoil(&|f| f.camera.translation_m[1] = nan)),
        (Status::RefusedEmpty, spoil(&|f| f.pixels.fill(0))),
        (Status::RefusedSaturated, spoil(&|f| f.pixels.fill(u16::MAX))),
        (Status::RefusedStamp, spoil(&|f| f.capture_ns = PERIOD_NS)),
        (Status::RefusedStamp, spoil(&|f| f.capture_ns = 0)),
        (Status::RefusedOdometry, spoil(&|f| f.capture_ns = PERIOD_NS + 20_000_001)),
    ];
    for (count, (status, frame)) in cases.iter().enumerate() {
        assert_eq!(mapper.depth(frame), *status, "case {count}");
        let after = local(&mapper);
        assert_eq!(after.refused as usize, count + 1);
        assert_eq!((after.occupancy, after.capture_ns), (before.occupancy, PERIOD_NS), "case {count}");
    }
    mapper.odometry(&Odometry { pose: Pose2::new(f64::NAN, 0.0, 0.0), ..view.odometry(2 * PERIOD_NS) });
    assert_eq!(mapper.depth(&good), Status::RefusedPose);
    mapper.odometry(&view.odometry(2 * PERIOD_NS));
    assert_eq!(mapper.depth(&good), Status::Ok);
}

/// The pose between two samples is interpolated, beyond the last it is driven on for at most 20 ms.
#[test]
fn a_frame_is_placed_at_its_capture_stamp() {
    let scene = Scene::default();
    let mut mapper = mapper(false);
    let sample = |stamp_ns: u64, x_m: f64| {
        let twist = sidestep_msgs::Twist::new(1.0, 0.0);
        Odometry { twist, ..View::level(Pose2::new(x_m, 0.0, 0.0)).odometry(stamp_ns) }
    };
    let mut seen = frame(4);
    for (capture_ns, x_m) in [(95_000_000, 0.095), (100_000_000, 0.1), (119_000_000, 0.119)] {
        mapper.odometry(&sample(90_000_000, 0.09));
        mapper.odometry(&sample(100_000_000, 0.1));
        scene.render(&View::level(Pose2::new(x_m, 0.0, 0.0)), capture_ns, &mut seen);
        assert_eq!(mapper.depth(&seen), Status::Ok);
        assert!((local(&mapper).pose.x_m - x_m).abs() < 1e-9, "{}", local(&mapper).pose.x_m);
    }
}

/// State taken in mid-drive and restored elsewhere continues with the same bytes; garbage is refused.
#[test]
fn a_restored_mapper_continues_with_the_same_bytes() {
    let scene = Scene::default().stand([2.0, 2.2], [-0.4, 0.3], 0.4).stand([3.5, 3.6], [-3.0, 3.0], 2.0);
    let mut bytes = vec![0; MAPPER_STATE_BYTES];
    let (mut first, mut second) = (mapper(true), mapper(true));
    let pose = |count: u64| Pose2::new(0.03 * count as f64, 0.01 * count as f64, 0.02 * count as f64);
    for count in 1..=15 {
        look(&mut first, &scene, &View::level(pose(count)), count);
    }
    let size = first.state(&mut bytes);
    assert!(size > 0 && second.restore(&bytes[..size]));
    assert_eq!(local(&first), local(&second));
    for count in 16..=25 {
        for mapper in [&mut first, &mut second] {
            look(mapper, &scene, &View::level(pose(count)), count);
        }
        assert_eq!(safety(&first), safety(&second));
    }
    let mut again = vec![0; MAPPER_STATE_BYTES];
    let _ = first.state(&mut bytes);
    let _ = second.state(&mut again);
    assert!(bytes == again);
    assert!(
        !first.restore(&bytes[..size - 1])
            && !first.restore(&vec![0; size])
            && !first.restore(&vec![0xff; size])
    );
    assert_eq!(first.state(&mut [0; 10]), 0);
    assert_eq!(safety(&first), safety(&second));
}

fn sonar(stamp_ns: u64, range_m: f32) -> Ranges {
    let mut ranges = Ranges { stamp_ns, count: 1, ..Ranges::default() };
    let mount = Range { x_m: 0.1, field_of_view_rad: 0.6, near_m: 0.25, far_m: 1.5, ..Range::default() };
    ranges.sensors[0] = Range { range_m, ..mount };
    ranges
}

/// A frame without a measurement is the camera's fault, unless a sensor that looks along it hears something too near for it:
/// then the map goes on as it was, for as long as that is heard.
#[test]
fn a_view_full_of_what_is_too_near_is_no_fault_while_it_is_heard() {
    let scene = Scene::default().stand([2.0, 2.2], [-1.0, 1.0], 1.0);
    let view = View::level(Pose2::ORIGIN);
    let mut mapper = mapper(true);
    look(&mut mapper, &scene, &view, 1);
    let known = local(&mapper);
    let mut blind = |count: u64, heard: Option<Ranges>| {
        mapper.odometry(&view.odometry(PERIOD_NS * count));
        if let Some(heard) = heard {
            mapper.ranges(&Ranges { stamp_ns: PERIOD_NS * count, ..heard });
        }
        let mut empty = frame(2);
        scene.render(&view, PERIOD_NS * count, &mut empty);
        empty.pixels.fill(0);
        (mapper.depth(&empty), local(&mapper))
    };
    let aside = |yaw_rad: f32| {
        let mut ranges = sonar(0, 0.3);
        ranges.sensors[0].yaw_rad = yaw_rad;
        ranges
    };
    // The camera is 0.1 m ahead of the axle as the sensor is, and measures from 0.35 m on.
    let faults = [(2, sonar(0, 0.5)), (3, sonar(0, f32::NAN)), (4, aside(1.0)), (5, aside(-3.1))];
    for (count, heard) in faults {
        let (status, map) = blind(count, Some(heard));
        assert_eq!((status, map.capture_ns), (Status::RefusedEmpty, PERIOD_NS), "{count}");
    }
    for (count, heard) in [(6, sonar(0, 0.3)), (7, aside(0.4))] {
        let (status, map) = blind(count, Some(heard));
        assert_eq!((status, map.capture_ns), (Status::Ok, count * PERIOD_NS), "{count}");
        let occupied = |map: &LocalMap| map.occupancy.iter().filter(|odds| **odds > 127).count();
        assert!(occupied(&map) >= occupied(&known), "{count}");
    }
    assert_eq!(blind(12, None).0, Status::Ok);
    // Too long ago.
    assert_eq!(blind(14, None).0, Status::RefusedEmpty);
}

/// Something at 0.4 m before the sensor marks its arc; seeing past it takes the mark, not the camera's memory.
#[test]
fn a_near_ultrasonic_reading_blocks_its_arc_until_it_sees_past() {
    let (scene, view) = (Scene::default(), View::level(Pose2::ORIGIN));
    let mut mapper = mapper(true);
    for (count, (range_m, blocked)) in
        [(f32::NAN, false), (0.4, true), (f32::NAN, true), (-1.0, true), (f32::INFINITY, false), (0.8, false)]
            .into_iter()
            .enumerate()
    {
        let count = count as u64 + 1;
        look(&mut mapper, &scene, &view, 2 * count);
        mapper.ranges(&sonar(2 * count * PERIOD_NS, range_m));
        look(&mut mapper, &scene, &view, 2 * count + 1);
        let map = safety(&mapper);
        for y_m in [-0.1, 0.0, 0.1] {
            let (occupancy, _) = at(&map, 0.49, y_m);
            assert_eq!(occupancy > 200, blocked, "reading {range_m} at y {y_m}: {occupancy}");
            assert!(blocked || is_free(at(&map, 0.49, y_m)));
        }
        assert!(is_free(at(&map, 0.3, 0.0)), "before the arc");
    }
}

/// A box before the left part of the sensor's cone, driven up to: its echo marks nothing that the camera sees to be free. What is
/// too low for the beam explains nothing, nor does anything explain an echo at the near limit.
#[test]
fn an_echo_of_what_the_camera_saw_marks_no_arc() {
    // Height of the box, reading, and whether its arc is marked.
    for (height_m, range_m, marks) in
        [(0.6, 0.36, false), (0.2, 0.36, true), (0.6, 0.25, true), (0.6, f32::NAN, false), (0.0, 0.36, true)]
    {
        let scene = Scene::default().stand([1.45, 1.6], [0.05, 0.4], height_m);
        let mut mapper = mapper(true);
        let mut count = 0;
        let mut sees = |mapper: &mut Mapper, x_m: f64| {
            count += 1;
            look(mapper, &scene, &View::level(Pose2::new(x_m, 0.0, 0.0)), count);
            count
        };
        for step in 0..=25 {
            sees(&mut mapper, 0.04 * f64::from(step));
        }
        // The sensor is 0.1 m farther on, the box 0.35 m before it, or 0.27 m, and 5 cm to the left.
        let (x_m, beside_m) = if range_m < 0.3 { (1.08, 1.42) } else { (1.0, 1.46) };
        let last = sees(&mut mapper, x_m);
        mapper.ranges(&sonar(last * PERIOD_NS, range_m));
        sees(&mut mapper, x_m);
        let map = safety(&mapper);
        assert_eq!(!is_free(at(&map, beside_m, -0.08)), marks, "{range_m} before {height_m}");
    }
}

/// Something that only the sensor hears, then a box beside it at the same range, for 12 s: what was marked stays so while there is
/// an echo, and goes without.
#[test]
fn a_mark_from_before_the_camera_knew_of_anything_stays_while_it_is_heard() {
    let view = View::level(Pose2::new(1.0, 0.0, 0.0));
    for hears in [true, false] {
        let mut mapper = mapper(true);
        look(&mut mapper, &Scene::default(), &view, 1);
        mapper.ranges(&sonar(PERIOD_NS, 0.36));
        let scene = Scene::default().stand([1.45, 1.6], [0.05, 0.4], 0.6);
        for count in 2..362 {
            look(&mut mapper, &scene, &view, count);
            if hears {
                mapper.ranges(&sonar(count * PERIOD_NS, 0.36));
            }
        }
        look(&mut mapper, &scene, &view, 362);
        assert_eq!(is_free(at(&safety(&mapper), 1.46, -0.08)), !hears);
    }
}

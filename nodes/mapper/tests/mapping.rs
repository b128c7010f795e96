//! What one look puts into the maps: closed forms against a rendered world.

#![allow(clippy::unwrap_used, reason = "a test may unwrap")]

mod scene;

use scene::{Scene, View, frame, jackal, loomo};
use sidestep_mapper::{CLEAR_BELOW, Config, Mapper};
use sidestep_msgs::{AGE_NEVER, Isometry, LOCAL_GRID, LocalMap, Pose2, SAFETY_GRID, SafetyMap, Scan, Status};

const PERIOD_NS: u64 = 33_333_333;

/// A mapper without granted disc that has looked `times` times at a scene from one place.
fn looked(scene: &Scene, view: &View, divide: u32, times: u64) -> Mapper {
    let config = Config { grant_start_disc: false, ..Config::shipped() };
    let mut mapper = Mapper::new(&config, &loomo()).unwrap();
    let mut frame = frame(divide);
    scene.render(view, PERIOD_NS, &mut frame);
    for count in 1..=times {
        frame.capture_ns = PERIOD_NS * count;
        mapper.odometry(&view.odometry(frame.capture_ns));
        assert_eq!(mapper.depth(&frame), Status::Ok);
    }
    mapper
}

fn local(mapper: &Mapper) -> LocalMap {
    let mut map = LocalMap::default();
    mapper.write_local(&mut map);
    map
}

fn safety(mapper: &Mapper) -> SafetyMap {
    let mut map = SafetyMap::default();
    mapper.write_safety(&mut map);
    map
}

/// Cells of the local map whose centres lie in a rectangle, as (occupancy, age).
fn cells(map: &LocalMap, x_m: [f32; 2], y_m: [f32; 2]) -> Vec<(u8, u8)> {
    let within = |index: &usize| {
        let (x, y) = LOCAL_GRID.centre(index / 28, index % 28);
        x > x_m[0] && x < x_m[1] && y > y_m[0] && y < y_m[1]
    };
    (0..784).filter(within).map(|index| (map.occupancy[index], map.age[index])).collect()
}

fn occupied_count(map: &LocalMap) -> usize {
    map.occupancy.iter().filter(|&&occupancy| occupancy > 140).count()
}

fn is_free((occupancy, age): (u8, u8)) -> bool {
    occupancy < CLEAR_BELOW && age != AGE_NEVER
}

/// A wall at 2.03 m: its row of cells is occupied, the floor before it free, what lies behind unknown.
#[test]
fn a_wall_lands_in_the_cells_where_it_stands() {
    for divide in [1, 2] {
        let wall = Scene::default().stand([2.03, 2.3], [-3.0, 3.0], 2.0);
        let map = local(&looked(&wall, &View::level(Pose2::ORIGIN), divide, 3));
        assert!(cells(&map, [2.0, 2.1], [-0.9, 0.9]).iter().all(|c| c.0 > 200), "divide {divide}");
        assert!(cells(&map, [1.1, 1.95], [-0.4, 0.4]).iter().all(|&c| is_free(c)), "divide {divide}");
        assert!(cells(&map, [2.2, 2.4], [-1.0, 1.0]).iter().all(|c| c.1 == AGE_NEVER), "divide {divide}");
        assert!(cells(&map, [0.3, 0.6], [-0.2, 0.2]).iter().all(|c| c.1 == AGE_NEVER), "the blind metre");
    }
}

/// Turned and moved robots see the same wall at the same place of `odom`.
#[test]
fn the_local_map_turns_with_the_robot_and_the_safety_map_does_not() {
    let pose = Pose2::new(31.37, -12.81, 2.2);
    let (x, y) = pose.transform(1.5, 0.4);
    let post = Scene::default().stand([x - 0.05, x + 0.05], [y - 0.05, y + 0.05], 1.0);
    let mapper = looked(&post, &View::level(pose), 1, 3);
    let (local, safety) = (local(&mapper), safety(&mapper));
    assert!(local.occupancy[LOCAL_GRID.index(1.48, 0.4).unwrap()] > 200);
    // The face towards the camera, as wide as a cell or two.
    let occupied = (0..10).filter(|part| {
        let (x, y) = pose.transform(1.42 + 0.01 * f64::from(*part), 0.4);
        let (dx, dy) = safety.frame().inverse_transform(x, y);
        safety.occupancy[SAFETY_GRID.index(dx as f32, dy as f32).unwrap()] > 200
    });
    assert!(occupied.count() >= 3);
    let frame = safety.frame();
    assert!(safety.base == pose && frame.yaw_rad == 0.0 && frame.distance_m(&pose) < 0.036, "{frame:?}");
    assert!(occupied_count(&local) <= 9, "{}", occupied_count(&local));
}

/// The body leans by 3 degrees fore and aft, by 7 to the sides: with the attitude of the odometry the floor stays floor; without it, it rises.
#[test]
fn pitch_and_roll_of_the_odometry_keep_the_floor_flat() {
    for (pitch_rad, roll_rad) in [(0.052, 0.0), (-0.052, 0.0), (0.0, 0.12), (0.0, -0.12)] {
        let view = View { pitch_rad, roll_rad, ..View::level(Pose2::ORIGIN) };
        let map = local(&looked(&Scene::default(), &view, 1, 3));
        assert_eq!(occupied_count(&map), 0, "pitch {pitch_rad} roll {roll_rad}");
        assert!(cells(&map, [1.2, 2.3], [-0.3, 0.3]).iter().all(|&c| is_free(c)));
        let mut mapper = Mapper::new(&Config::shipped(), &loomo()).unwrap();
        let mut frame = frame(1);
        Scene::default().render(&view, PERIOD_NS, &mut frame);
        mapper.odometry(&View::level(Pose2::ORIGIN).odometry(PERIOD_NS));
        assert_eq!(mapper.depth(&frame), Status::Ok);
        assert!(occupied_count(&local(&mapper)) > 0, "pitch {pitch_rad} roll {roll_rad} must show");
    }
}

/// A pit from 1.5 m on: its near edge is marked, and nothing in it is free.
/// One look at an empty floor: straight ahead what is unknown ends, and the planning cost of 0.5 with it, where the robot
/// file's camera first sees the floor.
#[test]
fn the_floor_is_first_seen_where_the_robot_file_says() {
    let map = local(&looked(&Scene::default(), &View::level(Pose2::ORIGIN), 1, 1));
    let blind_m = loomo().blind_m();
    assert!((blind_m - 0.995).abs() < 0.005, "{blind_m}");
    for step in 3..20 {
        let x_m = 0.05 + 0.1 * step as f32;
        let cell = LOCAL_GRID.index(x_m, 0.05).unwrap();
        if (x_m - blind_m).abs() > 0.1 {
            assert_eq!(map.age[cell] == AGE_NEVER, x_m < blind_m, "{x_m} m");
        }
        let kept_off = map.planning_cost[cell] == 128;
        assert!(
            kept_off == (x_m < blind_m) || (x_m - blind_m).abs() < 0.45,
            "{x_m} m: {}",
            map.planning_cost[cell]
        );
    }
    assert!(jackal().blind_m().abs() < 1e-6, "a scanner sees from where it stands");
}

#[test]
fn a_hole_in_the_floor_is_an_obstacle() {
    let stairs = Scene { holes: vec![[1.52, 9.0, -9.0, 9.0]], ..Scene::default() };
    let map = local(&looked(&stairs, &View::level(Pose2::ORIGIN), 1, 3));
    assert!(cells(&map, [1.5, 1.6], [-0.5, 0.5]).iter().all(|c| c.0 > 200));
    assert!(cells(&map, [1.6, 2.4], [-1.0, 1.0]).iter().all(|&c| !is_free(c)));
    assert!(cells(&map, [1.1, 1.45], [-0.3, 0.3]).iter().all(|&c| is_free(c)));
}

/// What hangs above 0.9 m is passed under, what hangs at 0.7 m is not, though the floor below is seen.
#[test]
fn overhead_is_ignored_and_a_table_top_is_not() {
    for (z_m, obstacle) in [([1.0, 1.2], false), ([0.7, 0.74], true)] {
        let top = Scene::default().hang([2.0, 2.3], [-0.5, 0.5], z_m);
        let map = local(&looked(&top, &View::level(Pose2::ORIGIN), 1, 5));
        let edge = cells(&map, [2.0, 2.1], [-0.4, 0.4]);
        assert_eq!(edge.iter().all(|c| c.0 > 140), obstacle, "top at {} m: {edge:?}", z_m[0]);
        assert_eq!(edge.iter().all(|&c| is_free(c)), !obstacle, "top at {} m: {edge:?}", z_m[0]);
    }
}

/// Legs of 2 and 4 cm at 1.2 to 3 m, also where a cell's edge splits them and at half the resolution.
#[test]
fn thin_table_legs_are_marked_in_one_look() {
    for side_m in [0.02, 0.04] {
        for x_m in [1.2, 1.99, 2.5, 3.0] {
            for divide in [1, 2] {
                let leg = Scene::default().stand([x_m, x_m + side_m], [0.09, 0.09 + side_m], 0.7);
                let config = Config { grant_start_disc: false, ..Config::shipped() };
                let mut mapper = Mapper::new(&config, &loomo()).unwrap();
                let view = View::level(Pose2::new(x_m - 2.0, 0.0, 0.0));
                let mut seen = frame(divide);
                leg.render(&View::level(Pose2::ORIGIN), PERIOD_NS, &mut seen);
                mapper.odometry(&View::level(Pose2::ORIGIN).odometry(PERIOD_NS));
                assert_eq!(mapper.depth(&seen), Status::Ok);
                // A second look at nothing, from where the leg lies inside the local map.
                let mut nothing = frame(divide);
                nothing.pixels[..4000].fill(9_000);
                nothing.capture_ns = 2 * PERIOD_NS;
                nothing.camera = view.camera;
                mapper.odometry(&sidestep_msgs::Odometry { pose_epoch: 0, ..view.odometry(100 * PERIOD_NS) });
                nothing.capture_ns = 100 * PERIOD_NS;
                assert_eq!(mapper.depth(&nothing), Status::Ok);
                let map = local(&mapper);
                assert!(occupied_count(&map) > 0, "leg of {side_m} m at {x_m} m, divide {divide}");
            }
        }
    }
}

/// The paper's camera, level; and a head-worn one, 1.6 m high and 24 degrees down.
#[test]
fn other_cameras_see_the_same_box() {
    for (height_m, pitch_down_rad) in [(0.55, 0.0), (1.6, 0.42)] {
        let camera = Isometry::camera(0.0, 0.0, height_m, pitch_down_rad);
        let view = View { camera, ..View::level(Pose2::ORIGIN) };
        let scene = Scene::default().stand([2.0, 2.35], [-0.3, 0.3], 0.4);
        let map = local(&looked(&scene, &view, 1, 3));
        assert!(cells(&map, [2.0, 2.1], [-0.25, 0.25]).iter().all(|c| c.0 > 200), "camera at {height_m} m");
        assert!(cells(&map, [1.6, 1.9], [-0.25, 0.25]).iter().all(|&c| is_free(c)), "camera at {height_m} m");
    }
}

/// Mirrors an uneven world; both maps must be mirrored too.
#[test]
fn a_mirrored_world_gives_a_mirrored_map() {
    let left =
        Scene::default().stand([1.53, 1.77], [0.13, 0.41], 0.5).stand([2.02, 2.2], [-0.77, -0.33], 0.9);
    let right =
        Scene::default().stand([1.53, 1.77], [-0.41, -0.13], 0.5).stand([2.02, 2.2], [0.33, 0.77], 0.9);
    let [a, b] = [left, right].map(|scene| looked(&scene, &View::level(Pose2::ORIGIN), 1, 16));
    let differing = |a: &[u8], b: &[u8], side: usize| {
        let mirror = |index: usize| index / side * side + side - 1 - index % side;
        (0..a.len()).filter(|&index| a[index] != b[mirror(index)]).count()
    };
    let (la, lb) = (local(&a), local(&b));
    assert_eq!(differing(&la.occupancy, &lb.occupancy, 28), 0);
    assert_eq!(differing(&la.planning_cost, &lb.planning_cost, 28), 0);
    assert_eq!(differing(&safety(&a).occupancy, &safety(&b).occupancy, 80), 0);
}

/// A floor of 1 m that gives no return: cells there turn free only as far as rays pass right above it.
#[test]
fn no_return_is_no_evidence() {
    let black = Scene { black: vec![[1.2, 2.2, -2.0, 2.0]], ..Scene::default() };
    let map = local(&looked(&black, &View::level(Pose2::ORIGIN), 1, 8));
    assert!(cells(&map, [1.2, 1.8], [-0.4, 0.4]).iter().all(|&c| !is_free(c)));
    assert!(cells(&map, [2.25, 2.4], [-0.4, 0.4]).iter().all(|&c| is_free(c)));
}

fn sweep(range_m: impl Fn(f32) -> f32) -> Scan {
    let mut scan = Scan { near_m: 0.1, far_m: 10.0, height_m: 0.25, count: 720, ..Scan::default() };
    (scan.first_rad, scan.step_rad) = (-2.356_194, 4.712_389 / 719.0);
    for beam in 0..720 {
        scan.range_m[beam] = range_m(scan.first_rad + beam as f32 * scan.step_rad);
    }
    scan
}

/// A round room of 1.525 m: a ring of obstacles, free inside; then the ring is gone, and it is cleared.
#[test]
fn a_sweep_marks_its_ends_and_clears_its_way() {
    let config = Config { grant_start_disc: false, ..Config::shipped() };
    let mut mapper = Mapper::new(&config, &jackal()).unwrap();
    let view = View::level(Pose2::ORIGIN);
    for count in 1..=20 {
        let range_m = if count <= 6 { 1.525 } else { f32::INFINITY };
        let mut scan = sweep(|_| range_m);
        scan.capture_ns = PERIOD_NS * count;
        mapper.odometry(&view.odometry(scan.capture_ns));
        assert_eq!(mapper.scan(&scan), Status::Ok);
        if count == 6 {
            let map = safety(&mapper);
            for (x, y) in [(1.52f32, 0.01f32), (0.01, 1.52), (1.078, 1.078), (1.078, -1.078)] {
                assert!(map.occupancy[SAFETY_GRID.index(x, y).unwrap()] > 200, "end at {x}, {y}");
                let (x, y) = (0.9 * x, 0.9 * y);
                let index = SAFETY_GRID.index(x, y).unwrap();
                assert!(is_free((map.occupancy[index], map.age[index])), "way at {x}, {y}");
            }
            assert_eq!(map.age[SAFETY_GRID.index(-1.0, 0.0).unwrap()], AGE_NEVER, "behind");
        }
    }
    let map = safety(&mapper);
    for (x, y) in [(1.52, 0.01), (0.01, 1.52), (1.078, 1.078), (1.9, 0.2)] {
        let index = SAFETY_GRID.index(x, y).unwrap();
        assert!(is_free((map.occupancy[index], map.age[index])), "{x}, {y}: {}", map.occupancy[index]);
    }
}

//! The simulator as its users see it: drives, images, contact, mirrors, bytes.

use crate::fixtures::{jackal, loomo};
use crate::{Config, Simulator, Solid, World};
use sidestep_msgs::{Command, DepthFrame, Odometry, Path, Pose2, Ranges, Robot, Scan, Truth, Twist};

const MS: u64 = 1_000_000;

fn quiet() -> Config {
    Config { noise: false, people: 0, ..Config::default() }
}

fn frame() -> Box<DepthFrame> {
    Box::new(DepthFrame::default())
}

fn simulator(config: &Config, robot: &Robot, world: World, start: Pose2) -> Simulator {
    let mut simulator = Simulator::new(config, robot, world, start, config.seed);
    simulator.advance(1000 * MS);
    simulator
}

/// Drives `(v, w)` for a time, a command every 10 ms; `each` sees the simulator after every tick.
fn drive(simulator: &mut Simulator, twist: Twist, ms: u64, mut each: impl FnMut(&mut Simulator)) {
    for _ in 0..ms / 10 {
        let now_ns = simulator.now_ns();
        let command = Command { twist, valid_until_ns: now_ns + 80 * MS, ..Command::default() };
        simulator.command(&command, now_ns);
        simulator.advance(now_ns + 10 * MS);
        each(simulator);
    }
}

fn truth(simulator: &Simulator) -> Truth {
    let mut truth = Truth::default();
    simulator.truth(&mut truth);
    truth
}

fn wall_at(x_m: f64) -> World {
    let mut world = World::empty();
    world.solids.push(Solid::block([x_m + 0.05, 0.0], [0.1, 20.0], 0.0, [0.0, 3.0]));
    world
}

#[test]
fn a_wall_ahead_is_seen_at_its_distance_and_the_floor_before_it() {
    let robot = loomo();
    let mut simulator = simulator(&quiet(), &robot, wall_at(3.0), Pose2::ORIGIN);
    let mut depth = frame();
    simulator.render(&mut depth);
    let pitch = f64::from(robot.camera.unwrap().pitch_down_rad);
    for row in 0..480_u32 {
        let below = libm::atan((f64::from(row) - 239.5) / f64::from(depth.fy_px));
        let cos = libm::cos(below);
        let wall = 2.9 / libm::cos(below + pitch) * cos;
        let floor = if below + pitch > 0.0 { 0.55 / libm::sin(below + pitch) * cos } else { f64::INFINITY };
        let found = f64::from(depth.pixels[(row * 640 + 320) as usize]) * 1e-3;
        assert!((found - wall.min(floor)).abs() < 2e-3, "row {row}: {found} {wall} {floor}");
    }
}

#[test]
fn the_thin_leg_of_a_table_three_metres_away_is_seen() {
    let world = World::with_table();
    let leg = world.solids.iter().find(|s| s.reach_m() < 0.02).copied().unwrap();
    let start = Pose2::new(leg.x_m - 3.1, leg.y_m, 0.0);
    let mut simulator = simulator(&quiet(), &loomo(), world, start);
    let mut depth = frame();
    simulator.render(&mut depth);
    let row = &depth.pixels[240 * 640 + 300..240 * 640 + 340];
    let width = row.iter().filter(|mm| (2950..3100).contains(*mm)).count();
    assert!((5..=9).contains(&width), "{width} px");
}

#[test]
fn noise_grows_with_the_square_of_the_distance_and_some_pixels_are_lost() {
    let robot = loomo();
    for distance in [1.0, 2.0, 3.0] {
        let config = Config { people: 0, ..Config::default() };
        let mut simulator = simulator(&config, &robot, wall_at(distance + 0.1), Pose2::ORIGIN);
        let mut depth = frame();
        simulator.render(&mut depth);
        let pixels = &depth.pixels[150 * 640..170 * 640];
        let lost = pixels.iter().filter(|mm| **mm == 0).count() as f64 / pixels.len() as f64;
        assert!((0.02..0.06).contains(&lost), "{lost}");
        let inverse: Vec<f64> = pixels.iter().filter(|mm| **mm > 0).map(|mm| 1e3 / f64::from(*mm)).collect();
        // Rows of a pitched camera see the wall at slightly different depth: compare along one row.
        let row: Vec<f64> = depth.pixels[160 * 640..161 * 640]
            .iter()
            .filter(|mm| **mm > 0)
            .map(|mm| 1e3 / f64::from(*mm))
            .collect();
        let mean = row.iter().sum::<f64>() / row.len() as f64;
        let sigma = (row.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / row.len() as f64).sqrt();
        let expected = 0.2 / (606.97 * 0.07);
        assert!(
            (sigma / expected - 1.0).abs() < 0.25 && inverse.len() > 1000,
            "{distance} m: {sigma} {expected}"
        );
    }
}

#[test]
fn beyond_the_limits_of_the_camera_there_is_no_depth() {
    for (distance, robot) in [(0.40, loomo()), (9.0, loomo())] {
        for noise in [false, true] {
            let config = Config { noise, people: 0, ..Config::default() };
            let mut simulator = simulator(&config, &robot, wall_at(distance), Pose2::ORIGIN);
            let mut depth = frame();
            simulator.render(&mut depth);
            assert!(
                depth.pixels[100 * 640..101 * 640].iter().all(|mm| *mm == 0),
                "{distance} m, noise {noise}"
            );
        }
    }
}

#[test]
fn a_mirrored_world_gives_a_mirrored_image() {
    let world = World::office(1);
    let start = Pose2::new(1.3, 2.0, 0.2);
    let mut images = Vec::new();
    for (world, start) in [(world.mirrored(), Pose2::new(1.3, -2.0, -0.2)), (world, start)] {
        let mut simulator = simulator(&quiet(), &loomo(), world, start);
        let mut depth = frame();
        simulator.render(&mut depth);
        images.push(depth);
    }
    let differ = (0..480 * 640).filter(|i| {
        let other = images[1].pixels[i / 640 * 640 + 639 - i % 640];
        images[0].pixels[*i].abs_diff(other) > 2
    });
    assert!(differ.count() < 300);
}

#[test]
fn a_small_image_sees_what_the_large_one_sees() {
    let mut images = Vec::new();
    for (width_px, height_px) in [(0, 0), (160, 120)] {
        let config = Config { width_px, height_px, ..quiet() };
        let mut simulator = simulator(&config, &loomo(), wall_at(2.0), Pose2::ORIGIN);
        let mut depth = frame();
        simulator.render(&mut depth);
        images.push((depth.width as usize, depth));
    }
    let (large, small) = (&images[0].1, &images[1].1);
    assert_eq!((small.width, small.height), (160, 120));
    assert!(small.pixels[160 * 120..].iter().all(|mm| *mm == 0));
    for row in 0..120 {
        let middle = (0..4).map(|k| f64::from(large.pixels[(4 * row + k) * 640 + 320])).sum::<f64>() / 4.0;
        let found = f64::from(small.pixels[row * 160 + 80]);
        assert!((found / middle - 1.0).abs() < 0.01, "row {row}: {found} {middle}");
    }
}

#[test]
fn a_wall_stops_the_robot_and_counts_once() {
    let mut simulator = simulator(&quiet(), &loomo(), wall_at(2.0), Pose2::ORIGIN);
    drive(&mut simulator, Twist::new(0.8, 0.0), 6000, |_| {});
    let stuck = truth(&simulator);
    assert_eq!((stuck.collisions, stuck.contact), (1, 1));
    assert!(stuck.pose.x_m <= 2.0 - 0.14 && stuck.pose.x_m > 2.0 - 0.145, "{:?}", stuck.pose);
    drive(&mut simulator, Twist::new(-0.2, 0.0), 1000, |_| {});
    let freed = truth(&simulator);
    assert_eq!((freed.collisions, freed.contact), (1, 0));
    assert!(freed.clearance_m > 0.05 && freed.min_clearance_m < 1e-5);
}

#[test]
fn clearance_is_the_gap_between_footprint_and_wall() {
    let mut simulator = simulator(&quiet(), &loomo(), wall_at(2.0), Pose2::ORIGIN);
    drive(&mut simulator, Twist::new(0.4, 0.0), 2000, |simulator| {
        let truth = truth(simulator);
        assert!((f64::from(truth.clearance_m) - (2.0 - 0.14 - truth.pose.x_m)).abs() < 1e-6);
    });
}

#[test]
fn a_person_who_walks_past_a_standing_robot_is_no_collision() {
    let mut world = World::empty();
    world.walkers.push(crate::Walker { waypoints_m: vec![[1.0, -3.0], [1.0, 3.0]], speed_m_s: 1.0 });
    let config = Config { people: 1, ..Config::default() };
    let mut simulator = simulator(&config, &loomo(), world, Pose2::ORIGIN);
    simulator.advance(60_000 * MS);
    assert_eq!(truth(&simulator).collisions, 0);
}

#[test]
fn ultrasound_hears_the_wall_and_silence() {
    let mut near = simulator(&quiet(), &loomo(), wall_at(1.0), Pose2::ORIGIN);
    let mut ranges = Ranges::default();
    near.ranges(&mut ranges);
    assert!(ranges.count == 1 && (ranges.sensors[0].range_m - 0.9).abs() < 1e-6, "{:?}", ranges.sensors[0]);
    let mut far = simulator(&quiet(), &loomo(), wall_at(5.0), Pose2::ORIGIN);
    far.ranges(&mut ranges);
    assert!(ranges.sensors[0].range_m.is_infinite());
}

#[test]
fn a_scan_sees_the_wall_along_its_beams() {
    let mut simulator = simulator(&quiet(), &jackal(), wall_at(2.0), Pose2::ORIGIN);
    let mut scan = Scan::default();
    simulator.scan(&mut scan);
    assert_eq!(scan.count, 720);
    for (index, range) in scan.range_m[..720].iter().enumerate() {
        let bearing = scan.first_rad + index as f32 * scan.step_rad;
        let expected = 1.88 / libm::cosf(bearing);
        if bearing.abs() < 1.2 {
            assert!((range - expected).abs() < 1e-3, "{bearing}: {range} {expected}");
        } else if bearing.abs() > 1.6 {
            assert!(range.is_infinite());
        }
    }
}

#[test]
fn odometry_drifts_within_its_bound_and_not_at_all_without_noise() {
    for (noise, seed) in [(false, 1), (true, 1), (true, 2), (true, 3)] {
        let config = Config { noise, seed, people: 0, ..Config::default() };
        let mut simulator = simulator(&config, &loomo(), World::empty(), Pose2::new(1.0, 2.0, 0.5));
        drive(&mut simulator, Twist::new(0.7, 0.1), 20_000, |_| {});
        let (truth, mut odometry) = (truth(&simulator), Odometry::default());
        simulator.odometry(&mut odometry);
        let error = truth.pose.distance_m(&odometry.pose);
        assert!(error < if noise { 0.03 * truth.distance_m } else { 1e-9 }, "{error} m");
        assert_eq!(noise, error > 1e-4);
    }
}

#[test]
fn wheels_that_slip_say_so_and_believe_too_much() {
    let config = Config { slips_per_min: 30.0, ..quiet() };
    let mut simulator = simulator(&config, &loomo(), World::empty(), Pose2::ORIGIN);
    let mut slipped = 0;
    drive(&mut simulator, Twist::new(0.5, 0.0), 20_000, |simulator| {
        let mut odometry = Odometry::default();
        simulator.odometry(&mut odometry);
        slipped += odometry.slip;
    });
    let mut odometry = Odometry::default();
    simulator.odometry(&mut odometry);
    assert!((100..600).contains(&slipped), "{slipped}");
    assert!(odometry.pose.x_m > truth(&simulator).pose.x_m + 0.1);
}

#[test]
fn a_path_comes_once_and_the_next_one_at_arrival() {
    let mut world = World::empty();
    world.legs_m = vec![vec![[0.0, 0.0], [1.0, 0.0]], vec![[1.0, 0.0], [2.0, 0.0]]];
    let mut simulator = simulator(&quiet(), &loomo(), world, Pose2::ORIGIN);
    let mut path = Path::default();
    let mut ids = Vec::new();
    drive(&mut simulator, Twist::new(0.5, 0.0), 6000, |simulator| {
        if simulator.path(&mut path) {
            assert_eq!(path.count, 11);
            ids.push(path.id);
        }
    });
    assert_eq!((ids, truth(&simulator).arrivals), (vec![1, 2], 2));
}

/// The same calls give the same bytes; another seed gives others.
#[test]
fn a_seed_fixes_every_byte() {
    let run = |seed: u64| {
        let config = Config { seed, width_px: 160, height_px: 120, ..Config::default() };
        let world = World::office(seed);
        let start = world.start;
        let mut simulator = simulator(&config, &loomo(), world, start);
        let (mut depth, mut odometry) = (frame(), Odometry::default());
        let mut bytes = Vec::new();
        for _ in 0..10 {
            drive(&mut simulator, Twist::new(0.3, 0.1), 100, |_| {});
            simulator.render(&mut depth);
            simulator.odometry(&mut odometry);
            bytes.push((depth.pixels.to_vec(), odometry, truth(&simulator)));
        }
        bytes
    };
    assert!(run(4) == run(4));
    assert!(run(4) != run(5));
}

/// Rendering ahead by less than the dead time shows what is true when the time has come.
#[test]
fn a_frame_rendered_ahead_is_the_frame_of_its_time() {
    let robot = loomo();
    let world = World::office(1);
    let start = world.start;
    let mut simulator = simulator(&quiet(), &robot, world, start);
    drive(&mut simulator, Twist::new(0.5, 0.2), 500, |_| {});
    let at_ns = simulator.now_ns() + 33_333_333;
    let (mut early, mut late) = (frame(), frame());
    simulator.render_ahead(at_ns, &mut early);
    drive(&mut simulator, Twist::new(-0.2, -1.0), 30, |_| {});
    simulator.advance(at_ns);
    simulator.render(&mut late);
    assert!(early.pixels == late.pixels && early.capture_ns == late.capture_ns);
}

/// Steps of any size lead to the same state at whole milliseconds.
#[test]
fn how_often_time_is_told_does_not_matter() {
    let mut ends = Vec::new();
    for step_ms in [10, 1, 7] {
        let mut simulator = simulator(&Config::default(), &loomo(), World::empty(), Pose2::ORIGIN);
        let command =
            Command { twist: Twist::new(0.5, 0.3), valid_until_ns: 1600 * MS, ..Command::default() };
        simulator.command(&command, 1000 * MS);
        let mut at = 1000;
        while at < 2000 {
            at = (at + step_ms).min(2000);
            simulator.advance(at * MS);
        }
        ends.push(truth(&simulator).pose);
    }
    assert!(ends[0] == ends[1] && ends[0] == ends[2], "{ends:?}");
}

/// A block appears before a robot at full speed, which an empty world had not made it look out for.
#[test]
fn what_is_placed_is_there_at_once() {
    let mut simulator = simulator(&quiet(), &loomo(), World::empty(), Pose2::ORIGIN);
    drive(&mut simulator, Twist::new(1.0, 0.0), 2000, |_| ());
    let ahead_m = simulator.pose().x_m + 0.5;
    simulator.place(Solid::block([ahead_m, 0.0], [0.2, 1.0], 0.0, [0.0, 1.0]));
    assert_eq!(simulator.solids().count(), 1);
    drive(&mut simulator, Twist::new(1.0, 0.0), 2000, |_| ());
    assert_eq!(truth(&simulator).collisions, 1);
    assert!(simulator.pose().x_m < ahead_m, "{:?}", simulator.pose());
}

/// Pushed in small steps and turned, with noise: wheels and truth agree as well as before.
#[test]
fn a_robot_that_is_pushed_knows_where_it_came_to() {
    let noisy = Config { people: 0, ..Config::default() };
    let mut simulator = simulator(&noisy, &loomo(), World::empty(), Pose2::ORIGIN);
    drive(&mut simulator, Twist::new(0.8, 0.3), 3000, |_| ());
    let mut odometry = Odometry::default();
    simulator.odometry(&mut odometry);
    let (before, from) = (odometry.pose, simulator.pose());
    for step in 1..=100 {
        let part = 0.01 * f64::from(step);
        simulator.push(&Pose2::new(from.x_m + 0.4 * part, from.y_m - 0.2 * part, from.yaw_rad + part));
        simulator.advance(simulator.now_ns() + 10 * MS);
    }
    simulator.odometry(&mut odometry);
    let (moved, believed) = (from.relative(&simulator.pose()), before.relative(&odometry.pose));
    assert!(moved.distance_m(&believed) < 5e-3 && (moved.yaw_rad - believed.yaw_rad).abs() < 5e-3);
    assert!((simulator.pose().yaw_rad - from.yaw_rad - 1.0).abs() < 0.02);
}

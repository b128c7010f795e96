//! What the guard says of a rendered world: what stands in the way, and that the floor does not, however the base leans.

#![allow(clippy::unwrap_used, reason = "a test may unwrap")]

use sidestep_guard::{Config, Guard};
use sidestep_msgs::{Command, DepthFrame, NearField, Odometry, Pose2, Robot, Status, Twist};
use sidestep_sim::{Simulator, Solid, World};

const MS: u64 = 1_000_000;

fn loomo() -> Robot {
    let text = include_str!("../../../launch/robots/loomo.toml");
    Robot::from_toml("loomo.toml", text).unwrap()
}

/// A robot at the origin of a world of these solids, with all noise of its camera.
fn simulator(solids: Vec<Solid>, divide: u32, seed: u64) -> Simulator {
    let world = World { solids, ..World::empty() };
    let config = sidestep_sim::Config {
        width_px: 640 / divide,
        height_px: 480 / divide,
        people: 0,
        brake_part: 1.0,
        ..sidestep_sim::Config::default()
    };
    Simulator::new(&config, &loomo(), world, Pose2::ORIGIN, seed)
}

fn guard() -> Guard {
    Guard::new(&Config::STANDARD, &loomo()).unwrap()
}

/// Nearest range of the sectors within so many metres of the robot's axis; 0 where one straight ahead was not seen:
/// beside what stands near lies its shadow, since the camera is not at the origin of `base`.
fn ahead_m(field: &NearField, half_width_m: f32) -> f32 {
    let inside = |(index, range_m): (usize, &f32)| {
        let bearing = field.left_rad - (index as f32 + 0.5) * field.sector_rad;
        let known_m = if range_m.is_nan() && bearing.abs() < 0.2 { 0.0 } else { *range_m };
        ((known_m * libm::sinf(bearing)).abs() <= half_width_m).then_some(known_m)
    };
    field.range_m.iter().enumerate().filter_map(inside).fold(f32::INFINITY, f32::min)
}

/// A box of 0.3 m, a column as wide as a person and a wall, from 0.5 m on (what is nearer than the camera's 0.35 m
/// cannot be seen), at two resolutions and with ten frames of noise each.
#[test]
fn a_box_a_person_and_a_wall_are_seen_where_they_stand() {
    let camera = loomo().camera.unwrap();
    for distance_m in [0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0] {
        let things = [
            ("box", Solid::block([distance_m + 0.15, 0.0], [0.3, 0.3], 0.0, [0.0, 0.3])),
            ("person", Solid::column([distance_m + 0.2, 0.0], 0.2, [0.0, 1.7])),
            ("wall", Solid::block([distance_m + 0.05, 0.0], [0.1, 20.0], 0.0, [0.0, 2.5])),
        ];
        for (name, solid) in things {
            for divide in [1, 2] {
                let focal_px = camera.focal_px / divide as f32;
                let sigma_m = (distance_m * distance_m) as f32 * camera.disparity_sigma_px
                    / (focal_px * camera.baseline_m);
                for seed in 0..10 {
                    let mut simulator = simulator(vec![solid], divide, seed);
                    simulator.advance(100 * MS);
                    let (mut frame, mut field) = (Box::<DepthFrame>::default(), NearField::default());
                    simulator.render(&mut frame);
                    assert_eq!(guard().step(&frame, &mut field), Status::Ok);
                    assert_eq!(field.capture_ns, 100 * MS);
                    let found_m = ahead_m(&field, 0.1);
                    let off_m = (found_m - distance_m as f32).abs();
                    assert!(
                        off_m <= 0.05 + 2.0 * sigma_m,
                        "{name} at {distance_m} m, divided by {divide}, seed {seed}: {found_m}"
                    );
                }
            }
        }
    }
}

/// Full acceleration to 1 m/s, the hardest brake that the base has, the same backward: the floor is never in the way,
/// although the body leans by more than 3 degrees.
#[test]
fn the_floor_is_not_in_the_way_however_the_base_leans() {
    let mut simulator = simulator(Vec::new(), 1, 3);
    let (mut frame, mut field) = (Box::<DepthFrame>::default(), NearField::default());
    let (mut guard, mut odometry) = (guard(), Odometry::default());
    let (mut leant, mut fastest) = ([0.0_f32; 2], 0.0_f32);
    for tick in 1..=480 {
        let now_ns = 10 * MS * tick;
        let v_m_s = match tick {
            1..=150 => 1.0,
            151..=320 => 0.0,
            321..=400 => -0.2,
            _ => 0.0,
        };
        let twist = Twist { v_m_s, w_rad_s: 0.0 };
        simulator.command(&Command { valid_until_ns: now_ns + 80 * MS, twist, ..Command::default() }, now_ns);
        simulator.advance(now_ns);
        simulator.odometry(&mut odometry);
        leant = [leant[0].min(odometry.pitch_rad), leant[1].max(odometry.pitch_rad)];
        fastest = fastest.max(odometry.twist.v_m_s);
        if tick % 3 == 0 {
            simulator.render(&mut frame);
            assert_eq!(guard.step(&frame, &mut field), Status::Ok);
            // The outermost sectors are those of the lower corners of the image alone.
            let clear = field.range_m[3..61].iter().all(|range_m| range_m.is_infinite());
            let blocked = field.range_m.iter().any(|range_m| range_m.is_finite());
            assert!(clear && !blocked, "{now_ns} ns, pitch {}: {:?}", odometry.pitch_rad, field.range_m);
        }
    }
    assert!(fastest > 0.95 && leant[0] < -0.052 && leant[1] > 0.045, "{fastest} {leant:?}");
}

/// A wall before a robot that brakes from 1 m/s is seen all the time.
#[test]
fn a_wall_is_seen_while_the_base_brakes() {
    let wall = Solid::block([4.05, 0.0], [0.1, 20.0], 0.0, [0.0, 2.5]);
    let mut simulator = simulator(vec![wall], 1, 4);
    let (mut frame, mut field) = (Box::<DepthFrame>::default(), NearField::default());
    let mut guard = guard();
    for tick in 1..=300 {
        let now_ns = 10 * MS * tick;
        let twist = Twist { v_m_s: if tick < 160 { 1.0 } else { 0.0 }, w_rad_s: 0.0 };
        simulator.command(&Command { valid_until_ns: now_ns + 80 * MS, twist, ..Command::default() }, now_ns);
        simulator.advance(now_ns);
        let gap_m = (4.0 - simulator.pose().x_m) as f32;
        if tick % 3 == 0 && gap_m < 3.2 {
            simulator.render(&mut frame);
            assert_eq!(guard.step(&frame, &mut field), Status::Ok);
            let found_m = ahead_m(&field, 0.3);
            // A lean of 3.4 degrees moves what stands half a metre high by 3 cm.
            assert!((found_m - gap_m).abs() < 0.08 + 0.0094 * gap_m * gap_m, "{gap_m}: {found_m}");
        }
    }
}

/// What hangs above the robot is not in the way; half a frame without returns is not called clear.
#[test]
fn overhead_passes_and_what_was_not_measured_is_not_clear() {
    let beam = Solid::block([1.5, 0.0], [0.2, 6.0], 0.0, [1.05, 1.3]);
    let mut simulator = simulator(vec![beam], 1, 5);
    simulator.advance(100 * MS);
    let (mut frame, mut field) = (Box::<DepthFrame>::default(), NearField::default());
    simulator.render(&mut frame);
    assert_eq!(guard().step(&frame, &mut field), Status::Ok);
    assert!(field.range_m[3..61].iter().all(|range_m| range_m.is_infinite()), "{:?}", field.range_m);
    frame.pixels.chunks_exact_mut(640).for_each(|row| row[..320].fill(0));
    assert_eq!(guard().step(&frame, &mut field), Status::Ok);
    assert!(field.range_m[..30].iter().all(|range_m| range_m.is_nan()), "{:?}", field.range_m);
    assert!(field.range_m[34..61].iter().all(|range_m| range_m.is_infinite()), "{:?}", field.range_m);
}

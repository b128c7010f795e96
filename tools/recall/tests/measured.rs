//! What the measurement must say whatever else it says: facts of the sensor that are known without it.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "a test may unwrap and print")]

use sidestep_arbiter::{Arbiter, Config};
use sidestep_msgs::{Command, Header, Odometry, Pose2, Robot, SAFETY_GRID, SafetyMap, Teleop, Twist};
use sidestep_recall::{CLASSES, Class, Options, Recall, RecallError, Witness, measure, reach_m, speeds_m_s};
use sidestep_sim::{BEGIN_NS, Solid, TICK_NS, draw, seen_from};

const TRIALS: u64 = 8;
/// `[m/s]` the Loomo's fastest: the farthest away is the hardest, and the shortest drive.
const FAST: [f64; 1] = [1.0];

fn robot(name: &str) -> Robot {
    let path = format!("{}/../../launch/robots/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Robot::from_toml(name, &std::fs::read_to_string(path).unwrap()).unwrap()
}

fn classes(names: &[&str]) -> Vec<Class> {
    names.iter().map(|name| *CLASSES.iter().find(|class| class.name == *name).unwrap()).collect()
}

fn measured(names: &[&str], trials: u64, threads: usize) -> Recall {
    let robot = robot("loomo");
    let classes = classes(names);
    let options = Options { robot: &robot, classes: &classes, speeds_m_s: &FAST, trials, seed: 1, threads };
    measure(&options, &mut |_| ()).unwrap()
}

/// A box is recalled and glass is not; free floor is not marked by a camera that is mounted as its file says, and is by
/// one that looks 3 degrees lower.
#[test]
fn a_box_is_recalled_glass_is_not_and_free_floor_is_free() {
    let names = ["box, 20 cm", "glass pane", "nothing", "nothing, camera 3 degrees low"];
    let recall = measured(&names, TRIALS, 2);
    println!("{}", recall.text());
    let [cube, glass, nothing, low] = recall.rows.as_slice() else { panic!("{recall:?}") };
    assert!(cube.marked.share() >= 0.95 && cube.guarded.share() >= 0.95, "{cube:?}");
    assert!(glass.stopped.share() < 0.2, "{glass:?}");
    assert!(nothing.stopped.share() < 0.2, "{nothing:?}");
    assert!(low.marked.share() >= 0.95, "{low:?}");
}

/// A stair is nothing that stands there: no ray that passes its edge ends within the camera's range, so that nothing is
/// marked, yet what was not seen is not free.
#[test]
fn stairs_down_are_not_known_free_where_nothing_marks_them() {
    let recall = measured(&["stairs down"], TRIALS, 2);
    println!("{}", recall.text());
    let stairs = &recall.rows[0];
    assert!(stairs.marked.share() < 0.2 && stairs.not_known_free.share() >= 0.5, "{stairs:?}");
}

/// A slow robot looks over the edge for longest: what it saw of the hole, or never saw of the floor, must last.
#[test]
fn a_slow_robot_does_not_forget_stairs() {
    let (robot, classes) = (robot("loomo"), classes(&["stairs down"]));
    let options =
        Options { robot: &robot, classes: &classes, speeds_m_s: &[0.3], trials: 5, seed: 1, threads: 2 };
    let recall = measure(&options, &mut |_| ()).unwrap();
    println!("{}", recall.text());
    assert!(recall.rows[0].not_known_free.share() > 0.99, "{:?}", recall.rows[0]);
}

/// On other threads, and beside another class.
#[test]
fn a_seed_gives_the_same_numbers_on_any_number_of_threads() {
    let bytes = |recall: &Recall| serde_json::to_string(recall).unwrap();
    let one = measured(&["pole, 2 cm"], 3, 1);
    assert_eq!(bytes(&one), bytes(&measured(&["pole, 2 cm"], 3, 3)));
    assert_eq!(one.rows, measured(&["nothing", "pole, 2 cm"], 3, 2).rows[1..]);
}

/// `[m]` from the robot's front to a wall when the arbiter first slows a robot that drives steadily at it.
fn slowed_m(robot: &Robot, speed_m_s: f32) -> f64 {
    const FRONT_M: f64 = 0.14;
    let mut arbiter = Arbiter::new(&Config::STANDARD, robot, 0).unwrap();
    let (mut map, mut command) = (Box::<SafetyMap>::default(), Command::default());
    let (mut pose, mut v_m_s) = (Pose2::ORIGIN, 0.0_f32);
    for tick in 1..2000 {
        let now_ns = BEGIN_NS + tick * TICK_NS;
        v_m_s = (v_m_s + 0.01 * robot.limits.accelerate_m_s2).min(speed_m_s);
        pose.x_m += f64::from(v_m_s) * 0.01;
        let header = Header { sequence: tick, now_ns, ..Header::default() };
        let twist = Twist::new(v_m_s, 0.0);
        arbiter.odometry(&Odometry { stamp_ns: now_ns, pose, twist, ..Odometry::default() }, &header);
        (map.capture_ns, map.base) = (now_ns, pose);
        map.occupancy.fill(0);
        map.age.fill(0);
        let wall = Solid::block([5.5, 0.0], [1.0, 8.0], 0.0, [0.0, 2.0]);
        draw(&seen_from(&wall, &map.frame()), &SAFETY_GRID, &mut map.occupancy);
        arbiter.safety_map(&map, &header);
        arbiter.teleop(&Teleop { stamp_ns: now_ns, v_m_s: speed_m_s, dead_man: 1, ..Teleop::default() });
        arbiter.step(now_ns, false, &mut command);
        if v_m_s >= speed_m_s && command.scale < 1.0 {
            return 5.0 - pose.x_m - FRONT_M;
        }
    }
    panic!("never slowed");
}

/// The real arbiter slows for a wall no earlier than the reach says, and not much later than what a map as old as it
/// may be takes off. A cell of the map may begin 0.05 m before the wall.
#[test]
fn the_arbiter_begins_to_slow_where_the_tube_ends() {
    let robot = robot("loomo");
    let config = Config::STANDARD;
    for speed_m_s in speeds_m_s(&robot) {
        let reach = reach_m(&robot, &config, speed_m_s);
        let found = slowed_m(&robot, speed_m_s as f32);
        println!("{speed_m_s} m/s: reach {reach:.3} m, slowed at {found:.3} m");
        let late_m = speed_m_s * f64::from(config.map_age_s) + 0.05;
        assert!(found <= reach + 0.05 && found >= reach - late_m, "{speed_m_s} m/s: {found}, reach {reach}");
    }
}

/// By hand for the Loomo at 1 m/s: 1.02 * 0.34 + 0.52 / 0.45 + 0.025 m.
#[test]
fn the_tube_reaches_as_far_as_the_closed_form_says() {
    let reach = reach_m(&robot("loomo"), &Config::STANDARD, 1.0);
    assert!((reach - 1.527_36).abs() < 1e-4, "{reach}");
    assert_eq!(speeds_m_s(&robot("loomo")), [0.3, 0.6, 1.0]);
}

#[test]
fn what_cannot_be_measured_says_what_is_needed() {
    let lidar = robot("jackal");
    let blind = Witness::new(&lidar).unwrap_err();
    assert!(matches!(blind, RecallError::Blind { .. }), "{blind}");
    assert!(blind.to_string().contains("no depth camera, needed"), "{blind}");
    let loomo = robot("loomo");
    let options =
        Options { robot: &loomo, classes: &CLASSES, speeds_m_s: &FAST, trials: 0, seed: 1, threads: 1 };
    let error = measure(&options, &mut |_| ()).unwrap_err().to_string();
    assert_eq!(error, "recall: --trials is 0, needed: 1 to 100000");
}

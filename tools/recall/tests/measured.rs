//! What the measurement must say whatever else it says: facts of the sensor that are known without it.

use sidestep_arbiter::{Arbiter, Config};
use sidestep_msgs::{Command, Header, Odometry, Pose2, Robot, SAFETY_GRID, SafetyMap, Teleop, Twist};
use sidestep_recall::{CLASSES, Class, Options, Recall, RecallError, Witness, measure, reach_m, speeds_m_s};
use sidestep_sim::{BEGIN_NS, Solid, TICK_NS, draw, seen_from};

const TRIALS: u64 = 20;

fn robot(name: &str) -> Robot {
    let path = format!("{}/../../launch/robots/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Robot::from_toml(name, &std::fs::read_to_string(path).unwrap()).unwrap()
}

fn classes(names: &[&str]) -> Vec<Class> {
    names.iter().map(|name| *CLASSES.iter().find(|class| class.name == *name).unwrap()).collect()
}

fn measured(names: &[&str], threads: usize, seed: u64) -> Recall {
    let robot = robot("loomo");
    let classes = classes(names);
    let options = Options { robot: &robot, classes: &classes, trials: TRIALS, seed, threads };
    measure(&options, &mut |_| ()).unwrap()
}

/// Share of trials of a class at the fastest speed.
fn fastest<'a>(recall: &'a Recall, name: &str) -> &'a sidestep_recall::Row {
    recall.rows.iter().rfind(|row| row.class == name).unwrap()
}

/// A box is recalled and glass is not; free floor is not marked by a camera that is mounted as it says.
#[test]
fn a_box_is_recalled_glass_is_not_and_free_floor_is_free() {
    let recall = measured(&["box, 20 cm", "glass pane", "nothing"], 2, 1);
    println!("{}", recall.text());
    for row in recall.rows.iter().filter(|row| row.class == "box, 20 cm") {
        assert!(row.marked.share() >= 0.95, "{row:?}");
    }
    for row in recall.rows.iter().filter(|row| row.class == "glass pane") {
        assert!(row.either.share() < 0.2, "{row:?}");
    }
    for row in recall.rows.iter().filter(|row| row.class == "nothing") {
        assert!(row.either.share() < 0.05, "{row:?}");
    }
}

/// The same seed on other threads and beside other classes; another seed.
#[test]
fn a_seed_gives_the_same_numbers_on_any_number_of_threads() {
    let text = |recall: &Recall| serde_json::to_string(recall).unwrap();
    let one = measured(&["pole, 2 cm"], 1, 5);
    let three = measured(&["pole, 2 cm"], 3, 5);
    assert_eq!(text(&one), text(&three));
    let beside = measured(&["nothing", "pole, 2 cm"], 2, 5);
    assert_eq!(fastest(&one, "pole, 2 cm"), fastest(&beside, "pole, 2 cm"));
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
        (map.capture_ns, map.pose) = (now_ns, pose);
        map.occupancy.fill(0);
        map.age.fill(0);
        let wall = Solid::block([5.5, 0.0], [1.0, 8.0], 0.0, [0.0, 2.0]);
        draw(&seen_from(&wall, &pose), &SAFETY_GRID, &mut map.occupancy);
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
    let options = Options { robot: &loomo, classes: &CLASSES, trials: 0, seed: 1, threads: 1 };
    let error = measure(&options, &mut |_| ()).unwrap_err().to_string();
    assert_eq!(error, "recall: --trials is 0, needed: 1 to 100000");
}

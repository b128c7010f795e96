//! `sidestep identify` and `sidestep doctor` on simulated bases, whose true values are known.

use crate::command_line::refused;
use crate::harness::{Alone, Folder, PATIENT, Running, SMALL, run, sidestep};
use serde_json::Value;
use sidestep_bus::{Keep, Link, Step, pause};
use sidestep_msgs::COMMAND;
use std::time::Duration;

/// A hall without anything in it, and no path: only an operator drives there.
const HALL: &str = "start = { x_m = 1.0, y_m = 4.0, yaw_rad = 0.0 }
endless = false
wall = [
  { from_m = [0.0, 0.0], to_m = [14.0, 0.0], thickness_m = 0.1, top_m = 2.4 },
  { from_m = [0.0, 8.0], to_m = [14.0, 8.0], thickness_m = 0.1, top_m = 2.4 },
  { from_m = [0.0, 0.0], to_m = [0.0, 8.0], thickness_m = 0.1, top_m = 2.4 },
  { from_m = [14.0, 0.0], to_m = [14.0, 8.0], thickness_m = 0.1, top_m = 2.4 },
]
path = [{ points_m = [[1.0, 4.0], [1.1, 4.0]] }]
";

/// The whole drive; a fault on a loaded machine makes the black box a file beside it.
fn recording(folder: &Folder) -> String {
    let entries = std::fs::read_dir(folder.join("drives")).unwrap();
    let mut files = entries.map(|entry| entry.unwrap().path());
    let drive = files.find(|path| path.file_name().unwrap().to_string_lossy().starts_with("drive-"));
    drive.unwrap().display().to_string()
}

/// Runs a command that writes JSON, and returns its exit code, what it said, and the JSON.
fn with_json(folder: &Folder, arguments: &[&str]) -> (i32, String, Value) {
    let path = folder.join("figures.json").display().to_string();
    let outcome = run(&[arguments, &["--json", &path]].concat());
    let text = std::fs::read_to_string(&path).unwrap_or_else(|_| panic!("{}{}", outcome.out, outcome.err));
    (outcome.code, outcome.out + &outcome.err, serde_json::from_str(&text).unwrap())
}

/// A minute in the office in lockstep, the base at the end of its set of dead times: 0.08 s, lag 0.08 s, brake 0.525 m/s^2.
#[test]
fn a_drive_through_the_office_tells_the_true_values_of_its_base() {
    let _alone = Alone::wait();
    let folder = Folder::new("identify");
    let drives = folder.join("drives").display().to_string();
    let drive = ["run", "sim", "--for", "60s", "--record", &drives, "--set", "time=lockstep"];
    let base = ["--set", "sim.dead_time_part=1.0"];
    let outcome = run(&[&drive[..], &base, SMALL, PATIENT].concat());
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let file = recording(&folder);
    let (code, said, found) = with_json(&folder, &["identify", &file]);
    println!("{said}");
    assert_eq!(code, 0, "{said}");
    let mean = |key: &str| found[key]["mean"].as_f64().unwrap_or_else(|| panic!("{key}: {said}"));
    assert!((mean("dead_s") - 0.08).abs() < 0.005, "{said}");
    assert!((mean("lag_s") - 0.08).abs() < 0.01, "{said}");
    assert!((mean("turn_dead_s") - 0.08).abs() < 0.005, "{said}");
    assert!(found["brake_m_s2"]["max"].as_f64().unwrap() < 0.525 * 1.05, "{said}");
    assert!(said.contains("[actuator]\ndead_time_min_s = { value = 0.0"), "{said}");
    assert!(said.contains("robot loomo: its file contains what was measured"), "{said}");

    // Another robot file, of a base that would be quicker: found, needed, remedy, and exit code 1.
    let quick = include_str!("../launch/robots/loomo.toml")
        .replace("dead_time_max_s = { value = 0.08", "dead_time_max_s = { value = 0.03");
    let robot = folder.write("quick.toml", &quick);
    let says = [
        "actuator.dead_time_max_s: measured 0.08",
        "the file has 0.03",
        "needed: at least this",
        "put the block",
    ];
    refused(&["identify", &file, "--robot", &robot], 1, &says);
    // Commands never ceased in it.
    let (_, said, _) = with_json(&folder, &["doctor", &file]);
    assert!(said.contains("bad   watchdog: commands ceased 0 times in steady motion"), "{said}");
}

/// Drives four steps in a hall, then halts the arbiter at speed; the recording tells the same of the watchdog.
#[test]
fn steps_and_watchdog_of_a_live_base_are_measured() {
    let _alone = Alone::wait();
    let folder = Folder::new("watchdog");
    let drives = folder.join("drives").display().to_string();
    let world = format!("sim.world={}", folder.write("hall.toml", HALL));
    let arguments = ["run", "sim", "--record", &drives, "--set", &world, "--set", "sim.people=0"];
    let mut running = Running::start(sidestep(&[&arguments[..], SMALL, PATIENT].concat()));
    let domain = running.wait_for("the arbiter", |run| run.domain("arbiter"));
    running.wait_for("a command", |_| {
        let link = Link::attach(&domain, "test", 0, 0).ok()?;
        let mut commands = link.inbox(COMMAND, Keep::Newest).ok()?;
        pause(Duration::from_millis(50));
        commands.newest(&mut Step::new()).ok()?.map(|_| ())
    });
    let in_run = |arguments: &[&str]| {
        let mut command = sidestep(arguments);
        command.env("SIDESTEP_DOMAIN", &domain.prefix).env("SIDESTEP_ROOT", &domain.root);
        let outcome = Running::start(command).finish();
        println!("{}{}", outcome.out, outcome.err);
        outcome
    };
    let path = folder.join("steps.json").display().to_string();
    let steps = in_run(&["identify", "--steps", "4", "--json", &path]);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let dead = &found["dead_s"];
    assert!(dead["count"].as_u64().unwrap() >= 4, "{}{}", steps.out, steps.err);
    // Half-way between 0.02 and 0.08 s; the load of the machine delays commands in real time.
    assert!((dead["min"].as_f64().unwrap() - 0.05).abs() < 0.015, "{}", steps.out);
    assert!(found["tracking_m_s"]["count"].as_u64().unwrap() >= 1, "{}", steps.out);
    let live = in_run(&["doctor", "--base", "--yes-the-robot-may-roll"]);
    assert!(
        live.out.contains("ok    watchdog: commands ceased 1 times in steady motion"),
        "{}{}",
        live.out,
        live.err
    );
    running.signal(libc::SIGINT);
    let outcome = running.finish();
    assert!(outcome.out.contains("arbiter"), "{}{}", outcome.out, outcome.err);
    let (_, said, checks) = with_json(&folder, &["doctor", &recording(&folder)]);
    println!("{said}");
    let checks = checks["checks"].as_array().unwrap().clone();
    let watchdog = checks.iter().find(|check| check["name"] == "watchdog").unwrap();
    assert_eq!(watchdog["state"], "ok", "{watchdog:#}");
    assert!(watchdog["found"].as_str().unwrap().contains("after valid_until"), "{watchdog:#}");
}

#[test]
fn doctor_names_what_is_not_fit() {
    let folder = Folder::new("doctor");
    let (_, said, checks) = with_json(&folder, &["doctor", "--robot", "jackal"]);
    for name in [
        "shared memory",
        "runs",
        "stale runs",
        "disk",
        "cores",
        "processor",
        "clock",
        "real time",
        "locked memory",
    ] {
        assert!(said.contains(&format!("  {name}: ")), "no {name} in:\n{said}");
    }
    assert_eq!(checks["robot"], "jackal");
    let missing = folder.join("none.onnx").display().to_string();
    refused(&["doctor", "--model", &missing], 1, &["not fit for a drive: ", "model"]);
    refused(&["doctor", "--robot", "nobody"], 2, &["robot nobody", "loomo, jackal"]);
    refused(&["doctor", "--base"], 2, &["3 m of free floor", "--yes-the-robot-may-roll"]);
    refused(
        &["doctor", "--base", "--yes-the-robot-may-roll", "--speed", "7"],
        2,
        &["--speed is 7", "0.25 to 1.0"],
    );
    refused(&["doctor", "nowhere.mcap"], 3, &["nowhere.mcap"]);
    refused(&["identify", "nowhere.mcap"], 3, &["nowhere.mcap"]);
}

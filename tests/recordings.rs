//! Recordings as a user meets them: real depth imported, described, played into the live graph; a drive recorded and read.

use crate::command_line::refused;
use crate::harness::{Alone, Folder, run, run_with_summary};

#[test]
fn real_depth_drives_the_graph_and_every_command_says_open_loop() {
    let _alone = Alone::wait();
    let folder = Folder::new("walk");
    let walk = folder.join("walk.mcap").display().to_string();
    let imported = run(&["import", "tests/data/hololens", &walk, "--rate", "10"]);
    assert_eq!(imported.code, 0, "{}", imported.err);
    let info = run(&["info", &walk]);
    assert!(info.out.contains("depth") && info.out.contains("odometry"), "{}", info.out);
    let (outcome, summary) =
        run_with_summary("play", &["play", &walk, "--set", "supervision.start_ms=60000"]);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    assert_eq!(summary["open_loop"], true, "{summary:#}");
    let sent = |topic: &str| summary["topics"][topic]["sent"].as_u64().unwrap();
    // The last counts of a player that ended count once, and the arbiter ticks in recorded time too.
    assert!((50..=56).contains(&sent("depth")) && sent("local_map") + 5 >= sent("depth"), "{summary:#}");
    assert!(summary["arbiter"]["ticks"].as_u64().unwrap() > 3 * sent("depth"), "{summary:#}");
    let too_old = summary["arbiter"]["reasons"]["map too old"].as_u64().unwrap_or(0);
    assert!(
        10 * too_old < summary["arbiter"]["ticks"].as_u64().unwrap(),
        "ages fit ten frames a second: {summary:#}"
    );
    assert!(outcome.out.contains("open loop"), "{}", outcome.out);
}

/// An import is a recording of sensors: what may be asked of it, and where its results may go.
#[test]
fn no_result_takes_the_place_of_a_recording_and_what_a_recording_cannot_give_is_said() {
    let folder = Folder::new("in-place");
    let walk = folder.join("walk.mcap").display().to_string();
    assert_eq!(run(&["import", "tests/data/hololens", &walk, "--rate", "10"]).code, 0);
    let nowhere = folder.join("nowhere/page.html").display().to_string();
    let place = folder.0.display().to_string();
    for (arguments, says) in [
        (&["import", "tests/data/hololens", &walk][..], "exists and is not overwritten"),
        (&["export", &walk, &walk], "exists and is not overwritten"),
        (&["recover", &walk, &walk], "exists and is not overwritten"),
        (&["compare", &walk, "--mine", "3", "--out", &walk], "exists and is not overwritten"),
        (&["compare", &walk, "--html", &walk], "is a recording, and is not overwritten"),
        (&["replay", &walk, "--json", &walk], "is a recording, and is not overwritten"),
        (&["latency", &walk, "--trace", &walk], "is a recording, and is not overwritten"),
        (&["compare", &walk, "--html", &nowhere], "its folder does not exist; name another file"),
        (&["replay", &walk, "--json", &place], "is a folder; name another file"),
        (&["play", &walk, "--start-offset", "100"], "needed: less than the recording's graph time"),
        (&["import", "tests/data/hololens", &nowhere, "--rate", "0"], "--rate is 0, needed: more than 0"),
    ] {
        refused(arguments, 2, &[says]);
    }
    assert!(run(&["info", &walk]).out.contains("state:       complete"), "the recording is as it was");
}

/// A disk of 6 MB in memory, as far as this user may make one.
pub(crate) struct SmallDisk(pub(crate) Folder);

impl SmallDisk {
    pub(crate) fn mount() -> Option<Self> {
        let folder = Folder::new("disk");
        let status = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=6m", "tmpfs"])
            .arg(&folder.0)
            .stderr(std::process::Stdio::null())
            .status();
        status.is_ok_and(|status| status.success()).then_some(Self(folder))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(&self.0.0).status();
    }
}

#[test]
fn a_full_disk_ends_the_recording_with_a_message_and_the_drive_goes_on() {
    let _alone = Alone::wait();
    let Some(disk) = SmallDisk::mount() else {
        println!("skipped: a disk that fills needs a mount, which this user may not make");
        return;
    };
    let folder = disk.0.0.display().to_string();
    let (outcome, summary) = run_with_summary(
        "full",
        &[
            &["run", "sim", "--for", "8s", "--record", &folder, "--set", "supervision.start_ms=60000"][..],
            &["--set", "recorder.free_mb_least=0"],
        ]
        .concat(),
    );
    assert_eq!(outcome.code, 3, "{}{}", outcome.out, outcome.err);
    assert!(outcome.err.contains("the recording ended early, the drive goes on"), "{}", outcome.err);
    assert!(outcome.err.contains("free space before the next run"), "{}", outcome.err);
    assert!(summary["drive"]["distance_m"].as_f64().unwrap() > 2.0, "{summary:#}");
    assert_eq!(summary["drive"]["collisions"], 0);
    // What was written is kept under the name that the summary gives, and can be read.
    let info = run(&["info", summary["recording"].as_str().unwrap()]);
    assert_eq!(info.code, 0, "{}", info.err);
    assert!(info.out.contains("depth"), "{}", info.out);
}

#[test]
fn a_recorded_drive_has_its_latencies_and_a_trace() {
    let _alone = Alone::wait();
    let folder = Folder::new("trace");
    let recordings = folder.join("recordings").display().to_string();
    let (outcome, summary) = run_with_summary(
        "recorded",
        &["run", "sim", "--for", "3s", "--record", &recordings, "--set", "supervision.start_ms=60000"],
    );
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let recording = summary["recording"].as_str().unwrap();
    // What drove is within: robot, graph, and which model.
    let info = run(&["info", recording]);
    for file in ["graph.toml", "robot.toml", "model.toml"] {
        assert!(info.out.contains(file), "{}", info.out);
    }
    assert!(!info.out.contains("model.onnx"), "the binary holds the embedded model: {}", info.out);
    let trace = folder.join("trace.json").display().to_string();
    let latency = run(&["latency", recording, "--trace", &trace]);
    assert_eq!(latency.code, 0, "{}", latency.err);
    assert!(latency.out.contains("depth_to_command"), "{}", latency.out);
    let events: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&trace).unwrap()).unwrap();
    assert!(events["traceEvents"].as_array().unwrap().len() > 100);
    for topic in ["depth", "odometry", "local_map", "safety_map", "local_goal", "command"] {
        assert_eq!(summary["topics"][topic]["lost"], 0, "{topic}: {summary:#}");
    }
}

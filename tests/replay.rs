//! A drive again, in one process, byte for byte: with killed nodes, from a cut file, and changed on purpose.

use crate::harness::{Alone, Folder, Outcome, Running, run, run_with_summary, send_signal, sidestep};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Drives in real time, kills each of `killed` once the drive goes, and returns the recording.
fn recorded(folder: &Folder, lead: &str, time: &str, killed: &[&str]) -> PathBuf {
    let (recordings, json) = (folder.join("recordings"), folder.join("summary.json"));
    let [recordings, json] = [recordings, json].map(|path| path.display().to_string());
    let fixed = ["run", "sim", "--for", time, "--lead", lead, "--record", &recordings, "--json", &json];
    let mut running =
        Running::start(sidestep(&[&fixed[..], &["--set", "supervision.start_ms=60000"]].concat()));
    let begun = running.wait_for("the arbiter", |running| running.node("arbiter"));
    assert!(begun > 0);
    for node in killed {
        sidestep_bus::pause(std::time::Duration::from_millis(2500));
        let process = running.wait_for(node, |running| running.node(node));
        send_signal(process, libc::SIGKILL);
        running.wait_for(node, |running| running.node(node).filter(|other| *other != process));
    }
    let outcome = running.finish();
    let summary: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    PathBuf::from(summary["recording"].as_str().unwrap())
}

fn replay(file: &Path, options: &[&str]) -> (Outcome, Value) {
    let file = file.display().to_string();
    run_with_summary("replay-summary", &[&["replay", &file], options].concat())
}

/// Steps recorded, compared and differing, over all nodes.
fn steps(report: &Value) -> [u64; 3] {
    let sum = |key: &str| {
        report["nodes"].as_array().unwrap().iter().map(|node| node[1][key].as_u64().unwrap()).sum::<u64>()
    };
    [sum("recorded"), sum("compared"), sum("differing") + sum("states_differing")]
}

/// Nothing differs, and hardly a step is passed over.
#[track_caller]
fn is_exact(outcome: &Outcome, report: &Value) {
    let [recorded, compared, differing] = steps(report);
    assert_eq!((outcome.code, differing), (0, 0), "{}{}", outcome.out, outcome.err);
    assert!(recorded > 1000 && 100 * compared >= 99 * recorded, "{}", outcome.out);
}

#[test]
fn a_drive_with_every_node_killed_once_replays_byte_for_byte_under_each_lead() {
    let _alone = Alone::wait();
    for lead in ["policy", "refined"] {
        let folder = Folder::new("replay");
        let file =
            recorded(&folder, lead, "18s", &["mapper", "guard", "goal", "policy", "expert", "arbiter"]);
        let (outcome, report) = replay(&file, &[]);
        is_exact(&outcome, &report);
        for (name, node) in report["nodes"].as_array().unwrap().iter().map(|node| (&node[0], &node[1])) {
            assert!(node["compared"].as_u64().unwrap() > 100, "{name}: {}", outcome.out);
        }
        let states: u64 =
            report["nodes"].as_array().unwrap().iter().map(|node| node[1]["states"].as_u64().unwrap()).sum();
        assert!(states > 0, "states within are compared too: {}", outcome.out);
    }
}

#[test]
fn each_file_of_a_split_and_a_snapshot_replays_from_its_first_state() {
    let _alone = Alone::wait();
    let folder = Folder::new("replay-split");
    let recordings = folder.join("recordings").display().to_string();
    let mut running = Running::start(sidestep(&[
        "run",
        "sim",
        "--for",
        "14s",
        "--record",
        &recordings,
        "--set",
        "recorder.split_s=5",
        "--set",
        "supervision.start_ms=60000",
    ]));
    let domain = running.wait_for("the arbiter", |running| running.domain("arbiter"));
    sidestep_bus::pause(std::time::Duration::from_secs(12));
    let mut snapshot = sidestep(&["snapshot"]);
    snapshot.env("SIDESTEP_DOMAIN", &domain.prefix).env("SIDESTEP_ROOT", &domain.root);
    assert!(snapshot.status().unwrap().success());
    assert_eq!(running.finish().code, 0);
    let mut replayed = 0;
    for file in std::fs::read_dir(&recordings).unwrap() {
        let file = file.unwrap().path();
        let (outcome, report) = replay(&file, &[]);
        let [recorded, compared, differing] = steps(&report);
        assert_eq!(differing, 0, "{}: {}", file.display(), outcome.out);
        // The last file of a split may be too short to hold a state.
        if recorded > 1000 {
            assert_eq!(outcome.code, 0, "{}: {}", file.display(), outcome.out);
            assert!(100 * compared >= 90 * recorded, "{}: {}", file.display(), outcome.out);
            replayed += 1;
        }
    }
    assert!(replayed >= 3, "{replayed} files");
}

#[test]
fn what_was_changed_on_purpose_is_told_and_is_no_failure() {
    let _alone = Alone::wait();
    let folder = Folder::new("replay-changed");
    let file = recorded(&folder, "policy", "8s", &[]);
    let moved = |report: &Value, topic: &str| {
        report["changes"].as_array().unwrap().iter().any(|change| change["topic"] == topic)
    };
    let (outcome, report) = replay(&file, &["--set", "expert.candidates=200"]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    assert!(outcome.out.contains("changed on purpose: --set expert.candidates=200"), "{}", outcome.out);
    assert!(moved(&report, "expert_command") && !moved(&report, "local_goal"), "{}", outcome.out);
    // The policy leads: only where it was silent did the arbiter look at the other proposal.
    let arbiter = report["nodes"].as_array().unwrap().iter().find(|node| node[0] == "arbiter").unwrap();
    let [compared, differing] = ["compared", "differing"].map(|key| arbiter[1][key].as_u64().unwrap());
    assert!(10 * differing < compared, "{}", outcome.out);
    // The same model under another name changes nothing.
    let (outcome, report) = replay(&file, &["--model", "nodes/policy/model/loomo.onnx"]);
    assert!(outcome.code == 0 && report["changes"].as_array().unwrap().is_empty(), "{}", outcome.out);
    for lead in ["expert", "refined"] {
        let (outcome, report) = replay(&file, &["--lead", lead]);
        assert!(outcome.code == 0 && moved(&report, "command"), "{}{}", outcome.out, outcome.err);
    }
    // A wider memory of obstacles changes the maps, and with them everything further down.
    let (_, report) = replay(&file, &["--set", "mapper.far_m=2.0"]);
    for topic in ["local_map", "safety_map", "policy_command", "command"] {
        assert!(moved(&report, topic), "{topic}: {report:#}");
    }
}

#[test]
fn a_flipped_byte_is_found_with_topic_step_and_field() {
    let _alone = Alone::wait();
    let folder = Folder::new("replay-flipped");
    let file = recorded(&folder, "expert", "6s", &[]);
    let altered = folder.join("altered.mcap");
    alter(&file, &altered);
    let (outcome, report) = replay(&altered, &[]);
    assert_eq!(outcome.code, 1, "{}", outcome.out);
    let first = &report["first"];
    assert_eq!(
        (&first["topic"], &first["field"]),
        (&"expert_command".into(), &"twist.v_m_s".into()),
        "{report:#}"
    );
    assert!(outcome.out.contains("first difference: expert_command 40"), "{}", outcome.out);
    assert!(outcome.err.contains("differ from the recording"), "{}", outcome.err);
}

/// Writes a recording anew with another speed in proposal 40 of the expert.
fn alter(from: &Path, to: &Path) {
    use sidestep_msgs::{EXPERT_COMMAND, TOPICS};
    let origin = sidestep_recorder::Origin {
        attachments: ["graph.toml", "robot.toml", "model.toml"]
            .map(|name| (name.into(), sidestep_player::attachment(from, name).unwrap()))
            .into(),
        ..sidestep_recorder::Origin::default()
    };
    let mut writer = sidestep_recorder::Writer::create(to, &origin).unwrap();
    for entry in sidestep_player::Messages::open(from).unwrap() {
        let mut entry = entry.unwrap();
        if let Some(mut proposal) = entry.read(EXPERT_COMMAND).filter(|_| entry.header.sequence == 40) {
            proposal.twist.v_m_s += 0.25;
            entry.message = bytemuck::bytes_of(&proposal).to_vec();
        }
        writer.write(&TOPICS[entry.topic], &entry.header, &entry.message, entry.logged_ns).unwrap();
    }
    writer.complete(&[]).unwrap();
}

#[test]
fn what_cannot_be_replayed_says_why_and_what_to_do() {
    let folder = Folder::new("replay-refused");
    let walk = folder.join("walk.mcap").display().to_string();
    assert_eq!(run(&["import", "tests/data/hololens", &walk, "--rate", "10"]).code, 0);
    let text = folder.write("notes.mcap", "no recording");
    for (file, said) in [
        (walk.as_str(), "`sidestep play` it"),
        (text.as_str(), "not an MCAP file"),
        ("nowhere.mcap", "give the path of an .mcap"),
    ] {
        let outcome = run(&["replay", file]);
        assert!(outcome.code == 3 && outcome.err.contains(said), "{}", outcome.err);
    }
    let outcome = run(&["replay", &walk, "--lead", "nobody"]);
    assert!(outcome.code == 2 && outcome.err.contains("policy, expert, solved, refined"), "{}", outcome.err);
}

//! The default drive, as a newcomer sees it: half a minute in the office, under each lead.

use crate::harness::run_with_summary;
use serde_json::Value;

/// Every key of the summary that SPEC section 8 names.
fn has_all_keys(summary: &Value) {
    for stage in ["mapper", "goal", "policy", "expert", "arbiter", "depth_to_command"] {
        for key in ["count", "p50", "p90", "p99", "p999", "max", "budget", "misses"] {
            assert!(!summary["latency_ms"][stage][key].is_null(), "latency_ms.{stage}.{key} in {summary:#}");
        }
    }
    for topic in ["depth", "local_map", "command"] {
        for key in ["sent", "lost", "skipped"] {
            assert!(summary["topics"][topic][key].is_u64(), "topics.{topic}.{key} in {summary:#}");
        }
    }
    for node in ["sim", "mapper", "goal", "policy", "expert", "arbiter", "recorder"] {
        for key in ["restarts", "exit", "cpu_s", "pss_mb"] {
            assert!(!summary["nodes"][node][key].is_null(), "nodes.{node}.{key} in {summary:#}");
        }
    }
    for key in ["ticks", "modified", "stops", "reasons"] {
        assert!(!summary["arbiter"][key].is_null(), "arbiter.{key} in {summary:#}");
    }
    for key in ["distance_m", "collisions", "arrived", "min_clearance_m"] {
        assert!(!summary["drive"][key].is_null(), "drive.{key} in {summary:#}");
    }
}

fn drives_with(lead: &str) {
    let _alone = crate::harness::Alone::wait();
    let folder = crate::harness::Folder::new(&format!("drive-{lead}"));
    let recordings = folder.join("recordings").display().to_string();
    let (outcome, summary) =
        run_with_summary(&format!("lead-{lead}"), &["--lead", lead, "--record", &recordings]);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    has_all_keys(&summary);
    assert!(summary["drive"]["arrived"].as_u64().unwrap() >= 1, "{summary:#}");
    assert_eq!(summary["drive"]["collisions"], 0, "{summary:#}");
    let recording = summary["recording"].as_str().unwrap();
    assert!(std::fs::metadata(recording).is_ok_and(|file| file.len() > 100_000), "{recording}");
}

#[test]
fn the_policy_drives_through_the_office_to_its_goals() {
    drives_with("policy");
}

/// Two graphs at once, as two robots on one computer: each ends as if it were alone.
#[test]
fn two_runs_side_by_side_do_not_meet() {
    let _alone = crate::harness::Alone::wait();
    let folder = crate::harness::Folder::new("side-by-side");
    let start = |name: &str, world: &str| {
        let recordings = folder.join(name).display().to_string();
        let (world, start) = (format!("sim.world={world}"), "supervision.start_ms=60000");
        let small = ["--set", "sim.width_px=160", "--set", "sim.height_px=120"];
        let arguments =
            ["run", "sim", "--for", "5s", "--record", &recordings, "--set", &world, "--set", start];
        crate::harness::Running::start(crate::harness::sidestep(&[&arguments[..], &small].concat()))
    };
    let (mut one, mut other) = (start("one", "office"), start("other", "room"));
    let (one_domain, other_domain) =
        (one.wait_for("one", |run| run.domain("sim")), other.wait_for("the other", |run| run.domain("sim")));
    assert_ne!(one_domain, other_domain);
    for (running, name) in [(one, "one"), (other, "other")] {
        let outcome = running.finish();
        assert_eq!(outcome.code, 0, "{name}: {}{}", outcome.out, outcome.err);
        assert!(!outcome.out.contains("lost"), "{name}: {}", outcome.out);
        assert_eq!(std::fs::read_dir(folder.join(name)).unwrap().count(), 1, "one recording of {name}");
    }
}

#[test]
fn the_expert_drives_through_the_office_to_its_goals() {
    drives_with("expert");
}

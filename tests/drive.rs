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
    for node in ["sim", "mapper", "guard", "goal", "policy", "expert", "arbiter", "recorder"] {
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
    // Runs of their own folder, so that the stop reaches nobody else's; its name is short, since sockets lie in it.
    let folder = crate::harness::Folder(std::env::temp_dir().join(format!("s{}", std::process::id())));
    std::fs::create_dir_all(&folder.0).unwrap();
    let start = |name: &str, world: &str| {
        let recordings = folder.join(name).display().to_string();
        let (world, start) = (format!("sim.world={world}"), "supervision.start_ms=60000");
        let small = ["--set", "sim.width_px=160", "--set", "sim.height_px=120"];
        let arguments =
            ["run", "sim", "--for", "8s", "--record", &recordings, "--set", &world, "--set", start];
        let mut command = crate::harness::sidestep(&[&arguments[..], &small].concat());
        // A service manager that cannot be told is a line, and no reason to stand.
        command.env("XDG_RUNTIME_DIR", &folder.0).env("NOTIFY_SOCKET", "x".repeat(200));
        crate::harness::Running::start(command)
    };
    let say = |what: &str| {
        let mut command = crate::harness::sidestep(&[what]);
        command.env("XDG_RUNTIME_DIR", &folder.0);
        crate::harness::Running::start(command).finish()
    };
    let (mut one, mut other) = (start("one", "office"), start("other", "room"));
    let (one_domain, other_domain) =
        (one.wait_for("one", |run| run.domain("sim")), other.wait_for("the other", |run| run.domain("sim")));
    assert_ne!(one_domain, other_domain);
    // Which robot an operator means must be clear, but for the emergency stop, which goes to all.
    let reset = say("reset");
    assert_eq!(reset.code, 2, "{}{}", reset.out, reset.err);
    assert!(reset.err.contains("2 runs are alive; say which"), "{}", reset.err);
    assert!(
        reset.err.contains(&one_domain.prefix) && reset.err.contains(&other_domain.prefix),
        "{}",
        reset.err
    );
    let latched = |domain| {
        let link = sidestep_bus::Link::attach(domain, "test", 0, 0).ok()?;
        let mut commands = link.inbox(sidestep_msgs::COMMAND, sidestep_bus::Keep::Newest).ok()?;
        sidestep_bus::pause(std::time::Duration::from_millis(50));
        let newest = commands.newest(&mut sidestep_bus::Step::new()).ok()?;
        newest.map(|command| command.latched)
    };
    one.wait_for("a command of one", |_| latched(&one_domain));
    other.wait_for("a command of the other", |_| latched(&other_domain));
    let stop = say("estop");
    assert_eq!(stop.code, 0, "{}{}", stop.out, stop.err);
    assert_eq!(stop.out.matches("acknowledged").count(), 2, "{}", stop.out);
    one.wait_for("the latch of one", |_| latched(&one_domain).filter(|&latched| latched == 1));
    other.wait_for("the latch of the other", |_| latched(&other_domain).filter(|&latched| latched == 1));
    for (running, name) in [(one, "one"), (other, "other")] {
        let outcome = running.finish();
        assert_eq!(outcome.code, 0, "{name}: {}{}", outcome.out, outcome.err);
        assert!(outcome.err.contains("no service manager is told"), "{}", outcome.err);
        // The emergency stop also made the black box a file of its own.
        let files = std::fs::read_dir(folder.join(name)).unwrap();
        let drives =
            files.filter(|file| file.as_ref().unwrap().file_name().to_string_lossy().starts_with("drive-"));
        assert_eq!(drives.count(), 1, "one recording of {name}");
    }
}

/// A service manager's socket in the test's folder: it hears ready, signs of life, and the stop, in this order.
#[test]
fn a_service_manager_is_told_ready_alive_and_stopping() {
    let _alone = crate::harness::Alone::wait();
    let folder = crate::harness::Folder::new("notify");
    let path = folder.join("socket");
    let manager = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(std::time::Duration::from_secs(60))).unwrap();
    let heard = std::thread::spawn(move || {
        let (mut words, mut buffer) = (Vec::new(), [0; 64]);
        while words.last().is_none_or(|word| word != "STOPPING=1") {
            let size = manager.recv(&mut buffer).unwrap();
            words.push(String::from_utf8_lossy(&buffer[..size]).into_owned());
        }
        words
    });
    let recordings = folder.join("recordings").display().to_string();
    let small = ["--set", "sim.width_px=160", "--set", "sim.height_px=120"];
    let mut command = crate::harness::sidestep(&["run", "sim", "--for", "2s", "--record", &recordings]);
    command.args(small).args(["--set", "supervision.start_ms=60000"]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "400000");
    let outcome = crate::harness::Running::start(command).finish();
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    let words = heard.join().unwrap();
    let signs = words.iter().filter(|word| *word == "WATCHDOG=1").count();
    let ready = words.iter().position(|word| word == "READY=1").unwrap();
    assert!(ready < words.len() - 1 && signs >= 5, "{words:?}");
}

#[test]
fn the_expert_drives_through_the_office_to_its_goals() {
    drives_with("expert");
}

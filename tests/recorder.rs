//! The recorder in the field: killed at any moment, split, asked for the last seconds, beside another, before a full disk.

use crate::harness::{
    Alone, Folder, Outcome, PATIENT, Running, SMALL, finish, run, run_with_summary, send_signal, sidestep,
};
use crate::recordings::SmallDisk;
use serde_json::Value;
use sidestep_bus::{DomainName, environment, host_ns, pause};
use sidestep_msgs::{CLOCK, ODOMETRY, PATH, RANGES, STATE_ARBITER, STATE_GOAL, STATE_MAPPER};
use sidestep_player::{Entry, Info, Messages};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

const SECOND_NS: u64 = 1_000_000_000;
fn drive(folder: &Path, more: &[&str]) -> Command {
    let folder = folder.display().to_string();
    sidestep(&[&["run", "sim", "--record", &folder][..], SMALL, PATIENT, more].concat())
}

/// Runs a command of an operator on this run alone.
fn say(domain: &DomainName, arguments: &[&str]) -> Outcome {
    let mut command = sidestep(arguments);
    command.env(environment::DOMAIN, &domain.prefix).env(environment::ROOT, &domain.root);
    finish(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
}

/// Files of a folder whose name begins so, sorted.
fn files(folder: &Path, start: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path());
    let named = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(start);
    let mut files: Vec<_> = entries.filter(named).collect();
    files.sort();
    files
}

fn entries(path: &Path) -> Vec<Entry> {
    Messages::open(path).unwrap().map(Result::unwrap).collect()
}

/// SplitMix64.
fn draw(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// What a file of a recorder killed at host time `killed_ns` kept: `[ns]` from its first message to the kill, and from its
/// last to the kill. Dense topics must have no gap.
fn kept(path: &Path, killed_ns: u64) -> Option<(u64, u64)> {
    let info = Info::read(path).unwrap();
    let offset_ns: i64 = info.metadata["sidestep"]["mono_to_wall_ns"].parse().unwrap();
    let entries = entries(path);
    let killed_ns = killed_ns.saturating_add_signed(offset_ns);
    for topic in [ODOMETRY.index, RANGES.index] {
        let headers: Vec<_> =
            entries.iter().filter(|entry| entry.topic == topic).map(|entry| entry.header).collect();
        for pair in headers.windows(2).filter(|pair| pair[0].incarnation == pair[1].incarnation) {
            assert_eq!(pair[1].sequence, pair[0].sequence + 1, "{}: {}", path.display(), pair[0].sequence);
        }
    }
    let (first, last) = (entries.first()?, entries.last()?);
    Some((killed_ns.saturating_sub(first.logged_ns), killed_ns.saturating_sub(last.logged_ns)))
}

/// The file that the recorder of this process number writes.
fn written_by(process: u32) -> Option<PathBuf> {
    let open = std::fs::read_dir(format!("/proc/{process}/fd")).ok()?.flatten();
    let paths = open.filter_map(|entry| std::fs::read_link(entry.path()).ok());
    paths.into_iter().find(|path| path.extension().is_some_and(|end| end == "active"))
}

#[test]
fn a_recorder_killed_at_any_moment_loses_at_most_the_last_second() {
    let _alone = Alone::wait();
    let folder = Folder::new("recorder-kills");
    // On a machine that others use too, a recorder that gives way may not run for a second.
    let graph =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/launch/graphs/sim.toml")).unwrap();
    let graph = folder.write("sim.toml", &graph.replace("nice = 10", "nice = 0"));
    let recordings = folder.join("recordings").display().to_string();
    let arguments = [&["run", &graph, "--record", &recordings][..], SMALL, PATIENT].concat();
    let mut running = Running::start(sidestep(&arguments));
    let (count, mut seed) = (20, 5);
    println!("{count} kills, seed {seed}");
    let mut checked = 0;
    for _ in 0..count {
        let (process, path) = running.wait_for("a recording", |running| {
            let process = running.node("recorder")?;
            Some((process, written_by(process)?))
        });
        pause(Duration::from_millis(200 + draw(&mut seed) % 2800));
        let killed_ns = host_ns();
        send_signal(process, libc::SIGKILL);
        running.wait_for("its end", |running| (running.node("recorder") != Some(process)).then_some(()));
        let Some((since_ns, missing_ns)) = kept(&path, killed_ns) else { continue };
        if since_ns > SECOND_NS {
            checked += 1;
            assert!(missing_ns <= SECOND_NS, "{}: the last {missing_ns} ns are missing", path.display());
        }
    }
    running.signal(libc::SIGTERM);
    let outcome = running.finish();
    assert!(checked >= count / 3, "{checked} of {count} recorders lived for a second: {}", outcome.err);
}

#[test]
fn each_file_of_a_split_begins_with_fresh_states_and_what_still_holds() {
    let _alone = Alone::wait();
    let folder = Folder::new("recorder-split");
    let recordings = folder.join("recordings");
    let folder_name = recordings.display().to_string();
    let fixed = ["run", "sim", "--for", "10s", "--record", &folder_name, "--set", "recorder.split_s=4"];
    let (outcome, _) = run_with_summary("recorder-split-summary", &[&fixed[..], SMALL, PATIENT].concat());
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let files = files(&recordings, "drive-");
    assert!(files.len() >= 3, "{files:?}");
    let mut before: Option<Entry> = None;
    for (number, path) in files.iter().enumerate() {
        assert!(path.display().to_string().ends_with(&format!("_{number}.mcap")), "{files:?}");
        assert!(Info::read(path).unwrap().complete, "{}", path.display());
        let entries = entries(path);
        let of = |topic: usize| entries.iter().filter(move |entry| entry.topic == topic);
        // The end of the drive may cut the last file short of anything.
        let span = of(ODOMETRY.index).next().zip(of(ODOMETRY.index).next_back());
        let lasts_ns = span.map_or(0, |(first, last)| last.header.now_ns - first.header.now_ns);
        if number + 1 == files.len() && lasts_ns < SECOND_NS {
            continue;
        }
        assert!(of(PATH.index).count() > 0 && of(CLOCK.index).count() > 0, "{}", path.display());
        let (first, last) = span.unwrap();
        if let Some(before) = before {
            assert_eq!(
                first.header.sequence,
                before.header.sequence + 1,
                "nothing is lost between two files"
            );
        }
        before = Some(last.clone());
        // Asked for by the file itself: an old state at its head would be of long before. A file may begin between two
        // messages of odometry, so that a state asked for at once is a little older than the first.
        for topic in [STATE_MAPPER.index, STATE_GOAL.index, STATE_ARBITER.index] {
            let fresh = of(topic).find(|entry| entry.header.now_ns + SECOND_NS / 10 >= first.header.now_ns);
            let late =
                fresh.map_or(u64::MAX, |entry| entry.header.now_ns.saturating_sub(first.header.now_ns));
            assert!(late < SECOND_NS, "{}: topic {topic} after {late} ns", path.display());
        }
    }
}

fn snapshot_cause(path: &Path) -> (String, f64) {
    let info = Info::read(path).unwrap();
    assert!(info.complete && info.damage.is_none(), "{info:?}");
    let origin = &info.metadata["sidestep"];
    (origin["snapshot"].clone(), origin["held_s"].parse().unwrap())
}

/// Asks for a snapshot, then stops the robot; tells what was said, and every snapshot with its cause and the seconds it holds.
fn asked_then_stopped(folder: &Folder) -> (String, Vec<(PathBuf, String, f64)>) {
    let mut running = Running::start(drive(&folder.0, &["--set", "recorder.whole_drive=false"]));
    let domain = running.wait_for("its domain", |running| running.domain("arbiter"));
    running.wait_for("its recorder", |running| running.node("recorder"));
    pause(Duration::from_secs(4));
    let said = say(&domain, &["snapshot"]);
    assert_eq!(said.code, 0, "{}{}", said.out, said.err);
    let stop = say(&domain, &["estop"]);
    assert_eq!(stop.code, 0, "{}", stop.err);
    let whole = || -> Vec<_> {
        let files = files(&folder.0, "snapshot-").into_iter();
        files.filter(|path| path.extension().unwrap() == "mcap").collect()
    };
    running.wait_for("the second file", |_| (whole().len() >= 2).then_some(()));
    pause(Duration::from_secs(1));
    running.signal(libc::SIGTERM);
    running.finish();
    assert!(files(&folder.0, "drive-").is_empty());
    let kept = files(&folder.0, "snapshot-").into_iter();
    let told = kept.map(|path| {
        let (cause, held_s) = snapshot_cause(&path);
        (path, cause, held_s)
    });
    (said.out, told.collect())
}

#[test]
fn the_last_seconds_are_kept_when_asked_and_when_the_robot_is_stopped() {
    let _alone = Alone::wait();
    let expected = ["asked", "emergency stop latched"];
    for attempt in 1..=4 {
        let folder = Folder::new(&format!("recorder-snapshot-{attempt}"));
        let (said, kept) = asked_then_stopped(&folder);
        let causes: Vec<_> = kept.iter().map(|(_, cause, _)| cause.as_str()).collect();
        // A machine that stalls is a trouble of its own, and what follows within seconds belongs to it.
        if causes.iter().any(|cause| !expected.contains(cause)) {
            println!("attempt {attempt}: {causes:?}");
            continue;
        }
        assert_eq!(causes, expected, "one trouble, one file");
        let (asked, _, held_s) = &kept[0];
        assert!(*held_s > 1.0, "{held_s} s");
        assert!(said.contains(&asked.display().to_string()) && said.contains("the last"), "{said}");
        let states = entries(asked).iter().filter(|entry| entry.topic == STATE_MAPPER.index).count();
        assert!(states > 0, "it can be replayed");
        return;
    }
    panic!("the machine stalled in every attempt");
}

#[test]
fn a_snapshot_without_a_black_box_is_refused_with_the_remedy() {
    let _alone = Alone::wait();
    let folder = Folder::new("recorder-no-box");
    let mut running = Running::start(drive(&folder.0, &["--set", "recorder.black_box_mb=0"]));
    let domain = running.wait_for("its domain", |running| running.domain("arbiter"));
    let said = say(&domain, &["snapshot"]);
    assert_eq!(said.code, 3, "{}{}", said.out, said.err);
    assert!(said.err.contains("black box is off") && said.err.contains("black_box_mb=256"), "{}", said.err);
    running.signal(libc::SIGTERM);
    running.finish();
}

#[test]
fn a_second_recorder_records_beside_the_first_and_ends_with_the_run() {
    let _alone = Alone::wait();
    let folder = Folder::new("recorder-beside");
    let mut running = Running::start(drive(&folder.join("first"), &["--for", "12s"]));
    let domain = running.wait_for("its domain", |running| running.domain("arbiter"));
    let beside = folder.join("beside");
    let name = beside.display().to_string();
    let timed = say(&domain, &["record", "--folder", &name, "--topics", "odometry,state/*", "--for", "2s"]);
    assert_eq!(timed.code, 0, "{}{}", timed.out, timed.err);
    let file = files(&beside, "drive-").remove(0);
    let info = Info::read(&file).unwrap();
    assert!(info.complete && info.attachments.contains_key("graph.toml"), "{info:?}");
    let entries = entries(&file);
    assert!(entries.iter().filter(|entry| entry.topic == ODOMETRY.index).count() > 100);
    assert!(entries.iter().any(|entry| entry.topic == STATE_MAPPER.index));
    assert!(
        entries
            .iter()
            .all(|entry| { entry.topic == ODOMETRY.index || entry.row().name.starts_with("state/") })
    );
    // The second one has no time given: it ends with the run.
    let until_end = say(&domain, &["record", "--folder", &name, "--exclude", "depth"]);
    assert_eq!(until_end.code, 0, "{}{}", until_end.out, until_end.err);
    assert!(until_end.out.contains("none lost"), "{}", until_end.out);
    let outcome = running.finish();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let all = files(&beside, "drive-");
    assert!(all.len() == 2 && all.iter().all(|path| Info::read(path).unwrap().complete), "{all:?}");
}

#[test]
fn an_unknown_topic_is_refused_with_the_list() {
    for arguments in [["record", "--topics", "dept"], ["record", "--exclude", "dept"]] {
        let outcome = run(&arguments);
        assert_eq!(outcome.code, 2, "{}", outcome.err);
        assert!(outcome.err.contains("dept") && outcome.err.contains("odometry"), "{}", outcome.err);
    }
    let outcome = run(&["check", "sim", "--set", "recorder.topics=[\"dept\"]"]);
    assert_eq!(outcome.code, 2, "{}", outcome.err);
    assert!(outcome.err.contains("no topic is named dept"), "{}", outcome.err);
}

#[test]
fn a_recording_ends_in_order_before_the_disk_is_full() {
    let _alone = Alone::wait();
    let Some(disk) = SmallDisk::mount() else {
        println!("skipped: a disk that fills needs a mount, which this user may not make");
        return;
    };
    let folder = disk.0.0.display().to_string();
    let fixed = ["run", "sim", "--for", "8s", "--record", &folder, "--set", "recorder.free_mb_least=3"];
    let (outcome, summary): (Outcome, Value) =
        run_with_summary("recorder-space", &[&fixed[..], &["--set", "supervision.start_ms=60000"]].concat());
    assert_eq!(outcome.code, 3, "{}{}", outcome.out, outcome.err);
    assert!(outcome.err.contains("MB free, needed: 3 MB; free space"), "{}", outcome.err);
    let path = PathBuf::from(summary["recording"].as_str().unwrap());
    assert!(path.extension().unwrap() == "mcap" && outcome.err.contains(&path.display().to_string()));
    assert!(Info::read(&path).unwrap().complete, "{}", path.display());
    assert!(summary["drive"]["distance_m"].as_f64().unwrap() > 2.0, "the drive goes on: {summary:#}");
}

/// The shipped simulation without its recorder.
fn without_recorder(folder: &Folder) -> String {
    let text =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/launch/graphs/sim.toml")).unwrap();
    let mut graph: toml::Table = text.parse().unwrap();
    graph["nodes"].as_table_mut().unwrap().remove("recorder");
    folder.write("graph.toml", &toml::to_string(&graph).unwrap())
}

/// Prints the latency with and without a recorder, in turn; `SIDESTEP_ROUNDS` such pairs of drives (one without it).
#[test]
fn a_recorded_drive_loses_nothing_and_its_latency_stands_beside_that_of_one_without() {
    let _alone = Alone::wait();
    let folder = Folder::new("interleaved");
    let (plain, recordings) = (without_recorder(&folder), folder.join("recordings").display().to_string());
    let rounds = std::env::var("SIDESTEP_ROUNDS").map_or(1, |rounds| rounds.parse().unwrap());
    let p99_ms = |graph: &str, more: &[&str]| {
        let arguments = ["run", graph, "--for", "6s", "--set", "supervision.start_ms=60000"];
        let (outcome, summary) = run_with_summary("interleaved-summary", &[&arguments, more].concat());
        assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
        let latency = &summary["latency_ms"]["depth_to_command"];
        assert!(latency["count"].as_u64().unwrap() > 150, "{summary:#}");
        for topic in ["depth", "odometry", "local_map", "safety_map", "command"] {
            assert_eq!(summary["topics"][topic]["lost"], 0, "{topic}: {summary:#}");
        }
        latency["p99"].as_f64().unwrap()
    };
    let mut pairs: Vec<[f64; 2]> =
        (0..rounds).map(|_| [p99_ms("sim", &["--record", &recordings]), p99_ms(&plain, &[])]).collect();
    pairs.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
    for [with, without] in &pairs {
        println!("depth_to_command p99: {with:.2} ms with a recorder, {without:.2} ms without");
    }
    let [with, without] = pairs[pairs.len() / 2];
    println!("median of {rounds} ratios: {:.2}", with / without);
}

//! Recordings played as users of bag tools expect: in lockstep, in part, by the keyboard; and saved from a cut.

use crate::command_line::refused;
use crate::harness::{Alone, Folder, Running, run, run_with_summary, sidestep};
use sidestep_bus::{Keep, Link, Step};
use sidestep_msgs::{CLOCK, Clock, DEPTH};
use sidestep_player::{Entry, Info, KEYS_SOCKET, Key, Ordered};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

/// What is compared: every topic that does not speak of host time.
const TOPICS: &[&str] = &[
    "clock",
    "odometry",
    "ranges",
    "depth",
    "path",
    "local_map",
    "safety_map",
    "local_goal",
    "policy_command",
    "expert_command",
    "command",
];
/// Frames of the walk in `tests/data/hololens`, recorded at 10 Hz.
const FRAMES: u64 = 56;

fn walk(folder: &Folder) -> String {
    let walk = folder.join("walk.mcap").display().to_string();
    let imported = run(&["import", "tests/data/hololens", &walk, "--rate", "10"]);
    assert_eq!(imported.code, 0, "{}", imported.err);
    walk
}

/// Plays in lockstep with a recorder into a folder; the recording that comes of it.
fn in_lockstep(folder: &Folder, name: &str, walk: &str, more: &[&str]) -> PathBuf {
    let folder = folder.join(name).display().to_string();
    let patience = ["--set", "supervision.start_ms=60000", "--set", "supervision.hang_ms=10000"];
    let fixed = [&["play", walk, "--lockstep", "--record", &folder][..], &patience].concat();
    let (outcome, summary) = run_with_summary(name, &[&fixed[..], more].concat());
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    PathBuf::from(summary["recording"].as_str().unwrap())
}

fn entries(file: &Path) -> Vec<Vec<Entry>> {
    let all: Vec<_> = Ordered::open(file).unwrap().map(Result::unwrap).collect();
    let of = |name: &&str| all.iter().filter(|entry| entry.row().name == *name).cloned().collect();
    TOPICS.iter().map(of).collect()
}

fn is_same(one: &Entry, other: &Entry) -> bool {
    let key = |entry: &Entry| {
        let header = &entry.header;
        (header.now_ns, header.sequence, header.source_frame, header.status, header.epoch, header.inputs)
    };
    one.message == other.message && key(one) == key(other)
}

#[test]
fn a_recording_in_lockstep_gives_the_same_bytes_twice_and_no_message_is_lost() {
    let _alone = Alone::wait();
    let folder = Folder::new("play-lockstep");
    let walk = walk(&folder);
    let files = [in_lockstep(&folder, "one", &walk, &[]), in_lockstep(&folder, "two", &walk, &[])];
    let [one, two] = [entries(&files[0]), entries(&files[1])];
    for (name, (one, two)) in TOPICS.iter().zip(one.iter().zip(&two)) {
        assert_eq!(one.len(), two.len(), "{name}");
        let differs = one.iter().zip(two).position(|(one, two)| !is_same(one, two));
        assert_eq!(differs, None, "{name}: the first difference of {}", one.len());
        let whole = one.iter().zip(1..).all(|(entry, number)| entry.header.sequence == number);
        assert!(whole, "{name}: not every message of {} is in the recording", one.len());
    }
    let count = |name: &str| one[TOPICS.iter().position(|topic| *topic == name).unwrap()].len() as u64;
    for name in ["depth", "local_map", "safety_map", "local_goal", "policy_command", "expert_command"] {
        assert_eq!(count(name), FRAMES, "{name}");
    }
    // Every tick of 5.5 s and every frame has its command.
    assert!(count("command") >= 550 + FRAMES, "{} commands", count("command"));
    for file in &files {
        // Heartbeats go by host time, which waits for nobody.
        let mut lost = Info::read(file).unwrap().lost();
        lost.retain(|topic, _| !topic.starts_with("health/"));
        assert!(lost.is_empty(), "{lost:?}");
    }
}

#[test]
fn a_part_of_a_recording_is_played_with_the_topics_that_were_asked_for() {
    let _alone = Alone::wait();
    let folder = Folder::new("play-part");
    let walk = walk(&folder);
    let file = in_lockstep(
        &folder,
        "part",
        &walk,
        &["--start-offset", "1", "--duration", "2", "--exclude", "ranges"],
    );
    let info = Info::read(&file).unwrap();
    let count = |name: &str| {
        info.channels.iter().find(|channel| channel.topic == name).map_or(0, |channel| channel.count)
    };
    assert_eq!((count("depth"), count("local_map"), count("ranges")), (20, 20, 0), "{}", info.text());
    assert!((190..=210).contains(&count("odometry")), "{}", info.text());
}

#[test]
fn what_cannot_be_played_is_refused_with_what_can() {
    let folder = Folder::new("play-refused");
    let walk = walk(&folder);
    let cases: [(&[&str], &[&str]); 8] = [
        (&["--topics", "dept"], &["\"dept\"", "depth, scan, odometry, ranges, path, target"]),
        (&["--topics", "scan"], &["of scan the recording holds nothing", "it holds: depth"]),
        (&["--exclude", "command"], &["needed: a topic of the driver"]),
        (&["--remap", "odometry"], &["CHANNEL:=TOPIC"]),
        (&["--remap", "depth:=odometry"], &["takes sidestep/Odometry/1", "of this recording fit: odometry"]),
        (&["--remap", "gps:=odometry"], &["not in the recording"]),
        (&["--duration", "0"], &["player.duration_s is 0, needed"]),
        (&["--lockstep", "--rate", "2"], &["--lockstep", "--rate"]),
    ];
    for (options, needed) in cases {
        refused(&[&["play", &walk], options].concat(), 2, needed);
    }
}

#[test]
fn keys_hold_the_playback_step_it_and_let_it_go() {
    let _alone = Alone::wait();
    let folder = Folder::new("play-keys");
    let walk = walk(&folder);
    let fixed = ["play", &walk, "--start-paused", "--set", "supervision.start_ms=60000", "--rate", "4"];
    let mut running = Running::start(sidestep(&fixed));
    let domain = running.wait_for("the player", |running| running.domain("player"));
    let link = running.wait_for("a link", |_| Link::attach(&domain, "test", 0, 0).ok());
    let mut clocks = link.inbox(CLOCK, Keep::Newest).unwrap();
    let mut depth = link.inbox(DEPTH, Keep::All).unwrap();
    let socket = UnixDatagram::unbound().unwrap();
    let press = |key: Key| socket.send_to(&[key.byte()], domain.root.join(KEYS_SOCKET)).unwrap();
    let mut newest: Option<Clock> = None;
    let stands = running.wait_for("a clock that stands", |_| {
        newest = clocks.newest(&mut Step::new()).unwrap().map(|word| *word).or(newest);
        newest.filter(|word| word.paused == 1)
    });
    assert!(depth.next(&mut Step::new()).unwrap().is_none(), "nothing is shown before a key");
    let mut before_ns = stands.graph_ns;
    for number in 1..=3 {
        press(Key::Step);
        let stamp_ns = running.wait_for("one frame", |_| {
            depth.next(&mut Step::new()).unwrap().map(|frame| {
                assert_eq!(frame.header().sequence, number);
                frame.header().now_ns
            })
        });
        let word = running.wait_for("its time", |_| {
            newest = clocks.newest(&mut Step::new()).unwrap().map(|word| *word).or(newest);
            newest.filter(|word| word.graph_ns == stamp_ns)
        });
        assert!(word.paused == 1 && word.graph_ns >= before_ns, "{word:?}");
        before_ns = word.graph_ns;
        assert!(depth.next(&mut Step::new()).unwrap().is_none(), "one frame per key");
    }
    press(Key::Faster);
    press(Key::Pause);
    let word = running.wait_for("time that goes on", |_| {
        newest = clocks.newest(&mut Step::new()).unwrap().map(|word| *word).or(newest);
        newest.filter(|word| word.paused == 0)
    });
    assert!((word.rate - 4.4).abs() < 1e-9, "{word:?}");
    let outcome = running.finish();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
}

#[test]
fn a_recording_that_was_cut_is_recovered_beside_it_and_says_what_was_lost() {
    let folder = Folder::new("recover");
    let walk = walk(&folder);
    let whole = std::fs::read(&walk).unwrap();
    let cut = folder.join("cut.mcap.active");
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let name = cut.display().to_string();
    let saved = run(&["recover", &name]);
    assert_eq!(saved.code, 3, "{}{}", saved.out, saved.err);
    assert!(
        saved.out.contains("messages over") && saved.out.contains("bytes could not be read"),
        "{}",
        saved.out
    );
    assert!(saved.err.contains("not all of it could be saved"), "{}", saved.err);
    let copy = folder.join("cut-recovered.mcap");
    let info = Info::read(&copy).unwrap();
    assert!(info.complete && info.messages > 100, "{}", info.text());
    assert_eq!(std::fs::read(&cut).unwrap(), whole[..whole.len() / 2], "the original stays as it is");
    // Again: nothing is overwritten, and what is complete loses nothing.
    refused(&["recover", &name], 2, &["cut-recovered.mcap", "not overwritten"]);
    let again = folder.join("again.mcap").display().to_string();
    let second = run(&["recover", &copy.display().to_string(), &again]);
    assert_eq!(second.code, 0, "{}{}", second.out, second.err);
    assert!(second.out.contains("nothing that it holds was lost"), "{}", second.out);
    assert_eq!(Info::read(Path::new(&again)).unwrap().messages, info.messages);
    refused(&["recover", "Cargo.toml"], 3, &["Cargo.toml", "not an MCAP file"]);
    assert!(!Path::new("Cargo-recovered.mcap").exists());
}

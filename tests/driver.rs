//! Drivers in other languages: layouts, the launcher's care for programs of their own, and the same bytes as the simulator's.

use crate::harness::{Alone, Folder, Outcome, Running, run, run_with_summary, send_signal, sidestep};
use sidestep_bus::{DomainName, Inbox, Keep, Link, Step, environment, host_ns};
use sidestep_msgs::{
    CLOCK, COMMAND, Command, DEPTH, Field, Header, Message, ODOMETRY, Odometry, PATH, RANGES, Reason, Topic,
    TopicVisitor, visit_topics,
};
use sidestep_player::{Entry, Ordered};
use std::collections::{BTreeMap, BTreeSet};
use std::convert::Infallible;
use std::path::Path;
use std::process::Stdio;

/// Patience with slow starts on a loaded machine.
const PATIENT: &[&str] = &["--set", "supervision.start_ms=60000"];

/// The interpreter that has the package, or a line that says what is missing.
fn python() -> Option<String> {
    let program = std::env::var("SIDESTEP_PYTHON").unwrap_or_else(|_| "python3".into());
    let mut command = std::process::Command::new(&program);
    command.args(["-c", "import iceoryx2"]).stdout(Stdio::null()).stderr(Stdio::null());
    if command.status().is_ok_and(|status| status.success()) {
        return Some(program);
    }
    println!("skipped: no package iceoryx2; `pip install iceoryx2==0.10.0`, or set SIDESTEP_PYTHON");
    None
}

/// Runs a command that must fail with this code and say all of this.
pub(crate) fn refused(outcome: &Outcome, code: i32, says: &[&str]) {
    assert_eq!(outcome.code, code, "{}{}", outcome.out, outcome.err);
    for text in says {
        assert!(outcome.err.contains(text), "no \"{text}\" in:\n{}", outcome.err);
    }
}

/// Name, offset and size of every field of every structure.
#[derive(Default)]
struct Offsets {
    lines: Vec<String>,
    seen: BTreeSet<String>,
}

impl Offsets {
    fn structure(&mut self, name: &str, fields: &'static [Field]) {
        if !self.seen.insert(name.to_owned()) {
            return;
        }
        for field in fields {
            if !field.record_name.is_empty() {
                self.structure(field.record_name, field.record);
            }
            self.lines.push(format!("{name} {} {} {}", field.name, field.offset, field.size));
        }
    }
}

impl TopicVisitor for Offsets {
    type Error = Infallible;
    fn visit<M: Message>(&mut self, _topic: Topic<M>) -> Result<(), Infallible> {
        self.structure(M::NAME.split('/').nth(1).unwrap(), M::FIELDS);
        Ok(())
    }
}

/// Compiles a C program beside the printed header and returns it; `None` without a compiler.
fn compiled(folder: &Folder, name: &str, source: &str) -> Option<std::process::Command> {
    if std::process::Command::new("cc").arg("--version").stdout(Stdio::null()).status().is_err() {
        println!("skipped: no C compiler");
        return None;
    }
    folder.write("sidestep.h", &run(&["interface", "--c"]).out);
    let source = folder.write(&format!("{name}.c"), source);
    let program = folder.join(name);
    let mut compiler = std::process::Command::new("cc");
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-o"]).arg(&program).arg(source);
    let output = compiler.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(std::process::Command::new(program))
}

#[test]
fn a_c_program_sees_every_field_where_it_is() {
    let folder = Folder::new("c-offsets");
    let mut offsets = Offsets::default();
    offsets.structure("Header", Header::FIELDS);
    let Ok(()) = visit_topics(&mut offsets);
    let print = |line: &String| {
        let words: Vec<_> = line.split(' ').collect();
        let (structure, field) = (words[0], words[1]);
        format!(
            "printf(\"{structure} {field} %zu %zu\\n\", offsetof({structure}, {field}), sizeof((({structure} *)0)->{field}));\n"
        )
    };
    let prints: String = offsets.lines.iter().map(print).collect();
    let source =
        format!("#include \"sidestep.h\"\n#include <stdio.h>\nint main(void) {{\n{prints}return 0;\n}}\n");
    let Some(mut program) = compiled(&folder, "offsets", &source) else { return };
    let printed = String::from_utf8(program.output().unwrap().stdout).unwrap();
    assert!(offsets.lines.len() > 150, "{}", offsets.lines.len());
    assert_eq!(printed.lines().collect::<Vec<_>>(), offsets.lines);
}

#[test]
fn the_c_example_brakes_when_a_command_is_over() {
    let folder = Folder::new("c-example");
    let source = include_str!("../tools/driver/command.c");
    let Some(mut program) = compiled(&folder, "command", source) else { return };
    let mut command =
        Command { valid_until_ns: 80_000_000, reason: Reason::Slowed as u32, ..Command::default() };
    (command.twist.v_m_s, command.twist.w_rad_s) = (0.5, -0.25);
    std::fs::write(folder.join("commands.bin"), bytemuck::bytes_of(&command)).unwrap();
    program.stdin(std::fs::File::open(folder.join("commands.bin")).unwrap());
    let printed = String::from_utf8(program.output().unwrap().stdout).unwrap();
    let says = "0.500 m/s -0.250 rad/s, then 0.000 m/s 0.000 rad/s: stop, slowed for a cell that is not known free\n";
    assert_eq!(printed, says);
}

#[test]
fn python_names_the_transport_that_is_built_in() {
    let python = run(&["interface", "--python"]).out;
    let version = python.split("ICEORYX2 = \"").nth(1).unwrap().split('"').next().unwrap();
    assert!(include_str!("../Cargo.toml").contains(&format!("iceoryx2 = \"={version}\"")), "{version}");
}

#[test]
fn a_new_robot_begins_with_files_that_are_valid_and_never_overwritten() {
    let folder = Folder::new("init");
    let robot = folder.join("robot").display().to_string();
    let made = run(&["init", &robot, "--python"]);
    assert_eq!(made.code, 0, "{}", made.err);
    let check = run(&["check", &format!("{robot}/graph.toml")]);
    assert_eq!(check.code, 0, "{}", check.err);
    assert!(check.out.contains("driver; robot loomo"), "{}", check.out);
    std::fs::write(format!("{robot}/robot.toml"), "mine").unwrap();
    refused(&run(&["init", &robot]), 2, &["graph.toml is there already and is kept"]);
    std::fs::remove_file(format!("{robot}/graph.toml")).unwrap();
    refused(&run(&["init", &robot]), 2, &["robot.toml is there already"]);
    assert_eq!(std::fs::read_to_string(format!("{robot}/robot.toml")).unwrap(), "mine");
    assert!(!Path::new(&format!("{robot}/graph.toml")).exists(), "all or nothing");
}

/// The shipped graph of a robot with this driver.
pub(crate) fn graph_with(folder: &Folder, command: &[&str]) -> String {
    let shipped = include_str!("../launch/graphs/robot.toml");
    let graph = shipped.replace("[\"/usr/local/lib/sidestep/driver\"]", &format!("{command:?}"));
    let recordings = folder.join("recordings").display().to_string();
    folder.write("graph.toml", &graph.replace("folder = \"recordings\"", &format!("folder = {recordings:?}")))
}

#[test]
fn a_program_that_cannot_be_started_is_named_before_anything_starts() {
    let folder = Folder::new("programs");
    for program in ["./nowhere", "no-such-program-in-path"] {
        let graph = graph_with(&folder, &[program]);
        refused(
            &run(&["run", &graph]),
            2,
            &["external.driver.command", program, "is not found; needed: a path"],
        );
    }
    folder.write("plain.sh", "#!/bin/sh\n");
    let graph = graph_with(&folder, &["./plain.sh"]);
    refused(&run(&["run", &graph]), 2, &["plain.sh is not executable; `chmod +x"]);
    let graph = graph_with(&folder, &["true"]);
    let text = std::fs::read_to_string(&graph).unwrap() + "writes = [\"smell\"]\n";
    std::fs::write(&graph, text).unwrap();
    refused(&run(&["check", &graph]), 2, &["external.driver.writes: no topic is named smell"]);
}

#[test]
fn a_driver_that_never_speaks_is_given_up() {
    let _alone = Alone::wait();
    let folder = Folder::new("mute");
    let graph = graph_with(&folder, &["sleep", "1000"]);
    let limits = ["--set", "supervision.start_ms=4000", "--set", "supervision.restarts_most=0"];
    let outcome = run(&[&["run", &graph], &limits[..]].concat());
    refused(
        &outcome,
        1,
        &["driver | not ready in time: neither a message nor a heartbeat", "driver was given up: signal 9"],
    );
}

/// The example driver in a folder of its own, changed a little.
fn example(name: &str, change: impl Fn(&str) -> String) -> Option<(Folder, String)> {
    let python = python()?;
    let folder = Folder::new(name);
    folder.write("sidestep.py", &run(&["interface", "--python"]).out);
    let driver = folder.write("driver.py", &change(include_str!("../tools/driver/driver.py")));
    let graph = graph_with(&folder, &[&python, &driver]);
    Some((folder, graph))
}

#[test]
fn a_second_writer_of_a_topic_is_refused() {
    let Some((_folder, graph)) = example("second", str::to_owned) else { return };
    let _alone = Alone::wait();
    let text = std::fs::read_to_string(&graph).unwrap();
    let (_, driver) = text.split_once("[external.driver]").unwrap();
    std::fs::write(&graph, format!("{text}\n[external.camera]{driver}")).unwrap();
    let outcome = run(&[&["run", &graph, "--set", "supervision.restarts_most=0"], PATIENT].concat());
    refused(&outcome, 3, &["cannot write it", "a topic has one writer", "was given up: exit 3"]);
}

#[test]
fn a_driver_of_another_layout_is_refused() {
    let Some((folder, graph)) = example("layout", str::to_owned) else { return };
    let _alone = Alone::wait();
    let module = std::fs::read_to_string(folder.join("sidestep.py")).unwrap();
    let hash = format!("{:016x}", Odometry::LAYOUT_HASH);
    folder.write("sidestep.py", &module.replace(&hash, "0123456789abcdef"));
    let outcome = run(&[&["run", &graph], PATIENT].concat());
    let found = format!("topic odometry: layout here is 0123456789abcdef, of the run {hash};");
    refused(&outcome, 2, &[&found, "print this module again with `sidestep interface --python`"]);
    assert!(outcome.err.contains("driver was given up: exit 2"), "{}", outcome.err);
}

/// A run with the example driver, with readers of what it says and of what it is told.
struct Hall {
    running: Running,
    link: Link,
    commands: Inbox<Command>,
    odometry: Inbox<Odometry>,
    step: Step,
    folder: Folder,
    _alone: Alone,
}

/// Process number and domain of the driver.
fn driver(running: &Running) -> Option<(u32, DomainName)> {
    let launcher = running.launcher();
    let children = std::fs::read_to_string(format!("/proc/{launcher}/task/{launcher}/children")).ok()?;
    children.split_whitespace().find_map(|id| {
        let text = std::fs::read(format!("/proc/{id}/environ")).ok()?;
        let text = String::from_utf8_lossy(&text).into_owned();
        let value = |name: &str| {
            text.split('\0').find_map(|line| Some(line.strip_prefix(name)?.strip_prefix('=')?.to_owned()))
        };
        (value(environment::NODE)? == "driver").then_some(())?;
        let domain =
            DomainName { prefix: value(environment::DOMAIN)?, root: value(environment::ROOT)?.into() };
        Some((id.parse().ok()?, domain))
    })
}

impl Hall {
    fn start(name: &str, change: impl Fn(&str) -> String, settings: &[&str]) -> Option<Self> {
        let (folder, graph) = example(name, change)?;
        let alone = Alone::wait();
        let json = folder.join("summary.json").display().to_string();
        let fixed = [&["run", &graph, "--json", &json], PATIENT].concat();
        let mut running = Running::start(sidestep(&[&fixed[..], settings].concat()));
        let (_, domain) = running.wait_for("the driver", driver);
        let link = running.wait_for("a link", |_| Link::attach(&domain, "test", 0, 0).ok());
        let commands = link.inbox(COMMAND, Keep::All).unwrap();
        let odometry = link.inbox(ODOMETRY, Keep::All).unwrap();
        let step = Step::new();
        let mut hall = Self { running, link, commands, odometry, step, folder, _alone: alone };
        hall.until_odometry("driving", |odometry, _| odometry.twist.v_m_s > 0.3);
        Some(hall)
    }

    /// Reads odometry until it fits; all read is returned.
    fn until_odometry(&mut self, what: &str, fits: impl Fn(&Odometry, &Header) -> bool) -> Vec<Odometry> {
        let mut seen = Vec::new();
        let Self { running, link, odometry, step, .. } = self;
        running.wait_for(what, |_| {
            link.look(step).unwrap();
            let mut found = None;
            odometry
                .each(step, |message, header| {
                    seen.push(*message);
                    found = found.or(fits(message, header).then_some(()));
                })
                .unwrap();
            found
        });
        seen
    }

    fn end(self) -> (Outcome, serde_json::Value) {
        self.running.signal(libc::SIGTERM);
        let outcome = self.running.finish();
        let summary = std::fs::read_to_string(self.folder.join("summary.json")).unwrap_or_default();
        let summary =
            serde_json::from_str(&summary).unwrap_or_else(|_| panic!("{}{}", outcome.out, outcome.err));
        (outcome, summary)
    }
}

#[test]
fn a_driver_in_python_drives_and_leaves_when_asked() {
    let Some(mut hall) = Hall::start("python", str::to_owned, &[]) else { return };
    hall.until_odometry("a metre", |odometry, _| odometry.pose.x_m > 1.0);
    let (outcome, summary) = hall.end();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    assert_eq!(summary["nodes"]["driver"]["exit"], "exit 0", "{summary:#}");
    assert_eq!(summary["nodes"]["driver"]["restarts"], 0, "{summary:#}");
    // Every frame was answered by a map.
    let sent = |topic: &str| summary["topics"][topic]["sent"].as_u64().unwrap();
    assert!(sent("depth") > 30 && sent("odometry") > 2 * sent("depth"), "{summary:#}");
    assert!(sent("local_map") + 5 >= sent("depth"), "{summary:#}");
    assert!(summary["latency_ms"]["depth_to_command"]["count"].as_u64().unwrap() > 20, "{summary:#}");
}

#[test]
fn a_driver_in_python_brakes_by_itself_when_a_command_is_over() {
    let settings = ["--set", "supervision.hang_ms=60000"];
    let Some(mut hall) = Hall::start("brakes", str::to_owned, &settings) else { return };
    let arbiter = hall.running.node("arbiter").unwrap();
    send_signal(arbiter, libc::SIGSTOP);
    let seen = hall.until_odometry("standing", |odometry, _| odometry.twist.v_m_s == 0.0);
    let mut valid_until_ns = 0;
    hall.commands.each(&mut Step::new(), |command, _| valid_until_ns = command.valid_until_ns).unwrap();
    send_signal(arbiter, libc::SIGCONT);
    let before = seen.iter().rfind(|odometry| odometry.stamp_ns < valid_until_ns).unwrap().twist.v_m_s;
    assert!(before > 0.2, "no stop before its time: {before} m/s");
    let brakes = seen.iter().filter(|odometry| odometry.stamp_ns >= valid_until_ns);
    for (odometry, next) in brakes.clone().zip(brakes.skip(1)) {
        let dt_s = (next.stamp_ns - odometry.stamp_ns) as f32 * 1e-9;
        let least = (odometry.twist.v_m_s - 0.55 * dt_s).max(0.0);
        assert!(next.twist.v_m_s <= least, "{} then {} m/s", odometry.twist.v_m_s, next.twist.v_m_s);
    }
    hall.until_odometry("driving on", |odometry, _| odometry.twist.v_m_s > 0.2);
    assert_eq!(hall.end().0.code, 0);
}

/// The example with a base that knows its pose also after its driver was killed, as wheels with a controller of their own do.
fn with_a_base_of_its_own(text: &str) -> String {
    let pose = "hall.x_m, hall.y_m, hall.yaw_rad";
    let keep =
        format!("with open('next', 'w') as file: file.write(f'{{{pose}}}')\n    os.replace('next', 'pose')");
    let read = format!("if os.path.exists('pose'): {pose} = eval(open('pose').read())");
    text.replace("import math\n", "import math, os, sys\nos.chdir(sys.path[0])\n")
        .replace(
            "link, hall = sidestep.Link(), Hall()\n",
            &format!("link, hall = sidestep.Link(), Hall()\n{read}\n"),
        )
        .replace("odometry.send(now_ns)\n", &format!("odometry.send(now_ns)\n    {keep}\n"))
        .replace("pose_epoch = link.incarnation", "pose_epoch = 0")
}

/// Kills the driver of a driving robot; the arbiter stops it for want of odometry until the next incarnation speaks,
/// whose first odometry ends what is returned.
fn kill(hall: &mut Hall) -> Vec<Odometry> {
    let killed_ns = host_ns();
    send_signal(driver(&hall.running).unwrap().0, libc::SIGKILL);
    let seen = hall.until_odometry("a new life", |_, header| header.incarnation == 1);
    let mut stopped = false;
    hall.commands
        .each(&mut Step::new(), |command, header| {
            stopped |= header.now_ns > killed_ns && command.reason == Reason::StaleOdometry as u32;
        })
        .unwrap();
    assert!(stopped, "without odometry the arbiter stops the robot");
    seen
}

#[test]
fn a_killed_driver_is_started_again_and_drives_on_from_where_its_base_stands() {
    let Some(mut hall) = Hall::start("killed-driver", with_a_base_of_its_own, &[]) else { return };
    let mut seen = hall.until_odometry("a metre", |odometry, _| odometry.pose.x_m > 1.0);
    seen.extend(kill(&mut hall));
    let kept = |two: &[Odometry]| (two[1].pose.x_m - two[0].pose.x_m).abs() < 0.3 && two[1].pose_epoch == 0;
    assert!(seen.windows(2).all(kept), "the pose was lost: {seen:?}");
    hall.until_odometry("driving on", |odometry, _| odometry.twist.v_m_s > 0.3);
    let (outcome, summary) = hall.end();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    assert_eq!(summary["nodes"]["driver"]["restarts"], 1, "{summary:#}");
}

#[test]
fn a_killed_driver_that_lost_its_pose_stands_on_floor_that_nobody_knows() {
    let Some(mut hall) = Hall::start("lost-driver", str::to_owned, &[]) else { return };
    kill(&mut hall);
    let seen = hall.until_odometry("the new epoch", |odometry, _| odometry.pose_epoch == 1);
    let begun_ns = seen.last().unwrap().stamp_ns;
    let later =
        hall.until_odometry("two seconds", |odometry, _| odometry.stamp_ns > begun_ns + 2_000_000_000);
    // The cells under its own footprint are free, and it may creep to their edge.
    let farthest_m = later.iter().map(|odometry| odometry.pose.x_m.abs()).fold(0.0, f64::max);
    assert!(farthest_m < 0.1, "it drove {farthest_m} m over floor that it never saw");
    assert!(later.last().unwrap().twist.v_m_s < 0.01, "{:?}", later.last());
    assert_eq!(hall.end().0.code, 0);
}

#[test]
fn a_driver_that_beats_is_killed_when_it_hangs_and_one_that_does_not_is_left_alone() {
    let Some(mut hall) = Hall::start("hung-driver", str::to_owned, &[]) else { return };
    let (process, _) = driver(&hall.running).unwrap();
    send_signal(process, libc::SIGSTOP);
    hall.until_odometry("a new life", |_, header| header.incarnation == 1);
    assert!(hall.end().0.err.contains("driver | hung: no heartbeat"));

    let silent = |text: &str| text.replace("sidestep.Link()", "sidestep.Link(heartbeat=False)");
    let mut hall = Hall::start("silent-driver", silent, &[]).unwrap();
    let (process, _) = driver(&hall.running).unwrap();
    send_signal(process, libc::SIGSTOP);
    sidestep_bus::pause(std::time::Duration::from_secs(1));
    send_signal(process, libc::SIGCONT);
    hall.until_odometry("driving on", |odometry, _| odometry.twist.v_m_s > 0.3);
    let (outcome, summary) = hall.end();
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    assert_eq!(summary["nodes"]["driver"]["restarts"], 0, "{summary:#}");
}

/// Every message of a recording, by topic.
fn recorded(summary: &serde_json::Value) -> BTreeMap<&'static str, Vec<Entry>> {
    let mut topics: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for entry in Ordered::open(Path::new(summary["recording"].as_str().unwrap())).unwrap().map(Result::unwrap)
    {
        topics.entry(entry.row().name).or_default().push(entry);
    }
    topics
}

/// What the simulator's driver said, in its order: a tick's word of the clock comes last, a frame's first.
fn said(topics: &BTreeMap<&'static str, Vec<Entry>>) -> Vec<Entry> {
    let of = |topic: &str| topics.get(topic).into_iter().flatten();
    for name in ["clock", "odometry", "ranges", "depth", "path"] {
        let complete = of(name).zip(1..).all(|(entry, number)| entry.header.sequence == number);
        assert!(complete && of(name).next().is_some(), "the recording misses some of {name}");
    }
    let frames: BTreeSet<_> = of("depth").map(|entry| entry.header.now_ns).collect();
    let place = |entry: &Entry| match entry.topic {
        topic if topic == CLOCK.index && !frames.contains(&entry.header.now_ns) => 3,
        topic if topic == CLOCK.index || topic == PATH.index => 0,
        topic if topic == ODOMETRY.index || topic == DEPTH.index => 1,
        topic => {
            assert_eq!(topic, RANGES.index);
            2
        }
    };
    let all = ["clock", "odometry", "ranges", "depth", "path"].into_iter().flat_map(of);
    let mut all: Vec<_> = all.cloned().collect();
    all.sort_by_key(|entry| (entry.header.now_ns, place(entry)));
    // The end of the recording may have cut a tick in two.
    let whole = all.iter().rposition(|entry| place(entry) == 3).unwrap();
    all.truncate(whole + 1);
    all
}

/// A recorded drive of the simulator in lockstep, fed again by a driver in Python: every node gives the same bytes.
#[test]
fn fed_the_same_frames_by_python_the_graph_gives_the_same_bytes() {
    let Some(python) = python() else { return };
    let _alone = Alone::wait();
    let folder = Folder::new("identity");
    let recordings = folder.join("recordings").display().to_string();
    let fixed = ["run", "sim", "--for", "4s", "--set", "time=lockstep", "--record", &recordings];
    let small =
        ["--set", "sim.width_px=160", "--set", "sim.height_px=120", "--set", "sim.lockstep_rate_most=1.0"];
    let (outcome, summary) = run_with_summary("identity-a", &[&fixed[..], &small, PATIENT].concat());
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let built_in = recorded(&summary);
    let fed = said(&built_in);
    let mut dump = Vec::new();
    for entry in &fed {
        for number in [entry.topic as u64, entry.header.now_ns, entry.message.len() as u64] {
            dump.extend_from_slice(&number.to_ne_bytes());
        }
        dump.extend_from_slice(&entry.message);
    }
    std::fs::write(folder.join("messages.bin"), dump).unwrap();

    folder.write("sidestep.py", &run(&["interface", "--python"]).out);
    let feed = folder.write("feed.py", include_str!("../tools/driver/feed.py"));
    let sim = include_str!("../launch/graphs/sim.toml").replace("time = \"real\"", "time = \"lockstep\"");
    let (head, rest) = sim.split_once("[nodes.sim]").unwrap();
    let (_, nodes) = rest.split_once("[nodes.mapper]").unwrap();
    let command = [python, feed, folder.join("messages.bin").display().to_string()];
    let external = format!("[external.driver]\nrestart = \"never\"\ncommand = {command:?}\n");
    let graph = folder.write("graph.toml", &format!("{head}[nodes.mapper]{nodes}\n{external}"));
    let arguments = [&["run", &graph, "--record", &recordings], PATIENT].concat();
    let (outcome, summary) = run_with_summary("identity-b", &arguments);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let python = recorded(&summary);

    let last_ns = fed.last().unwrap().header.now_ns;
    for name in ["local_map", "safety_map", "local_goal", "policy_command", "expert_command", "command"] {
        let others: BTreeMap<_, _> =
            python[name].iter().map(|entry| (entry.header.sequence, entry)).collect();
        let known = built_in[name].iter().filter(|entry| entry.header.now_ns < last_ns);
        let mut same = 0;
        for entry in known {
            let Some(other) = others.get(&entry.header.sequence) else { continue };
            let key = |entry: &Entry| {
                let header = &entry.header;
                (header.now_ns, header.source_frame, header.sequence, header.status, header.inputs)
            };
            assert_eq!(key(entry), key(other), "{name}");
            assert!(entry.message == other.message, "{name} {}: another payload", entry.header.sequence);
            same += 1;
        }
        println!("{name}: {same} of {} messages have the same bytes", built_in[name].len());
        assert!(same >= if name == "command" { 350 } else { 90 }, "{name}: only {same} could be compared");
    }
}

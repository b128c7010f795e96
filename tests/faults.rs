//! Nodes are killed and stopped; the graph comes back, the robot stops in time, nothing is left.

use crate::harness::{Alone, Folder, Outcome, PATIENT, Running, SMALL, finish, send_signal, sidestep};
use serde_json::Value;
use sidestep_bus::{DomainName, Keep, Link, Step, environment, host_ns, pause};
use sidestep_msgs::{COMMAND, Code, Command, Reason};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::time::Duration;

const NODES: &[&str] = &["sim", "mapper", "guard", "goal", "policy", "expert", "arbiter", "recorder"];
/// SplitMix64: the seed is printed by its user.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound
    }
}

fn left_in_shared_memory(prefix: &str) -> Vec<String> {
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with(prefix)).collect()
}

fn kills() -> u64 {
    std::env::var("SIDESTEP_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(50)
}

/// Kills nodes at random moments; each must be there again, and the drive must go on to a clean end.
fn survives_kills(command: std::process::Command, json: &Path, seed: u64) {
    let _alone = Alone::wait();
    let count = kills();
    eprintln!("{count} kills, seed {seed}");
    let mut random = Random(seed);
    let mut running = Running::start(command);
    for node in NODES {
        running.wait_for(node, |running| running.node(node));
    }
    let domain = running.wait_for("its domain", |running| running.domain("arbiter"));
    let mut back_ms = Vec::new();
    for _ in 0..count {
        let node = NODES[random.below(NODES.len() as u64) as usize];
        let process = running.wait_for(node, |running| running.node(node));
        // From the first instant of its life to well into its work.
        pause(Duration::from_millis(random.below(60)));
        let killed_ns = host_ns();
        send_signal(process, libc::SIGKILL);
        running.wait_for(node, |running| running.node(node).filter(|&id| id != process));
        back_ms.push((host_ns() - killed_ns) / 1_000_000);
    }
    pause(Duration::from_secs(3));
    running.signal(libc::SIGTERM);
    let outcome = running.finish();
    assert_eq!(left_in_shared_memory(&domain.prefix), Vec::<String>::new());
    assert!(!domain.root.exists(), "{} is left", domain.root.display());
    back_ms.sort_unstable();
    eprintln!(
        "process back after p50 {} ms, max {} ms",
        back_ms[back_ms.len() / 2],
        back_ms[back_ms.len() - 1]
    );
    let summary: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap_or_default())
        .unwrap_or_else(|error| panic!("{error}: {}{}", outcome.out, outcome.err));
    let restarts: u64 = NODES.iter().map(|node| summary["nodes"][*node]["restarts"].as_u64().unwrap()).sum();
    assert!(restarts >= count, "{restarts} restarts: {summary:#}");
    assert!(summary["nodes"]["mapper"]["exit"] == "exit 0", "{summary:#}\n{}", outcome.err);
    NODES.iter().for_each(|node| dies_and_comes_back_in_turn(node, summary["events"].as_array().unwrap()));
}

/// In the order of time, each end of a node is followed by its next incarnation.
fn dies_and_comes_back_in_turn(node: &str, events: &[Value]) {
    let moved = events.iter().any(|event| event["node"] == "launcher");
    let (mut alive, mut incarnation, mut last_s) = (true, 0, f64::MIN);
    for event in events.iter().filter(|event| event["node"] == node) {
        let (what, at_s) = (event["what"].as_str().unwrap(), event["at_s"].as_f64().unwrap());
        assert!(at_s >= last_s, "{node}: {what} at {at_s} s, after {last_s} s");
        if what.starts_with("started again") {
            incarnation += 1;
            // A move to a fresh domain ends every node without a word about each.
            assert!(!alive || moved, "{node}: {what} at {at_s} s, and it was alive");
            assert!(
                what.ends_with(&format!("incarnation {incarnation}")),
                "{node}: {what}, not {incarnation}"
            );
        } else {
            assert!(what.starts_with("ended: ") && alive, "{node}: {what} at {at_s} s");
        }
        (alive, last_s) = (what.starts_with("started again"), at_s);
    }
    assert!(alive, "{node} did not come back");
}

#[test]
fn killed_nodes_come_back_as_root_or_whoever_runs_the_test() {
    let folder = Folder::new("kills");
    let (json, recordings) = (folder.join("summary.json"), folder.join("recordings"));
    let (json_text, recordings) = (json.display().to_string(), recordings.display().to_string());
    let arguments = [&["run", "sim", "--json", &json_text, "--record", &recordings], PATIENT, SMALL].concat();
    survives_kills(sidestep(&arguments), &json, 11);
}

#[test]
fn killed_nodes_come_back_as_an_ordinary_user() {
    const NOBODY: u32 = 65_534;
    if !std::fs::metadata("/proc/self").is_ok_and(|data| std::os::unix::fs::MetadataExt::uid(&data) == 0) {
        eprintln!("skipped: only root can become another user");
        return;
    }
    let folder = Folder::new("kills-nobody");
    // The build folder may be closed to others: the binary travels alone, as it does to a robot.
    let binary = folder.join("sidestep");
    std::fs::copy(env!("CARGO_BIN_EXE_sidestep"), &binary).unwrap();
    for path in [&folder.0, &binary] {
        std::os::unix::fs::chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    }
    let json = folder.join("summary.json");
    let recordings = folder.join("recordings").display().to_string();
    let mut command = std::process::Command::new(&binary);
    command
        .args(["run", "sim", "--json", &json.display().to_string(), "--record", &recordings])
        .args(PATIENT)
        .args(SMALL);
    command.current_dir(&folder.0).stdin(std::process::Stdio::null()).uid(NOBODY).gid(NOBODY);
    command.env_remove("XDG_RUNTIME_DIR");
    survives_kills(command, &json, 12);
}

/// A run that drives, with a reader of all its commands.
pub(crate) struct Drive {
    pub(crate) running: Running,
    pub(crate) link: Link,
    pub(crate) commands: sidestep_bus::Inbox<Command>,
    pub(crate) step: Step,
    domain: DomainName,
    _folder: Folder,
    _alone: Alone,
}

impl Drive {
    pub(crate) fn start(name: &str, settings: &[&str]) -> Self {
        let alone = Alone::wait();
        let folder = Folder::new(name);
        let recordings = folder.join("recordings").display().to_string();
        let fixed = [
            "run",
            "sim",
            "--lead",
            "expert",
            "--record",
            &recordings,
            "--set",
            "supervision.start_ms=60000",
        ];
        let fixed = [&fixed, SMALL].concat();
        let mut running = Running::start(sidestep(&[&fixed, settings].concat()));
        let domain = running.wait_for("its domain", |running| running.domain("arbiter"));
        let link = running.wait_for("a link", |_| Link::attach(&domain, "test", 0, 0).ok());
        let commands = link.inbox(COMMAND, Keep::All).unwrap();
        let mut drive =
            Self { running, link, commands, step: Step::new(), domain, _folder: folder, _alone: alone };
        drive.until("driving", |command| command.twist.v_m_s > 0.3);
        drive
    }

    /// Reads commands until one fits; all read are returned.
    pub(crate) fn until(
        &mut self,
        what: &str,
        mut fits: impl FnMut(&Command) -> bool,
    ) -> Vec<(u64, Command)> {
        let mut seen = Vec::new();
        let Self { running, link, commands, step, .. } = self;
        running.wait_for(what, |_| {
            link.look(step).unwrap();
            let mut found = None;
            commands
                .each(step, |command, header| {
                    seen.push((header.now_ns, *command));
                    if fits(command) {
                        found = Some(());
                    }
                })
                .unwrap();
            found
        });
        seen
    }

    /// Says something as an operator of this run.
    fn say(&self, what: &str) -> Outcome {
        let mut command = sidestep(&what.split(' ').collect::<Vec<_>>());
        command.env(environment::DOMAIN, &self.domain.prefix).env(environment::ROOT, &self.domain.root);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        finish(command.spawn().unwrap())
    }

    pub(crate) fn end(self) -> Outcome {
        self.running.signal(libc::SIGINT);
        let outcome = self.running.finish();
        assert_eq!(left_in_shared_memory(&self.domain.prefix), Vec::<String>::new());
        assert!(!self.domain.root.exists());
        outcome
    }
}

pub(crate) fn is(command: &Command, reason: Reason) -> bool {
    Reason::from_code(command.reason) == Some(reason)
}

/// Stops nodes without killing them, and looks at the order of reasons and at the ages in graph time.
fn stops_in_time(nodes: &[&str], reasons: &[Reason]) {
    let names = nodes.join("-");
    let mut drive = Drive::start(&format!("hung-{names}"), &[]);
    let processes: Vec<_> = nodes.iter().map(|node| drive.running.node(node).unwrap()).collect();
    let before_ns = host_ns();
    processes.iter().for_each(|&process| send_signal(process, libc::SIGSTOP));
    let fits = |command: &Command| reasons.iter().any(|&reason| is(command, reason));
    let seen = drive.until("the stop", fits);
    let (stop_ns, _) = seen.last().unwrap();
    eprintln!("{names} hung: {:.0} ms to the stop command", (stop_ns - before_ns) as f64 * 1e-6);
    // Until the stop, every command rested on inputs within their ages.
    for (now_ns, command) in &seen[..seen.len() - 1] {
        let young = command.map_age_s <= 0.1001 && command.odometry_age_s <= 0.0601;
        assert!(fits(command) || command.twist.v_m_s == 0.0 || young, "at {now_ns}: {command:?}");
    }
    let since =
        drive.until("driving again", |command| is(command, Reason::Clear) && command.twist.v_m_s > 0.2);
    // Until the new node speaks, the robot only ever slows.
    let stopping: Vec<_> = since.iter().take_while(|(_, command)| fits(command)).collect();
    let slows = |pair: &[&(u64, Command)]| pair[1].1.twist.v_m_s <= pair[0].1.twist.v_m_s;
    assert!(stopping.len() > 3 && stopping.windows(2).all(slows), "{stopping:?}");
    let outcome = drive.end();
    assert!(outcome.err.contains("hung: no heartbeat"), "{}", outcome.err);
    assert!(outcome.err.contains("started again, incarnation 1"), "{}", outcome.err);
}

#[test]
fn a_hung_mapper_stops_the_robot_and_is_replaced() {
    stops_in_time(&["mapper"], &[Reason::StaleMap]);
}

#[test]
fn a_hung_guard_stops_the_robot_and_is_replaced() {
    stops_in_time(&["guard"], &[Reason::StaleNearField]);
}

#[test]
fn a_hung_goal_stops_the_robot_and_is_replaced() {
    stops_in_time(&["goal"], &[Reason::StaleGoal, Reason::StaleProposals]);
}

#[test]
fn both_proposers_hung_stop_the_robot_and_are_replaced() {
    stops_in_time(&["policy", "expert"], &[Reason::StaleProposals]);
}

#[test]
fn a_hung_driver_stops_the_robot_and_is_replaced() {
    // A simulator that starts again puts the robot back to its start: the pose jumps, and what was seen is void.
    let mut drive = Drive::start("hung-sim", &[]);
    let (process, before_ns) = (drive.running.node("sim").unwrap(), host_ns());
    send_signal(process, libc::SIGSTOP);
    let seen = drive.until("the stop", |command| is(command, Reason::StaleOdometry));
    let stop_ns = seen.last().unwrap().0;
    eprintln!("odometry silent: {:.0} ms to the stop command", (stop_ns - before_ns) as f64 * 1e-6);
    drive.until("rest", |command| command.twist.v_m_s == 0.0);
    drive.until("odometry again", |command| command.odometry_age_s < 0.06);
    let outcome = drive.end();
    assert!(outcome.err.contains("hung: no heartbeat"), "{}", outcome.err);
}

#[test]
fn a_hung_lead_hands_over_to_the_other_proposal() {
    let mut drive = Drive::start("hung-lead", &[]);
    send_signal(drive.running.node("expert").unwrap(), libc::SIGSTOP);
    drive.until("the other proposal", |command| is(command, Reason::OtherProposal));
    drive.until("the lead again", |command| command.winner == sidestep_msgs::Winner::Expert as u32);
    drive.end();
}

#[test]
fn killed_perception_comes_back_and_the_drive_goes_on() {
    let mut drive = Drive::start("killed", &[]);
    for node in ["goal", "mapper"] {
        let process = drive.running.node(node).unwrap();
        send_signal(process, libc::SIGKILL);
        drive.running.wait_for(node, |running| running.node(node).filter(|&id| id != process));
        drive.until("a while", {
            let mut commands = 0;
            move |_| {
                commands += 1;
                commands > 100
            }
        });
        drive.until("driving", |command| command.twist.v_m_s > 0.2);
    }
    drive.end();
}

#[test]
fn a_killed_arbiter_brakes_before_it_drives_on() {
    let mut drive = Drive::start("killed-arbiter", &[]);
    send_signal(drive.running.node("arbiter").unwrap(), libc::SIGKILL);
    drive.until("starting", |command| is(command, Reason::Starting));
    drive.until("driving again", |command| command.twist.v_m_s > 0.2);
    drive.end();
}

#[test]
fn an_emergency_stop_holds_across_a_crash_until_the_operator_resets_it() {
    let mut drive = Drive::start("estop", &[]);
    let said = drive.say("estop");
    assert_eq!(said.code, 0, "{}{}", said.out, said.err);
    drive.until("the latch", |command| is(command, Reason::EstopLatched) && command.twist.v_m_s == 0.0);
    let process = drive.running.node("arbiter").unwrap();
    send_signal(process, libc::SIGKILL);
    drive.running.wait_for("a new arbiter", |running| running.node("arbiter").filter(|&id| id != process));
    let seen = drive.until("the latch again", |command| is(command, Reason::EstopLatched));
    // The base may still roll when the new arbiter takes over: it brakes, and nothing ever speeds up.
    let speeds: Vec<_> = seen.iter().map(|(_, command)| command.twist.v_m_s.abs()).collect();
    let braking = speeds.windows(2).skip_while(|pair| pair[0] == 0.0).skip(1).all(|pair| pair[1] <= pair[0]);
    assert!(braking && speeds.iter().all(|&speed| speed < 0.5), "{speeds:?}");
    let said = drive.say("reset");
    assert_eq!(said.code, 0, "{}{}", said.out, said.err);
    drive.until("driving again", |command| command.twist.v_m_s > 0.2);
    drive.end();
}

#[test]
fn a_hold_outlives_a_crash_until_the_operator_lets_go() {
    let mut drive = Drive::start("hold", &[]);
    assert_eq!(drive.say("hold").code, 0);
    drive.until("the hold", |command| is(command, Reason::Hold) && command.twist.v_m_s == 0.0);
    let process = drive.running.node("arbiter").unwrap();
    send_signal(process, libc::SIGKILL);
    drive.running.wait_for("a new arbiter", |running| running.node("arbiter").filter(|&id| id != process));
    let mut commands = 0;
    drive.until("a second of holding on", |command| {
        assert!(command.twist.v_m_s.abs() < 0.05, "{command:?}");
        commands += u32::from(is(command, Reason::Hold));
        commands > 100
    });
    assert_eq!(drive.say("hold --release").code, 0);
    drive.until("driving again", |command| command.twist.v_m_s > 0.2);
    drive.end();
}

#[test]
fn a_second_ctrl_c_ends_everything_at_once_and_leaves_nothing() {
    let drive = Drive::start("twice", &[]);
    drive.running.signal(libc::SIGINT);
    drive.running.signal(libc::SIGINT);
    let prefix = drive.domain.prefix.clone();
    drive.running.finish();
    assert_eq!(left_in_shared_memory(&prefix), Vec::<String>::new());
}

#[test]
fn what_a_killed_launcher_leaves_is_wiped_by_the_next_run() {
    let drive = Drive::start("orphans", &[]);
    let nodes: Vec<_> = NODES.iter().filter_map(|node| drive.running.node(node)).collect();
    drive.running.signal(libc::SIGKILL);
    let Drive { running, domain, .. } = drive;
    running.finish();
    pause(Duration::from_millis(1200));
    // Whoever adopts orphans may not have collected them yet: a zombie is dead too.
    let dead = |id: &u32| {
        std::fs::read_to_string(format!("/proc/{id}/stat")).map_or(true, |stat| stat.contains(") Z "))
    };
    assert!(nodes.iter().all(dead), "a node outlived its launcher");
    let next = sidestep_bus::Domain::create(host_ns() & 0xffff_ffff).unwrap();
    assert_eq!(left_in_shared_memory(&domain.prefix), Vec::<String>::new());
    drop(next);
}

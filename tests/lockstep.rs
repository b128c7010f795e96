//! Graph time in steps: the same seed gives the same bytes, over processes and in one.

use crate::harness::{Alone, Folder, Running, SMALL, run_with_summary, send_signal, sidestep};
use sidestep_bus::{Keep, Link, Step};
use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{COMMAND, LOCAL_GOAL, Robot, Winner};
use sidestep_player::{Entry, Ordered};
use sidestep_policy::Policy;
use sidestep_sim::{BEGIN_NS, TICK_NS, World};
use std::collections::BTreeMap;
use std::path::Path;

/// What is compared: every topic but those that speak of host time.
const TOPICS: &[&str] = &[
    "clock",
    "odometry",
    "ranges",
    "depth",
    "path",
    "truth",
    "near_field",
    "local_map",
    "safety_map",
    "local_goal",
    "policy_command",
    "expert_command",
    "command",
];

/// Drives in lockstep and returns the messages of each topic in their order.
fn drive(name: &str, lead: &str, time: &str) -> Vec<Vec<Entry>> {
    let folder = Folder::new(&format!("{name}-recordings"));
    let recordings = folder.join("recordings").display().to_string();
    let fixed =
        ["run", "sim", "--set", "time=lockstep", "--for", time, "--lead", lead, "--record", &recordings];
    let arguments = [&fixed[..], SMALL, &["--set", "supervision.start_ms=60000"]].concat();
    let (outcome, summary) = run_with_summary(name, &arguments);
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let file = Path::new(summary["recording"].as_str().unwrap()).to_path_buf();
    let entries: Vec<_> = Ordered::open(&file).unwrap().map(Result::unwrap).collect();
    let of = |name: &&str| entries.iter().filter(|entry| entry.row().name == *name).cloned().collect();
    TOPICS.iter().map(of).collect()
}

/// The same message at the same graph time about the same frame from the same inputs.
fn is_same(one: &Entry, other: &Entry) -> bool {
    let (a, b) = (&one.header, &other.header);
    one.message == other.message
        && (a.now_ns, a.sequence, a.source_frame, a.status)
            == (b.now_ns, b.sequence, b.source_frame, b.status)
        && a.inputs == b.inputs
}

#[test]
fn two_drives_of_one_seed_record_the_same_bytes() {
    let _alone = Alone::wait();
    for lead in ["policy", "refined"] {
        let (one, other) = (drive("lockstep-a", lead, "6s"), drive("lockstep-b", lead, "6s"));
        for (name, (one, other)) in TOPICS.iter().zip(one.iter().zip(&other)) {
            // The driver waits for the recorder: nothing is lost. The drives end some milliseconds apart.
            for entries in [one, other] {
                let gap = entries.iter().zip(1..).find(|(entry, number)| entry.header.sequence != *number);
                assert!(gap.is_none(), "{lead}, {name}: number {:?} is lost", gap.map(|(_, number)| number));
            }
            let pairs: Vec<_> = one.iter().zip(other).collect();
            let least = match *name {
                "path" => 1,
                "ranges" => 80,
                "depth" | "near_field" | "local_map" | "safety_map" | "local_goal" | "policy_command"
                | "expert_command" => 100,
                _ => 400,
            };
            assert!(
                pairs.len() >= least,
                "{lead}, {name}: {} of {} and {}",
                pairs.len(),
                one.len(),
                other.len()
            );
            let differs = pairs.iter().position(|(one, other)| !is_same(one, other));
            assert_eq!(differs, None, "{lead}, {name}: the first difference of {}", pairs.len());
        }
    }
}

/// The graph of processes against the same steps called in one process: every command has the same bytes.
#[test]
fn processes_in_lockstep_drive_as_the_chain_in_one_process_does() {
    let _alone = Alone::wait();
    let commands = drive("lockstep-chain", "policy", "6s").pop().unwrap();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/launch/robots/loomo.toml");
    let robot = Robot::from_toml(path, &std::fs::read_to_string(path).unwrap()).unwrap();
    let mut setup = Setup::shipped(robot.clone(), World::office(1), Winner::Policy);
    (setup.sim.width_px, setup.sim.height_px) = (160, 120);
    setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &robot).unwrap());
    let mut chain = Drive::new(setup).unwrap();
    let mut ticks = 0;
    let live: BTreeMap<_, _> = commands.iter().map(|entry| (entry.header.now_ns, entry)).collect();
    for tick in 0..600 {
        chain.tick();
        let Some(entry) = live.get(&(BEGIN_NS + tick * TICK_NS)) else { continue };
        let (live, alone) = (entry.read(COMMAND).unwrap(), chain.command());
        assert_eq!(bytemuck::bytes_of(&live), bytemuck::bytes_of(alone), "tick {tick}: {live:?}\n{alone:?}");
        ticks += 1;
    }
    assert!(ticks >= 400, "{ticks} ticks");
}

#[test]
fn a_silent_node_ends_the_drive_with_its_name() {
    let _alone = Alone::wait();
    let folder = Folder::new("lockstep-silent");
    let recordings = folder.join("recordings").display().to_string();
    let fixed = [
        "run",
        "sim",
        "--set",
        "time=lockstep",
        "--record",
        &recordings,
        "--set",
        "supervision.hang_ms=60000",
    ];
    let mut running = Running::start(sidestep(&[&fixed, SMALL].concat()));
    let process = running.wait_for("goal", |running| running.node("goal"));
    let link = running.wait_for("a link", |running| Link::attach(&running.domain("sim")?, "test", 0, 0).ok());
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest).unwrap();
    running.wait_for("a goal", |_| goals.newest(&mut Step::new()).unwrap().map(|_| ()));
    send_signal(process, libc::SIGSTOP);
    let outcome = running.finish();
    send_signal(process, libc::SIGKILL);
    assert_eq!(outcome.code, 3, "{}{}", outcome.out, outcome.err);
    assert!(outcome.err.contains("goal did not answer frame"), "{}", outcome.err);
}

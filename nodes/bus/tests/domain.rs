//! A real domain in shared memory: messages cross it, its rules hold, and nothing is left behind.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_bus::{Boot, Domain, Inbox, Keep, Link, Step, environment, host_ns, live_domains, pause, sweep};
use sidestep_msgs::{ESTOP, Estop, HEALTH_GOAL, LOCAL_MAP, LocalMap, Message, ODOMETRY, Odometry, Stage};
use std::time::Duration;

fn run_number(test: u64) -> u64 {
    (host_ns() << 8 | test) & 0xffff_ffff_ffff
}

fn shared_memory(prefix: &str) -> usize {
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)).count()
}

fn domain(test: u64) -> (Domain, Link) {
    let run = run_number(test);
    let domain = Domain::create(run).unwrap();
    let link = Link::attach(&domain.name, "test", run, 0).unwrap();
    (domain, link)
}

fn received<M: Message>(link: &mut Link, inbox: &mut Inbox<M>) -> Vec<(u64, M)> {
    let mut step = Step::new();
    link.look(&mut step).unwrap();
    let mut all = Vec::new();
    inbox.each(&mut step, |message, header| all.push((header.sequence, *message))).unwrap();
    all
}

#[test]
fn a_message_crosses_with_its_header_and_a_reader_of_the_newest_gets_the_newest() {
    let (_domain, mut link) = domain(1);
    let mut newest = link.inbox(ODOMETRY, Keep::Newest).unwrap();
    let mut all = link.inbox(ODOMETRY, Keep::All).unwrap();
    let mut outbox = link.outbox(ODOMETRY).unwrap();
    let mut step = Step::new();
    for stamp_ns in 1..=3 {
        link.look(&mut step).unwrap();
        step.originate(7, Stage::Depth);
        outbox
            .send(&mut step, |odometry: &mut Odometry| {
                *odometry = Odometry { stamp_ns, ..Odometry::default() }
            })
            .unwrap();
    }
    let stamps: Vec<_> = received(&mut link, &mut all)
        .iter()
        .map(|(sequence, odometry)| (*sequence, odometry.stamp_ns))
        .collect();
    assert_eq!(stamps, [(1, 1), (2, 2), (3, 3)]);
    link.look(&mut step).unwrap();
    let message = newest.newest(&mut step).unwrap().unwrap();
    assert_eq!((message.stamp_ns, message.header().sequence, message.header().source_frame), (3, 3, 7));
}

#[test]
fn a_topic_has_one_writer() {
    let (_domain, link) = domain(2);
    let _first = link.outbox(ESTOP).unwrap();
    let error = link.outbox::<Estop>(ESTOP).unwrap_err().to_string();
    assert!(error.contains("topic estop: cannot write it: ExceedsMaxSupportedPublishers"), "{error}");
}

#[test]
fn a_slow_reader_loses_the_oldest_and_the_writer_never_waits() {
    let (_domain, mut link) = domain(3);
    let mut inbox = link.inbox(LOCAL_MAP, Keep::All).unwrap();
    let mut outbox = link.outbox(LOCAL_MAP).unwrap();
    let mut step = Step::new();
    for capture_ns in 1..=100 {
        link.look(&mut step).unwrap();
        outbox.send(&mut step, |map: &mut LocalMap| map.capture_ns = capture_ns).unwrap();
    }
    let stamps: Vec<_> = received(&mut link, &mut inbox).iter().map(|(_, map)| map.capture_ns).collect();
    let kept = LOCAL_MAP.row().buffer as u64;
    assert_eq!(stamps, (101 - kept..=100).collect::<Vec<_>>());
}

#[test]
fn two_runs_side_by_side_do_not_meet() {
    let (first, _link) = domain(4);
    let (second, mut link) = domain(5);
    let mut there = Link::attach(&first.name, "other", 0, 0).unwrap().outbox(ODOMETRY).unwrap();
    let mut here = link.inbox(ODOMETRY, Keep::All).unwrap();
    there.send(&mut Step::new(), |odometry| odometry.stamp_ns = 1).unwrap();
    assert!(received(&mut link, &mut here).is_empty());
    assert!(live_domains().contains(&first.name) && live_domains().contains(&second.name));
}

#[test]
fn nothing_is_left_when_a_domain_ends() {
    let (domain, link) = domain(6);
    let _writer = link.outbox(ODOMETRY).unwrap();
    let name = domain.name.clone();
    assert!(shared_memory(&name.prefix) > 0 && name.root.exists());
    drop((link, domain));
    assert_eq!(shared_memory(&name.prefix), 0);
    assert!(!name.root.exists());
}

#[test]
fn a_sweep_removes_the_litter_on_which_a_clean_up_would_spin() {
    // What a process killed between creating and sizing a connection leaves behind: an empty file without rights.
    let (domain, _link) = domain(7);
    let litter = std::path::PathBuf::from(format!("/dev/shm/{}litter.connection", domain.name.prefix));
    std::fs::write(&litter, []).unwrap();
    pause(Duration::from_millis(150));
    sweep(&domain.name).unwrap();
    assert!(!litter.exists());
}

#[test]
fn a_node_that_is_started_by_hand_is_told_how_to_start_it() {
    let error = Boot::from_environment("goal").unwrap_err();
    let text = error.to_string();
    assert!(text.contains(environment::DOMAIN) && text.contains("sidestep run"), "{text}");
    assert_eq!(error.exit_code(), 2);
}

#[test]
fn a_loop_beats_and_ends_when_its_step_says_so() {
    let (domain, mut link) = domain(8);
    let mut hearts = link.inbox(HEALTH_GOAL, Keep::All).unwrap();
    let beating = Link::attach(&domain.name, "goal", 0, 0).unwrap().with_heartbeat(HEALTH_GOAL).unwrap();
    let (mut wakes, mut beats) = (0, 0);
    let begin_ns = host_ns();
    beating
        .run_while(|_| {
            wakes += 1;
            beats += received(&mut link, &mut hearts).len();
            Ok(host_ns() - begin_ns < 200_000_000)
        })
        .unwrap();
    assert!(beats >= 3 && wakes >= 3, "{beats} beats, {wakes} wakes");
}

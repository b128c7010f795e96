//! Liveness by the hundred: nodes are stopped at random moments of a drive, and the time to the answer is measured.
//!
//! `SIDESTEP_INJECTIONS=40 cargo test --release injections -- --nocapture` prints the table; by default each row is tried
//! a few times, and only the order of things is asserted, never a wall clock.

use crate::faults::{Drive, Random, is};
use crate::harness::send_signal;
use sidestep_bus::{Keep, host_ns, pause};
use sidestep_latency::{Distribution, Figures};
use sidestep_msgs::{Code, Command, ODOMETRY, Odometry, Reason, Robot, Winner};
use std::time::Duration;

/// A node that is stopped keeps its process: what is measured is the graph's answer, not the launcher's.
const PATIENT: &[&str] = &["--set", "supervision.hang_ms=60000"];

fn injections() -> usize {
    std::env::var("SIDESTEP_INJECTIONS").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

/// `[ns]` an answer that takes longer is shown with what was said meanwhile.
const LATE_NS: u64 = 120_000_000;

/// Winners and reasons in turn, without repetitions.
fn said(seen: &[(u64, Command)]) -> String {
    let mut words: Vec<String> = seen
        .iter()
        .map(|(_, command)| {
            let winner = Winner::from_code(command.winner).map_or("unknown", Winner::label);
            format!("{winner}: {}", Reason::from_code(command.reason).map_or("unknown", Reason::label))
        })
        .collect();
    words.dedup();
    words.join("; ")
}

/// What must follow once these nodes are silent.
struct Row {
    name: &'static str,
    nodes: &'static [&'static str],
    answers: fn(&Command) -> bool,
}

const ROWS: [Row; 5] = [
    Row { name: "mapper", nodes: &["mapper"], answers: |command| is(command, Reason::StaleMap) },
    Row {
        name: "goal",
        nodes: &["goal"],
        answers: |command| is(command, Reason::StaleGoal) || is(command, Reason::StaleProposals),
    },
    Row {
        name: "both proposers",
        nodes: &["policy", "expert"],
        answers: |command| is(command, Reason::StaleProposals),
    },
    Row { name: "odometry", nodes: &["sim"], answers: |command| is(command, Reason::StaleOdometry) },
    Row {
        name: "lead alone, switch",
        nodes: &["expert"],
        // Whatever the filter then makes of the other's wish.
        answers: |command| command.winner == Winner::Policy as u32,
    },
];

/// A line of the table: median, 99th percentile and maximum in milliseconds.
fn print(name: &str, times: &Distribution) {
    let Figures { count, p50, p99, max, .. } = times.figures();
    let [p50, p99, max] = [p50, p99, max].map(Option::unwrap);
    eprintln!("{name:24} {count:4} {p50:7.1} {p99:7.1} {max:7.1}");
}

fn drives(command: &Command) -> bool {
    is(command, Reason::Clear) && command.winner == Winner::Expert as u32 && command.twist.v_m_s > 0.3
}

fn rests(odometry: &Odometry) -> bool {
    odometry.twist.v_m_s < 0.01
}

/// A moment that no cycle of the graph is in step with.
fn wait_a_little(random: &mut Random) {
    pause(Duration::from_micros(300_000 + random.below(200_000)));
}

#[test]
fn injections_are_answered_within_the_ages() {
    let mut random = Random(21);
    eprintln!("silent, answer after [ms]   n     p50     p99     max   seed 21");
    for row in &ROWS {
        let mut drive = Drive::start(&format!("inject-{}", row.nodes[0]), PATIENT);
        let mut times = Distribution::new(None);
        for _ in 0..injections() {
            wait_a_little(&mut random);
            drive.until("driving", drives);
            let processes: Vec<_> = row.nodes.iter().map(|node| drive.running.node(node).unwrap()).collect();
            let before_ns = host_ns();
            processes.iter().for_each(|&process| send_signal(process, libc::SIGSTOP));
            let seen = drive.until("the answer", row.answers);
            processes.iter().for_each(|&process| send_signal(process, libc::SIGCONT));
            let (answer_ns, _) = seen.last().unwrap();
            let took_ns = answer_ns.saturating_sub(before_ns);
            times.add(took_ns);
            if took_ns > LATE_NS {
                eprintln!("{}: after {} ms, {}", row.name, took_ns / 1_000_000, said(&seen));
            }
            // Whatever is silent, and however late the machine, nobody drives on inputs above their ages.
            for (now_ns, command) in &seen {
                let young = command.map_age_s <= 0.1001 && command.odometry_age_s <= 0.0601;
                let stops = command.winner == Winner::Stop as u32;
                assert!(young || stops, "{} at {now_ns}: {command:?}", row.name);
            }
        }
        print(row.name, &times);
        drive.end();
    }
}

/// The arbiter falls silent: the base brakes when the last command ends, and rests after its dead time and v / brake.
#[test]
fn injections_into_the_arbiter_are_answered_by_the_base() {
    let robot = Robot::from_toml("loomo", include_str!("../launch/robots/loomo.toml")).unwrap();
    let mut random = Random(22);
    let mut drive = Drive::start("inject-arbiter", PATIENT);
    let mut odometry = drive.link.inbox(ODOMETRY, Keep::All).unwrap();
    let [mut begun, mut rested] = [(); 2].map(|()| Distribution::new(None));
    for _ in 0..injections() {
        wait_a_little(&mut random);
        let driving = drive.until("driving", drives);
        let arbiter = drive.running.node("arbiter").unwrap();
        let mut seen = Vec::<Odometry>::new();
        let mut valid_until_ns = driving.last().unwrap().1.valid_until_ns;
        let Drive { running, link, step, commands, .. } = &mut drive;
        let mut until = |what: &str, fits: fn(&Odometry) -> bool| {
            running.wait_for(what, |_| {
                link.look(step).unwrap();
                // A queue that is not read loses what comes last.
                commands.each(step, |command, _| valid_until_ns = command.valid_until_ns).unwrap();
                odometry.each(step, |message, _| seen.push(*message)).unwrap();
                seen.last().filter(|odometry| fits(odometry)).map(|_| ())
            });
        };
        until("rolling", |odometry| odometry.twist.v_m_s > 0.3);
        send_signal(arbiter, libc::SIGSTOP);
        until("rest", rests);
        send_signal(arbiter, libc::SIGCONT);
        let over = seen.iter().position(|odometry| odometry.stamp_ns > valid_until_ns).unwrap();
        let rolls_m_s = seen[over.saturating_sub(1)].twist.v_m_s;
        assert!(rolls_m_s > 0.2, "it stopped before its command ended: {rolls_m_s} m/s");
        let since_ns = |odometry: &Odometry| odometry.stamp_ns - valid_until_ns;
        // The odometry of the simulator is as noisy as the robot file says a base tracks.
        let noise_m_s = robot.actuator.tracking_m_s;
        let slower = |odometry: &&Odometry| odometry.twist.v_m_s < rolls_m_s - noise_m_s;
        begun.add(since_ns(seen[over..].iter().find(slower).unwrap()));
        let rest_ns = since_ns(seen[over..].iter().find(|odometry| rests(odometry)).unwrap());
        rested.add(rest_ns);
        // From stamp to stamp of graph time: dead time and v / brake of the weakest base.
        let actuator = &robot.actuator;
        let bound_s = actuator.dead_time_max_s + rolls_m_s / actuator.brake_min_m_s2;
        assert!(rest_ns as f64 * 1e-9 <= f64::from(bound_s), "{rest_ns} ns to rest, {bound_s} s at most");
        let falls = |pair: &[Odometry]| pair[1].twist.v_m_s <= pair[0].twist.v_m_s + noise_m_s;
        assert!(seen[over..].windows(2).all(falls), "it sped up without a command");
    }
    eprintln!("arbiter silent, after its last command ended [ms]   n     p50     p99     max   seed 22");
    print("base slower by 20 mm/s", &begun);
    print("at rest", &rested);
    drive.end();
}

//! Halts the arbiter of a live run while the robot drives, and listens to what the base does without commands.
//!
//! The robot is driven like by an operator, through the arbiter's filter. The launcher takes the halted arbiter for hung
//! and starts it again within some 0.3 s, and the new one brakes: a base without watchdog rolls no longer than that.

use crate::child::signal_process;
use crate::failure::Failure;
use crate::stick::Stick;
use sidestep_bus::{DomainName, environment, host_ns};
use sidestep_identify::Series;
use sidestep_msgs::Twist;

/// `[ns]` most time to reach a steady speed, and how long it must last.
const REACH_NS: u64 = 5_000_000_000;
const STEADY_NS: u64 = 800_000_000;
/// `[m/s]` difference from the speed asked for that is none.
const STEADY_M_S: f64 = 0.02;
/// `[ns]` silence that is listened to, unless the launcher ends it before.
const SILENCE_NS: u64 = 500_000_000;
/// `[ns]` listening after the arbiter was let go.
const AFTER_NS: u64 = 300_000_000;

/// A process that was halted; it goes on when this ends, whatever ends it.
struct Halted(libc::pid_t);

impl Halted {
    fn new(process: libc::pid_t) -> Self {
        signal_process(process, libc::SIGSTOP);
        Self(process)
    }
}

impl Drop for Halted {
    fn drop(&mut self) {
        signal_process(self.0, libc::SIGCONT);
    }
}

/// The arbiter's process of a run.
fn arbiter(run: &DomainName) -> Option<libc::pid_t> {
    let told = format!("{}={}", environment::DOMAIN, run.prefix);
    let begins = |path: &std::path::Path, name: &str, text: &str| {
        let bytes = std::fs::read(path.join(name)).unwrap_or_default();
        bytes.split(|&byte| byte == 0).any(|part| part == text.as_bytes())
    };
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    processes.map(|entry| entry.path()).find_map(|path| {
        let number = path.file_name()?.to_str()?.parse().ok()?;
        (begins(&path, "cmdline", "sidestep-arbiter") && begins(&path, "environ", &told)).then_some(number)
    })
}

/// Whether commands were what was asked for, for long enough.
fn is_steady(series: &Series, v_m_s: f32) -> bool {
    let commands = series.commands();
    let Some(last) = commands.last() else { return false };
    let span = commands.iter().rev().take_while(|sent| (sent.v_m_s - f64::from(v_m_s)).abs() < STEADY_M_S);
    span.last().is_some_and(|first| last.sent_ns - first.sent_ns > STEADY_NS)
}

/// Drives ahead, halts the arbiter, and returns what was sent and what moved.
///
/// # Errors
/// Exit code 1 where the robot did not reach the speed, 3 where the run cannot be joined.
pub(crate) fn measure(run: &DomainName, v_m_s: f32) -> Result<Series, Failure> {
    let missing =
        || Failure::io("no process of the arbiter is on this machine; run `doctor` where the graph runs");
    let process = arbiter(run).ok_or_else(missing)?;
    let mut stick = Stick::take(run)?;
    let until_ns = host_ns() + REACH_NS;
    while !is_steady(&stick.series, v_m_s) {
        stick.wish(Some(Twist::new(v_m_s, 0.0)))?;
        if host_ns() > until_ns {
            let why = stick.reason();
            stick.hold(None, AFTER_NS)?;
            let remedy =
                "needed: 3 m of floor ahead that the robot has seen; turn it there, or lower --speed";
            return Err(Failure::unmet(format!(
                "the robot did not drive steadily at {v_m_s} m/s ({why}); {remedy}"
            )));
        }
    }
    let halted = Halted::new(process);
    stick.hold(None, SILENCE_NS)?;
    drop(halted);
    stick.hold(None, AFTER_NS)?;
    Ok(stick.series)
}

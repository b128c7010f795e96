//! The arbiter in the graph: a command every tick, and one more when the lead's proposal of a new frame arrives.

use crate::{Arbiter, Config, Lead, Resume};
use sidestep_bus::{Boot, Keep, Link, NodeError};
use sidestep_msgs::{
    COMMAND, ESTOP, EXPERT_COMMAND, Header, LOCAL_GOAL, NEAR_FIELD, ODOMETRY, POLICY_COMMAND, RANGES,
    SAFETY_MAP, STATE_ARBITER, Stage, TELEOP, Winner,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// One tick of graph time.
const TICK: Duration = Duration::from_millis(10);

/// Where the emergency stop outlives a crash.
fn latch_file(boot: &Boot, config: &Config) -> PathBuf {
    let in_run = || boot.domain.root.join(format!("{}.estop", boot.domain.prefix));
    if config.latch_file.is_empty() { in_run() } else { PathBuf::from(&config.latch_file) }
}

/// Writes the latch down before it is acted on; a disk that refuses does not stop the stop.
fn keep_latch(path: &Path, latched: bool) {
    let kept = if latched { std::fs::write(path, "latched\n") } else { std::fs::remove_file(path) };
    if let Err(error) = kept {
        eprintln!("arbiter: {}: {error}; the emergency stop will not outlive a crash", path.display());
    }
}

fn configured(boot: &Boot) -> Result<Config, NodeError> {
    let mut config: Config = boot.config()?;
    config.lead = if boot.lead_winner()? == Winner::Policy { Lead::Policy } else { Lead::Expert };
    let operator = boot.graph_text("resume")?.as_deref() == Some("operator");
    config.resume = if operator { Resume::Operator } else { Resume::Auto };
    Ok(config)
}

/// Commands until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config = configured(boot)?;
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut arbiter = Arbiter::new(&config, &boot.robot()?, boot.incarnation).map_err(refused)?;
    let latch = latch_file(boot, &config);
    let mut latched = latch.exists();
    if latched {
        arbiter.latch();
    }

    let mut link = Link::open(boot)?;
    let mut odometry = link.inbox(ODOMETRY, Keep::Newest)?;
    let mut ranges = link.inbox(RANGES, Keep::Newest)?;
    let mut teleop = link.inbox(TELEOP, Keep::Newest)?;
    let mut estop = link.inbox(ESTOP, Keep::All)?;
    let mut near_field = link.inbox(NEAR_FIELD, Keep::Newest)?;
    let mut maps = link.inbox(SAFETY_MAP, Keep::Newest)?;
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest)?;
    let mut policy = link.inbox(POLICY_COMMAND, Keep::Newest)?;
    let mut expert = link.inbox(EXPERT_COMMAND, Keep::Newest)?;
    let mut commands = link.outbox(COMMAND)?;
    let mut states = link.outbox(STATE_ARBITER)?;
    link.wake_on(if config.lead == Lead::Policy { POLICY_COMMAND } else { EXPERT_COMMAND })?;
    link.tick_every(TICK)?;
    // Headers of the newest proposals and map: the command carries on the stamps of those it is about.
    let mut seen = [Header::default(); 3];
    link.run(|step| {
        if step.epoch_raised() {
            arbiter.reset();
        }
        if let Some(message) = odometry.newest(step)? {
            arbiter.odometry(&message, message.header());
        }
        if let Some(message) = ranges.newest(step)? {
            arbiter.ranges(&message);
        }
        if let Some(message) = teleop.newest(step)? {
            arbiter.teleop(&message);
        }
        estop.each(step, |message, _| arbiter.estop(message))?;
        if let Some(message) = near_field.newest(step)? {
            arbiter.near_field(&message);
        }
        if let Some(message) = maps.newest(step)? {
            arbiter.safety_map(&message, message.header());
            seen[0] = *message.header();
        }
        if let Some(message) = goals.newest(step)? {
            arbiter.local_goal(&message, message.header());
        }
        let mut due = step.is_tick();
        for (inbox, winner, slot) in [(&mut policy, Winner::Policy, 1), (&mut expert, Winner::Expert, 2)] {
            if let Some(message) = inbox.newest(step)? {
                due |= arbiter.proposal(winner, &message, message.header());
                seen[slot] = *message.header();
            }
        }
        if !due {
            return Ok(());
        }
        if arbiter.latched() != latched {
            latched = arbiter.latched();
            keep_latch(&latch, latched);
        }
        let (now_ns, open_loop) = (step.now_ns(), step.is_open_loop());
        commands.send_about(step, Stage::Arbiter, &seen, |out| {
            let status = arbiter.step(now_ns, open_loop, out);
            (status, arbiter.source_frame())
        })?;
        if step.owes_state() {
            let after_sequence = commands.next_sequence() - 1;
            states.send(step, |state| {
                state.after_sequence = after_sequence;
                state.size = arbiter.state(&mut state.bytes) as u64;
            })?;
        }
        Ok(())
    })
}

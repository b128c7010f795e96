//! The arbiter in the graph: a command at each answer of the lead and at each tick of 10 ms.

use crate::{Arbiter, Config, ConfigError, Lead, Resume};
use sidestep_bus::{Boot, Keep, Link, NodeError};
use sidestep_msgs::{
    COMMAND, ESTOP, EXPERT_COMMAND, Header, LOCAL_GOAL, NEAR_FIELD, ODOMETRY, POLICY_COMMAND, RANGES,
    SAFETY_MAP, STATE_ARBITER, Stage, TELEOP, Winner,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Control period.
const TICK: Duration = Duration::from_millis(10);

/// The emergency stop on disk, so that it outlives this process.
struct LatchFile {
    path: PathBuf,
    written: bool,
}

impl LatchFile {
    fn open(configured: &str, root: &Path) -> Self {
        let path = if configured.is_empty() { root.join("latch") } else { configured.into() };
        Self { written: path.exists(), path }
    }

    /// Brings the file in line with the latch; before the command that shows it.
    fn keep(&mut self, latched: bool) -> Result<(), NodeError> {
        if latched == self.written {
            return Ok(());
        }
        let done =
            if latched { std::fs::write(&self.path, "latched\n") } else { std::fs::remove_file(&self.path) };
        let remedy = "the file of the emergency stop must be writable; see arbiter.latch_file";
        done.map_err(|source| NodeError::File { path: self.path.display().to_string(), source, remedy })?;
        self.written = latched;
        Ok(())
    }
}

fn configured(boot: &Boot) -> Result<Config, NodeError> {
    let mut config: Config = boot.config()?;
    config.lead = if boot.lead_winner()? == Winner::Policy { Lead::Policy } else { Lead::Expert };
    let operator = boot.graph_text("resume")?.is_some_and(|text| text == "operator");
    config.resume = if operator { Resume::Operator } else { Resume::Auto };
    Ok(config)
}

/// Commands until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, [`NodeError::File`] for the latch, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config = configured(boot)?;
    let refused = |error: ConfigError| NodeError::Configuration(error.to_string());
    let mut arbiter = Arbiter::new(&config, &boot.robot()?, boot.incarnation).map_err(refused)?;
    let mut latch = LatchFile::open(&config.latch_file, &boot.domain.root);
    if latch.written {
        arbiter.latch();
    }

    let mut link = Link::open(boot)?;
    let mut odometry = link.inbox(ODOMETRY, Keep::All)?;
    let mut ranges = link.inbox(RANGES, Keep::Newest)?;
    let mut teleop = link.inbox(TELEOP, Keep::Newest)?;
    let mut estop = link.inbox(ESTOP, Keep::All)?;
    let mut near = link.inbox(NEAR_FIELD, Keep::Newest)?;
    let mut maps = link.inbox(SAFETY_MAP, Keep::All)?;
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest)?;
    let mut proposals = [
        (Winner::Policy, link.inbox(POLICY_COMMAND, Keep::All)?),
        (Winner::Expert, link.inbox(EXPERT_COMMAND, Keep::All)?),
    ];
    let mut commands = link.outbox(COMMAND)?;
    let mut states = link.outbox(STATE_ARBITER)?;
    link.wake_on(POLICY_COMMAND)?;
    link.wake_on(EXPERT_COMMAND)?;
    link.wake_on(ESTOP)?;
    link.tick_every(TICK)?;
    let mut answered = [Header::default(); 2];
    link.run(|step| {
        if step.epoch_raised() {
            arbiter.reset();
        }
        odometry.each(step, |message, header| arbiter.odometry(message, header))?;
        ranges.each(step, |message, _| arbiter.ranges(message))?;
        teleop.each(step, |message, _| arbiter.teleop(message))?;
        estop.each(step, |message, _| arbiter.estop(message))?;
        near.each(step, |message, _| arbiter.near_field(message))?;
        maps.each(step, |message, header| arbiter.safety_map(message, header))?;
        goals.each(step, |message, header| arbiter.local_goal(message, header))?;
        let mut due = step.is_tick();
        for ((from, inbox), newest) in proposals.iter_mut().zip(&mut answered) {
            inbox.each(step, |message, header| {
                due |= arbiter.proposal(*from, message, header);
                *newest = *header;
            })?;
        }
        if !due {
            return Ok(());
        }
        latch.keep(arbiter.latched())?;
        let (now_ns, open_loop) = (step.now_ns(), step.is_open_loop());
        commands.send_about(step, Stage::Arbiter, &answered, |command| {
            let status = arbiter.step(now_ns, open_loop, command);
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

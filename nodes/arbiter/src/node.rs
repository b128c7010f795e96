//! The arbiter in the graph: a command every tick, and one more when the lead's proposal of a new frame arrives.

use crate::latch::LatchFile;
use crate::{Arbiter, Config};
use sidestep_bus::{Boot, Inbox, Keep, Link, NodeError, Step};
use sidestep_msgs::{
    COMMAND, ESTOP, EXPERT_COMMAND, Estop, Header, LOCAL_GOAL, LocalGoal, NEAR_FIELD, NearField, ODOMETRY,
    Odometry, POLICY_COMMAND, Proposal, RANGES, Ranges, SAFETY_MAP, STATE_ARBITER, SafetyMap, Stage, TELEOP,
    Teleop, Winner,
};
use std::time::Duration;

/// What the arbiter reads, in the order of the topic table.
struct Inlets {
    odometry: Inbox<Odometry>,
    ranges: Inbox<Ranges>,
    teleop: Inbox<Teleop>,
    estop: Inbox<Estop>,
    near_field: Inbox<NearField>,
    maps: Inbox<SafetyMap>,
    goals: Inbox<LocalGoal>,
    policy: Inbox<Proposal>,
    expert: Inbox<Proposal>,
    /// Headers of the newest map and proposals: a command carries on the stamps of those it is about.
    seen: [Header; 3],
    /// Whether a new frame of the lead waits for its answer.
    waiting: bool,
    /// Whether the graph has both proposers.
    pair: bool,
}

impl Inlets {
    fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        Ok(Self {
            pair: boot.has_node("policy")? && boot.has_node("expert")?,
            odometry: link.inbox(ODOMETRY, Keep::Newest)?,
            ranges: link.inbox(RANGES, Keep::Newest)?,
            teleop: link.inbox(TELEOP, Keep::Newest)?,
            estop: link.inbox(ESTOP, Keep::All)?,
            near_field: link.inbox(NEAR_FIELD, Keep::Newest)?,
            maps: link.inbox(SAFETY_MAP, Keep::Newest)?,
            goals: link.inbox(LOCAL_GOAL, Keep::Newest)?,
            policy: link.inbox(POLICY_COMMAND, Keep::Newest)?,
            expert: link.inbox(EXPERT_COMMAND, Keep::Newest)?,
            seen: [Header::default(); 3],
            waiting: false,
        })
    }

    /// Hands over what came; whether a new frame of the lead is to be answered: in lockstep, with map and both proposals.
    fn take(&mut self, step: &mut Step, arbiter: &mut Arbiter) -> Result<bool, NodeError> {
        self.odometry.newest(step)?.inspect(|message| arbiter.odometry(message, message.header()));
        self.ranges.newest(step)?.inspect(|message| arbiter.ranges(message));
        self.teleop.newest(step)?.inspect(|message| arbiter.teleop(message));
        self.estop.each(step, |message, _| arbiter.estop(message))?;
        self.near_field.newest(step)?.inspect(|message| arbiter.near_field(message));
        if let Some(map) = self.maps.newest(step)? {
            arbiter.safety_map(&map, map.header());
            self.seen[0] = *map.header();
        }
        self.goals.newest(step)?.inspect(|message| arbiter.local_goal(message, message.header()));
        let proposers = [(&mut self.policy, Winner::Policy), (&mut self.expert, Winner::Expert)];
        for ((inbox, winner), seen) in proposers.into_iter().zip(&mut self.seen[1..]) {
            if let Some(message) = inbox.newest(step)? {
                self.waiting |= arbiter.proposal(winner, &message, message.header());
                *seen = *message.header();
            }
        }
        let [map, policy, expert] = self.seen.map(|header| header.source_frame);
        let complete = (!self.pair || policy == expert) && map == policy.max(expert);
        Ok((complete || !step.is_lockstep()) && std::mem::take(&mut self.waiting))
    }
}

/// Commands until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let resume = boot.graph_text("resume")?;
    let config = boot.config::<Config>()?.under(boot.lead_winner()?, resume.as_deref());
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut arbiter = Arbiter::new(&config, &boot.robot()?, boot.incarnation).map_err(refused)?;
    let mut latch = LatchFile::at(&config.latch_file, &boot.domain.root, &boot.domain.prefix);
    if latch.is_latched() {
        arbiter.latch();
    }
    let mut link = Link::open(boot)?;
    let mut inputs = Inlets::open(&link, boot)?;
    let mut commands = link.outbox(COMMAND)?;
    let mut states = link.outbox(STATE_ARBITER)?;
    link.wake_on(POLICY_COMMAND)?;
    link.wake_on(EXPERT_COMMAND)?;
    if boot.is_lockstep()? {
        link.wake_on(SAFETY_MAP)?;
    }
    link.tick_every(Duration::from_millis(10))?;
    link.run(|step| {
        if step.epoch_raised() {
            arbiter.reset();
        }
        if !inputs.take(step, &mut arbiter)? && !step.is_tick() {
            return Ok(());
        }
        latch.keep(arbiter.latched());
        let (now_ns, open_loop) = (step.now_ns(), step.is_open_loop());
        commands.send_about(step, Stage::Arbiter, &inputs.seen, |out| {
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

//! What the arbiter reads, and when a frame is ready for its answer.

use crate::Arbiter;
use sidestep_bus::{Boot, Inbox, Keep, Link, NodeError, Step};
use sidestep_msgs::{
    ESTOP, EXPERT_COMMAND, Estop, Header, LOCAL_GOAL, LocalGoal, NEAR_FIELD, NearField, ODOMETRY, Odometry,
    POLICY_COMMAND, Proposal, RANGES, Ranges, SAFETY_MAP, SafetyMap, TELEOP, Teleop, Winner,
};

/// What the arbiter reads, in the order of the topic table.
pub(super) struct Inlets {
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
    pub(super) seen: [Header; 3],
    /// Whether a new frame of the lead waits for its answer.
    waiting: bool,
    /// Whether the graph has both proposers.
    pair: bool,
    /// Whether the policy leads.
    policy_leads: bool,
    /// Whether the graph has a guard, and the newest frame that it spoke of.
    guarded: bool,
    guard_frame: u64,
}

impl Inlets {
    pub(super) fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        Ok(Self {
            pair: boot.has_node("policy")? && boot.has_node("expert")?,
            policy_leads: boot.lead_winner()? == Winner::Policy,
            guarded: boot.has_node("guard")?,
            guard_frame: 0,
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

    /// Hands over what came; whether a new frame of the lead is to be answered: in lockstep, with near
    /// field, map and both proposals.
    pub(super) fn take(&mut self, step: &mut Step, arbiter: &mut Arbiter) -> Result<bool, NodeError> {
        let lead = if self.policy_leads { &self.policy } else { &self.expert };
        let on_the_way = || {
            Ok::<_, NodeError>(
                self.near_field.has_news()?
                    || self.maps.has_news()?
                    || self.policy.has_news()?
                    || self.expert.has_news()?,
            )
        };
        let news = if step.is_lockstep() { on_the_way()? } else { lead.has_news()? };
        if !step.is_tick() && !news {
            // Left for the next tick: what a step took must be countable from its header, and in lockstep not depend on when
            // a heartbeat woke it.
            return Ok(false);
        }
        self.odometry.newest(step)?.inspect(|message| arbiter.odometry(message, message.header()));
        self.ranges.newest(step)?.inspect(|message| arbiter.ranges(message));
        self.teleop.newest(step)?.inspect(|message| arbiter.teleop(message));
        self.estop.each(step, |message, _| arbiter.estop(message))?;
        if let Some(field) = self.near_field.newest(step)? {
            arbiter.near_field(&field);
            self.guard_frame = field.header().source_frame;
        }
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
        let watched = !self.guarded || self.guard_frame == map;
        let complete = (!self.pair || policy == expert) && map == policy.max(expert) && watched;
        Ok((complete || !step.is_lockstep()) && std::mem::take(&mut self.waiting))
    }
}

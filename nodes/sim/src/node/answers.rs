//! Who has spoken: all nodes of the graph before time begins, and the nodes on the way of a frame.

use sidestep_bus::{Boot, Inbox, Keep, Link, NodeError, Step};
use sidestep_msgs::{
    EXPERT_COMMAND, Health, LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap, POLICY_COMMAND, Proposal, SAFETY_MAP,
    SafetyMap, health_topic,
};

/// Whoever must beat before time begins, as far as the graph has them.
const AWAITED: &[&str] = &["mapper", "goal", "policy", "expert", "arbiter", "recorder"];

/// The answers on the way of a frame, to name who is silent.
pub(crate) struct Answers {
    maps: Inbox<LocalMap>,
    safety: Inbox<SafetyMap>,
    goals: Inbox<LocalGoal>,
    policy: Inbox<Proposal>,
    expert: Inbox<Proposal>,
    /// Nodes of the graph that did not beat yet.
    absent: Vec<Inbox<Health>>,
}

impl Answers {
    pub(crate) fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        let mut absent = Vec::new();
        for node in AWAITED {
            if let Some(topic) = health_topic(node).filter(|_| boot.has_node(node).unwrap_or(false)) {
                absent.push(link.inbox(topic, Keep::Newest)?);
            }
        }
        Ok(Self {
            maps: link.inbox(LOCAL_MAP, Keep::Newest)?,
            safety: link.inbox(SAFETY_MAP, Keep::Newest)?,
            goals: link.inbox(LOCAL_GOAL, Keep::Newest)?,
            policy: link.inbox(POLICY_COMMAND, Keep::Newest)?,
            expert: link.inbox(EXPERT_COMMAND, Keep::Newest)?,
            absent,
        })
    }

    /// Whether every node of the graph has said that it is ready.
    pub(crate) fn all_ready(&mut self, step: &mut Step) -> Result<bool, NodeError> {
        let mut error = None;
        self.absent.retain_mut(|inbox| match inbox.newest(step) {
            Ok(beat) => beat.is_none(),
            Err(found) => {
                error = Some(found);
                true
            }
        });
        error.map_or(Ok(self.absent.is_empty()), Err)
    }

    /// The first node on the way that did not speak of a frame.
    pub(crate) fn silent(&mut self, step: &mut Step, frame: u64) -> Result<&'static str, NodeError> {
        let newest = [
            ("mapper", self.maps.newest(step)?.map(|message| message.header().source_frame)),
            ("mapper", self.safety.newest(step)?.map(|message| message.header().source_frame)),
            ("goal", self.goals.newest(step)?.map(|message| message.header().source_frame)),
            ("policy", self.policy.newest(step)?.map(|message| message.header().source_frame)),
            ("expert", self.expert.newest(step)?.map(|message| message.header().source_frame)),
        ];
        let silent = newest.into_iter().find(|(_, told)| *told != Some(frame));
        Ok(silent.map_or("arbiter", |(node, _)| node))
    }
}

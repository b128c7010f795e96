//! When the black box is kept without being asked: the arbiter stops for a fault, or the robot touches something.

use sidestep_msgs::{
    COMMAND, Code, Command, Header, Health, NodeState, Reason, SNAPSHOT, Snapshot, TOPICS, TRUTH, Truth,
};
use std::mem::offset_of;

/// `[ns]` troubles closer together than this are one, and give one file.
const CALM_NS: u64 = 10_000_000_000;

/// Why the black box is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// The arbiter stopped the robot for a fault.
    Fault(Reason),
    /// The simulated robot touches something.
    Contact,
    /// Somebody asked, with this token.
    Asked(u64),
}

impl std::fmt::Display for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Fault(reason) => f.write_str(reason.label()),
            Self::Contact => f.write_str("contact"),
            Self::Asked(_) => f.write_str("asked"),
        }
    }
}

/// Whether a reason is a fault that somebody will want to understand: not a wish, not a way through the world.
fn is_fault(reason: Reason) -> bool {
    use Reason as R;
    matches!(
        reason,
        R::EstopLatched
            | R::StaleMap
            | R::RepeatedMap
            | R::BackwardMap
            | R::RefusedMap
            | R::StaleGoal
            | R::StaleProposals
            | R::UnfitProposals
            | R::StaleNearField
            | R::StaleOdometry
            | R::BackwardOdometry
            | R::UnfitOdometry
            | R::FrozenOdometry
            | R::Slip
            | R::PoseJump
            | R::StaleTeleop
            | R::Emergency
    )
}

/// Looks at each message for a cause.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// A command without fault, or a moment without contact, was seen: what follows is news.
    well: bool,
    /// `[ns]` host time at which trouble was last seen.
    trouble_ns: Option<u64>,
    token: u64,
}

/// Whether the black box must see a topic, recorded or not.
pub(crate) fn is_watched(topic: usize) -> bool {
    [COMMAND.index, TRUTH.index, SNAPSHOT.index].contains(&topic) || is_heartbeat(topic)
}

fn is_heartbeat(topic: usize) -> bool {
    TOPICS[topic].name.starts_with("health/")
}

/// Whether a heartbeat says that its node was asked to stop.
fn is_stopping(record: &[u8]) -> bool {
    let place = size_of::<Header>() + offset_of!(Health, state);
    record[place..place + 4] == (NodeState::Stopping as u32).to_le_bytes()
}

fn message<M: bytemuck::AnyBitPattern>(record: &[u8]) -> M {
    bytemuck::pod_read_unaligned(&record[size_of::<Header>()..])
}

impl Watch {
    /// The cause that a record (header and message) gives to keep the black box, received at host time `received_ns`.
    pub(crate) fn see(&mut self, topic: usize, record: &[u8], received_ns: u64) -> Option<Cause> {
        let cause = if topic == COMMAND.index {
            let reason = Reason::from_code(message::<Command>(record).reason);
            reason.filter(|&reason| is_fault(reason)).map(Cause::Fault)
        } else if topic == TRUTH.index {
            (message::<Truth>(record).contact != 0).then_some(Cause::Contact)
        } else if topic == SNAPSHOT.index {
            // Said again until it is acknowledged.
            let token = message::<Snapshot>(record).token;
            let news = std::mem::replace(&mut self.token, token) != token;
            return news.then_some(Cause::Asked(token));
        } else {
            if is_heartbeat(topic) && is_stopping(record) {
                // The end of a run takes the arbiter's inputs away one by one.
                self.trouble_ns = Some(received_ns);
            }
            return None;
        };
        let Some(cause) = cause else {
            self.well = true;
            return None;
        };
        let before_ns = self.trouble_ns.replace(received_ns);
        let calm = before_ns.is_none_or(|before_ns| received_ns.saturating_sub(before_ns) > CALM_NS);
        (self.well && calm).then_some(cause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    fn command(reason: Reason) -> Vec<u8> {
        let command = Command { reason: reason as u32, ..bytemuck::Zeroable::zeroed() };
        [vec![0; size_of::<Header>()], bytemuck::bytes_of(&command).to_vec()].concat()
    }

    fn contact(contact: u32) -> Vec<u8> {
        let truth = Truth { contact, ..bytemuck::Zeroable::zeroed() };
        [vec![0; size_of::<Header>()], bytemuck::bytes_of(&truth).to_vec()].concat()
    }

    #[test]
    fn one_trouble_is_one_cause_however_long_it_flickers() {
        let mut watch = Watch::default();
        let mut see = |reason, second| watch.see(COMMAND.index, &command(reason), second * SECOND_NS);
        assert_eq!(see(Reason::Clear, 1), None);
        assert_eq!(see(Reason::StaleMap, 2), Some(Cause::Fault(Reason::StaleMap)));
        for second in 3..60 {
            let reason = if second % 5 == 0 { Reason::Emergency } else { Reason::Braking };
            assert_eq!(see(reason, second), None, "at {second} s");
        }
        assert_eq!(see(Reason::Emergency, 80), Some(Cause::Fault(Reason::Emergency)));
        assert_eq!(watch.see(TRUTH.index, &contact(1), 81 * SECOND_NS), None, "the same trouble");
        assert_eq!(watch.see(TRUTH.index, &contact(1), 99 * SECOND_NS), Some(Cause::Contact));
    }

    #[test]
    fn a_trouble_that_was_there_before_the_recorder_and_a_blocked_way_are_no_cause() {
        let mut watch = Watch::default();
        for reason in [Reason::EstopLatched, Reason::NoMap, Reason::Braking, Reason::BoxedIn, Reason::NoGoal]
        {
            assert_eq!(watch.see(COMMAND.index, &command(reason), SECOND_NS), None, "{reason:?}");
        }
    }

    #[test]
    fn the_end_of_a_run_is_no_trouble() {
        let mut watch = Watch::default();
        assert_eq!(watch.see(COMMAND.index, &command(Reason::Clear), SECOND_NS), None);
        let health = Health { state: NodeState::Stopping as u32, ..bytemuck::Zeroable::zeroed() };
        let beat = [vec![0; size_of::<Header>()], bytemuck::bytes_of(&health).to_vec()].concat();
        assert!(is_watched(sidestep_msgs::HEALTH_POLICY.index) && !is_watched(sidestep_msgs::DEPTH.index));
        assert_eq!(watch.see(sidestep_msgs::HEALTH_POLICY.index, &beat, 2 * SECOND_NS), None);
        assert_eq!(watch.see(COMMAND.index, &command(Reason::StaleProposals), 3 * SECOND_NS), None);
    }

    #[test]
    fn a_token_asks_once() {
        let mut watch = Watch::default();
        let asked = [vec![0; size_of::<Header>()], 7_u64.to_le_bytes().to_vec()].concat();
        assert_eq!(watch.see(SNAPSHOT.index, &asked, 1), Some(Cause::Asked(7)));
        assert_eq!(watch.see(SNAPSHOT.index, &asked, 2), None);
    }
}

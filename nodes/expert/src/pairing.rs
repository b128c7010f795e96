//! Which map, goal and policy proposal belong together, and when the expert stops waiting for the policy.

use sidestep_msgs::{Code, Header, LocalGoal, LocalMap, Proposal, Status, Twist};

/// Maps kept: the one that the newest goal names, and the one after it that came already.
const MAPS: usize = 2;

/// A goal that waits for its answer.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// The goal.
    pub goal: LocalGoal,
    /// Its header.
    pub header: Header,
    /// `[ns]` graph time from which it is answered without the policy.
    pub deadline_ns: u64,
}

/// What has arrived.
#[derive(Debug)]
pub struct Pairing {
    maps: [(u64, LocalMap); MAPS],
    next_map: usize,
    frame: Option<Frame>,
    policy: Option<(Proposal, Header)>,
    /// `[ns]` how long to wait for the policy; `None` = not refining.
    wait_ns: Option<u64>,
}

impl Pairing {
    /// Nothing has come; `wait_ns` of graph time for the policy, `None` where the expert does not refine.
    #[must_use]
    pub fn new(wait_ns: Option<u64>) -> Self {
        Self { maps: [(0, LocalMap::default()); MAPS], next_map: 0, frame: None, policy: None, wait_ns }
    }

    /// Forgets everything: graph time jumped.
    pub fn reset(&mut self) {
        *self = Self::new(self.wait_ns);
    }

    /// Takes a map.
    pub fn map(&mut self, map: &LocalMap, header: &Header) {
        self.maps[self.next_map] = (header.sequence, *map);
        self.next_map = (self.next_map + 1) % MAPS;
    }

    /// Takes a goal; one that still waited is passed over. Returns when to wake at the latest.
    pub fn goal(&mut self, goal: &LocalGoal, header: &Header, now_ns: u64) -> u64 {
        let waits = header.status == Status::Ok.code();
        let wait_ns = self.wait_ns.filter(|_| waits).unwrap_or(0);
        let deadline_ns = now_ns.saturating_add(wait_ns);
        self.frame = Some(Frame { goal: *goal, header: *header, deadline_ns });
        deadline_ns
    }

    /// Takes a proposal of the policy.
    pub fn policy(&mut self, proposal: &Proposal, header: &Header) {
        self.policy = Some((*proposal, *header));
    }

    /// The frame to answer now, with the policy's proposal where there is one for it.
    pub fn ready(&mut self, now_ns: u64) -> Option<(Frame, Option<Twist>)> {
        let frame = self.frame?;
        let answer = self.policy.as_ref().filter(|(proposal, header)| {
            header.source_frame == frame.header.source_frame && proposal.capture_ns == frame.goal.capture_ns
        });
        if answer.is_none() && now_ns < frame.deadline_ns {
            return None;
        }
        self.frame = None;
        let fit = answer.filter(|(_, header)| header.status == Status::Ok.code());
        Some((frame, fit.map(|(proposal, _)| proposal.twist)))
    }

    /// The map that a goal names.
    #[must_use]
    pub fn map_of(&self, goal: &LocalGoal) -> Option<&LocalMap> {
        let named = |(sequence, map): &&(u64, LocalMap)| {
            *sequence == goal.map_sequence && map.capture_ns == goal.capture_ns
        };
        self.maps.iter().find(named).map(|(_, map)| map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal(number: u64) -> (LocalGoal, Header) {
        let goal = LocalGoal { map_sequence: number, capture_ns: number * 100, ..LocalGoal::default() };
        (goal, Header { source_frame: number, ..Header::default() })
    }

    fn policy(number: u64, status: Status) -> (Proposal, Header) {
        let proposal =
            Proposal { capture_ns: number * 100, twist: Twist::new(0.5, 0.1), ..Proposal::default() };
        (proposal, Header { source_frame: number, status: status.code(), ..Header::default() })
    }

    #[test]
    fn a_goal_finds_the_map_it_names_and_no_other() {
        let mut pairing = Pairing::new(None);
        for number in [7, 8] {
            let map = LocalMap { capture_ns: number * 100, ..LocalMap::default() };
            pairing.map(&map, &Header { sequence: number, ..Header::default() });
        }
        assert_eq!(pairing.map_of(&goal(7).0).unwrap().capture_ns, 700);
        assert_eq!(pairing.map_of(&goal(8).0).unwrap().capture_ns, 800);
        assert!(pairing.map_of(&goal(9).0).is_none());
        // The same number from before a restart of the mapper.
        assert!(pairing.map_of(&LocalGoal { capture_ns: 1, ..goal(7).0 }).is_none());
    }

    #[test]
    fn without_refining_a_goal_is_answered_at_once() {
        let mut pairing = Pairing::new(None);
        let (one, header) = goal(1);
        assert_eq!(pairing.goal(&one, &header, 50), 50);
        assert!(pairing.ready(50).is_some_and(|(_, seed)| seed.is_none()));
        assert!(pairing.ready(50).is_none());
    }

    #[test]
    fn refining_waits_for_the_policy_of_its_frame_but_not_for_ever() {
        let mut pairing = Pairing::new(Some(10));
        let (one, header) = goal(1);
        let (old, old_header) = policy(0, Status::Ok);
        pairing.policy(&old, &old_header);
        assert_eq!(pairing.goal(&one, &header, 50), 60);
        assert!(pairing.ready(55).is_none());
        let (fresh, fresh_header) = policy(1, Status::Ok);
        pairing.policy(&fresh, &fresh_header);
        assert_eq!(pairing.ready(56).unwrap().1, Some(fresh.twist));
        pairing.goal(&goal(2).0, &goal(2).1, 90);
        assert_eq!(pairing.ready(100).unwrap().1, None);
    }

    #[test]
    fn a_policy_at_fault_and_a_goal_without_work_are_not_waited_for() {
        let mut pairing = Pairing::new(Some(10));
        pairing.goal(&goal(1).0, &goal(1).1, 50);
        let (fault, fault_header) = policy(1, Status::Fault);
        pairing.policy(&fault, &fault_header);
        assert_eq!(pairing.ready(51).unwrap().1, None);
        let arrived = Header { status: Status::Arrived.code(), ..goal(2).1 };
        pairing.goal(&goal(2).0, &arrived, 60);
        assert!(pairing.ready(60).is_some());
    }
}

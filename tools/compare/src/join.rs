//! Messages of one recording joined by the frame that they are about; no more than some seconds are held.

use serde::Serialize;
use sidestep_msgs::{
    COMMAND, Code, Command, EXPERT_COMMAND, LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap, POLICY_COMMAND,
    Proposal, Status,
};
use sidestep_player::Entry;
use std::collections::{BTreeMap, VecDeque};

/// Frames held until everything about them was read; at 30 Hz two seconds, more than the recorder is ever out of order.
const HELD: usize = 64;

/// Everything that was said about one frame.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub(crate) run: u64,
    pub(crate) epoch: u32,
    /// Number of the depth frame.
    pub(crate) number: u64,
    pub(crate) capture_ns: u64,
    /// `[s]` since the first message, without the jumps of a playback that loops.
    pub(crate) time_s: f64,
    pub(crate) map: Option<Box<LocalMap>>,
    pub(crate) goal: Option<LocalGoal>,
    /// Of policy and expert, with status.
    pub(crate) proposals: [Option<(Proposal, u32)>; 2],
    /// The first command that answers the frame.
    pub(crate) command: Option<Command>,
}

/// How many frames have what.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Coverage {
    /// Frames with a local map.
    pub maps: u64,
    /// Of these, with a proposal of the policy.
    pub policy: u64,
    /// Of these, with a proposal of the expert.
    pub expert: u64,
    /// Of these, with both.
    pub both: u64,
    /// Depth frames whose number was skipped between two maps.
    pub skipped: u64,
    /// Proposals by status: of the policy.
    pub policy_statuses: BTreeMap<&'static str, u64>,
    /// Proposals by status: of the expert.
    pub expert_statuses: BTreeMap<&'static str, u64>,
}

/// Graph time as seconds that never run backward: where an epoch begins, time goes on from where the last one ended.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seconds {
    epoch: Option<u32>,
    base_ns: u64,
    start_s: f64,
    last_s: f64,
}

impl Seconds {
    pub(crate) fn last_s(&self) -> f64 {
        self.last_s
    }

    pub(crate) fn of(&mut self, epoch: u32, now_ns: u64) -> f64 {
        if self.epoch != Some(epoch) {
            (self.epoch, self.base_ns, self.start_s) = (Some(epoch), now_ns, self.last_s);
        }
        let since_s = (now_ns as i128 - i128::from(self.base_ns)) as f64 * 1e-9;
        let time_s = (self.start_s + since_s).max(0.0);
        self.last_s = self.last_s.max(time_s);
        time_s
    }
}

/// Puts messages together.
#[derive(Debug, Default)]
pub(crate) struct Joiner {
    held: VecDeque<Frame>,
    newest: Option<(u32, u64)>,
    pub(crate) coverage: Coverage,
}

impl Joiner {
    /// Takes a message at its time; gives a frame about which nothing more will come.
    pub(crate) fn take(&mut self, entry: &Entry, time_s: f64) -> Option<Frame> {
        let number = entry.header.source_frame;
        if number == 0 {
            return None;
        }
        if let Some(map) = entry.read(LOCAL_MAP) {
            self.note_gap(entry.header.epoch, number);
            self.frame(entry, map.capture_ns, time_s).map.get_or_insert_with(|| Box::new(map));
        } else if let Some(goal) = entry.read(LOCAL_GOAL) {
            self.frame(entry, goal.capture_ns, time_s).goal.get_or_insert(goal);
        } else if let Some(proposal) = entry.read(POLICY_COMMAND) {
            let said = (proposal, entry.header.status);
            self.frame(entry, proposal.capture_ns, time_s).proposals[0].get_or_insert(said);
        } else if let Some(proposal) = entry.read(EXPERT_COMMAND) {
            let said = (proposal, entry.header.status);
            self.frame(entry, proposal.capture_ns, time_s).proposals[1].get_or_insert(said);
        } else if let Some(command) = entry.read(COMMAND)
            && command.answers == 1
        {
            // A command has no capture stamp: it is about the newest frame of its number.
            let same = |frame: &&mut Frame| frame.epoch == entry.header.epoch && frame.number == number;
            if let Some(frame) = self.held.iter_mut().rev().find(same) {
                frame.command.get_or_insert(command);
            }
        }
        if self.held.len() > HELD { self.next() } else { None }
    }

    /// At the end: the frames still held, oldest first.
    pub(crate) fn next(&mut self) -> Option<Frame> {
        let frame = self.held.pop_front()?;
        if frame.map.is_some() {
            let coverage = &mut self.coverage;
            coverage.maps += 1;
            let has = frame.proposals.each_ref().map(Option::is_some);
            coverage.policy += u64::from(has[0]);
            coverage.expert += u64::from(has[1]);
            coverage.both += u64::from(has[0] && has[1]);
        }
        let statuses = [&mut self.coverage.policy_statuses, &mut self.coverage.expert_statuses];
        for (statuses, said) in statuses.into_iter().zip(&frame.proposals) {
            if let Some((_, status)) = said {
                let label = Status::from_code(*status).map_or("unknown", Status::label);
                *statuses.entry(label).or_default() += 1;
            }
        }
        Some(frame)
    }

    fn note_gap(&mut self, epoch: u32, number: u64) {
        if let Some((last_epoch, last)) = self.newest
            && last_epoch == epoch
        {
            // A driver that was started again counts from 1.
            self.coverage.skipped += number.saturating_sub(last + 1);
        }
        self.newest = Some((epoch, number));
    }

    /// The frame that a message is about.
    fn frame(&mut self, entry: &Entry, capture_ns: u64, time_s: f64) -> &mut Frame {
        let (epoch, number, run) = (entry.header.epoch, entry.header.source_frame, entry.header.run);
        let same =
            |frame: &Frame| frame.epoch == epoch && frame.number == number && frame.capture_ns == capture_ns;
        let place = self.held.iter().rposition(same).unwrap_or_else(|| {
            let (map, goal, command, proposals) = (None, None, None, [None; 2]);
            self.held.push_back(Frame {
                run,
                epoch,
                number,
                capture_ns,
                time_s,
                map,
                goal,
                proposals,
                command,
            });
            self.held.len() - 1
        });
        &mut self.held[place]
    }
}

//! Lockstep as its driver sees it: one question at a time, answered by the arbiter's command before the next is put.

use crate::absent::Absent;
use crate::bookmark::Bookmark;
use crate::boot::Boot;
use crate::clock::{host_ns, pause};
use crate::error::NodeError;
use crate::inbox::{Inbox, Keep};
use crate::link::Link;
use crate::step::Step;
use sidestep_msgs::{
    Command, EXPERT_COMMAND, HEALTH_RECORDER, Header, Health, LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap,
    NEAR_FIELD, NearField, POLICY_COMMAND, Proposal, SAFETY_MAP, SafetyMap,
};
use std::collections::VecDeque;
use std::time::Duration;

/// `[ns]` host time that an answer may take, and silence after which a recorder is not waited for.
const PATIENCE_NS: u64 = 2_000_000_000;
/// Questions, and frames among them, that the recorder may be behind: one frame less than its ring holds.
const BEHIND_MOST: (usize, usize) = (24, 2);
/// `[ns]` host time for which the recorder's bookmark is watched before the driver's own loop turns: its heart must beat.
const MOMENT_NS: u64 = 10_000_000;
const LOOK_EVERY: Duration = Duration::from_micros(200);

/// What a lockstep driver puts to the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// Every 10 ms: what to do now?
    Tick {
        /// `[ns]` graph time.
        stamp_ns: u64,
        /// From 0.
        number: u64,
    },
    /// An image: what to do about it?
    Frame {
        /// `[ns]` graph time.
        stamp_ns: u64,
        /// From 1, the sequence of the image.
        number: u64,
    },
}

impl Question {
    /// `[ns]` graph time.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        let (Self::Tick { stamp_ns, .. } | Self::Frame { stamp_ns, .. }) = self;
        *stamp_ns
    }

    /// Whether a command is the answer.
    #[must_use]
    pub fn is_answered_by(&self, command: &Command, header: &Header) -> bool {
        match *self {
            Self::Tick { stamp_ns, .. } => header.now_ns == stamp_ns,
            Self::Frame { number, .. } => command.answers != 0 && header.source_frame == number,
        }
    }
}

/// The question that is put, and whoever has to say something to it.
pub struct Answers {
    asked: Option<(Question, u64)>,
    answered: bool,
    recorder: Option<Behind>,
    maps: Inbox<LocalMap>,
    safety: Inbox<SafetyMap>,
    /// Where the graph has a guard.
    near: Option<Inbox<NearField>>,
    goals: Inbox<LocalGoal>,
    policy: Inbox<Proposal>,
    expert: Inbox<Proposal>,
    absent: Absent,
}

impl std::fmt::Debug for Answers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Answers").field("asked", &self.asked).finish_non_exhaustive()
    }
}

impl Answers {
    /// Listens to the graph of a driver that is about to begin.
    ///
    /// # Errors
    /// [`NodeError::Transport`], or what the boot says of the graph file.
    pub fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        let recorder = boot.has_node("recorder")?.then(|| Behind::open(link, boot)).transpose()?;
        Ok(Self {
            asked: None,
            answered: true,
            recorder,
            maps: link.inbox(LOCAL_MAP, Keep::Newest)?,
            safety: link.inbox(SAFETY_MAP, Keep::Newest)?,
            near: boot.has_node("guard")?.then(|| link.inbox(NEAR_FIELD, Keep::Newest)).transpose()?,
            goals: link.inbox(LOCAL_GOAL, Keep::Newest)?,
            policy: link.inbox(POLICY_COMMAND, Keep::Newest)?,
            expert: link.inbox(EXPERT_COMMAND, Keep::Newest)?,
            absent: Absent::open(link, boot)?,
        })
    }

    /// The question put last.
    #[must_use]
    pub fn asked(&self) -> Option<Question> {
        self.asked.map(|(question, _)| question)
    }

    /// Takes note of a command.
    pub fn hear(&mut self, command: &Command, header: &Header) {
        self.answered |= self.asked.is_some_and(|(question, _)| question.is_answered_by(command, header));
    }

    /// Whether the next question may be put: every node is there, the last question is answered, and the recorder has
    /// room for what follows.
    ///
    /// # Errors
    /// [`NodeError::Silent`] with the node that did not answer in time, or [`NodeError::Transport`].
    pub fn may_ask(&mut self, step: &mut Step) -> Result<bool, NodeError> {
        let Some((question, since_ns)) = self.asked else {
            return self.absent.are_none();
        };
        if self.answered {
            return self.recorder.as_mut().map_or(Ok(true), Behind::catches_up);
        }
        let waited_ns = host_ns() - since_ns;
        if waited_ns < PATIENCE_NS {
            return Ok(false);
        }
        let (node, what) = match question {
            Question::Tick { number, .. } => ("arbiter", format!("tick {number}")),
            Question::Frame { number, .. } => (self.silent(step, number)?, format!("frame {number}")),
        };
        Err(NodeError::Silent { node, what, waited_s: waited_ns as f64 * 1e-9 })
    }

    /// Notes a question that was put with this word of the clock.
    pub fn ask(&mut self, question: Question, clock_sequence: u64) {
        (self.asked, self.answered) = (Some((question, host_ns())), false);
        if let Some(recorder) = &mut self.recorder {
            recorder.told.push_back((clock_sequence, matches!(question, Question::Frame { .. })));
        }
    }

    /// The first node on the way that did not speak of a frame.
    fn silent(&mut self, step: &mut Step, frame: u64) -> Result<&'static str, NodeError> {
        let near = match &mut self.near {
            Some(near) => near.newest(step)?.map(|message| message.header().source_frame),
            None => Some(frame),
        };
        let newest = [
            ("mapper", self.maps.newest(step)?.map(|message| message.header().source_frame)),
            ("mapper", self.safety.newest(step)?.map(|message| message.header().source_frame)),
            ("guard", near),
            ("goal", self.goals.newest(step)?.map(|message| message.header().source_frame)),
            ("policy", self.policy.newest(step)?.map(|message| message.header().source_frame)),
            ("expert", self.expert.newest(step)?.map(|message| message.header().source_frame)),
        ];
        let silent = newest.into_iter().find(|(_, told)| *told != Some(frame));
        Ok(silent.map_or("arbiter", |(node, _)| node))
    }
}

/// How far the recorder is behind.
struct Behind {
    boot: Boot,
    mark: Bookmark,
    /// Questions that it may not have taken: word of the clock, and whether it was a frame.
    told: VecDeque<(u64, bool)>,
    beats: Inbox<Health>,
    /// `[ns]` host time of its newest heartbeat that was heard.
    beat_ns: u64,
}

impl Behind {
    fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        let (mark, told) = (Bookmark::read(boot, "recorder"), VecDeque::new());
        let beats = link.inbox(HEALTH_RECORDER, Keep::Newest)?;
        Ok(Self { boot: boot.clone(), mark, told, beats, beat_ns: host_ns() })
    }

    fn is_far(&mut self) -> bool {
        if self.mark.told().is_none() {
            self.mark = Bookmark::read(&self.boot, "recorder");
        }
        // Of the word itself nothing is sure: a frame follows it.
        let taken = self.mark.told().unwrap_or(0);
        while self.told.front().is_some_and(|(sequence, _)| *sequence < taken) {
            self.told.pop_front();
        }
        let frames = self.told.iter().filter(|(_, is_frame)| *is_frame).count();
        self.told.len() > BEHIND_MOST.0 || frames > BEHIND_MOST.1
    }

    /// Waits a moment for the recorder; whether it has come near enough. It is waited for as long as its heart beats: a
    /// disk may take its time. One that is gone is not.
    fn catches_up(&mut self) -> Result<bool, NodeError> {
        let until_ns = host_ns() + MOMENT_NS;
        while self.is_far() {
            if host_ns() >= until_ns {
                if self.beats.newest(&mut Step::new())?.is_some() {
                    self.beat_ns = host_ns();
                }
                let gone = host_ns() - self.beat_ns > PATIENCE_NS;
                if gone {
                    self.told.clear();
                }
                return Ok(gone);
            }
            pause(LOOK_EVERY);
        }
        self.beat_ns = host_ns();
        Ok(true)
    }
}

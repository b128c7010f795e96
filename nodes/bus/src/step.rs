//! One step of a node: its one time, what it took, whom it follows.

use sidestep_msgs::{Header, INPUTS_MAX, STAGES, Stage, StageStamp, Status, Taken};

/// `[ns]` graph time between two states of a node.
const STATE_EVERY_NS: u64 = 10_000_000_000;

/// Given to the node's closure at each wake; keeps what was taken until an output carried it away.
#[derive(Debug)]
pub struct Step {
    pub(crate) now_ns: u64,
    pub(crate) receive_ns: u64,
    pub(crate) epoch: u32,
    pub(crate) epoch_raised: bool,
    pub(crate) open_loop: bool,
    pub(crate) lockstep: bool,
    pub(crate) clock_sequence: u64,
    pub(crate) tick: bool,
    pub(crate) wake_at_ns: Option<u64>,
    pub(crate) published: bool,
    state_due_ns: u64,
    pub(crate) status: Status,
    source_frame: u64,
    stages: [StageStamp; STAGES],
    stage: Option<Stage>,
    taken: [Taken; INPUTS_MAX],
    taken_count: usize,
}

impl Default for Step {
    fn default() -> Self {
        Self::new()
    }
}

impl Step {
    /// A step that took nothing yet; loops make their own.
    #[must_use]
    pub fn new() -> Self {
        Self {
            now_ns: 0,
            receive_ns: 0,
            epoch: 0,
            epoch_raised: false,
            open_loop: false,
            lockstep: false,
            clock_sequence: 0,
            tick: false,
            wake_at_ns: None,
            published: false,
            state_due_ns: 0,
            status: Status::Ok,
            source_frame: 0,
            stages: [StageStamp::default(); STAGES],
            stage: None,
            taken: [Taken::default(); INPUTS_MAX],
            taken_count: 0,
        }
    }

    /// Forgets what an output has carried away, and whom the last step followed.
    pub(crate) fn begin(&mut self, now_ns: u64, receive_ns: u64) {
        if self.published {
            self.taken_count = 0;
            self.published = false;
        }
        if now_ns < self.now_ns {
            // What was due in the old time is due now: a driver's word set graph time back.
            self.state_due_ns = 0;
            self.wake_at_ns = self.wake_at_ns.map(|_| now_ns);
        }
        self.now_ns = now_ns;
        self.receive_ns = receive_ns;
        self.source_frame = 0;
        self.stages = [StageStamp::default(); STAGES];
        self.stage = None;
        self.status = Status::Ok;
    }

    /// `[ns]` graph time of this step, its only time.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Sets the time of this step: for a lockstep driver, whose word moves time.
    pub fn set_now(&mut self, graph_ns: u64) {
        self.now_ns = graph_ns;
    }

    /// Whether playback looped or sought since the last step: the node must reset.
    #[must_use]
    pub fn epoch_raised(&self) -> bool {
        self.epoch_raised
    }

    /// Whether the sensors are a recording that no command can change.
    #[must_use]
    pub fn is_open_loop(&self) -> bool {
        self.open_loop
    }

    /// Whether graph time moves only when the driver says so.
    #[must_use]
    pub fn is_lockstep(&self) -> bool {
        self.lockstep
    }

    /// Number of the newest word of the clock that was there when this step began; 0 = none.
    #[must_use]
    pub fn clock_sequence(&self) -> u64 {
        self.clock_sequence
    }

    /// The recorder asks for the state.
    pub(crate) fn owe_state(&mut self) {
        self.state_due_ns = 0;
    }

    /// Whether the node owes its state to the recording: after its first step, every 10 s, and when a file begins; asking
    /// settles the debt.
    #[must_use]
    pub fn owes_state(&mut self) -> bool {
        let due = self.epoch_raised || self.now_ns >= self.state_due_ns;
        if due {
            self.state_due_ns = self.now_ns + STATE_EVERY_NS;
        }
        due
    }

    /// Whether the period of [`crate::Link::tick_every`] has passed.
    #[must_use]
    pub fn is_tick(&self) -> bool {
        self.tick
    }

    /// `[ns]` the graph time a span from now, to be woken at or to compare with later.
    #[must_use]
    pub fn deadline(&self, span_ns: u64) -> u64 {
        self.now_ns.saturating_add(span_ns)
    }

    /// Asks to be woken at a graph time, once; the earliest wish of a step counts.
    pub fn wake_at(&mut self, graph_ns: u64) {
        self.wake_at_ns = Some(self.wake_at_ns.map_or(graph_ns, |earlier| earlier.min(graph_ns)));
    }

    /// Makes the outputs of this step about the frame of an input, and carries its stamps on.
    pub fn follow(&mut self, input: &Header, stage: Stage) {
        self.about(input);
        self.stage = Some(stage);
    }

    /// As [`Step::follow`], for a node that is no stage of the way from frame to command.
    pub fn about(&mut self, input: &Header) {
        self.source_frame = input.source_frame;
        for (mine, theirs) in self.stages.iter_mut().zip(&input.stages) {
            if theirs.send_ns != 0 {
                *mine = *theirs;
            }
        }
    }

    /// Makes the outputs of this step about a frame without an input to follow: drivers, and stops of the arbiter.
    pub fn originate(&mut self, source_frame: u64, stage: Stage) {
        self.source_frame = source_frame;
        self.stage = Some(stage);
    }

    /// Says whether the step could do its work.
    pub fn status(&mut self, status: Status) {
        self.status = status;
    }

    /// Notes that a message was taken.
    pub(crate) fn note(&mut self, topic: usize, header: &Header) {
        let entries = &mut self.taken[..self.taken_count];
        let same =
            |entry: &&mut Taken| entry.topic as usize == topic && entry.incarnation == header.incarnation;
        if let Some(entry) = entries.iter_mut().rev().find(same) {
            entry.last = header.sequence;
            entry.count += 1;
        } else if self.taken_count < INPUTS_MAX {
            // In the order of the table, whatever the order of the inboxes.
            let place =
                entries.iter().position(|entry| entry.topic as usize > topic).unwrap_or(self.taken_count);
            self.taken.copy_within(place..self.taken_count, place + 1);
            self.taken[place] = Taken {
                first: header.sequence,
                last: header.sequence,
                count: 1,
                incarnation: header.incarnation,
                topic: topic as u32,
                _pad: 0,
            };
            self.taken_count += 1;
        }
    }

    /// The header of an output; the caller fills run, incarnation and sequence.
    pub(crate) fn header(&self, send_ns: u64) -> Header {
        let mut header = Header {
            source_frame: self.source_frame,
            now_ns: self.now_ns,
            epoch: self.epoch,
            status: self.status as u32,
            input_count: self.taken_count as u32,
            inputs: self.taken,
            stages: self.stages,
            ..Header::default()
        };
        header.inputs[self.taken_count..].fill(Taken::default());
        if let Some(stage) = self.stage {
            header.stages[stage as usize] = StageStamp { receive_ns: self.receive_ns, send_ns };
        }
        header
    }

    pub(crate) fn source_frame(&self) -> u64 {
        self.source_frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_named_once_per_topic_and_incarnation_until_an_output_carried_them() {
        let mut step = Step::new();
        step.begin(10, 20);
        for sequence in 4..=6 {
            step.note(3, &Header { sequence, ..Header::default() });
        }
        step.note(3, &Header { sequence: 1, incarnation: 1, ..Header::default() });
        step.begin(11, 21);
        let header = step.header(30);
        assert_eq!(header.input_count, 2);
        assert_eq!((header.inputs[0].first, header.inputs[0].last, header.inputs[0].count), (4, 6, 3));
        assert_eq!((header.inputs[1].incarnation, header.inputs[1].count), (1, 1));
        step.published = true;
        step.begin(12, 22);
        assert_eq!(step.header(31).input_count, 0);
    }

    #[test]
    fn a_stage_adds_its_stamps_to_those_of_its_input() {
        let mut input = Header { source_frame: 9, ..Header::default() };
        input.stages[Stage::Depth as usize] = StageStamp { receive_ns: 1, send_ns: 2 };
        let mut step = Step::new();
        step.begin(10, 20);
        step.follow(&input, Stage::Mapper);
        let header = step.header(30);
        assert_eq!(header.source_frame, 9);
        assert_eq!(header.stages[0].send_ns, 2);
        assert_eq!(header.stages[1], StageStamp { receive_ns: 20, send_ns: 30 });
    }
}

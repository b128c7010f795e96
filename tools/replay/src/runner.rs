//! One node of a replay, step after step, as its recorded outputs arrive.

use crate::nodes::{Again, Kind, Output};
use crate::report::NodeTally;
use crate::store::{Inputs, Key, Store};
use sidestep_msgs::{EXPERT_COMMAND, POLICY_COMMAND, TOPICS};
use sidestep_player::Entry;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// `[ns]` of receipt: what has not come this long after a step was lost, or never was.
const PATIENCE_NS: u64 = 1_000_000_000;
/// States kept until their step comes.
const STATES: usize = 4;

/// A state record: the epoch of its step, and the bytes.
struct State {
    epoch: u32,
    bytes: Vec<u8>,
}

/// What came of looking at the next step.
pub(crate) enum Turn {
    /// Nothing to do, or inputs are awaited.
    Waiting,
    /// The step could not be replayed; its recorded outputs stand.
    PassedOver(Vec<Rc<Entry>>),
    /// The step was made: each recorded output and the one made now.
    Made(Vec<(Rc<Entry>, Output)>),
}

/// A node with its recorded steps.
pub(crate) struct Runner {
    pub(crate) kind: &'static Kind,
    node: Box<dyn Again>,
    steps: VecDeque<Rc<Entry>>,
    /// Outputs on the further topics.
    further: BTreeMap<(usize, Key), Rc<Entry>>,
    states: BTreeMap<Key, State>,
    /// The last step whose effect the node carries; `None` = it must go on from a state.
    at: Option<(Key, u32)>,
    pub(crate) tally: NodeTally,
}

impl Runner {
    pub(crate) fn new(kind: &'static Kind, node: Box<dyn Again>) -> Self {
        Self {
            kind,
            node,
            steps: VecDeque::new(),
            further: BTreeMap::new(),
            states: BTreeMap::new(),
            at: None,
            tally: NodeTally::default(),
        }
    }

    /// Takes an output or a state of this node; whether it was one.
    pub(crate) fn offer(&mut self, entry: &Rc<Entry>) -> bool {
        let key = (entry.header.incarnation, entry.header.sequence);
        if entry.topic == self.kind.outputs[0] {
            self.steps.push_back(Rc::clone(entry));
        } else if self.kind.outputs.contains(&entry.topic) {
            self.further.insert((entry.topic, key), Rc::clone(entry));
        } else if self.kind.state == Some(entry.topic) {
            self.keep_state(entry);
        } else {
            return false;
        }
        true
    }

    fn keep_state(&mut self, entry: &Entry) {
        let number = |place: usize| {
            let bytes = entry.message.get(place..place + 8).and_then(|bytes| bytes.try_into().ok());
            bytes.map_or(0, u64::from_le_bytes)
        };
        let (after, size) = (number(0), number(8) as usize);
        let Some(bytes) = entry.message.get(16..16_usize.saturating_add(size)) else { return };
        let state = State { epoch: entry.header.epoch, bytes: bytes.to_vec() };
        self.states.insert((entry.header.incarnation, after), state);
        while self.states.len() > STATES {
            self.states.pop_first();
        }
    }

    /// Looks at the next step. `newest_ns` is how far the file was read; `refine_from_now` makes the expert wait for the
    /// policy of its frame, whatever the header says.
    pub(crate) fn turn(&mut self, store: &Store, newest_ns: u64, refine_from_now: bool, exact: bool) -> Turn {
        let Some(step) = self.steps.front().map(Rc::clone) else { return Turn::Waiting };
        let late = newest_ns > step.logged_ns.saturating_add(PATIENCE_NS);
        let key @ (incarnation, sequence) = (step.header.incarnation, step.header.sequence);
        let follows = self
            .at
            .is_some_and(|((life, last), _)| life == incarnation && last.checked_add(1) == Some(sequence));
        let from_state = self.kind.state.is_some() && !follows;
        let before = (incarnation, sequence.saturating_sub(1));
        if from_state && !self.states.contains_key(&before) {
            return if late { self.pass_over(&step, "before its first state") } else { Turn::Waiting };
        }
        let taken = &step.header.inputs[..(step.header.input_count as usize).min(step.header.inputs.len())];
        let mut inputs = match store.inputs(taken) {
            Inputs::There(inputs) => inputs,
            Inputs::Uncountable(topic) => return self.pass_over(&step, why("not countable", topic)),
            Inputs::Waiting(topic) if late => return self.pass_over(&step, why("lost", topic)),
            Inputs::Waiting(_) => return Turn::Waiting,
        };
        if refine_from_now && self.kind.outputs[0] == EXPERT_COMMAND.index {
            match store.about(POLICY_COMMAND.index, step.header.source_frame) {
                Some(proposal) => inputs.push(Rc::clone(proposal)),
                None if late => {}
                None => return Turn::Waiting,
            }
        }
        let mut outputs = vec![Rc::clone(&step)];
        for topic in &self.kind.outputs[1..] {
            match self.further.remove(&(*topic, key)) {
                Some(entry) => outputs.push(entry),
                None if late => return self.pass_over(&step, "its outputs are cut off"),
                None => {
                    outputs.drain(1..).for_each(|entry| {
                        self.further.insert((entry.topic, key), entry);
                    });
                    return Turn::Waiting;
                }
            }
        }
        if !self.go_on(&step, before, from_state, exact) {
            return self.pass_over(&step, "its state is of another version");
        }
        inputs.iter().for_each(|entry| self.node.take(entry));
        self.at = Some((key, step.header.epoch));
        self.steps.pop_front();
        self.tally.recorded += 1;
        match self.node.step(&step) {
            Some(made) => {
                self.tally.compared += 1;
                Turn::Made(outputs.into_iter().zip(made).collect())
            }
            None => {
                *self.tally.passed_over.entry("knows what was before the recording".into()).or_default() += 1;
                Turn::PassedOver(outputs)
            }
        }
    }

    /// Brings the node to where the step begins: from a state where it must, and through a jump of graph time. False where the
    /// state is none of this version's.
    fn go_on(&mut self, step: &Entry, before: Key, from_state: bool, exact: bool) -> bool {
        let state = self.states.remove(&before);
        let mut epoch = self.at.map_or(step.header.epoch, |(_, epoch)| epoch);
        if let Some(state) = &state {
            if from_state {
                if !self.node.restore(&state.bytes) {
                    return false;
                }
                // A state told at birth was told before the first word of the clock.
                epoch = if before.1 == 0 { step.header.epoch } else { state.epoch };
            } else if exact && before.1 != 0 {
                self.tally.states += 1;
                if self.node.state() != state.bytes {
                    self.tally.states_differing += 1;
                    self.node.restore(&state.bytes);
                }
            }
        }
        if step.header.epoch > epoch {
            self.node.reset();
        }
        true
    }

    fn pass_over(&mut self, step: &Rc<Entry>, why: impl Into<String>) -> Turn {
        self.steps.pop_front();
        self.tally.recorded += 1;
        *self.tally.passed_over.entry(why.into()).or_default() += 1;
        if self.kind.state.is_some() {
            self.at = None;
        }
        let key = (step.header.incarnation, step.header.sequence);
        let further = self.kind.outputs[1..].iter().filter_map(|topic| self.further.remove(&(*topic, key)));
        Turn::PassedOver(std::iter::once(Rc::clone(step)).chain(further).collect())
    }
}

fn why(what: &str, topic: usize) -> String {
    format!("an input on {} is {what}", TOPICS[topic].name)
}

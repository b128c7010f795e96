//! The driver's topics, as a playback writes them.

use crate::{Entry, PLAYED, PlayerError};
use sidestep_bus::{Link, NodeError, Outbox, Step};
use sidestep_msgs::{DEPTH, Message, SCAN, Stage, TOPICS, Topic, TopicVisitor, visit_topics};

/// An outbox of any topic that is played.
trait Sink {
    fn send(&mut self, step: &mut Step, entry: &Entry) -> Result<(), NodeError>;
    fn next_sequence(&self) -> u64;
}

struct Spout<M: Message> {
    topic: Topic<M>,
    outbox: Outbox<M>,
}

impl<M: Message> Sink for Spout<M> {
    fn send(&mut self, step: &mut Step, entry: &Entry) -> Result<(), NodeError> {
        self.outbox.send(step, |message| {
            entry.read_into(self.topic, message);
        })
    }

    fn next_sequence(&self) -> u64 {
        self.outbox.next_sequence()
    }
}

/// An outbox per topic that is played.
pub(super) struct Spouts {
    sinks: Vec<Option<Box<dyn Sink>>>,
}

/// Opens them.
struct Opening<'a> {
    link: &'a Link,
    sinks: Vec<Option<Box<dyn Sink>>>,
}

impl TopicVisitor for Opening<'_> {
    type Error = NodeError;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        let sink: Option<Box<dyn Sink>> = if PLAYED.contains(&topic.index) {
            Some(Box::new(Spout { topic, outbox: self.link.outbox(topic)? }))
        } else {
            None
        };
        self.sinks.push(sink);
        Ok(())
    }
}

/// A recording that cannot be played will not be playable after a restart either.
pub(super) fn refused(error: &PlayerError) -> NodeError {
    NodeError::Configuration(error.to_string())
}

/// Whether a message is a frame, to which the stages that follow refer.
pub(super) fn is_frame(topic: usize) -> bool {
    topic == DEPTH.index || topic == SCAN.index
}

impl Spouts {
    pub(super) fn open(link: &Link) -> Result<Self, NodeError> {
        let mut opening = Opening { link, sinks: Vec::with_capacity(TOPICS.len()) };
        visit_topics(&mut opening)?;
        Ok(Self { sinks: opening.sinks })
    }

    /// Sends a message; the number of the frame, if it is one.
    pub(super) fn send(&mut self, step: &mut Step, entry: &Entry) -> Result<Option<u64>, NodeError> {
        let Some(sink) = &mut self.sinks[entry.topic] else { return Ok(None) };
        let number = is_frame(entry.topic).then(|| sink.next_sequence());
        if let Some(number) = number {
            step.originate(number, Stage::Depth);
        }
        sink.send(step, entry)?;
        Ok(number)
    }
}

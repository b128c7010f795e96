//! Stands where camera and base driver stand: says the time and sends each recorded message when it is due.

use crate::{Config, Entry, Feed, Next, PLAYED, PlayerError, Schedule};
use sidestep_bus::{Boot, Link, NodeError, Outbox, Step, host_ns};
use sidestep_msgs::{CLOCK, DEPTH, Message, SCAN, Stage, TOPICS, Topic, TopicVisitor, visit_topics};

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

/// Opens an outbox per topic that is played.
struct Spouts<'a> {
    link: &'a Link,
    sinks: Vec<Option<Box<dyn Sink>>>,
}

impl TopicVisitor for Spouts<'_> {
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
fn refused(error: &PlayerError) -> NodeError {
    NodeError::Configuration(error.to_string())
}

/// Whether a message is a frame, to which the stages that follow refer.
fn is_frame(topic: usize) -> bool {
    topic == DEPTH.index || topic == SCAN.index
}

/// Plays the recording of the configuration into the graph, open loop, and ends with it.
///
/// # Errors
/// [`NodeError::Configuration`] for a recording that cannot be played, else what the transport says.
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    config.check().map_err(NodeError::Configuration)?;
    let mut schedule = Schedule::new(config.rate).map_err(|error| refused(&error))?;
    let feed = Feed::start(&config.file, config.start_offset_ns(), config.repeat);
    let mut feed = feed.map_err(|error| refused(&error))?;

    let mut link = Link::open(boot)?;
    let mut clock = link.outbox(CLOCK)?;
    let mut spouts = Spouts { link: &link, sinks: Vec::with_capacity(TOPICS.len()) };
    visit_topics(&mut spouts)?;
    let mut sinks = spouts.sinks;
    // The node's own word of time wakes it, as it wakes everybody else.
    link.wake_on(CLOCK)?;
    let mut jumping = false;
    link.run_while(|step| {
        while let Some(next) = feed.peek().map_err(|error| refused(&error))? {
            match next {
                Next::Jump => {
                    jumping = true;
                    feed.take();
                }
                Next::Message(entry) if jumping => {
                    jumping = false;
                    schedule.jump(entry.header.now_ns, host_ns());
                    clock.send(step, |word| *word = schedule.clock(host_ns()))?;
                    return Ok(true);
                }
                Next::Message(entry) if host_ns() < schedule.due_host_ns(entry.header.now_ns) => {
                    step.wake_at(entry.header.now_ns);
                    return Ok(true);
                }
                Next::Message(entry) => {
                    let topic = entry.topic;
                    let Some(sink) = &mut sinks[topic] else { continue };
                    if is_frame(topic) {
                        step.originate(sink.next_sequence(), Stage::Depth);
                    }
                    sink.send(step, entry)?;
                    feed.take();
                    if is_frame(topic) {
                        // What follows is not about this frame: it belongs to the next step.
                        step.wake_at(0);
                        return Ok(true);
                    }
                }
            }
        }
        Ok(false)
    })
}

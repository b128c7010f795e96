//! An inbox per topic that is recorded or watched, emptied into the queue.

use crate::trouble::is_watched;
use crate::{Config, Filter, Queue};
use sidestep_bus::{Inbox, Keep, Link, NodeError, Step, host_ns};
use sidestep_msgs::{Message, Topic, TopicVisitor, visit_topics};

/// An inbox of any topic.
trait Source {
    fn drain(&mut self, step: &mut Step, queue: &mut Queue) -> Result<(), NodeError>;
}

struct Tap<M: Message> {
    topic: Topic<M>,
    inbox: Inbox<M>,
}

impl<M: Message> Source for Tap<M> {
    fn drain(&mut self, step: &mut Step, queue: &mut Queue) -> Result<(), NodeError> {
        self.inbox.each(step, |message, header| {
            queue.offer(self.topic.row(), header, bytemuck::bytes_of(message), host_ns());
        })
    }
}

/// The inboxes.
pub(crate) struct Taps {
    sources: Vec<Box<dyn Source>>,
    told: bool,
}

/// Opens an inbox per topic.
struct Opener<'a> {
    link: &'a Link,
    filter: Filter,
    /// Whether there is a black box, which must see what tells it when to keep what it holds.
    watches: bool,
    sources: Vec<Box<dyn Source>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = NodeError;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        if self.filter.takes(topic.index) || (self.watches && is_watched(topic.index)) {
            let inbox = self.link.inbox(topic, Keep::All)?;
            self.sources.push(Box::new(Tap { topic, inbox }));
        }
        Ok(())
    }
}

impl Taps {
    pub(crate) fn open(link: &Link, config: &Config) -> Result<Self, NodeError> {
        let filter = config.filter().map_err(NodeError::Configuration)?;
        let watches = config.black_box_mb > 0;
        let mut opener = Opener { link, filter, watches, sources: Vec::new() };
        visit_topics(&mut opener)?;
        Ok(Self { sources: opener.sources, told: false })
    }

    /// Hands on all that waits; says once why a recording ended early.
    pub(crate) fn drain(&mut self, step: &mut Step, queue: &mut Queue) -> Result<(), NodeError> {
        self.sources.iter_mut().try_for_each(|source| source.drain(step, queue))?;
        if let Some(why) = queue.failure().filter(|_| !self.told) {
            self.told = true;
            eprintln!("the recording ended early, the drive goes on; {why}");
        }
        Ok(())
    }
}

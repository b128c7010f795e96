//! An inbox per topic that shows something.

use crate::Outlet;
use sidestep_bus::{Inbox, Keep, Link, NodeError, Step, host_ns};
use sidestep_msgs::{DEPTH, Header, Message, Topic, TopicVisitor, visit_topics};
use sidestep_recorder::View;

trait Source {
    fn drain(&mut self, step: &mut Step, record: &mut Vec<u8>, outlet: &mut Outlet) -> Result<(), NodeError>;
}

struct Tap<M: Message> {
    topic: Topic<M>,
    inbox: Inbox<M>,
}

impl<M: Message> Source for Tap<M> {
    fn drain(&mut self, step: &mut Step, record: &mut Vec<u8>, outlet: &mut Outlet) -> Result<(), NodeError> {
        let row = self.topic.row();
        let wants_image = outlet.wants_image(host_ns());
        let mut show = |message: &M, header: &Header| {
            record.clear();
            record.extend_from_slice(bytemuck::bytes_of(header));
            record.extend_from_slice(bytemuck::bytes_of(message));
            outlet.show(row, record, host_ns());
        };
        if row.index != DEPTH.index {
            return self.inbox.each(step, show);
        }
        match self.inbox.newest(step)? {
            Some(frame) if wants_image => show(&frame, frame.header()),
            _ => {}
        }
        Ok(())
    }
}

/// Opens the inboxes.
struct Opening<'a> {
    link: &'a Link,
    sources: Vec<Box<dyn Source>>,
}

impl TopicVisitor for Opening<'_> {
    type Error = NodeError;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        if View::reads(topic.row()) {
            let keep = if topic.index == DEPTH.index { Keep::Newest } else { Keep::All };
            self.sources.push(Box::new(Tap { topic, inbox: self.link.inbox(topic, keep)? }));
        }
        Ok(())
    }
}

/// All inboxes, in the order of the topic table.
pub(crate) struct Sources {
    sources: Vec<Box<dyn Source>>,
    record: Vec<u8>,
}

impl Sources {
    pub(crate) fn open(link: &Link) -> Result<Self, NodeError> {
        let mut opening = Opening { link, sources: Vec::new() };
        visit_topics(&mut opening)?;
        Ok(Self { sources: opening.sources, record: Vec::new() })
    }

    pub(crate) fn drain(&mut self, step: &mut Step, outlet: &mut Outlet) -> Result<(), NodeError> {
        self.sources.iter_mut().try_for_each(|source| source.drain(step, &mut self.record, outlet))
    }
}

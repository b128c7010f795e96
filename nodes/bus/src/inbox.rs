//! Reading a topic.

use crate::error::NodeError;
use crate::link::Counters;
use crate::step::Step;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample;
use sidestep_msgs::{Header, Message, Topic};
use std::ops::Deref;
use std::rc::Rc;

/// Whether a reader wants the newest message or all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// Only the newest; what it passes over counts as skipped.
    Newest,
    /// Every message, oldest first; what the ring overwrote counts as lost.
    All,
}

/// A message in shared memory, released when dropped.
#[derive(Debug)]
pub struct Received<M: Message>(Sample<ipc::Service, M, Header>);

impl<M: Message> Received<M> {
    /// Its header.
    #[must_use]
    pub fn header(&self) -> &Header {
        self.0.user_header()
    }
}

impl<M: Message> Deref for Received<M> {
    type Target = M;
    fn deref(&self) -> &M {
        self.0.payload()
    }
}

/// A reader of one topic.
#[derive(Debug)]
pub struct Inbox<M: Message> {
    topic: Topic<M>,
    keep: Keep,
    subscriber: Subscriber<ipc::Service, M, Header>,
    counters: Rc<Counters>,
    /// Incarnation and sequence of the last message taken.
    last: Option<(u32, u64)>,
}

impl<M: Message> Inbox<M> {
    pub(crate) fn new(
        topic: Topic<M>,
        keep: Keep,
        subscriber: Subscriber<ipc::Service, M, Header>,
        counters: Rc<Counters>,
    ) -> Self {
        Self { topic, keep, subscriber, counters, last: None }
    }

    fn receive(&mut self) -> Result<Option<Received<M>>, NodeError> {
        let sample = self.subscriber.receive().map_err(|error| self.refused(error))?;
        Ok(sample.map(|sample| {
            self.count_gap(sample.user_header());
            Received(sample)
        }))
    }

    fn refused(&self, error: impl std::fmt::Debug) -> NodeError {
        NodeError::transport(self.topic.row().name, "receive", error)
    }

    fn count_gap(&mut self, header: &Header) {
        let expected = match self.last {
            Some((incarnation, sequence)) if incarnation == header.incarnation => sequence + 1,
            // A first message, or the first of a restarted writer: nothing is known of what came before.
            _ => header.sequence,
        };
        let gap = header.sequence.saturating_sub(expected);
        let counts = if self.keep == Keep::All { &self.counters.lost } else { &self.counters.skipped };
        counts[self.topic.index].set(counts[self.topic.index].get() + gap);
        self.last = Some((header.incarnation, header.sequence));
    }

    /// Whether a message waits that was not taken before.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn has_news(&self) -> Result<bool, NodeError> {
        self.subscriber.has_samples().map_err(|error| self.refused(error))
    }

    /// The newest message that was not taken before, if there is one.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn newest(&mut self, step: &mut Step) -> Result<Option<Received<M>>, NodeError> {
        let mut newest = None;
        while self.subscriber.has_samples().map_err(|error| self.refused(error))? {
            // Given back before the next is taken, so that one borrowed message is enough.
            drop(newest.take());
            newest = self.receive()?;
            if newest.is_none() {
                break;
            }
        }
        if let Some(message) = &newest {
            step.note(self.topic.index, message.header());
        }
        Ok(newest)
    }

    /// The oldest message that was not taken before, if there is one.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn next(&mut self, step: &mut Step) -> Result<Option<Received<M>>, NodeError> {
        let message = self.receive()?;
        if let Some(message) = &message {
            step.note(self.topic.index, message.header());
        }
        Ok(message)
    }

    /// Hands over every message that was not taken before, oldest first.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn each(&mut self, step: &mut Step, mut handle: impl FnMut(&M, &Header)) -> Result<(), NodeError> {
        while let Some(message) = self.next(step)? {
            handle(&message, message.header());
        }
        Ok(())
    }
}

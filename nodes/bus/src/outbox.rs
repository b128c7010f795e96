//! Writing a topic.

use crate::clock::host_ns;
use crate::error::NodeError;
use crate::link::Counters;
use crate::step::Step;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::ipc;
use sidestep_msgs::{Header, Message, Stage, Status, Topic};
use std::rc::Rc;

/// The one writer of a topic.
#[derive(Debug)]
pub struct Outbox<M: Message> {
    topic: Topic<M>,
    publisher: Rc<Publisher<ipc::Service, M, Header>>,
    notifier: Notifier<ipc::Service>,
    counters: Rc<Counters>,
    run: u64,
    incarnation: u32,
    sequence: u64,
}

impl<M: Message> Outbox<M> {
    pub(crate) fn new(
        topic: Topic<M>,
        publisher: Rc<Publisher<ipc::Service, M, Header>>,
        notifier: Notifier<ipc::Service>,
        counters: Rc<Counters>,
        (run, incarnation): (u64, u32),
    ) -> Self {
        Self { topic, publisher, notifier, counters, run, incarnation, sequence: 0 }
    }

    /// Sequence of the message that would be sent next: what a driver names as source frame.
    #[must_use]
    pub fn next_sequence(&self) -> u64 {
        self.sequence + 1
    }

    /// Fills a message in place, in shared memory, and sends it; `fill` must write every field it means.
    ///
    /// The memory is recycled: it holds an older message of this topic, or zeros.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn send(&mut self, step: &mut Step, fill: impl FnOnce(&mut M)) -> Result<(), NodeError> {
        let status = step.status;
        self.send_with(step, |message| {
            fill(message);
            status
        })
    }

    /// As [`Outbox::send`], where filling the message is the work of the step and says how it went.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn send_with(
        &mut self,
        step: &mut Step,
        fill: impl FnOnce(&mut M) -> Status,
    ) -> Result<(), NodeError> {
        self.fill_and_send(step, |step, message| step.status = fill(message))
    }

    /// As [`Outbox::send_with`], where only the work of the step tells which frame the message is about; the stamps of
    /// those inputs that are about the same frame are carried on.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn send_about(
        &mut self,
        step: &mut Step,
        stage: Stage,
        inputs: &[Header],
        fill: impl FnOnce(&mut M) -> (Status, u64),
    ) -> Result<(), NodeError> {
        self.fill_and_send(step, |step, message| {
            let (status, source_frame) = fill(message);
            step.status = status;
            inputs
                .iter()
                .filter(|input| input.source_frame == source_frame)
                .for_each(|input| step.follow(input, stage));
            step.originate(source_frame, stage);
        })
    }

    fn fill_and_send(
        &mut self,
        step: &mut Step,
        fill: impl FnOnce(&mut Step, &mut M),
    ) -> Result<(), NodeError> {
        let name = self.topic.row().name;
        let mut loan =
            self.publisher.loan_uninit().map_err(|error| NodeError::transport(name, "loan memory", error))?;
        // SAFETY: a message is plain bytes (`Pod`): any content of the loan is a valid value, and `fill` only sees it
        // as such. Fresh memory comes zeroed from the system, recycled memory holds an older message.
        #[allow(unsafe_code, reason = "a 614 KB frame must be written in place, not copied over the stack")]
        let mut loan = unsafe {
            fill(step, &mut *loan.payload_mut().as_mut_ptr());
            loan.assume_init()
        };
        self.sequence += 1;
        *loan.user_header_mut() = Header {
            run: self.run,
            incarnation: self.incarnation,
            sequence: self.sequence,
            ..step.header(host_ns())
        };
        loan.send().map_err(|error| NodeError::transport(name, "send", error))?;
        self.notifier.notify().map_err(|error| NodeError::transport(name, "notify", error))?;
        let sent = &self.counters.sent[self.topic.index];
        sent.set(sent.get() + 1);
        step.published = true;
        Ok(())
    }
}

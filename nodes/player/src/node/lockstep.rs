//! A recording in lockstep: as fast as the graph answers, and every frame is answered before anything follows it.

use super::keys::Keys;
use super::spouts::{Spouts, refused};
use crate::beats::{Beat, Beats};
use crate::{Control, Entry, Feed, Key, Next};
use sidestep_bus::{Answers, Boot, Keep, Link, NodeError, Outbox, Question, Step};
use sidestep_msgs::{CLOCK, COMMAND, Clock, ClockMode, DEPTH, SCAN};

/// What is published, and the time that goes with it.
struct Stage {
    clock: Outbox<Clock>,
    spouts: Spouts,
    epoch: u32,
    control: Control,
}

impl Stage {
    fn say(&mut self, step: &mut Step, graph_ns: u64) -> Result<(), NodeError> {
        let (mode, epoch) = (ClockMode::Lockstep as u32, self.epoch);
        step.set_now(graph_ns);
        self.clock.send(step, |word| {
            *word = Clock { mode, epoch, graph_ns, rate: 1.0, open_loop: 1, ..Clock::default() };
        })
    }

    fn press(&mut self, key: Key) {
        match key {
            Key::Pause => self.control = Control { paused: !self.control.paused, stepping: false },
            Key::Step => self.control.stepping = self.control.paused,
            // It is as fast as it can be.
            Key::Faster | Key::Slower => {}
        }
    }

    fn tick(&mut self, step: &mut Step, stamp_ns: u64, number: u64) -> Result<Question, NodeError> {
        self.say(step, stamp_ns)?;
        Ok(Question::Tick { stamp_ns, number })
    }

    /// The frame's word of the clock comes first, since the frame itself makes the mapper step.
    fn frame(&mut self, step: &mut Step, entry: &Entry) -> Result<Option<Question>, NodeError> {
        let stamp_ns = entry.header.now_ns;
        self.say(step, stamp_ns)?;
        self.control.stepping = false;
        let number = self.spouts.send(step, entry)?;
        Ok(number.map(|number| Question::Frame { stamp_ns, number }))
    }
}

/// Plays until the end of the recording.
///
/// # Errors
/// [`NodeError::Silent`] with the node that did not answer, [`NodeError::Configuration`] for a recording that cannot be
/// played, or [`NodeError::Transport`].
pub(super) fn run(mut link: Link, boot: &Boot, mut feed: Feed, paused: bool) -> Result<(), NodeError> {
    link.wake_on(COMMAND)?;
    let mut commands = link.inbox(COMMAND, Keep::All)?;
    let mut answers = Answers::open(&link, boot)?;
    // Of a robot without a camera the sweeps are the frames.
    let frames = if boot.robot()?.camera.is_some() { DEPTH.index } else { SCAN.index };
    let (clock, spouts) = (link.outbox(CLOCK)?, Spouts::open(&link)?);
    let mut stage = Stage { clock, spouts, epoch: 0, control: Control { paused, stepping: false } };
    let keys = Keys::listen(boot)?;
    let mut beats = Beats::default();
    link.run_while(|step| {
        keys.pressed().into_iter().for_each(|key| stage.press(key));
        commands.each(step, |command, header| answers.hear(command, header))?;
        if (stage.control.paused && !stage.control.stepping) || !answers.may_ask(step)? {
            return Ok(true);
        }
        let question = loop {
            let Some(Next::Message(entry)) = feed.peek().map_err(|error| refused(&error))? else {
                // What is open is answered before time jumps or ends.
                if let Some(Beat::Tick { stamp_ns, number }) = beats.last() {
                    break Some(stage.tick(step, stamp_ns, number)?);
                }
                if feed.take().is_none() {
                    return Ok(false);
                }
                beats.jump();
                stage.epoch += 1;
                continue;
            };
            match beats.next(entry.header.now_ns, entry.topic == frames) {
                Beat::Tick { stamp_ns, number } => break Some(stage.tick(step, stamp_ns, number)?),
                Beat::Frame => {
                    let question = stage.frame(step, entry)?;
                    feed.take();
                    break question;
                }
                Beat::Publish => {
                    step.set_now(entry.header.now_ns);
                    stage.spouts.send(step, entry)?;
                    feed.take();
                }
            }
        };
        question.inspect(|question| answers.ask(*question, stage.clock.next_sequence() - 1));
        Ok(true)
    })
}

//! Lockstep in the graph: one event at a time, each answered by the arbiter's command before the next.

use super::topics::Topics;
use crate::simulator::Simulator;
use crate::timeline::{BEGIN_NS, Event, Timeline};
use sidestep_bus::{Answers, Boot, Link, NodeError, Question, Step, host_ns, pause};
use sidestep_msgs::{Clock, ClockMode};
use std::time::Duration;

/// Simulates until asked to stop, as fast as the graph answers.
///
/// # Errors
/// [`NodeError::Silent`] with the node that did not answer, or [`NodeError::Transport`].
pub(crate) fn run(
    mut link: Link,
    boot: &Boot,
    mut simulator: Simulator,
    rate_most: f64,
) -> Result<(), NodeError> {
    let mut topics = Topics::open(&mut link, boot)?;
    let mut answers = Answers::open(&link, boot)?;
    let mut timeline = Timeline::new(simulator.rate_hz());
    let mut begun_ns = None;
    link.run(|step| {
        topics.command.each(step, |command, header| {
            let Some(question) = answers.asked() else { return };
            simulator.command(command, question.stamp_ns());
            answers.hear(command, header);
        })?;
        if !answers.may_ask(step)? {
            return Ok(());
        }
        let event = timeline.next();
        keep_pace(event, *begun_ns.get_or_insert_with(host_ns), rate_most);
        say(&mut topics, step, event, &mut simulator)?;
        let question = match event {
            Event::Tick { stamp_ns, number } => Question::Tick { stamp_ns, number },
            Event::Frame { stamp_ns, number } => Question::Frame { stamp_ns, number },
        };
        answers.ask(question, topics.clock.next_sequence() - 1);
        Ok(())
    })
}

/// Waits where graph time runs ahead of the rate that was asked for.
fn keep_pace(event: Event, begun_ns: u64, rate_most: f64) {
    let due_ns = begun_ns + ((event.stamp_ns() - BEGIN_NS) as f64 / rate_most) as u64;
    if let Some(early_ns) = due_ns.checked_sub(host_ns()) {
        pause(Duration::from_nanos(early_ns));
    }
}

/// Publishes an event. A tick's word of the clock comes last, since it makes the arbiter step; a frame's comes first, since
/// the frame itself does.
fn say(
    topics: &mut Topics,
    step: &mut Step,
    event: Event,
    simulator: &mut Simulator,
) -> Result<(), NodeError> {
    let (Event::Tick { stamp_ns, number } | Event::Frame { stamp_ns, number }) = event;
    let word = Clock { mode: ClockMode::Lockstep as u32, graph_ns: stamp_ns, rate: 1.0, ..Clock::default() };
    step.set_now(stamp_ns);
    simulator.advance(stamp_ns);
    if let Event::Frame { .. } = event {
        topics.clock.send(step, |clock| *clock = word)?;
        topics.render(simulator, stamp_ns);
        return topics.send_image(step);
    }
    topics.tick(step, number, simulator)?;
    topics.clock.send(step, |clock| *clock = word)
}

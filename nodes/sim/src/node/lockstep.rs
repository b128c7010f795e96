//! Lockstep in the graph: one event at a time, each answered by the arbiter's command before the next.

use super::answers::Answers;
use super::topics::Topics;
use crate::simulator::Simulator;
use crate::timeline::{BEGIN_NS, Event, Timeline};
use sidestep_bus::{Boot, Link, NodeError, Step, host_ns, pause};
use sidestep_msgs::{Clock, ClockMode, Command, Header};
use std::time::Duration;

/// `[ns]` host time that an answer may take.
const PATIENCE_NS: u64 = 2_000_000_000;

/// Whether a command is the answer to an event.
fn answers(event: Event, command: &Command, header: &Header) -> bool {
    match event {
        Event::Tick { stamp_ns, .. } => header.now_ns == stamp_ns,
        Event::Frame { number, .. } => command.answers != 0 && header.source_frame == number,
    }
}

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
    let mut others = Answers::open(&link, boot)?;
    let mut timeline = Timeline::new(simulator.rate_hz());
    let mut asked: Option<(Event, u64)> = None;
    let mut begun_ns = None;
    link.run(|step| {
        // Heartbeats are of host time, and no input of what follows.
        if asked.is_none() && !others.all_ready(&mut Step::new())? {
            return Ok(());
        }
        let mut answered = asked.is_none();
        topics.command.each(step, |command, header| {
            let Some((event, _)) = asked else { return };
            simulator.command(command, event.stamp_ns());
            answered |= answers(event, command, header);
        })?;
        if let Some((event, since_ns)) = asked.filter(|_| !answered) {
            return wait(&mut others, step, event, since_ns);
        }
        let event = timeline.next();
        keep_pace(event, *begun_ns.get_or_insert_with(host_ns), rate_most);
        say(&mut topics, step, event, &mut simulator)?;
        asked = Some((event, host_ns()));
        Ok(())
    })
}

/// Waits where graph time runs ahead of what readers of everything can follow.
fn keep_pace(event: Event, begun_ns: u64, rate_most: f64) {
    let due_ns = begun_ns + ((event.stamp_ns() - BEGIN_NS) as f64 / rate_most) as u64;
    if let Some(early_ns) = due_ns.checked_sub(host_ns()) {
        pause(Duration::from_nanos(early_ns));
    }
}

fn wait(others: &mut Answers, step: &mut Step, event: Event, since_ns: u64) -> Result<(), NodeError> {
    let waited_ns = host_ns() - since_ns;
    if waited_ns < PATIENCE_NS {
        return Ok(());
    }
    let (node, what) = match event {
        Event::Tick { number, .. } => ("arbiter", format!("tick {number}")),
        Event::Frame { number, .. } => (others.silent(step, number)?, format!("frame {number}")),
    };
    Err(NodeError::Silent { node, what, waited_s: waited_ns as f64 * 1e-9 })
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

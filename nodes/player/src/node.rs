//! Stands where camera and base driver stand: says the time and sends each recorded message when it is due.

mod keys;
mod lockstep;
mod spouts;

use crate::{Config, Control, Feed, Next, Schedule, Selection};
use keys::Keys;
use sidestep_bus::{Absent, Boot, Link, NodeError, Outbox, Step, host_ns};
use sidestep_msgs::{CLOCK, Clock};
use spouts::{Spouts, is_frame, refused};

/// `[ns]` pause between two looks whether every node is there: who began at once would lose the first frames.
const LOOK_NS: u64 = 2_000_000;

/// Graph time of a playback, as it is told.
struct Time {
    schedule: Schedule,
    control: Control,
    clock: Outbox<Clock>,
}

impl Time {
    fn say(&mut self, step: &mut Step) -> Result<(), NodeError> {
        self.clock.send(step, |word| *word = self.schedule.clock(host_ns()))
    }

    fn press(&mut self, keys: &Keys, step: &mut Step) -> Result<(), NodeError> {
        for key in keys.pressed() {
            if let Some(told) = self.control.take(key, &mut self.schedule, host_ns()) {
                eprintln!("{told}");
                self.say(step)?;
            }
        }
        Ok(())
    }
}

/// Plays the recording of the configuration into the graph, open loop, and ends with it.
///
/// # Errors
/// [`NodeError::Configuration`] for a recording that cannot be played, else what the transport says.
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    config.check().map_err(NodeError::Configuration)?;
    let selection = Selection::of(&config).map_err(NodeError::Configuration)?;
    let schedule = Schedule::new(config.rate).map_err(|error| refused(&error))?;
    let feed = Feed::start(&config.file, &selection, config.repeat).map_err(|error| refused(&error))?;
    let mut link = Link::open(boot)?;
    if boot.is_lockstep()? {
        return lockstep::run(link, boot, feed, config.paused);
    }
    let control = Control { paused: config.paused, stepping: false };
    let time = Time { schedule, control, clock: link.outbox(CLOCK)? };
    // The node's own word of time wakes it, as it wakes everybody else.
    link.wake_on(CLOCK)?;
    play(link, boot, feed, time)
}

fn play(link: Link, boot: &Boot, mut feed: Feed, mut time: Time) -> Result<(), NodeError> {
    let mut spouts = Spouts::open(&link)?;
    let keys = Keys::listen(boot)?;
    let mut absent = Absent::open(&link, boot)?;
    let mut jumping = false;
    link.run_while(|step| {
        if !absent.are_none()? {
            step.wake_at(step.deadline(LOOK_NS));
            return Ok(true);
        }
        time.press(&keys, step)?;
        while let Some(next) = feed.peek().map_err(|error| refused(&error))? {
            let Next::Message(entry) = next else {
                jumping = true;
                feed.take();
                continue;
            };
            let now_ns = entry.header.now_ns;
            if jumping {
                jumping = false;
                time.schedule.jump(now_ns, host_ns());
                if time.control.paused {
                    time.schedule.pause(host_ns());
                }
                time.say(step)?;
                return Ok(true);
            }
            if time.control.stepping {
                // Graph time stands at the frame that is shown, and goes there with all that comes before it.
                time.schedule.stand_at(now_ns);
                step.set_now(now_ns);
                if is_frame(entry.topic) {
                    time.control.stepping = false;
                    time.say(step)?;
                }
            } else if time.schedule.due_host_ns(now_ns).is_none_or(|due_ns| host_ns() < due_ns) {
                step.wake_at(now_ns);
                return Ok(true);
            }
            let frame = spouts.send(step, entry)?;
            feed.take();
            if frame.is_some() {
                // What follows is not about this frame: it belongs to the next step.
                step.wake_at(0);
                return Ok(true);
            }
        }
        Ok(false)
    })
}

//! The simulator in the graph: it publishes what a robot's drivers would, in real time or in lockstep.

mod lockstep;
mod topics;

use crate::config::Config;
use crate::random::{Random, mix};
use crate::schedule::{Schedule, TICKS_PER_CLOCK};
use crate::simulator::Simulator;
use sidestep_bus::{Boot, Link, NodeError, Outbox, Step};
use sidestep_msgs::{Clock, ClockMode};
use topics::Topics;

/// Simulates until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with what was found and what is needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let robot = boot.robot()?;
    let config: Config = boot.config()?;
    let simulator = Simulator::configured(&config, &robot);
    let mut simulator = simulator.map_err(|error| NodeError::Configuration(error.to_string()))?;
    // A simulator that starts again puts the robot back to its start: the pose jumps.
    simulator.set_pose_epoch(boot.incarnation);
    let mut link = Link::open(boot)?;
    if boot.is_lockstep()? {
        return lockstep::run(link, boot, simulator, config.lockstep_rate_most);
    }
    let mut topics = Topics::open(&mut link, boot)?;
    let phase = Random::new(mix(boot.run, u64::from(boot.incarnation))).unit();
    let mut schedule: Option<Schedule> = None;
    link.run(|step| {
        let now_ns = step.now_ns();
        let schedule = schedule.get_or_insert_with(|| Schedule::new(now_ns, simulator.rate_hz(), phase));
        topics.command.each(step, |command, header| {
            simulator.command(command, now_ns);
            schedule.answer(header.source_frame, topics.frames);
        })?;
        while let Some((stamp_ns, number)) = schedule.tick(now_ns) {
            simulator.advance(stamp_ns);
            if number.is_multiple_of(TICKS_PER_CLOCK) {
                tell_real_time(&mut topics.clock, step)?;
            }
            topics.tick(step, number, &mut simulator)?;
        }
        if schedule.send(now_ns) {
            topics.send_image(step)?;
        }
        if schedule.render(now_ns) {
            topics.render(&mut simulator, schedule.capture_ns());
        }
        step.wake_at(schedule.wake_ns());
        Ok(())
    })
}

fn tell_real_time(clock: &mut Outbox<Clock>, step: &mut Step) -> Result<(), NodeError> {
    let now = step.now_ns();
    let mode = ClockMode::RealTime as u32;
    let word = Clock { mode, graph0_ns: now, host0_ns: now, graph_ns: now, rate: 1.0, ..Clock::default() };
    clock.send(step, |clock| *clock = word)
}

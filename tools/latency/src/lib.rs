//! Where the time goes between a depth frame and its command: live in the launcher, offline from a recording.
//!
//! [`Collector`] takes headers and gives a table and JSON; [`analyse`] feeds it from a file and collects a [`Trace`]
//! beside. Frames that were due and never came count from the time they were due, so that a driver or stage that
//! falls behind cannot make the figures look good.

mod collector;
mod distribution;
mod frames;
mod trace;

pub use collector::Collector;
pub use distribution::{Distribution, Figures};
pub use trace::Trace;

use sidestep_msgs::{CLOCK, COMMAND, DEPTH};
use sidestep_player::{Ordered, PlayerError};
use std::collections::BTreeMap;
use std::path::Path;

/// Latencies and trace of a recording, complete or cut.
///
/// # Errors
/// What the player says of the file.
pub fn analyse(path: &Path, budgets_ms: &BTreeMap<String, f64>) -> Result<(Collector, Trace), PlayerError> {
    let (mut collector, mut trace) = (Collector::new(budgets_ms), Trace::default());
    for entry in Ordered::open(path)? {
        let entry = entry?;
        if let Some(clock) = entry.read(CLOCK) {
            collector.clock(&clock);
        }
        collector.passed(entry.topic, &entry.header, |step| trace.add(step));
        if entry.topic == DEPTH.index
            && let Some(capture_ns) = collector::capture_ns(&entry.message)
        {
            collector.depth(capture_ns, &entry.header);
        }
        if let Some(command) = entry.read(COMMAND) {
            collector.command(&command);
        }
    }
    Ok((collector, trace))
}

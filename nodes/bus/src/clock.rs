//! The only file that reads a clock or waits.

use sidestep_msgs::{Clock, ClockMode};
use std::time::Duration;

/// `[ns]` host time, CLOCK_MONOTONIC: for latency, deadlines and, in real time, graph time.
#[must_use]
pub fn host_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid place for the answer, and CLOCK_MONOTONIC exists on every Linux.
    #[allow(
        unsafe_code,
        reason = "std hides the origin of CLOCK_MONOTONIC, which stamps of all processes share"
    )]
    unsafe {
        libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut time);
    }
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// `[ns]` since 1970, for file names and the log time of recordings.
#[must_use]
#[allow(clippy::disallowed_methods, reason = "this is the one file that reads a clock")]
pub fn wall_ns() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |duration| duration.as_nanos() as u64)
}

/// Waits; for the launcher and tools, never in a node's step.
#[allow(clippy::disallowed_methods, reason = "this is the one file that sleeps")]
pub fn pause(duration: Duration) {
    std::thread::sleep(duration);
}

/// Graph time of a process: the newest word of the topic `clock`, or host time where there is none.
#[derive(Debug, Default)]
pub(crate) struct GraphClock {
    newest: Option<Clock>,
}

impl GraphClock {
    /// Takes a word of the driver; true if the epoch was raised.
    pub(crate) fn take(&mut self, clock: Clock) -> bool {
        let raised = self.newest.is_some_and(|old| clock.epoch > old.epoch);
        self.newest = Some(clock);
        raised
    }

    /// `[ns]` graph time at a host time.
    pub(crate) fn graph_ns(&self, host_ns: u64) -> u64 {
        self.newest.map_or(host_ns, |clock| clock.graph_ns_at(host_ns))
    }

    /// Host time from now until a graph time; `None` where only the driver moves time.
    pub(crate) fn until(&self, graph_ns: u64, host_ns: u64) -> Option<Duration> {
        let left_ns = graph_ns.saturating_sub(self.graph_ns(host_ns));
        let rate = match &self.newest {
            Some(clock) if clock.paused != 0 || clock.mode == ClockMode::Lockstep as u32 => return None,
            Some(clock) if clock.mode == ClockMode::Playback as u32 => clock.rate.max(1e-3),
            _ => 1.0,
        };
        Some(Duration::from_nanos((left_ns as f64 / rate) as u64))
    }

    pub(crate) fn epoch(&self) -> u32 {
        self.newest.map_or(0, |clock| clock.epoch)
    }

    pub(crate) fn lockstep(&self) -> bool {
        self.newest.is_some_and(|clock| clock.mode == ClockMode::Lockstep as u32)
    }

    pub(crate) fn open_loop(&self) -> bool {
        self.newest.is_some_and(|clock| clock.open_loop != 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn playback_runs_at_its_rate_and_lockstep_only_when_told() {
        let mut clock = GraphClock::default();
        assert_eq!(clock.graph_ns(7), 7);
        let word = Clock {
            mode: ClockMode::Playback as u32,
            graph0_ns: 1000,
            host0_ns: 500,
            rate: 2.0,
            ..Default::default()
        };
        clock.take(word);
        assert_eq!(clock.graph_ns(600), 1200);
        assert_eq!(clock.until(1400, 600), Some(Duration::from_nanos(100)));
        assert!(clock.take(Clock { mode: ClockMode::Lockstep as u32, graph_ns: 42, epoch: 1, ..word }));
        assert_eq!(clock.graph_ns(1_000_000), 42);
        assert_eq!(clock.until(50, 0), None);
    }
}

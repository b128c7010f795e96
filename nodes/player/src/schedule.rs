//! Which graph time it is while a recording plays, and when a recorded message is due.

use crate::error::PlayerError;
use sidestep_msgs::{Clock, ClockMode};

/// The relation of host time and graph time of one playback; recorded stamps stay as they are.
#[derive(Debug, Clone)]
pub struct Schedule {
    rate: f64,
    graph0_ns: u64,
    host0_ns: u64,
    epoch: u32,
    paused: bool,
}

/// `[1]` the slowest playback.
const RATE_LEAST: f64 = 0.01;
/// `[1]` the fastest.
const RATE_MOST: f64 = 100.0;

impl Schedule {
    /// A playback that runs `rate` graph seconds per host second and begins when [`Schedule::jump`] says.
    ///
    /// # Errors
    /// [`PlayerError::Setting`] for a rate outside (0, 100].
    pub fn new(rate: f64) -> Result<Self, PlayerError> {
        let fits = rate > 0.0 && rate <= RATE_MOST;
        if !fits {
            let needed = "more than 0, at most 100";
            return Err(PlayerError::Setting { key: "rate", found: rate, needed });
        }
        Ok(Self { rate, graph0_ns: 0, host0_ns: 0, epoch: 0, paused: false })
    }

    /// Begins, loops or seeks: graph time is `graph_ns` at host time `host_ns`, in a new epoch.
    pub fn jump(&mut self, graph_ns: u64, host_ns: u64) {
        self.graph0_ns = graph_ns;
        self.host0_ns = host_ns;
        self.epoch += 1;
    }

    /// Graph time stands from now on.
    pub fn pause(&mut self, host_ns: u64) {
        self.rebase(host_ns);
        self.paused = true;
    }

    /// Graph time goes on from where it stood.
    pub fn resume(&mut self, host_ns: u64) {
        self.rebase(host_ns);
        self.paused = false;
    }

    /// While paused: graph time stands at another time, that of the frame that is shown.
    pub fn stand_at(&mut self, graph_ns: u64) {
        self.graph0_ns = graph_ns;
    }

    /// Changes the rate by a factor from now on; the rate that it has then.
    pub fn change_rate(&mut self, factor: f64, host_ns: u64) -> f64 {
        self.rebase(host_ns);
        self.rate = (self.rate * factor).clamp(RATE_LEAST.min(self.rate), RATE_MOST);
        self.rate
    }

    fn rebase(&mut self, host_ns: u64) {
        self.graph0_ns = self.clock(host_ns).graph_ns;
        self.host0_ns = host_ns;
    }

    /// `[ns]` host time at which a message of graph time `stamp_ns` is due; `None` while paused.
    #[must_use]
    pub fn due_host_ns(&self, stamp_ns: u64) -> Option<u64> {
        let passed_ns = stamp_ns.saturating_sub(self.graph0_ns) as f64 / self.rate;
        (!self.paused).then_some(self.host0_ns.saturating_add(passed_ns as u64))
    }

    /// What every node is told about time.
    #[must_use]
    pub fn clock(&self, host_ns: u64) -> Clock {
        let clock = Clock {
            graph0_ns: self.graph0_ns,
            host0_ns: self.host0_ns,
            graph_ns: self.graph0_ns,
            rate: self.rate,
            mode: ClockMode::Playback as u32,
            epoch: self.epoch,
            paused: u32::from(self.paused),
            open_loop: 1,
        };
        Clock { graph_ns: clock.graph_ns_at(host_ns), ..clock }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn a_message_is_due_when_graph_time_reaches_its_stamp() {
        for rate in [0.25, 1.0, 3.0, 100.0] {
            let mut schedule = Schedule::new(rate).unwrap();
            schedule.jump(500 * SECOND_NS, 7 * SECOND_NS);
            let stamp_ns = 512 * SECOND_NS;
            let due_ns = schedule.due_host_ns(stamp_ns).unwrap();
            let reached_ns = schedule.clock(due_ns).graph_ns;
            assert!(stamp_ns.abs_diff(reached_ns) <= 100, "rate {rate}: {reached_ns}");
        }
    }

    #[test]
    fn each_jump_is_a_new_epoch_and_every_clock_says_open_loop() {
        let mut schedule = Schedule::new(1.0).unwrap();
        schedule.jump(10, 20);
        let first = schedule.clock(20);
        schedule.jump(10, 50);
        let second = schedule.clock(50);
        assert_eq!((first.graph_ns, second.graph_ns, first.epoch + 1), (10, 10, second.epoch));
        assert_eq!((first.open_loop, first.mode), (1, ClockMode::Playback as u32));
    }

    #[test]
    fn a_rate_that_cannot_be_is_refused() {
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY, 101.0] {
            assert!(Schedule::new(rate).is_err(), "{rate}");
        }
    }
}

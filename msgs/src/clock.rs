//! Graph time: how every node turns host time into the time of the world it works in.

use crate::layout::{ZeroCopySend, codes, record};

codes! {
    /// Who moves graph time.
    pub enum ClockMode {
        /// Graph time is host time.
        RealTime = 0 "real time",
        /// Graph time follows a recording: graph0 + rate * (host - host0).
        Playback = 1 "playback",
        /// Graph time moves only when the driver says so.
        Lockstep = 2 "lockstep",
    }
}

record! {
    /// The run's relation between host time and graph time. Without this topic, graph time is host time.
    ///
    /// Writer: `sim`, `player` or a lockstep driver. Readers: every node.
    pub struct Clock("sidestep/Clock/1") {
        /// `[ns]` graph time at `host0_ns`.
        pub graph0_ns: u64,
        /// `[ns]` host time (CLOCK_MONOTONIC) at which `graph0_ns` held.
        pub host0_ns: u64,
        /// `[ns]` graph time now; in lockstep the only time there is.
        pub graph_ns: u64,
        /// `[1]` (0, 100] graph seconds per host second.
        pub rate: f64,
        /// [`ClockMode`].
        pub mode: u32,
        /// Raised when playback loops or seeks.
        pub epoch: u32,
        /// 1 while paused: graph time stands at `graph_ns`.
        pub paused: u32,
        /// 1 while the sensors are a recording that no command can change.
        pub open_loop: u32,
    }
}

impl Clock {
    /// Graph time at a host time.
    #[must_use]
    pub fn graph_ns_at(&self, host_ns: u64) -> u64 {
        if self.mode == ClockMode::RealTime as u32 {
            return host_ns;
        }
        if self.mode == ClockMode::Lockstep as u32 || self.paused != 0 {
            return self.graph_ns;
        }
        let passed_ns = host_ns.saturating_sub(self.host0_ns);
        self.graph0_ns + (passed_ns as f64 * self.rate) as u64
    }
}

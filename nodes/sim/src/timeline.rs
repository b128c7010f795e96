//! What comes when, where graph time moves in steps: a tick every 10 ms, and each frame before the tick that follows it.

/// `[ns]` graph time at which a drive begins.
pub const BEGIN_NS: u64 = 1_000_000_000;
/// `[ns]` between two odometry messages, and two commands.
pub const TICK_NS: u64 = 10_000_000;
/// Odometry messages per message of the ultrasonic sensors.
pub const TICKS_PER_RANGES: u64 = 5;
/// `[1]` of a frame period: when the first frame comes.
const PHASE: f64 = 0.37;

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Odometry, and every few ticks ranges.
    Tick {
        /// `[ns]` graph time.
        stamp_ns: u64,
        /// From 0.
        number: u64,
    },
    /// An image.
    Frame {
        /// `[ns]` graph time of capture.
        stamp_ns: u64,
        /// From 1.
        number: u64,
    },
}

impl Event {
    /// `[ns]` graph time.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        let (Self::Tick { stamp_ns, .. } | Self::Frame { stamp_ns, .. }) = self;
        *stamp_ns
    }
}

/// The order of events of a drive.
#[derive(Debug, Clone)]
pub struct Timeline {
    period_ns: f64,
    ticks: u64,
    frames: u64,
}

impl Timeline {
    /// Frames at `rate_hz`.
    #[must_use]
    pub fn new(rate_hz: f32) -> Self {
        Self { period_ns: 1e9 / f64::from(rate_hz).max(1.0), ticks: 0, frames: 0 }
    }

    /// The next event.
    #[allow(clippy::should_implement_trait, reason = "it never ends, so that callers need no None")]
    pub fn next(&mut self) -> Event {
        let tick_ns = BEGIN_NS + self.ticks * TICK_NS;
        let frame_ns = BEGIN_NS + ((self.frames as f64 + PHASE) * self.period_ns) as u64;
        if frame_ns < tick_ns {
            self.frames += 1;
            Event::Frame { stamp_ns: frame_ns, number: self.frames }
        } else {
            self.ticks += 1;
            Event::Tick { stamp_ns: tick_ns, number: self.ticks - 1 }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_come_in_order_at_their_rates() {
        let mut timeline = Timeline::new(30.0);
        let (mut last_ns, mut ticks, mut frames) = (0, 0, 0);
        while ticks < 300 {
            let stamp_ns = match timeline.next() {
                Event::Tick { stamp_ns, number } => {
                    assert_eq!(number, ticks);
                    ticks += 1;
                    stamp_ns
                }
                Event::Frame { stamp_ns, number } => {
                    frames += 1;
                    assert_eq!(number, frames);
                    stamp_ns
                }
            };
            assert!(stamp_ns >= last_ns);
            last_ns = stamp_ns;
        }
        assert!((89..=90).contains(&frames), "{frames}");
    }
}

//! When the node does what: a tick every 10 ms, a frame at its intended time, rendered while the pipeline rests.

use crate::timeline::TICK_NS;

/// Odometry messages per word on the clock.
pub(crate) const TICKS_PER_CLOCK: u64 = 100;
/// `[ns]` a frame is rendered this long after the last one was sent, if no command about that came before.
const RENDER_AFTER_NS: u64 = 25_000_000;
/// `[ns]` ticks older than this are not made up for.
const STALL_NS: u64 = 100_000_000;

/// The plan of the node, in graph time.
#[derive(Debug, Clone)]
pub(crate) struct Schedule {
    next_tick_ns: u64,
    ticks: u64,
    first_frame_ns: u64,
    period_ns: f64,
    frame: u64,
    sent_ns: u64,
    answered: bool,
    rendered: bool,
}

impl Schedule {
    /// Frames at `rate_hz`, the first after `phase` in [0, 1) of a period and one period more.
    pub(crate) fn new(now_ns: u64, rate_hz: f32, phase: f64) -> Self {
        let period_ns = 1e9 / f64::from(rate_hz).clamp(1.0, 200.0);
        Self {
            next_tick_ns: now_ns,
            ticks: 0,
            first_frame_ns: now_ns + ((1.0 + phase) * period_ns) as u64,
            period_ns,
            frame: 0,
            sent_ns: now_ns,
            answered: false,
            rendered: false,
        }
    }

    /// Stamp and number of a tick that is due; after a stall only the newest.
    pub(crate) fn tick(&mut self, now_ns: u64) -> Option<(u64, u64)> {
        if now_ns < self.next_tick_ns {
            return None;
        }
        if now_ns - self.next_tick_ns > STALL_NS {
            let missed = (now_ns - self.next_tick_ns) / TICK_NS;
            self.next_tick_ns += missed * TICK_NS;
        }
        let due = (self.next_tick_ns, self.ticks);
        self.next_tick_ns += TICK_NS;
        self.ticks += 1;
        Some(due)
    }

    /// `[ns]` intended time of the next frame.
    pub(crate) fn capture_ns(&self) -> u64 {
        self.first_frame_ns + (self.frame as f64 * self.period_ns) as u64
    }

    /// A command about frame `source_frame` was seen; `newest` is the last frame sent.
    pub(crate) fn answer(&mut self, source_frame: u64, newest: u64) {
        self.answered |= source_frame >= newest;
    }

    /// Whether to render the next frame now; frames whose time has passed are skipped.
    pub(crate) fn render(&mut self, now_ns: u64) -> bool {
        if self.rendered || !(self.answered || now_ns >= self.sent_ns + RENDER_AFTER_NS) {
            return false;
        }
        while self.capture_ns() <= now_ns {
            self.frame += 1;
        }
        self.rendered = true;
        true
    }

    /// Whether the rendered frame is to be sent; it is taken as sent.
    pub(crate) fn send(&mut self, now_ns: u64) -> bool {
        let due = self.rendered && now_ns >= self.capture_ns();
        if due {
            self.rendered = false;
            self.answered = false;
            self.sent_ns = now_ns;
            self.frame += 1;
        }
        due
    }

    /// `[ns]` when something is due next.
    pub(crate) fn wake_ns(&self) -> u64 {
        let frame_ns = if self.rendered { self.capture_ns() } else { self.sent_ns + RENDER_AFTER_NS };
        self.next_tick_ns.min(frame_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Runs the plan with wakes at the wished times, `late_ms` too late; returns the capture stamps.
    fn frames(late_ms: u64, answer: bool) -> Vec<u64> {
        let mut schedule = Schedule::new(1000 * MS, 30.0, 0.5);
        let mut now = 1000 * MS;
        let mut sent = Vec::new();
        while now < 2000 * MS {
            while schedule.tick(now).is_some() {}
            schedule.render(now);
            let capture = schedule.capture_ns();
            if schedule.send(now) {
                sent.push(capture);
                if answer {
                    schedule.answer(sent.len() as u64, sent.len() as u64);
                }
            }
            now = schedule.wake_ns().max(now) + late_ms * MS;
        }
        sent
    }

    #[test]
    fn frames_keep_their_rate_whether_the_pipeline_answers_or_not() {
        for answer in [false, true] {
            let sent = frames(0, answer);
            assert!((28..=30).contains(&sent.len()), "{}", sent.len());
            assert!(sent.windows(2).all(|w| (w[1] - w[0]).abs_diff(33_333_333) < 2));
        }
    }

    #[test]
    fn a_late_node_skips_frames_and_keeps_to_the_grid_of_intended_times() {
        let sent = frames(40, false);
        assert!(sent.len() > 5 && sent.len() < 25, "{}", sent.len());
        for stamp in sent {
            let periods = (stamp as f64 - 1050e6) / 33_333_333.3;
            assert!((periods - periods.round()).abs() < 1e-3, "{periods}");
        }
    }

    #[test]
    fn after_a_stall_only_the_newest_tick_is_due() {
        let mut schedule = Schedule::new(0, 30.0, 0.0);
        assert_eq!(schedule.tick(0), Some((0, 0)));
        assert_eq!(schedule.tick(5 * MS), None);
        assert_eq!(schedule.tick(5000 * MS), Some((5000 * MS, 1)));
        assert_eq!(schedule.tick(5000 * MS), None);
    }
}

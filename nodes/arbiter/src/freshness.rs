//! Whether an input may still be believed: its stamp's age, and whether the stamps run as time does.
//!
//! A message that repeats, runs backward, lies in the future or carries garbage is not taken. The last good one holds
//! until its age limit; then the reason names what went wrong. So one duplicate stops nobody, and a frozen source stops
//! the robot within the age limit and one tick.

use crate::config::span_ns;
use bytemuck::{Pod, Zeroable};

/// `[ns]` a stamp may be ahead of the reader's clock: it was read when the step began, the message came later.
const AHEAD_NS: u64 = 20_000_000;

/// What is wrong with an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// Nothing came yet.
    Never,
    /// The last good message is too old, and nothing came since.
    Stale,
    /// The stamps since the last good message repeat.
    Repeated,
    /// The stamps since the last good message run backward or lie in the future.
    Backward,
    /// The messages since the last good one carry garbage or were refused.
    Unfit,
}

const NONE: u32 = 0;
const REPEATED: u32 = 1;
const BACKWARD: u32 = 2;
const UNFIT: u32 = 3;

/// The stamp of the last good message of an input, and what came since.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Stamps {
    /// `[ns]` graph time of the last good message.
    pub(crate) stamp_ns: u64,
    /// 1 once a good message came.
    taken: u32,
    /// What came since the last good message.
    trouble: u32,
}

impl Stamps {
    /// Whether a message may be taken; `writer_now_ns` is the writer's time, 0 where the message has none.
    pub(crate) fn offer(&mut self, stamp_ns: u64, writer_now_ns: u64, fit: bool) -> bool {
        let ahead = writer_now_ns != 0 && stamp_ns > writer_now_ns.saturating_add(AHEAD_NS);
        self.trouble = if !fit {
            UNFIT
        } else if ahead || self.taken != 0 && stamp_ns < self.stamp_ns {
            BACKWARD
        } else if self.taken != 0 && stamp_ns == self.stamp_ns {
            REPEATED
        } else {
            self.stamp_ns = stamp_ns;
            self.taken = 1;
            NONE
        };
        self.trouble == NONE
    }

    /// Whether a good message came.
    pub(crate) fn is_known(&self) -> bool {
        self.taken != 0
    }

    /// `[ns]` age of the last good message, or `None` before one came.
    pub(crate) fn age_ns(&self, now_ns: u64) -> Option<u64> {
        (self.taken != 0).then(|| now_ns.saturating_sub(self.stamp_ns))
    }

    /// `[s]` the same for the command; infinite before one came.
    pub(crate) fn age_s(&self, now_ns: u64) -> f32 {
        self.age_ns(now_ns).map_or(f32::INFINITY, |age| age as f32 * 1e-9)
    }

    /// Forgets a stamp that lies in the future, so that later honest ones do not look backward.
    pub(crate) fn distrust_future(&mut self, now_ns: u64) {
        if self.taken != 0 && self.stamp_ns > now_ns.saturating_add(AHEAD_NS) {
            *self = Self { stamp_ns: 0, taken: 0, trouble: BACKWARD };
        }
    }

    /// Why the last good message cannot be used, or nothing.
    pub(crate) fn trouble(&self, now_ns: u64, limit_s: f32) -> Option<Trouble> {
        let fresh = self.age_ns(now_ns).is_some_and(|age| age <= span_ns(limit_s));
        if fresh {
            return None;
        }
        Some(match self.trouble {
            REPEATED => Trouble::Repeated,
            BACKWARD => Trouble::Backward,
            UNFIT => Trouble::Unfit,
            _ if self.taken == 0 => Trouble::Never,
            _ => Trouble::Stale,
        })
    }

    /// Whether it can be used.
    pub(crate) fn is_fresh(&self, now_ns: u64, limit_s: f32) -> bool {
        self.trouble(now_ns, limit_s).is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn an_age_limit_is_exact_to_the_nanosecond() {
        let mut stamps = Stamps::zeroed();
        assert_eq!(stamps.trouble(0, 0.1), Some(Trouble::Never));
        assert!(stamps.offer(500 * MS, 501 * MS, true));
        assert!(stamps.is_fresh(600 * MS, 0.1));
        assert_eq!(stamps.trouble(600 * MS + 1, 0.1), Some(Trouble::Stale));
    }

    #[test]
    fn bad_messages_do_not_refresh_and_name_the_trouble_when_the_good_one_expires() {
        for (stamp, fit, trouble) in [
            (500 * MS, true, Trouble::Repeated),
            (400 * MS, true, Trouble::Backward),
            (900 * MS, true, Trouble::Backward),
            (510 * MS, false, Trouble::Unfit),
        ] {
            let mut stamps = Stamps::zeroed();
            assert!(stamps.offer(500 * MS, 500 * MS, true));
            assert!(!stamps.offer(stamp, 520 * MS, fit));
            assert!(stamps.is_fresh(600 * MS, 0.1), "one bad message stops nobody");
            assert_eq!(stamps.trouble(601 * MS, 0.1), Some(trouble));
            assert!(stamps.offer(605 * MS, 606 * MS, true));
            assert!(stamps.is_fresh(606 * MS, 0.1), "a good one heals");
        }
    }

    #[test]
    fn a_stamp_from_the_future_is_forgotten_and_honest_ones_are_taken_again() {
        let mut stamps = Stamps::zeroed();
        assert!(stamps.offer(u64::MAX, 0, true));
        stamps.distrust_future(500 * MS);
        assert_eq!(stamps.trouble(500 * MS, 0.1), Some(Trouble::Backward));
        assert!(stamps.offer(500 * MS, 0, true));
        assert!(stamps.is_fresh(500 * MS, 0.1));
    }
}

//! Step tests in a drive: stretches in which a command goes one way.

use crate::fit::slope;
use crate::response::Window;
use crate::series::{Moved, Sent, Series};
use serde::Serialize;

/// `[ns]` commands that are farther apart end a stretch: the base may have braked by itself.
const GAP_MOST_NS: u64 = 60_000_000;
/// `[ns]` a command that stays this long ends the stretch.
const PLATEAU_NS: u64 = 100_000_000;
/// `[ns]` commands before the window that may still be on their way.
const BEFORE_NS: u64 = 700_000_000;
/// `[ns]` motion before the stretch that belongs to the window.
const LEAD_NS: u64 = 60_000_000;
/// `[ns]` motion after the stretch, at least where nothing else begins, and at most.
const AFTER_NS: (u64, u64) = (400_000_000, 3_000_000_000);
/// `[1]` of the change that the base has not made yet, below which a window may end.
const SETTLED: f64 = 0.04;
/// `[1]` parts of the change between which the slope is taken.
const MIDDLE: (f64, f64) = (0.25, 0.8);

/// What turns or drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Forward speed, in metres per second.
    Forward,
    /// Turn rate, in radians per second.
    Turn,
}

impl Axis {
    pub(crate) fn commanded(self, sent: &Sent) -> f64 {
        match self {
            Self::Forward => sent.v_m_s,
            Self::Turn => sent.w_rad_s,
        }
    }

    pub(crate) fn measured(self, moved: &Moved) -> f64 {
        match self {
            Self::Forward => moved.v_m_s,
            Self::Turn => moved.w_rad_s,
        }
    }

    /// Smallest change of the command that is a test.
    fn change_least(self) -> f64 {
        match self {
            Self::Forward => 0.2,
            Self::Turn => 0.4,
        }
    }

    /// Change of the command that is none.
    pub(crate) fn still(self) -> f64 {
        0.01 * self.change_least()
    }
}

/// Which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Away from rest.
    Speeding,
    /// Towards rest.
    Slowing,
}

/// A stretch in which the command goes one way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    pub(crate) axis: Axis,
    pub(crate) kind: Kind,
    pub(crate) begin_ns: u64,
    pub(crate) end_ns: u64,
    pub(crate) from: f64,
    pub(crate) to: f64,
}

/// A run of commands in one direction while it grows.
struct Stretch {
    begin: usize,
    /// Last command that moved on.
    last: usize,
    sign: f64,
}

impl Edge {
    fn of(axis: Axis, commands: &[Sent], stretch: &Stretch) -> Option<Self> {
        let (first, last) = (commands.get(stretch.begin)?, commands.get(stretch.last)?);
        let (from, to) = (axis.commanded(first), axis.commanded(last));
        let crosses = from * to < 0.0;
        if (to - from).abs() < axis.change_least() || crosses {
            return None;
        }
        let kind = if to.abs() > from.abs() { Kind::Speeding } else { Kind::Slowing };
        // The change begins with the first command that differs.
        let begin_ns = commands.get(stretch.begin + 1)?.sent_ns;
        Some(Self { axis, kind, begin_ns, end_ns: last.sent_ns, from, to })
    }

    /// All tests of an axis, in the order of time.
    pub(crate) fn all(series: &Series, axis: Axis) -> Vec<Self> {
        let commands = series.commands();
        let mut found = Vec::new();
        let mut stretch: Option<Stretch> = None;
        for index in 1..commands.len() {
            let (before, now) = (&commands[index - 1], &commands[index]);
            let gap = now.sent_ns - before.sent_ns > GAP_MOST_NS;
            let change = axis.commanded(now) - axis.commanded(before);
            let still = change.abs() < axis.still();
            let goes_on = stretch.as_ref().is_some_and(|stretch| {
                let plateau = now.sent_ns - commands[stretch.last].sent_ns > PLATEAU_NS;
                if still { !plateau } else { change * stretch.sign > 0.0 }
            });
            if gap || !goes_on {
                found.extend(stretch.take().and_then(|stretch| Self::of(axis, commands, &stretch)));
            }
            if still || gap {
                continue;
            }
            match &mut stretch {
                Some(stretch) => stretch.last = index,
                None => stretch = Some(Stretch { begin: index - 1, last: index, sign: change.signum() }),
            }
        }
        found.extend(stretch.and_then(|stretch| Self::of(axis, commands, &stretch)));
        found
    }

    /// When the base has done what it was told, or something else was begun; `None` where commands were missing.
    fn settled_ns(&self, series: &Series) -> Option<u64> {
        let last_ns = self.end_ns + AFTER_NS.1;
        let mut end_ns = last_ns;
        let mut before_ns = self.begin_ns;
        for sent in series.sent_within(self.begin_ns, last_ns) {
            let other = (self.axis.commanded(sent) - self.to) * (self.to - self.from).signum();
            let left = sent.sent_ns > self.end_ns && other.abs() > 2.0 * self.axis.still();
            let missing = sent.sent_ns - before_ns > GAP_MOST_NS;
            if left || missing {
                end_ns = before_ns;
                break;
            }
            before_ns = sent.sent_ns;
        }
        end_ns = end_ns.min(before_ns);
        let (open, floor_ns) = (SETTLED * (self.to - self.from).abs(), self.end_ns + AFTER_NS.0);
        let motion = series.moved_within(self.end_ns, end_ns);
        let settled =
            |moved: &&Moved| moved.stamp_ns >= floor_ns && (self.axis.measured(moved) - self.to).abs() < open;
        Some(motion.iter().find(settled).map_or(end_ns, |moved| moved.stamp_ns))
            .filter(|&end_ns| end_ns >= self.end_ns)
    }

    /// Commands and motion around the stretch; `None` where wheels slipped or too little was measured.
    pub(crate) fn window(&self, series: &Series) -> Option<Window> {
        let from_ns = self.begin_ns.checked_sub(LEAD_NS)?;
        let to_ns = self.settled_ns(series)?;
        let motion = series.moved_within(from_ns, to_ns + 1);
        let sent = series.sent_within(from_ns.saturating_sub(BEFORE_NS), to_ns);
        let whole = sent.windows(2).all(|pair| pair[1].sent_ns - pair[0].sent_ns <= GAP_MOST_NS);
        if motion.len() < 20 || motion.iter().any(|moved| moved.slip) || !whole {
            return None;
        }
        let first_ns = motion[0].stamp_ns;
        let seconds = |ns: u64| (ns as f64 - first_ns as f64) * 1e-9;
        let commands = sent.iter().map(|sent| (seconds(sent.sent_ns), self.axis.commanded(sent))).collect();
        let points = |motion: &[Moved]| -> Vec<(f64, f64)> {
            motion.iter().map(|moved| (seconds(moved.stamp_ns), self.axis.measured(moved))).collect()
        };
        // The mean of what lies evenly about an instant is its value, whatever the slope.
        let around = points(series.moved_within(first_ns.saturating_sub(25_000_000), first_ns + 25_000_000));
        let first = around.iter().map(|point| point.1).sum::<f64>() / around.len().max(1) as f64;
        Some(Window { commands, motion: points(motion), first })
    }

    /// `[m/s^2]` or `[rad/s^2]` slope of the motion in the middle of the change, positive; `None` where it never got there.
    pub(crate) fn slope(&self, window: &Window) -> Option<f64> {
        let part = |speed: f64| (speed - self.from) / (self.to - self.from);
        let begin = window.motion.iter().position(|point| part(point.1) >= MIDDLE.0)?;
        let length = window.motion[begin..].iter().position(|point| part(point.1) > MIDDLE.1)?;
        let middle = &window.motion[begin..begin + length];
        slope(middle).map(f64::abs)
    }
}

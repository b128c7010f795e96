//! Whether a base brakes by itself when commands cease, and how soon.

use crate::fit::{Search, fit};
use crate::response::Window;
use crate::series::{Moved, Sent, Series};
use crate::spread::Spread;
use serde::Serialize;

/// `[s]` most time from the end of the newest command's validity to the beginning of braking.
pub const BRAKES_WITHIN_S: f64 = 0.15;
/// `[m/s]` slowest speed at which braking can be told from standing.
const SPEED_LEAST_M_S: f64 = 0.15;
/// `[m/s]` change that is braking for sure.
const DROP_M_S: f64 = 0.04;
/// `[m/s]` most change of the commands before, so that nothing else is on its way.
const STEADY_M_S: f64 = 0.02;
/// `[ns]` span before the last command in which commands must be steady.
const STEADY_NS: u64 = 600_000_000;
/// `[ns]` motion before the end of the command that belongs to the window, and most after it.
const WINDOW_NS: (u64, u64) = (380_000_000, 2_000_000_000);
/// `[ns]` least motion after the end of the command.
const AFTER_LEAST_NS: u64 = 100_000_000;
/// `[s]` an effect may lie this long before the end of the command, if the base does not wait for it.
const EARLIEST_S: f64 = -0.08;

/// When braking began.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Onset {
    /// `[s]` after the end of the newest command's validity.
    After(f64),
    /// `[s]` not within this time, after which commands came again or the record ends.
    NotWithin(f64),
}

/// One time that commands ceased while the robot drove.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Lapse {
    /// `[ns]` graph time at which the newest command ended.
    pub valid_until_ns: u64,
    /// `[m/s]` speed then.
    pub speed_m_s: f64,
    /// When the base began to brake.
    pub onset: Onset,
}

/// All times that commands ceased.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Watchdog {
    /// Those that tell something.
    pub lapses: Vec<Lapse>,
    /// Those that do not: at rest, in the midst of a change, or too short.
    pub unfit: usize,
}

/// What the lapses say together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Commands never ceased while the robot drove steadily.
    Unknown,
    /// `[s]` the longest time, less the dead time: within the limit.
    Brakes(f64),
    /// `[s]` the longest time, less the dead time: beyond the limit.
    Late(f64),
}

impl Watchdog {
    /// Looks for lapses and measures them.
    #[must_use]
    pub fn of(series: &Series) -> Self {
        let commands = series.commands();
        let mut found = Self::default();
        for (index, sent) in commands.iter().enumerate() {
            let end_ns = series.motion().last().map_or(0, |moved| moved.stamp_ns);
            let next_ns = commands.get(index + 1).map_or(end_ns, |next| next.sent_ns);
            if next_ns <= sent.valid_until_ns {
                continue;
            }
            match lapse(series, sent, next_ns) {
                Some(lapse) => found.lapses.push(lapse),
                None => found.unfit += 1,
            }
        }
        found
    }

    /// The spread of the times that braking took to begin, in seconds, before the dead time is subtracted.
    #[must_use]
    pub fn spread(&self) -> Option<Spread> {
        let after = |lapse: &Lapse| match lapse.onset {
            Onset::After(after_s) => Some(after_s),
            Onset::NotWithin(_) => None,
        };
        Spread::of(&self.lapses.iter().filter_map(after).collect::<Vec<_>>())
    }

    /// The worst lapse against the limit. `dead_s` is the shortest dead time that the base may have: it passes between the
    /// base's own decision and its effect, and subtracting more would flatter the watchdog.
    #[must_use]
    pub fn verdict(&self, dead_s: f64) -> Verdict {
        let mut worst: Option<f64> = None;
        for lapse in &self.lapses {
            let net_s = match lapse.onset {
                Onset::After(after_s) => (after_s - dead_s).max(0.0),
                Onset::NotWithin(within_s) if within_s - dead_s > BRAKES_WITHIN_S => within_s - dead_s,
                Onset::NotWithin(_) => continue,
            };
            worst = Some(worst.map_or(net_s, |worst| worst.max(net_s)));
        }
        match worst {
            None => Verdict::Unknown,
            Some(net_s) if net_s > BRAKES_WITHIN_S => Verdict::Late(net_s),
            Some(net_s) => Verdict::Brakes(net_s),
        }
    }
}

/// Measures one lapse; `None` where it tells nothing.
fn lapse(series: &Series, sent: &Sent, next_ns: u64) -> Option<Lapse> {
    let end_ns = sent.valid_until_ns;
    let before = series.sent_within(sent.sent_ns.saturating_sub(STEADY_NS), sent.sent_ns + 1);
    let steady = before.len() >= 5
        && before.iter().all(|other| (other.v_m_s - sent.v_m_s).abs() < STEADY_M_S)
        && before.windows(2).all(|pair| pair[1].sent_ns <= pair[0].valid_until_ns);
    let motion = series.moved_within(end_ns.saturating_sub(WINDOW_NS.0), next_ns.min(end_ns + WINDOW_NS.1));
    let (first, last) = (motion.first()?, motion.last()?);
    let known = motion.iter().all(|moved| !moved.slip) && last.stamp_ns >= end_ns + AFTER_LEAST_NS;
    let early: Vec<_> = motion
        .iter()
        .filter(|moved| moved.stamp_ns < sent.sent_ns.max(first.stamp_ns + 60_000_000))
        .collect();
    let speed_m_s = early.iter().map(|moved| moved.v_m_s).sum::<f64>() / early.len().max(1) as f64;
    if !steady || !known || speed_m_s.abs() < SPEED_LEAST_M_S {
        return None;
    }
    let drop_m_s = (speed_m_s - last.v_m_s) * speed_m_s.signum();
    if drop_m_s < DROP_M_S {
        let within_s = (last.stamp_ns - end_ns) as f64 * 1e-9;
        return Some(Lapse { valid_until_ns: end_ns, speed_m_s, onset: Onset::NotWithin(within_s) });
    }
    let after_s = onset_s(motion, end_ns, speed_m_s);
    Some(Lapse { valid_until_ns: end_ns, speed_m_s, onset: Onset::After(after_s) })
}

/// The time from `end_ns` to the beginning of the brake that fits best.
fn onset_s(motion: &[Moved], end_ns: u64, speed_m_s: f64) -> f64 {
    let seconds = |ns: u64| (ns as f64 - end_ns as f64) * 1e-9;
    let points: Vec<_> = motion.iter().map(|moved| (seconds(moved.stamp_ns), moved.v_m_s)).collect();
    // The steepest that the base shows over 0.1 s: where the grid of limits begins.
    let slopes = points.windows(11).filter_map(crate::fit::slope);
    let slope = slopes.map(f64::abs).fold(0.1, f64::max);
    let commands = vec![(-10.0, speed_m_s), (0.0, 0.0)];
    let window = Window { commands, motion: points, first: speed_m_s };
    let dead_most_s = window.motion.last().map_or(0.0, |point| point.0);
    let search = Search { dead_least_s: EARLIEST_S, dead_most_s, lag_s: None, slope: Some(slope) };
    fit(&window, &search).response.dead_s
}

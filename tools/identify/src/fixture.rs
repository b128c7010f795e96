//! A base with known values that follows an arbiter's ramps, for tests: 1 ms Euler steps, odometry at 100 Hz with noise.

use crate::series::Series;
use sidestep_msgs::{Command, Odometry, Twist, VALID_FOR_NS};

const MS: u64 = 1_000_000;

/// The truth that a test must find again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Truth {
    pub(crate) dead_s: f64,
    pub(crate) lag_s: f64,
    pub(crate) accelerate_m_s2: f64,
    pub(crate) brake_m_s2: f64,
    /// `[s]` from the end of a command to the base's own brake; infinite = it has no watchdog.
    pub(crate) watchdog_s: f64,
    /// `[m/s]` standard deviation of the measured speed.
    pub(crate) noise_m_s: f64,
    pub(crate) seed: u64,
}

/// What the arbiter is asked for at a time, and whether it lives.
pub(crate) type Wish = fn(f64) -> Option<f64>;

/// A number near 0 with standard deviation 1: the sum of twelve uniform ones.
fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

/// Drives for `span_s`; the arbiter ramps by `ramp` (speeding, slowing) towards the wish.
pub(crate) fn drive(truth: &Truth, ramp: (f64, f64), span_s: f64, wish: Wish) -> Series {
    let mut series = Series::default();
    let (mut sent, mut speed, mut command) = (Vec::new(), 0.0_f64, 0.0_f64);
    let (mut state, mut valid_until_ns) = (truth.seed | 1, 0);
    for ms in 1..(span_s * 1e3) as u64 {
        let now_ns = 1_000 * MS + ms * MS;
        if ms % 10 == 3
            && let Some(wished) = wish(ms as f64 * 1e-3)
        {
            let most = 0.01 * if wished < command { ramp.1 } else { ramp.0 };
            command += (wished - command).clamp(-most, most);
            valid_until_ns = now_ns + VALID_FOR_NS;
            let twist = Twist::new(command as f32, 0.0);
            series.command(&Command { twist, valid_until_ns, ..Command::default() }, now_ns);
            sent.push((now_ns + (truth.dead_s * 1e9) as u64, command));
        }
        let effective = sent.iter().rev().find(|(effective_ns, _)| *effective_ns <= now_ns);
        let dead = now_ns as f64 >= valid_until_ns as f64 + truth.watchdog_s * 1e9;
        let target = if dead { 0.0 } else { effective.map_or(0.0, |(_, target)| *target) };
        let wished = (target - speed) / truth.lag_s;
        let most = if wished * speed < 0.0 { truth.brake_m_s2 } else { truth.accelerate_m_s2 };
        speed += wished.clamp(-most, most) * 1e-3;
        if ms % 10 == 0 {
            let twist = Twist::new((speed + truth.noise_m_s * normal(&mut state)) as f32, 0.0);
            series.odometry(&Odometry { stamp_ns: now_ns + MS, twist, ..Odometry::default() });
        }
    }
    series
}

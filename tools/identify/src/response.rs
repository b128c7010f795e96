//! The model of a base: dead time, first-order lag, and the most it accelerates.

/// One axis of a base, as the arbiter assumes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// `[s]` from a command to its first effect.
    pub dead_s: f64,
    /// `[s]` time constant.
    pub lag_s: f64,
    /// `[m/s^2]` or `[rad/s^2]` most acceleration; infinite = never reached.
    pub most: f64,
}

impl Response {
    /// The speed `span_s` later under a constant command: a ramp while the limit holds, then an exponential.
    #[must_use]
    pub fn advance(&self, speed: f64, command: f64, span_s: f64) -> f64 {
        let gap = command - speed;
        let knee = self.most * self.lag_s;
        let (mut left, mut rest_s) = (gap.abs(), span_s);
        if left > knee {
            let ramp_s = (left - knee) / self.most;
            if span_s <= ramp_s {
                return speed + gap.signum() * self.most * span_s;
            }
            (left, rest_s) = (knee, span_s - ramp_s);
        }
        if self.lag_s <= 0.0 {
            return command;
        }
        command - gap.signum() * left * libm::exp(-rest_s / self.lag_s)
    }

    /// `[s]` part of a span that begins at the limit.
    fn limited_s(&self, speed: f64, command: f64, span_s: f64) -> f64 {
        if (command - speed).abs() > self.most * self.lag_s { span_s } else { 0.0 }
    }
}

/// Commands and speeds of one axis in a stretch of time, in seconds from its beginning.
#[derive(Debug, Clone, Default)]
pub(crate) struct Window {
    /// `[s]` time sent, and the command; in order, from before the window on.
    pub(crate) commands: Vec<(f64, f64)>,
    /// `[s]` time measured, and the speed; in order.
    pub(crate) motion: Vec<(f64, f64)>,
    /// Speed at the time of the first measurement, with less noise than that one has.
    pub(crate) first: f64,
}

impl Window {
    /// Sum of squared differences between the model and what was measured, and the time spent at the limit in seconds.
    pub(crate) fn misfit(&self, response: &Response) -> (f64, f64) {
        let Some(&(begin_s, _)) = self.motion.first() else { return (0.0, 0.0) };
        let mut next = self.commands.partition_point(|(sent_s, _)| sent_s + response.dead_s <= begin_s);
        let mut command = next.checked_sub(1).map_or(self.first, |index| self.commands[index].1);
        let (mut now_s, mut speed) = (begin_s, self.first);
        let (mut sum, mut limited_s) = (0.0, 0.0);
        for &(stamp_s, measured) in &self.motion {
            while let Some(&(sent_s, following)) = self.commands.get(next)
                && sent_s + response.dead_s <= stamp_s
            {
                let effective_s = sent_s + response.dead_s;
                limited_s += response.limited_s(speed, command, effective_s - now_s);
                speed = response.advance(speed, command, effective_s - now_s);
                (now_s, command, next) = (effective_s, following, next + 1);
            }
            limited_s += response.limited_s(speed, command, stamp_s - now_s);
            speed = response.advance(speed, command, stamp_s - now_s);
            now_s = stamp_s;
            sum += (speed - measured) * (speed - measured);
        }
        (sum, limited_s)
    }
}

//! All step tests of a drive, fitted and gathered.

use crate::edge::{Axis, Edge, Kind};
use crate::fit::{Fit, Search, fit};
use crate::response::Window;
use crate::series::Series;
use crate::spread::{Spread, median};
use crate::steady::differences;
use serde::Serialize;
use sidestep_msgs::Actuator;

/// `[s]` longest dead time looked for.
const DEAD_MOST_S: f64 = 0.3;
/// `[s]` what a single dead time may be wrong by: half of an odometry period.
const RESOLUTION_S: f64 = 0.005;
/// `[s]` difference of the lag that matters.
const LAG_RESOLUTION_S: f64 = 0.02;
/// `[1]` what a single deceleration may be wrong by.
const BRAKE_RESOLUTION: f64 = 0.03;
/// `[1]` of the change: a fit that is worse describes something else than a base that follows.
const RMS_MOST: f64 = 0.08;
/// `[1]` part of the misfit that a limit of acceleration must take away, and speed in `[m/s]` or `[rad/s]`, to be one.
const LIMIT_GAINS: (f64, f64) = (0.1, 5e-4);
/// `[s]` time at the limit without which it says nothing.
const LIMITED_LEAST_S: f64 = 0.1;

/// What kept a base from changing faster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitedBy {
    /// The commands: the base followed them, and might do more.
    Command,
    /// The base itself: this is what it can do.
    Base,
}

/// One step test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Test {
    /// What changed.
    pub axis: Axis,
    /// Which way.
    pub kind: Kind,
    /// `[ns]` graph time of the first command that differed.
    pub begin_ns: u64,
    /// `[m/s]` or `[rad/s]` command before.
    pub from: f64,
    /// `[m/s]` or `[rad/s]` command after.
    pub to: f64,
    /// `[s]` dead time, the lag held at the median of all tests of this axis: alone, more of one looks like less of the other.
    pub dead_s: f64,
    /// `[s]` lag of this test alone.
    pub lag_s: f64,
    /// `[m/s^2]` or `[rad/s^2]` slope of the middle of the change.
    pub slope: Option<f64>,
    /// What limited the slope.
    pub limited_by: LimitedBy,
    /// `[m/s]` or `[rad/s]` root of the mean squared difference from the model.
    pub rms: f64,
}

/// What is known of a base after some step tests.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Identification {
    /// The tests.
    pub tests: Vec<Test>,
    /// Stretches that no base of the model could have driven: slips, contact, a push.
    pub unfit: usize,
    /// `[s]` dead time of forward speed.
    pub dead_s: Option<Spread>,
    /// `[s]` lag of forward speed.
    pub lag_s: Option<Spread>,
    /// `[s]` dead time of the turn rate.
    pub turn_dead_s: Option<Spread>,
    /// `[s]` lag of the turn rate.
    pub turn_lag_s: Option<Spread>,
    /// `[m/s^2]` acceleration shown.
    pub accelerate_m_s2: Option<Spread>,
    /// `[m/s^2]` deceleration shown, whatever limited it.
    pub brake_m_s2: Option<Spread>,
    /// `[m/s^2]` deceleration where the base was at its own limit.
    pub own_brake_m_s2: Option<Spread>,
    /// `[m/s]` mean absolute difference of steady forward speed.
    pub tracking_m_s: Option<Spread>,
    /// `[rad/s]` mean absolute difference of steady turning.
    pub tracking_rad_s: Option<Spread>,
}

/// A value of the robot file that does not contain what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The key below `[actuator]`.
    pub key: &'static str,
    /// What was measured, in the key's unit.
    pub found: f64,
    /// What the robot file has.
    pub file: f32,
    /// What it would have to be.
    pub needed: &'static str,
}

/// A stretch with the fit of its own.
struct Candidate {
    edge: Edge,
    window: Window,
    slope: Option<f64>,
    limited: bool,
    alone: Fit,
}

impl Candidate {
    fn of(edge: Edge, series: &Series) -> Option<Self> {
        let window = edge.window(series)?;
        let slope = edge.slope(&window);
        let search = Search { dead_least_s: 0.0, dead_most_s: DEAD_MOST_S, lag_s: None, slope: None };
        let free = fit(&window, &search);
        let limited = slope.map(|_| fit(&window, &Search { slope, ..search }));
        let limited = limited.filter(|limited| {
            let gain = free.rms - limited.rms;
            gain > (LIMIT_GAINS.0 * free.rms).max(LIMIT_GAINS.1) && limited.limited_s >= LIMITED_LEAST_S
        });
        Some(Self { edge, window, slope, limited: limited.is_some(), alone: limited.unwrap_or(free) })
    }

    fn fits(&self) -> bool {
        self.alone.rms < RMS_MOST * (self.edge.to - self.edge.from).abs()
    }

    fn test(&self, lag_s: f64) -> Test {
        let slope = if self.limited { self.slope } else { None };
        let search = Search { dead_least_s: 0.0, dead_most_s: DEAD_MOST_S, lag_s: Some(lag_s), slope };
        let pooled = fit(&self.window, &search);
        let Edge { axis, kind, begin_ns, from, to, .. } = self.edge;
        Test {
            axis,
            kind,
            begin_ns,
            from,
            to,
            dead_s: pooled.response.dead_s,
            lag_s: self.alone.response.lag_s,
            slope: self.slope,
            limited_by: if self.limited { LimitedBy::Base } else { LimitedBy::Command },
            rms: pooled.rms,
        }
    }
}

/// The lag of an axis. Where the base was at its limit, its lag hardly shows: such tests count where there are no others.
fn pooled_lag_s(candidates: &[Candidate]) -> Option<f64> {
    let lags = |limited: bool| -> Vec<f64> {
        let telling = candidates.iter().filter(|candidate| limited || !candidate.limited);
        telling.map(|candidate| candidate.alone.response.lag_s).collect()
    };
    median(lags(false)).or_else(|| median(lags(true)))
}

impl Identification {
    /// Fits every step test of a drive.
    #[must_use]
    pub fn of(series: &Series) -> Self {
        let mut found = Self::default();
        for axis in [Axis::Forward, Axis::Turn] {
            let edges = Edge::all(series, axis);
            let (fit, unfit): (Vec<_>, Vec<_>) =
                edges.into_iter().filter_map(|edge| Candidate::of(edge, series)).partition(Candidate::fits);
            found.unfit += unfit.len();
            let Some(lag_s) = pooled_lag_s(&fit) else { continue };
            let tests = fit.iter().map(|candidate| candidate.test(lag_s));
            let (good, poor): (Vec<_>, Vec<_>) =
                tests.partition(|test| test.rms < RMS_MOST * (test.to - test.from).abs());
            found.unfit += poor.len();
            found.tests.extend(good);
        }
        found.gather(series);
        found
    }

    fn spread(&self, value: impl Fn(&Test) -> Option<f64>) -> Option<Spread> {
        Spread::of(&self.tests.iter().filter_map(value).collect::<Vec<_>>())
    }

    fn lag(&self, axis: Axis) -> Option<Spread> {
        let lag = |limited| {
            move |test: &Test| {
                let telling = limited || test.limited_by == LimitedBy::Command;
                (test.axis == axis && telling).then_some(test.lag_s)
            }
        };
        self.spread(lag(false)).or_else(|| self.spread(lag(true)))
    }

    fn gather(&mut self, series: &Series) {
        let dead = |axis| move |test: &Test| (test.axis == axis).then_some(test.dead_s);
        self.dead_s = self.spread(dead(Axis::Forward));
        self.turn_dead_s = self.spread(dead(Axis::Turn));
        self.lag_s = self.lag(Axis::Forward);
        self.turn_lag_s = self.lag(Axis::Turn);
        let slope = |kind: Kind| {
            move |test: &Test| test.slope.filter(|_| test.axis == Axis::Forward && test.kind == kind)
        };
        self.accelerate_m_s2 = self.spread(slope(Kind::Speeding));
        self.brake_m_s2 = self.spread(slope(Kind::Slowing));
        let own = slope(Kind::Slowing);
        self.own_brake_m_s2 = self.spread(|test| own(test).filter(|_| test.limited_by == LimitedBy::Base));
        self.tracking_m_s = Spread::of(&differences(series, Axis::Forward));
        self.tracking_rad_s = Spread::of(&differences(series, Axis::Turn));
    }

    /// Whether anything was measured that a robot file could use.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.dead_s.is_none() && self.turn_dead_s.is_none()
    }

    /// `[s]` shortest and longest dead time of both axes.
    #[must_use]
    pub fn dead_range_s(&self) -> Option<(f64, f64)> {
        let spreads = [self.dead_s, self.turn_dead_s];
        let spreads = spreads.iter().flatten();
        spreads.map(|spread| (spread.min, spread.max)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Values of the robot file that do not contain what was measured, within what the method resolves.
    #[must_use]
    pub fn findings(&self, file: &Actuator) -> Vec<Finding> {
        let mut findings = Vec::new();
        let mut check = |key, found: f64, file: f32, beyond: f64, needed| {
            if beyond > 0.0 {
                findings.push(Finding { key, found, file, needed });
            }
        };
        if let Some((least, most)) = self.dead_range_s() {
            let (low, high) = (file.dead_time_min_s, file.dead_time_max_s);
            check("dead_time_min_s", least, low, f64::from(low) - RESOLUTION_S - least, "at most this");
            check("dead_time_max_s", most, high, most - f64::from(high) - RESOLUTION_S, "at least this");
        }
        for lag in [self.lag_s, self.turn_lag_s].iter().flatten() {
            let beyond = (lag.mean - f64::from(file.lag_s)).abs() - LAG_RESOLUTION_S;
            check("lag_s", lag.mean, file.lag_s, beyond, "this within 0.02 s");
        }
        if let Some(own) = self.own_brake_m_s2 {
            let low = file.brake_min_m_s2;
            let beyond = f64::from(low) * (1.0 - BRAKE_RESOLUTION) - own.min;
            check("brake_min_m_s2", own.min, low, beyond, "at most this");
        }
        if let Some(brake) = self.brake_m_s2 {
            let high = file.brake_max_m_s2;
            let beyond = brake.max - f64::from(high) * (1.0 + BRAKE_RESOLUTION);
            check("brake_max_m_s2", brake.max, high, beyond, "at least this");
        }
        if let Some(tracking) = self.tracking_m_s {
            let beyond = tracking.max - f64::from(file.tracking_m_s);
            check("tracking_m_s", tracking.max, file.tracking_m_s, beyond, "at least this");
        }
        if let Some(tracking) = self.tracking_rad_s {
            let beyond = tracking.max - f64::from(file.tracking_rad_s);
            check("tracking_rad_s", tracking.max, file.tracking_rad_s, beyond, "at least this");
        }
        findings
    }

    /// The figures as a table.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!(
            "{:<34} {:>5} {:>8} {:>8} {:>8} {:>8}\n",
            "measured", "tests", "min", "mean", "max", "std"
        );
        for (name, spread) in self.rows() {
            let line = match spread {
                Some(Spread { count, min, mean, max, deviation }) => {
                    format!("{name:<34} {count:>5} {min:>8.4} {mean:>8.4} {max:>8.4} {deviation:>8.4}\n")
                }
                None => format!("{name:<34} {:>5} {:>8}\n", 0, "-"),
            };
            text.push_str(&line);
        }
        text.push_str(&format!("stretches that fit no such base    {:>5}\n", self.unfit));
        text
    }

    fn rows(&self) -> [(&'static str, Option<Spread>); 9] {
        [
            ("dead time, forward [s]", self.dead_s),
            ("lag, forward [s]", self.lag_s),
            ("dead time, turn [s]", self.turn_dead_s),
            ("lag, turn [s]", self.turn_lag_s),
            ("acceleration shown [m/s^2]", self.accelerate_m_s2),
            ("deceleration shown [m/s^2]", self.brake_m_s2),
            ("deceleration at base limit [m/s^2]", self.own_brake_m_s2),
            ("steady error, forward [m/s]", self.tracking_m_s),
            ("steady error, turn [rad/s]", self.tracking_rad_s),
        ]
    }
}

//! Least squares of the model over a window: a grid, then a pattern search from its best point.

use crate::response::{Response, Window};

/// `[s]` spacing of the dead times of the grid.
const DEAD_GRID_S: f64 = 0.02;
/// `[s]` lags of the grid.
const LAG_GRID: [f64; 10] = [0.005, 0.02, 0.04, 0.06, 0.08, 0.1, 0.14, 0.18, 0.24, 0.3];
/// `[1]` limits of the grid, as parts of the slope that was seen.
const LIMIT_GRID: [f64; 5] = [0.85, 1.0, 1.15, 1.4, 2.0];
/// `[s]` longest lag that is looked for.
const LAG_MOST_S: f64 = 0.6;
/// `[s]` steps of the search: first and last.
const STEPS_S: (f64, f64) = (0.01, 5e-5);

/// Where to look.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search {
    /// `[s]` earliest dead time; negative where an effect may come before its cause was due.
    pub(crate) dead_least_s: f64,
    /// `[s]` latest dead time.
    pub(crate) dead_most_s: f64,
    /// `[s]` the lag where it is known.
    pub(crate) lag_s: Option<f64>,
    /// Slope that was seen, where a limit of acceleration is looked for.
    pub(crate) slope: Option<f64>,
}

/// A model and how well it fits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) response: Response,
    /// Root of the mean squared difference, in the unit of the speed.
    pub(crate) rms: f64,
    /// `[s]` time at the limit of acceleration.
    pub(crate) limited_s: f64,
}

/// The best model of a window: of each limit, the best of the grid is refined, since one may hide another.
pub(crate) fn fit(window: &Window, search: &Search) -> Fit {
    let free = [f64::INFINITY];
    let limits = search.slope.map(|slope| LIMIT_GRID.map(|part| part * slope));
    let limits: &[f64] = limits.as_ref().map_or(&free, |limits| limits);
    let mut best = refine(window, search, coarse(window, search, limits[0]));
    for &most in &limits[1..] {
        let found = refine(window, search, coarse(window, search, most));
        if found.rms < best.rms {
            best = found;
        }
    }
    best
}

/// The best of the grid under one limit.
fn coarse(window: &Window, search: &Search, most: f64) -> (Response, f64) {
    let known = search.lag_s.map(|lag_s| [lag_s]);
    let lags: &[f64] = known.as_ref().map_or(&LAG_GRID, |lag| lag);
    let mut best = (Response { dead_s: search.dead_least_s, lag_s: lags[0], most }, f64::INFINITY);
    let count = ((search.dead_most_s - search.dead_least_s) / DEAD_GRID_S) as u32;
    for number in 0..=count {
        let dead_s = search.dead_least_s + f64::from(number) * DEAD_GRID_S;
        for &lag_s in lags {
            best = better(window, best, Response { dead_s, lag_s, most });
        }
    }
    best
}

fn better(window: &Window, best: (Response, f64), candidate: Response) -> (Response, f64) {
    let (sum, _) = window.misfit(&candidate);
    if sum < best.1 { (candidate, sum) } else { best }
}

/// Moves along dead time, lag, limit, and along the valley where more dead time looks like less lag.
fn refine(window: &Window, search: &Search, mut best: (Response, f64)) -> Fit {
    const DIRECTIONS: [[f64; 3]; 5] =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0], [1.0, 0.0, 1.0]];
    let mut step_s = STEPS_S.0;
    while step_s > STEPS_S.1 {
        let before = best.1;
        for [dead, lag, limit] in DIRECTIONS {
            if (lag != 0.0 && search.lag_s.is_some()) || (limit != 0.0 && search.slope.is_none()) {
                continue;
            }
            for sign in [-1.0, 1.0] {
                let Response { dead_s, lag_s, most } = best.0;
                let candidate = Response {
                    dead_s: (dead_s + sign * dead * step_s).clamp(search.dead_least_s, search.dead_most_s),
                    lag_s: (lag_s + sign * lag * step_s).clamp(1e-3, LAG_MOST_S),
                    most: if limit == 0.0 { most } else { most * (1.0 + 4.0 * sign * limit * step_s) },
                };
                best = better(window, best, candidate);
            }
        }
        if best.1 >= before {
            step_s *= 0.5;
        }
    }
    let (sum, limited_s) = window.misfit(&best.0);
    let count = window.motion.len().max(1) as f64;
    Fit { response: best.0, rms: (sum / count).sqrt(), limited_s }
}

/// Slope of the least-squares line through points; `None` of fewer than four, or of one instant.
pub(crate) fn slope(points: &[(f64, f64)]) -> Option<f64> {
    if points.len() < 4 {
        return None;
    }
    let count = points.len() as f64;
    let mean = |value: fn(&(f64, f64)) -> f64| points.iter().map(value).sum::<f64>() / count;
    let (time_s, speed) = (mean(|point| point.0), mean(|point| point.1));
    let along: f64 = points.iter().map(|point| (point.0 - time_s) * (point.0 - time_s)).sum();
    let across: f64 = points.iter().map(|point| (point.0 - time_s) * (point.1 - speed)).sum();
    (along > 0.0).then(|| across / along)
}

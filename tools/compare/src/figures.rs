//! The numbers of a comparison.

use crate::conduct::Conduct;
use crate::frames::Point;
use serde::Serialize;
use sidestep_msgs::Twist;
use sidestep_train::{Difference, Errors, LARGE_V_M_S, LARGE_W_RAD_S, caught, combined_doubt, is_large};

/// Errors within one window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct WindowErrors {
    /// `[s]` both commands lie within u' +- acceleration x this.
    pub window_s: f32,
    /// How far first and second are apart.
    pub errors: Errors,
}

/// How often the two agree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Agreement {
    /// `[1]` part of the frames.
    pub share: f64,
    /// `[m/s]` further apart they do not agree.
    pub v_m_s: f32,
    /// `[rad/s]` further apart they do not agree.
    pub w_rad_s: f32,
}

/// Cost of the first proposal above that of the second.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Regret {
    /// `[1]` mean.
    pub mean: f64,
    /// `[1]` median.
    pub p50: f64,
    /// `[1]` nine of ten are at most this.
    pub p90: f64,
    /// `[1]` 99 of 100 are at most this.
    pub p99: f64,
    /// `[1]` the largest.
    pub max: f64,
    /// `[1]` part of the frames on which the first is the better one.
    pub first_better: f64,
    /// `[1]` mean cost of first and second.
    pub costs: [f64; 2],
    /// `[1]` mean cost of first and second above the least that is known: the optimality gap.
    pub gaps: [f64; 2],
}

/// Ages of a proposal when the arbiter answered its frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Ages {
    /// `[ms]` median, from the capture of the map.
    pub p50_ms: f64,
    /// `[ms]` 99 of 100 are at most this.
    pub p99_ms: f64,
    /// `[ms]` the oldest.
    pub max_ms: f64,
}

/// The numbers of a comparison.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Frames compared.
    pub frames: u64,
    /// Errors, by window.
    pub windows: Vec<WindowErrors>,
    /// Agreement.
    pub agreement: Agreement,
    /// Regret.
    pub regret: Regret,
    /// Share of the large errors among the tenth of most doubt of the first; `None` where there is no large error.
    pub doubt_catches: Option<f64>,
}

/// The value below which a part of sorted values lies.
pub(crate) fn quantile(sorted: &[f64], part: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((part * last as f64).round() as usize).copied().unwrap_or(0.0)
}

impl Figures {
    pub(crate) fn of(points: &[Point], windows: Vec<(f32, Difference)>) -> Self {
        let count = points.len().max(1) as f64;
        let apart = |point: &Point| is_large(Twist::new(point.v_m_s, point.w_rad_s), Twist::STOP);
        let large = points.iter().filter(|point| apart(point)).count();
        let doubted = points.iter().filter(|point| point.doubt.iter().all(|doubt| doubt.is_finite()));
        let doubted: Vec<_> = doubted.map(|point| (combined_doubt(point.doubt), apart(point))).collect();
        let known = doubted.iter().any(|(_, large)| *large);
        Self {
            frames: points.len() as u64,
            windows: windows
                .into_iter()
                .map(|(window_s, difference)| WindowErrors { window_s, errors: difference.errors() })
                .collect(),
            agreement: Agreement {
                share: 1.0 - large as f64 / count,
                v_m_s: LARGE_V_M_S,
                w_rad_s: LARGE_W_RAD_S,
            },
            regret: Regret::of(points),
            doubt_catches: known.then(|| caught(doubted)),
        }
    }
}

impl Regret {
    fn of(points: &[Point]) -> Self {
        let count = points.len().max(1) as f64;
        let mut sorted: Vec<f64> = points.iter().map(|point| f64::from(point.regret())).collect();
        sorted.sort_by(f64::total_cmp);
        let mean = |value: &dyn Fn(&Point) -> f32| {
            points.iter().map(|point| f64::from(value(point))).sum::<f64>() / count
        };
        Self {
            mean: mean(&Point::regret),
            p50: quantile(&sorted, 0.5),
            p90: quantile(&sorted, 0.9),
            p99: quantile(&sorted, 0.99),
            max: quantile(&sorted, 1.0),
            first_better: sorted.iter().filter(|regret| **regret < 0.0).count() as f64 / count,
            costs: [0, 1].map(|side| mean(&|point| point.costs[side])),
            gaps: [0, 1].map(|side| mean(&|point| point.gap(side))),
        }
    }
}

impl Ages {
    /// Of policy and expert.
    pub(crate) fn of(conduct: &Conduct) -> [Option<Self>; 2] {
        [&conduct.policy_ages_s, &conduct.expert_ages_s].map(|ages_s| {
            let at = |part| 1e3 * quantile(ages_s, part);
            (!ages_s.is_empty()).then(|| Self { p50_ms: at(0.5), p99_ms: at(0.99), max_ms: at(1.0) })
        })
    }
}

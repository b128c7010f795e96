//! Whether the doubt can be trusted: does it rise where errors are large (AUROC), and is it as large as they are.

use crate::answers::Answered;
use serde::Serialize;
use sidestep_msgs::{Limits, WINDOW_S};
use sidestep_train::{LARGE_V_M_S, LARGE_W_RAD_S, within_window};

/// Bins of equal count that the calibration is judged in.
const BINS: usize = 10;

/// A bin of like doubt.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Reliability {
    /// Mean of the doubt, in the unit of the axis.
    pub doubt: f64,
    /// Mean of the absolute error, in the unit of the axis.
    pub error: f64,
}

/// One axis.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Axis {
    /// Errors above this, in the unit of the axis, are large (window 0.3 s, solved label).
    pub large: f32,
    /// `[1]` part of the errors that are large.
    pub large_share: f64,
    /// `[1]` chance that a large error comes with more doubt than one that is not; `None` without either.
    pub auroc: Option<f64>,
    /// Mean over bins of |doubt - error|, in the unit of the axis.
    pub calibration_error: f64,
    /// The bins, by rising doubt.
    pub bins: Vec<Reliability>,
}

/// Both axes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Doubt {
    /// v `[m/s]`.
    pub v: Axis,
    /// w `[rad/s]`.
    pub w: Axis,
}

pub(crate) fn doubt(answers: &[Answered], limits: &Limits) -> Doubt {
    let pairs = |axis: usize| -> Vec<(f64, f64)> {
        let pair = |answer: &Answered| {
            let within = |twist| within_window(twist, answer.record.twist(), limits, WINDOW_S);
            let (wish, label) = (within(answer.wish), within(answer.solved()));
            let error = [wish.v_m_s - label.v_m_s, wish.w_rad_s - label.w_rad_s][axis].abs();
            (f64::from(answer.doubt[axis]), f64::from(error))
        };
        answers.iter().map(pair).collect()
    };
    Doubt { v: of_axis(pairs(0), LARGE_V_M_S), w: of_axis(pairs(1), LARGE_W_RAD_S) }
}

/// Pairs of doubt and error.
fn of_axis(mut pairs: Vec<(f64, f64)>, large: f32) -> Axis {
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_large = |error: f64| error > f64::from(large);
    let count = pairs.len().max(1) as f64;
    let bins: Vec<_> = pairs
        .chunks(pairs.len().div_ceil(BINS).max(1))
        .map(|bin| {
            let mean = |part: fn(&(f64, f64)) -> f64| bin.iter().map(part).sum::<f64>() / bin.len() as f64;
            Reliability { doubt: mean(|pair| pair.0), error: mean(|pair| pair.1) }
        })
        .collect();
    Axis {
        large,
        large_share: pairs.iter().filter(|pair| is_large(pair.1)).count() as f64 / count,
        auroc: auroc(&pairs, is_large),
        calibration_error: bins.iter().map(|bin| (bin.doubt - bin.error).abs()).sum::<f64>()
            / bins.len().max(1) as f64,
        bins,
    }
}

/// The rank statistic of Mann and Whitney over pairs sorted by doubt; equal doubts share their ranks.
fn auroc(sorted: &[(f64, f64)], is_large: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut ranks, mut larges) = (0.0, 0.0);
    let mut first = 0;
    while first < sorted.len() {
        let same = sorted[first..].iter().take_while(|pair| pair.0 <= sorted[first].0).count();
        let rank = first as f64 + 0.5 * (same as f64 + 1.0);
        let large = sorted[first..first + same].iter().filter(|pair| is_large(pair.1)).count() as f64;
        ranks += large * rank;
        larges += large;
        first += same;
    }
    let others = sorted.len() as f64 - larges;
    (larges > 0.0 && others > 0.0).then(|| (ranks - 0.5 * larges * (larges + 1.0)) / (larges * others))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubt_that_knows_separates_all_and_doubt_that_does_not_half() {
        let knowing = (0..100).map(|i| (f64::from(i), if i >= 80 { 1.0 } else { 0.0 })).collect();
        assert_eq!(of_axis(knowing, 0.5).auroc, Some(1.0));
        let constant = (0..100).map(|i| (1.0, f64::from(u8::from(i % 5 == 0)))).collect();
        assert_eq!(of_axis(constant, 0.5).auroc, Some(0.5));
        assert_eq!(of_axis(vec![(1.0, 0.0)], 0.5).auroc, None);
    }

    #[test]
    fn doubt_of_the_size_of_the_error_is_calibrated() {
        let pairs = (0..1000).map(|i| (f64::from(i), f64::from(i))).collect();
        assert!(of_axis(pairs, 0.5).calibration_error < 1e-9);
        let twice = of_axis((0..1000).map(|i| (2.0 * f64::from(i), f64::from(i))).collect(), 0.5);
        assert!((twice.calibration_error - 499.5).abs() < 1e-6, "{}", twice.calibration_error);
    }
}

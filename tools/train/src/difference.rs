//! How far two commands are apart, and what counts as far: one measure for evaluation and comparison.

use serde::Serialize;
use sidestep_msgs::{Limits, Twist};

/// `[s]` windows that errors are given for: that of Table I of the paper, and that of the messages.
pub const WINDOWS_S: [f32; 2] = [0.1, sidestep_msgs::WINDOW_S];
/// `[m/s]` commands further apart do not agree.
pub const LARGE_V_M_S: f32 = 0.09;
/// `[rad/s]` commands further apart do not agree.
pub const LARGE_W_RAD_S: f32 = 0.3;

/// Whether two commands do not agree.
#[must_use]
pub fn is_large(a: Twist, b: Twist) -> bool {
    (a.v_m_s - b.v_m_s).abs() > LARGE_V_M_S || (a.w_rad_s - b.w_rad_s).abs() > LARGE_W_RAD_S
}

/// `[1]` doubt about v and w as one number, each measured by the reach of the messages' window.
#[must_use]
pub fn combined_doubt(doubt: [f32; 2]) -> f32 {
    doubt[0] / 0.3 + doubt[1] / 0.9
}

/// Mean and deviation of the absolute error.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Errors {
    /// `[m/s]` mean of |v|.
    pub v_mean: f64,
    /// `[m/s]` standard deviation of |v|.
    pub v_std: f64,
    /// `[rad/s]` mean of |w|.
    pub w_mean: f64,
    /// `[rad/s]` standard deviation of |w|.
    pub w_std: f64,
    /// Mean length of the error (v, w), SI units.
    pub l2_mean: f64,
    /// Mean of its square.
    pub l2_squared_mean: f64,
}

/// Errors of many pairs, summed as they come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Difference {
    count: f64,
    sums: [f64; 6],
}

impl Difference {
    /// Takes a pair.
    pub fn add(&mut self, a: Twist, b: Twist) {
        let v = f64::from((a.v_m_s - b.v_m_s).abs());
        let w = f64::from((a.w_rad_s - b.w_rad_s).abs());
        let parts = [v, v * v, w, w * w, (v * v + w * w).sqrt(), v * v + w * w];
        self.sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        self.count += 1.0;
    }

    /// What the pairs come to; zeros without one.
    #[must_use]
    pub fn errors(&self) -> Errors {
        let [v, vv, w, ww, l2, square] = self.sums.map(|sum| sum / self.count.max(1.0));
        let deviation = |mean: f64, square: f64| (square - mean * mean).max(0.0).sqrt();
        Errors {
            v_mean: v,
            v_std: deviation(v, vv),
            w_mean: w,
            w_std: deviation(w, ww),
            l2_mean: l2,
            l2_squared_mean: square,
        }
    }
}

/// Share of the large errors among the tenth with most doubt.
#[must_use]
pub fn caught(mut doubts: Vec<(f32, bool)>) -> f64 {
    doubts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let large = doubts.iter().filter(|(_, large)| *large).count();
    let found = doubts[..doubts.len() / 10].iter().filter(|(_, large)| *large).count();
    found as f64 / large.max(1) as f64
}

/// [`sidestep_msgs::clamp_to_window`] for a window of one's own.
#[must_use]
pub fn within_window(twist: Twist, from: Twist, limits: &Limits, window_s: f32) -> Twist {
    let part = window_s / sidestep_msgs::WINDOW_S;
    let limits = Limits {
        accelerate_m_s2: limits.accelerate_m_s2 * part,
        turn_accelerate_rad_s2: limits.turn_accelerate_rad_s2 * part,
        ..*limits
    };
    sidestep_msgs::clamp_to_window(twist, from, &limits)
}

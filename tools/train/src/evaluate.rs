//! How far the policy is from the expert on data it has not seen: Table I of the paper, with the window named.

use crate::error::TrainError;
use crate::record::{Dataset, Record};
use serde::Serialize;
use sidestep_msgs::{Limits, Robot, Twist};
use sidestep_policy::Policy;
use std::path::PathBuf;

/// What to evaluate.
#[derive(Debug, Clone)]
pub struct EvaluateOptions {
    /// Held-out dataset: another seed than the training data.
    pub data: PathBuf,
    /// Model file; `None` for the model in the binary.
    pub model: Option<PathBuf>,
    /// Records to use, the first ones.
    pub samples: u64,
    /// Robot.
    pub robot: Robot,
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
    /// Mean length of the error (v, w).
    pub l2_mean: f64,
}

/// One window, all pairs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Window {
    /// `[s]` a command lies within u' +- acceleration x this.
    pub window_s: f32,
    /// Policy against the solved expert.
    pub policy_solved: Errors,
    /// Policy against 734 candidates.
    pub policy_734: Errors,
    /// 734 candidates against the solved expert: the noise of that label.
    pub candidates_solved: Errors,
    /// Keeping u' against the solved expert: what knowing nothing gives.
    pub keep_solved: Errors,
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Records used.
    pub samples: u64,
    /// Seed of the data.
    pub seed: u64,
    /// Windows of 0.1 s (Table I) and 0.3 s (the label's own).
    pub windows: Vec<Window>,
    /// Share of the large errors (|v| > 0.09 m/s or |w| > 0.3 rad/s at 0.3 s) among the tenth of most doubt.
    pub doubt_catches: f64,
}

#[derive(Default)]
struct Running {
    count: f64,
    sums: [f64; 5],
}

impl Running {
    fn add(&mut self, a: Twist, b: Twist) {
        let v = f64::from((a.v_m_s - b.v_m_s).abs());
        let w = f64::from((a.w_rad_s - b.w_rad_s).abs());
        let parts = [v, v * v, w, w * w, (v * v + w * w).sqrt()];
        self.sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        self.count += 1.0;
    }

    fn errors(&self) -> Errors {
        let [v, vv, w, ww, l2] = self.sums.map(|sum| sum / self.count.max(1.0));
        let deviation = |mean: f64, square: f64| (square - mean * mean).max(0.0).sqrt();
        Errors { v_mean: v, v_std: deviation(v, vv), w_mean: w, w_std: deviation(w, ww), l2_mean: l2 }
    }
}

/// Compares a model with the labels of a dataset.
///
/// # Errors
/// [`TrainError`] where data or model do not fit.
pub fn evaluate(options: &EvaluateOptions) -> Result<Evaluation, TrainError> {
    let data = Dataset::open(&options.data)?;
    data.require(&options.robot)?;
    let path = options.model.as_ref().map_or(String::new(), |path| path.display().to_string());
    let mut policy = sidestep_policy::Config { model: path }.load(&options.robot)?;
    let samples = options.samples.min(data.header().count);
    let windows = [0.1_f32, 0.3];
    let mut running: [[Running; 4]; 2] = Default::default();
    let mut doubts = Vec::new();
    for index in 0..samples {
        let record = data.read(index)?;
        let answer = ask(&mut policy, &record)?;
        let wish = Twist::new(answer.command[0], answer.command[1]);
        let [plain, solved] =
            [record.label_734, record.label_solved].map(|label| Twist::new(label[0], label[1]));
        let from = record.twist();
        for (window, running) in windows.iter().zip(&mut running) {
            let within = |twist| within_window(twist, from, &options.robot.limits, *window);
            let (policy, plain, solved) = (within(wish), within(plain), within(solved));
            for (running, (a, b)) in running.iter_mut().zip([
                (policy, solved),
                (policy, plain),
                (plain, solved),
                (within(from), solved),
            ]) {
                running.add(a, b);
            }
            if *window > 0.2 {
                let large = (policy.v_m_s - solved.v_m_s).abs() > 0.09
                    || (policy.w_rad_s - solved.w_rad_s).abs() > 0.3;
                doubts.push((answer.doubt[0] / 0.3 + answer.doubt[1] / 0.9, large));
            }
        }
    }
    let table = windows.iter().zip(&running).map(|(window, running)| {
        let [policy_solved, policy_734, candidates_solved, keep_solved] =
            running.each_ref().map(Running::errors);
        Window { window_s: *window, policy_solved, policy_734, candidates_solved, keep_solved }
    });
    Ok(Evaluation {
        samples,
        seed: data.header().seed,
        windows: table.collect(),
        doubt_catches: caught(doubts),
    })
}

/// Share of the large errors among the tenth with most doubt.
fn caught(mut doubts: Vec<(f32, bool)>) -> f64 {
    doubts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let large = doubts.iter().filter(|(_, large)| *large).count();
    let found = doubts[..doubts.len() / 10].iter().filter(|(_, large)| *large).count();
    found as f64 / large.max(1) as f64
}

fn ask(policy: &mut Policy, record: &Record) -> Result<sidestep_policy::Answer, TrainError> {
    policy.infer(&record.planning_cost, usize::from(record.goal_cell), record.twist()).map_err(|detail| {
        TrainError::Model(sidestep_policy::ModelError::Engine { model: "evaluated".into(), detail })
    })
}

/// [`sidestep_msgs::clamp_to_window`] for a window of one's own.
fn within_window(twist: Twist, from: Twist, limits: &Limits, window_s: f32) -> Twist {
    let part = window_s / sidestep_msgs::WINDOW_S;
    let limits = Limits {
        accelerate_m_s2: limits.accelerate_m_s2 * part,
        turn_accelerate_rad_s2: limits.turn_accelerate_rad_s2 * part,
        ..*limits
    };
    sidestep_msgs::clamp_to_window(twist, from, &limits)
}

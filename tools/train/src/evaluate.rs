//! How far the policy is from the expert on data it has not seen: Table I of the paper, with the window named.

use crate::difference::{Difference, Errors, WINDOWS_S, caught, combined_doubt, is_large, within_window};
use crate::error::TrainError;
use crate::record::{Dataset, Record};
use serde::Serialize;
use sidestep_msgs::{Robot, Twist};
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
    let mut running: [[Difference; 4]; 2] = Default::default();
    let mut doubts = Vec::new();
    for index in 0..samples {
        let record = data.read(index)?;
        let answer = ask(&mut policy, &record)?;
        let wish = Twist::new(answer.command[0], answer.command[1]);
        let [plain, solved] =
            [record.label_734, record.label_solved].map(|label| Twist::new(label[0], label[1]));
        let from = record.twist();
        for (window, running) in WINDOWS_S.iter().zip(&mut running) {
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
                doubts.push((combined_doubt(answer.doubt), is_large(policy, solved)));
            }
        }
    }
    let table = WINDOWS_S.iter().zip(&running).map(|(window, running)| {
        let [policy_solved, policy_734, candidates_solved, keep_solved] =
            running.each_ref().map(Difference::errors);
        Window { window_s: *window, policy_solved, policy_734, candidates_solved, keep_solved }
    });
    Ok(Evaluation {
        samples,
        seed: data.header().seed,
        windows: table.collect(),
        doubt_catches: caught(doubts),
    })
}

fn ask(policy: &mut Policy, record: &Record) -> Result<sidestep_policy::Answer, TrainError> {
    policy.infer(&record.planning_cost, usize::from(record.goal_cell), record.twist()).map_err(|detail| {
        TrainError::Model(sidestep_policy::ModelError::Engine { model: "evaluated".into(), detail })
    })
}

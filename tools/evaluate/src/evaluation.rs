//! What is measured, and on what.

use crate::answers::{Answered, Split, ask};
use crate::cases::{Case, cases};
use crate::doubt::{Doubt, doubt};
use crate::error::EvaluateError;
use crate::gap::{Curve, Equals, Gap, Gaps, Regrets, gaps, regrets};
use crate::oracle::{Oracle, oracle};
use crate::table1::{SetTable, set_table};
use crate::timing::{Timing, timing};
use serde_json::{Value, json};
use sidestep_expert::{Mode, Plan, Planner, Weights};
use sidestep_msgs::{Robot, Twist};
use sidestep_policy::{ModelError, Policy, embedded};
use sidestep_report::Spread;
use sidestep_train::{Mixture, Record, WINDOWS_S, within_window};
use std::path::PathBuf;

/// Frames of Fig. 6b.
const GAP_SAMPLES: usize = 4000;
/// Frames whose commands are judged by their cost.
const REGRET_SAMPLES: usize = 1000;

/// Frames of the oracle, which takes its time.
const ORACLE_SAMPLES: usize = 200;

/// What to evaluate.
#[derive(Debug, Clone)]
pub struct EvaluateOptions {
    /// Model file; `None` for the model in the binary.
    pub model: Option<PathBuf>,
    /// Datasets that the model was trained on, if they are there: for the error in training and the random split.
    pub training: Vec<PathBuf>,
    /// Datasets of other worlds.
    pub held_out: Vec<PathBuf>,
    /// Datasets of worlds of other origin, such as BARN: for the doubt.
    pub foreign: Vec<PathBuf>,
    /// Records to use of each split.
    pub samples: u64,
    /// Robot.
    pub robot: Robot,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Fingerprint of the model file.
    pub model_hash: u64,
    /// What the model says of its training: samples seen, hash of its datasets.
    pub trained: (u64, u64),
    /// Sets by name: `random.train`, `random.test`, `by_world.test`, `foreign.test`.
    pub tables: Vec<(&'static str, SetTable)>,
    /// Fig. 3.
    pub cases: Vec<Case>,
    /// Fig. 5: absolute errors (window 0.1 s, solved label), by name and unit.
    pub spreads: Vec<(String, Spread)>,
    /// Fig. 6a.
    pub timing: Timing,
    /// Fig. 6b: the model's gap.
    pub gap: Gap,
    /// Fig. 6b: that of sets of candidates.
    pub curves: Vec<Curve>,
    /// Fig. 6b: how many candidates the model equals.
    pub equals: Equals,
    /// J of emitted commands above the solved plan: model, refined, 734 candidates.
    pub regrets: [Regrets; 3],
    /// How far solved plans are from the optimum with free knots.
    pub oracle: Oracle,
    /// The doubt on held-out worlds, and on foreign ones.
    pub doubts: Vec<(&'static str, Doubt)>,
}

/// Measures everything; `progress` gets a line now and then.
///
/// # Errors
/// [`EvaluateError`] where data or model do not fit.
pub fn evaluate(
    options: &EvaluateOptions,
    progress: &mut dyn FnMut(&str),
) -> Result<Evaluation, EvaluateError> {
    if options.held_out.is_empty() {
        return Err(EvaluateError::NoData);
    }
    let name = options.model.as_ref().map_or("embedded".into(), |path| path.display().to_string());
    let onnx = match &options.model {
        None => embedded().to_vec(),
        Some(path) => std::fs::read(path)
            .map_err(|source| ModelError::Read { model: name.clone(), detail: source.to_string() })?,
    };
    let robot = &options.robot;
    let mut policy = Policy::load(&onnx, &name, robot)?;
    let mut sets: Vec<(&'static str, Vec<Answered>)> = Vec::new();
    for (set, paths, split) in [
        ("random.train", &options.training, Split::Trained),
        ("random.test", &options.training, Split::HeldOut),
        ("by_world.test", &options.held_out, Split::All),
        ("foreign.test", &options.foreign, Split::All),
    ] {
        if !paths.is_empty() {
            progress(&format!("evaluate: {set}"));
            sets.push((set, ask(&mut policy, &Mixture::open(paths, robot)?, split, options.samples)?));
        }
    }
    let of = |wanted: &str| sets.iter().find(|set| set.0 == wanted).map_or(&[][..], |set| &set.1[..]);
    let test = of("by_world.test");
    progress("evaluate: gaps");
    let Gaps { policy: gap, curves, equals } = gaps(&test[..test.len().min(GAP_SAMPLES)], &robot.limits);
    progress("evaluate: regrets and times");
    let doubted = sets.iter().filter(|set| set.0 != "random.train" && set.0 != "random.test");
    Ok(Evaluation {
        model_hash: policy.model_hash(),
        trained: (policy.contract().samples_seen, policy.contract().dataset_hash),
        tables: sets.iter().map(|(set, answers)| (*set, set_table(answers, &robot.limits))).collect(),
        cases: cases(test, robot),
        spreads: spreads(&sets, robot),
        timing: timing(test, &onnx, &name, robot)?,
        gap,
        curves,
        equals,
        regrets: regrets(&test[..test.len().min(REGRET_SAMPLES)], &robot.limits),
        oracle: oracle(
            &solved(&test[..test.len().min(ORACLE_SAMPLES)], robot),
            &robot.limits,
            &Weights::STANDARD,
        ),
        doubts: doubted.map(|(set, answers)| (*set, doubt(answers, &robot.limits))).collect(),
    })
}

/// Frames with their solved plans.
fn solved(answers: &[Answered], robot: &Robot) -> Vec<(Record, Plan)> {
    let mut planner = Planner::new(&robot.limits, &Weights::STANDARD, 734);
    let solve = |answer: &Answered| {
        let record = answer.record;
        let cell = usize::from(record.goal_cell);
        (record, planner.plan(&record.planning_cost, cell, record.twist(), Mode::Solved))
    };
    answers.iter().map(solve).collect()
}

/// Absolute errors of v and w in training and on other worlds.
fn spreads(sets: &[(&'static str, Vec<Answered>)], robot: &Robot) -> Vec<(String, Spread)> {
    let mut spreads = Vec::new();
    for (set, name) in [("random.train", "train"), ("by_world.test", "test")] {
        let Some((_, answers)) = sets.iter().find(|candidate| candidate.0 == set) else { continue };
        for (axis, unit) in ["v [m/s]", "w [rad/s]"].into_iter().enumerate() {
            let errors = answers.iter().map(|answer| {
                let within =
                    |twist: Twist| within_window(twist, answer.record.twist(), &robot.limits, WINDOWS_S[0]);
                let (a, b) = (within(answer.wish), within(answer.solved()));
                f64::from([a.v_m_s - b.v_m_s, a.w_rad_s - b.w_rad_s][axis].abs())
            });
            spreads.extend(Spread::of(errors).map(|spread| (format!("{name} {unit}"), spread)));
        }
    }
    spreads
}

impl Evaluation {
    /// A set by name.
    #[must_use]
    pub fn table(&self, name: &str) -> Option<&SetTable> {
        self.tables.iter().find(|set| set.0 == name).map(|set| &set.1)
    }

    /// All numbers.
    #[must_use]
    pub fn json(&self) -> Value {
        let mut table1 = json!({});
        for (name, set) in &self.tables {
            if let Some((split, part)) = name.split_once('.') {
                table1[split][part] = set_json(set);
            }
        }
        let doubts: serde_json::Map<String, Value> =
            self.doubts.iter().map(|(name, doubt)| ((*name).into(), json!(doubt))).collect();
        json!({
            "model_hash": format!("{:016x}", self.model_hash),
            "samples_seen": self.trained.0,
            "dataset_hash": format!("{:016x}", self.trained.1),
            "table1": table1,
            "fig3": self.cases,
            "fig6a": { "us": self.timing },
            "fig6b": {
                "equals_candidates": self.equals, "policy": self.gap, "curves": self.curves,
                "regret": {
                    "policy": self.regrets[0], "refined": self.regrets[1], "candidates_734": self.regrets[2],
                },
            },
            "oracle": self.oracle,
            "doubt": doubts,
        })
    }
}

fn set_json(set: &SetTable) -> Value {
    let windows = |labels: &crate::table1::Labels| -> Value {
        labels.windows.iter().map(|window| (format!("{}", window.window_s), json!(window))).collect()
    };
    json!({
        "samples": set.samples, "artificial": set.artificial, "label_noise": set.label_noise,
        "by_source": set.by_source, "734": windows(&set.plain), "solved": windows(&set.solved),
    })
}

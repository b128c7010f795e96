//! Fig. 6a: how long one answer takes, by number of candidates, and the model beside it, all measured in one run.

use crate::answers::Answered;
use serde::Serialize;
use sidestep_bus::host_ns;
use sidestep_expert::{Mode, Planner, Weights};
use sidestep_msgs::Robot;
use sidestep_policy::{ModelError, Policy};
use std::process::Command;

/// Sizes of the sets; the last but two is the demonstrator's.
const COUNTS: [usize; 9] = [50, 100, 150, 200, 250, 300, 734, 2000, 10_000];
/// Answers of which the median is taken.
const ROUNDS: usize = 300;
/// Answers of plain tract, which takes milliseconds.
const PLAIN_ROUNDS: usize = 20;

/// Median times of one answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Candidates and `[us]`.
    pub candidates: Vec<(usize, f64)>,
    /// `[us]` a solved plan.
    pub solved_us: f64,
    /// `[us]` the model's proposal, refined; the model's own time not counted.
    pub refined_us: f64,
    /// `[us]` the model as it is deployed.
    pub policy_us: f64,
    /// `[us]` the same file in plain tract.
    pub plain_tract_us: f64,
    /// `[us]` the same file in onnxruntime, where the Python that `SIDESTEP_PYTHON` names has it.
    pub onnxruntime_us: Option<f64>,
}

pub(crate) fn timing(
    answers: &[Answered],
    onnx: &[u8],
    name: &str,
    robot: &Robot,
) -> Result<Timing, ModelError> {
    let plan = |count: usize, mode: &dyn Fn(&Answered) -> Mode| {
        let mut planner = Planner::new(&robot.limits, &Weights::STANDARD, count);
        median_us(answers, ROUNDS, |answer| {
            let record = &answer.record;
            let cell = usize::from(record.goal_cell);
            planner.plan(&record.planning_cost, cell, record.twist(), mode(answer)).cost
        })
    };
    let infer = |mut policy: Policy, rounds| {
        median_us(answers, rounds, |answer| {
            let record = &answer.record;
            let cell = usize::from(record.goal_cell);
            policy.infer(&record.planning_cost, cell, record.twist()).map_or(0.0, |answer| answer.doubt[0])
        })
    };
    Ok(Timing {
        candidates: COUNTS.iter().map(|count| (*count, plan(*count, &|_| Mode::Plain))).collect(),
        solved_us: plan(734, &|_| Mode::Solved),
        refined_us: plan(734, &|answer| Mode::Refined(answer.wish)),
        policy_us: infer(Policy::load(onnx, name, robot)?, ROUNDS),
        plain_tract_us: infer(Policy::load_plain(onnx, name, robot)?, PLAIN_ROUNDS),
        onnxruntime_us: onnxruntime_us(onnx),
    })
}

/// The peer's own measurement of the same file.
fn onnxruntime_us(onnx: &[u8]) -> Option<f64> {
    let python = std::env::var_os("SIDESTEP_PYTHON").unwrap_or_else(|| "python3".into());
    let file = std::env::temp_dir().join(format!("sidestep-evaluate-{}.onnx", std::process::id()));
    std::fs::write(&file, onnx).ok()?;
    let script = include_str!("onnxruntime.py");
    let output = Command::new(python).args(["-c", script]).arg(&file).output();
    let _ = std::fs::remove_file(&file);
    String::from_utf8(output.ok()?.stdout).ok()?.trim().parse().ok()
}

/// `[us]` median time of an answer.
fn median_us(answers: &[Answered], rounds: usize, mut ask: impl FnMut(&Answered) -> f32) -> f64 {
    let mut times: Vec<u64> = answers
        .iter()
        .cycle()
        .take(rounds + 5)
        .map(|answer| {
            let begin = host_ns();
            std::hint::black_box(ask(answer));
            host_ns() - begin
        })
        .skip(5)
        .collect();
    times.sort_unstable();
    times.get(times.len() / 2).map_or(0.0, |time| *time as f64 * 1e-3)
}

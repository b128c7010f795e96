//! Fig. 3: single frames by size of their error, and one with the goal behind, drawn.

use crate::answers::Answered;
use serde::Serialize;
use sidestep_expert::Judge;
use sidestep_expert::Weights;
use sidestep_msgs::{LOCAL_CELLS, Limits, Robot, Twist};
use sidestep_train::{PARTLY_UNKNOWN, WINDOWS_S, within_window};

/// One frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// What it stands for.
    pub name: String,
    /// Norm of the error over (v, w) in SI units, window 0.1 s, solved label.
    pub error: f64,
    /// `[1/255]` planning cost.
    #[serde(skip)]
    pub cost: Box<[u8; LOCAL_CELLS]>,
    /// Whether parts of the map are unknown.
    pub partly_unknown: bool,
    /// Cell of the goal.
    pub goal_cell: u16,
    /// u', v `[m/s]` and w `[rad/s]`.
    pub velocity: [f32; 2],
    /// What the model wishes.
    pub policy: [f32; 2],
    /// The best of 734 candidates.
    pub plain: [f32; 2],
    /// The solved plan.
    pub solved: [f32; 2],
    /// `[m]` the way of the solved plan.
    pub way_m: Vec<(f64, f64)>,
}

/// The cases of the paper's figure: error at the median, the 95th and the 99.9th percentile, goal behind.
pub(crate) fn cases(answers: &[Answered], robot: &Robot) -> Vec<Case> {
    let limits = &robot.limits;
    let mut order: Vec<(f64, &Answered)> =
        answers.iter().map(|answer| (error(answer, limits), answer)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut behind: Vec<(f64, &Answered)> =
        order.iter().filter(|(_, answer)| answer.record.goal_x_m < -0.5).copied().collect();
    behind.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |sorted: &[(f64, &Answered)], part: f64, name: &str| {
        let index = (part * sorted.len().saturating_sub(1) as f64) as usize;
        sorted.get(index).map(|(error, answer)| case(name, *error, answer, robot))
    };
    [
        at(&order, 0.5, "median error"),
        at(&order, 0.95, "95 of 100 are better"),
        at(&order, 0.999, "999 of 1000 are better"),
        at(&behind, 0.9, "goal behind, 9 of 10 are better"),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn error(answer: &Answered, limits: &Limits) -> f64 {
    let within = |twist: Twist| within_window(twist, answer.record.twist(), limits, WINDOWS_S[0]);
    let (a, b) = (within(answer.wish), within(answer.solved()));
    libm::hypot(f64::from(a.v_m_s - b.v_m_s), f64::from(a.w_rad_s - b.w_rad_s))
}

fn case(name: &str, error: f64, answer: &Answered, robot: &Robot) -> Case {
    let record = &answer.record;
    let mut judge = Judge::new(&robot.limits, &Weights::STANDARD, 734);
    let plan = judge.solve(&record.planning_cost, usize::from(record.goal_cell), record.twist());
    let way = judge.trajectory(&plan).map(|pose| (pose.x_m, pose.y_m));
    Case {
        name: name.into(),
        error,
        cost: Box::new(record.planning_cost),
        partly_unknown: record.kind & PARTLY_UNKNOWN != 0,
        goal_cell: record.goal_cell,
        velocity: record.velocity,
        policy: [answer.wish.v_m_s, answer.wish.w_rad_s],
        plain: record.label_734,
        solved: record.label_solved,
        way_m: std::iter::once((0.0, 0.0)).chain(way).collect(),
    }
}

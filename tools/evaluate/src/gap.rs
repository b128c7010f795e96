//! Fig. 6b: the optimality gap of the model beside that of planners with fewer or more candidates.
//!
//! The gap is the mean distance of two emitted commands, as the paper has it: against the 734-candidate demonstrator, and
//! against the solved optimum. Beside it stands what the distance costs: J of the best plan that begins with the emitted
//! command, above that of the best plan of all.

use crate::answers::Answered;
use serde::Serialize;
use sidestep_expert::{Effort, Judge, Mode, Planner, Weights, arc_numbers};
use sidestep_msgs::{Limits, Twist, clamp_to_window};
use sidestep_train::{WINDOWS_S, within_window};

/// Sizes of the sets.
const COUNTS: [usize; 16] =
    [50, 75, 100, 150, 200, 250, 300, 400, 500, 734, 1000, 1500, 2000, 3000, 5000, 10_000];
/// Where the independent subsets begin in the endless sequence: beyond every nested one.
const APART: usize = 20_000;

/// Mean distance of emitted commands to two baselines, by window of [`WINDOWS_S`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Gap {
    /// To the 734-candidate demonstrator, norm over (v, w) in SI units.
    pub demonstrator: [f64; 2],
    /// To the solved optimum.
    pub solved: [f64; 2],
    /// The same two as mean squared norm.
    pub demonstrator_squared: [f64; 2],
    /// To the solved optimum, squared.
    pub solved_squared: [f64; 2],
}

/// A family of sets of candidates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// What the sets are: the first ones, others than those, arcs only.
    pub name: String,
    /// Candidates and their gap.
    pub points: Vec<(usize, Gap)>,
}

/// How many candidates are as near as the model; `None` beyond the largest set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Equals {
    /// To the 734-candidate demonstrator, of its own first candidates (sets smaller than 734), by window.
    pub demonstrator: [Option<f64>; 2],
    /// To the 734-candidate demonstrator, of candidates that it does not hold.
    pub demonstrator_apart: [Option<f64>; 2],
    /// To the solved optimum, of first candidates.
    pub solved: [Option<f64>; 2],
}

/// J of the emitted command above the solved plan's: mean, and 90 and 99 of 100.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Regrets {
    /// `[1]` mean.
    pub mean: f64,
    /// `[1]` nine of ten are at most this.
    pub p90: f64,
    /// `[1]` 99 of 100 are at most this.
    pub p99: f64,
}

/// A name and the candidates of a set by its size.
type Family<'a> = (&'a str, &'a dyn Fn(usize) -> Vec<usize>);

/// The gap of the model, and the curves of the sets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Gaps {
    pub(crate) policy: Gap,
    pub(crate) curves: Vec<Curve>,
    pub(crate) equals: Equals,
}

pub(crate) fn gaps(answers: &[Answered], limits: &Limits) -> Gaps {
    let policy = gap(answers, limits, |answer| answer.wish);
    let arcs = arc_numbers(10_000);
    let families: [Family<'_>; 3] = [
        ("first candidates", &|count| (0..count).collect()),
        ("other candidates", &|count| (APART..APART + count).collect()),
        ("arcs only", &|count| arcs[..count].to_vec()),
    ];
    let curves: Vec<Curve> = families
        .iter()
        .map(|(name, numbers)| Curve {
            name: (*name).into(),
            points: COUNTS.iter().map(|count| (*count, of_set(answers, limits, &numbers(*count)))).collect(),
        })
        .collect();
    let equals = equals(&policy, [&curves[0], &curves[1]]);
    Gaps { policy, curves, equals }
}

fn of_set(answers: &[Answered], limits: &Limits, numbers: &[usize]) -> Gap {
    let mut planner = Planner::choosing_from(limits, &Weights::STANDARD, numbers);
    gap(answers, limits, |answer| {
        let record = &answer.record;
        let cell = usize::from(record.goal_cell);
        planner.plan(&record.planning_cost, cell, record.twist(), Mode::Plain).twist
    })
}

fn gap(answers: &[Answered], limits: &Limits, mut command: impl FnMut(&Answered) -> Twist) -> Gap {
    let mut sums = Gap::default();
    let part = 1.0 / answers.len().max(1) as f64;
    for answer in answers {
        let command = command(answer);
        for (index, window) in WINDOWS_S.iter().enumerate() {
            let within = |twist| within_window(twist, answer.record.twist(), limits, *window);
            let square = |label: Twist| {
                let (a, b) = (within(command), within(label));
                let (v, w) = (f64::from(a.v_m_s - b.v_m_s), f64::from(a.w_rad_s - b.w_rad_s));
                v * v + w * w
            };
            let (plain, solved) = (square(answer.plain()), square(answer.solved()));
            sums.demonstrator[index] += part * plain.sqrt();
            sums.demonstrator_squared[index] += part * plain;
            sums.solved[index] += part * solved.sqrt();
            sums.solved_squared[index] += part * solved;
        }
    }
    sums
}

fn equals(policy: &Gap, [nested, apart]: [&Curve; 2]) -> Equals {
    let find = |curve: &Curve, most: usize, own: f64, of: &dyn Fn(&Gap) -> f64| {
        let points: Vec<(f64, f64)> = curve
            .points
            .iter()
            .filter(|(count, _)| *count <= most)
            .map(|(count, gap)| (*count as f64, of(gap)))
            .collect();
        crossing(&points, own)
    };
    Equals {
        demonstrator: [0, 1].map(|w| find(nested, 734, policy.demonstrator[w], &|gap| gap.demonstrator[w])),
        demonstrator_apart: [0, 1]
            .map(|w| find(apart, usize::MAX, policy.demonstrator[w], &|gap| gap.demonstrator[w])),
        solved: [0, 1].map(|w| find(nested, usize::MAX, policy.solved[w], &|gap| gap.solved[w])),
    }
}

/// Where a falling curve reaches a value, between points on a logarithmic axis; its beginning where it starts lower.
fn crossing(points: &[(f64, f64)], value: f64) -> Option<f64> {
    let first = points.first()?;
    if first.1 <= value {
        return Some(first.0);
    }
    points.windows(2).find(|pair| pair[1].1 <= value).map(|pair| {
        let ((from, high), (to, low)) = (pair[0], pair[1]);
        let part = (high - value) / (high - low).max(1e-12);
        from * libm::pow(to / from, part)
    })
}

/// What emitted commands cost above the solved plan: of the model, of the refined model, of 734 candidates.
pub(crate) fn regrets(answers: &[Answered], limits: &Limits) -> [Regrets; 3] {
    // As long as the labels were searched for, whose cost is one of those compared.
    let mut judge = Judge::searching(limits, &Weights::STANDARD, 734, Effort::LABEL);
    let mut planner = Planner::new(limits, &Weights::STANDARD, 734);
    let mut all = [const { Vec::new() }; 3];
    for answer in answers {
        let record = &answer.record;
        let (cost, cell, from) = (&record.planning_cost, usize::from(record.goal_cell), record.twist());
        let emitted = clamp_to_window(answer.wish, from, limits);
        let refined = planner.plan(cost, cell, from, Mode::Refined(emitted)).twist;
        let best = judge.solve(cost, cell, from).cost.min(record.cost_solved);
        for (costs, wish) in all.iter_mut().zip([answer.wish, refined, answer.plain()]) {
            let emitted = clamp_to_window(wish, from, limits);
            costs.push(f64::from(judge.judge(cost, cell, from, emitted).cost - best));
        }
    }
    all.map(|mut costs: Vec<f64>| {
        costs.sort_by(f64::total_cmp);
        let at = |part: f64| {
            costs.get((part * costs.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0)
        };
        Regrets { mean: costs.iter().sum::<f64>() / costs.len().max(1) as f64, p90: at(0.9), p99: at(0.99) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_crossed_between_its_points_or_not_at_all() {
        let points = [(50.0, 1.0), (100.0, 0.5), (200.0, 0.25)];
        assert_eq!(crossing(&points, 2.0), Some(50.0));
        assert!((crossing(&points, 0.5).unwrap() - 100.0).abs() < 1e-9);
        assert!((crossing(&points, 0.375).unwrap() - 141.4).abs() < 0.1);
        assert_eq!(crossing(&points, 0.1), None);
    }
}

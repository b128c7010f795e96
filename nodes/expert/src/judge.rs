//! What a proposal is worth, whoever made it: so that policy and expert are measured by one rule.

use crate::candidates::PIECES;
use crate::config::Weights;
use crate::planner::{Effort, Plan, Planner};
use crate::problem::HORIZON_STEPS;
use crate::refinement::Range;
use crate::rollout::Group;
use sidestep_msgs::{LOCAL_CELLS, Limits, Pose2, Twist, WINDOW_S};

/// Part of the window within which a proposal counts as lying on its edge.
const EDGE: f32 = 1e-3;

/// Judges proposals by eq. (6).
///
/// A proposal is one velocity, clamped to what can be reached within [`WINDOW_S`] from u'. Many plans begin with it:
/// their first piece is that velocity or, where it lies on the edge of the window, anything beyond the edge. Its cost is
/// the least J of eq. (6) of all of them, found as a solved plan is.
#[derive(Debug, Clone)]
pub struct Judge {
    planner: Planner,
    candidates: Vec<Group>,
    limits: Limits,
}

impl Judge {
    /// A judge with this many candidates for a robot, who searches as long as a live plan.
    #[must_use]
    pub fn new(limits: &Limits, weights: &Weights, candidates: usize) -> Self {
        Self::searching(limits, weights, candidates, Effort::LIVE)
    }

    /// As [`Judge::new`], with an effort of the caller's choice.
    #[must_use]
    pub fn searching(limits: &Limits, weights: &Weights, candidates: usize, effort: Effort) -> Self {
        let planner = Planner::searching(limits, weights, candidates, effort);
        Self { candidates: planner.groups().to_vec(), planner, limits: *limits }
    }

    /// The best plan that begins with a proposal; a proposal that is not finite counts as standing still.
    pub fn judge(
        &mut self,
        cost: &[u8; LOCAL_CELLS],
        goal_cell: usize,
        from: Twist,
        proposal: Twist,
    ) -> Plan {
        let problem = self.planner.problem();
        problem.pose(cost, goal_cell, from);
        let wanted = if proposal.is_finite() { problem.turned(proposal) } else { Twist::STOP };
        let range = beginning(wanted, problem.from, &self.limits);
        self.planner.solve_within(&self.candidates, &range)
    }

    /// The best plan of all, whatever it begins with.
    pub fn solve(&mut self, cost: &[u8; LOCAL_CELLS], goal_cell: usize, from: Twist) -> Plan {
        self.planner.problem().pose(cost, goal_cell, from);
        self.planner.solve_within(&self.candidates, &Range::whole(&self.limits))
    }

    /// The poses of the last plan in `base`, one per 0.1 s, the first at 0.1 s.
    #[must_use]
    pub fn trajectory(&self, plan: &Plan) -> [Pose2; HORIZON_STEPS] {
        self.planner.trajectory(plan)
    }
}

/// The plans that propose `wanted` from `from`.
fn beginning(wanted: Twist, from: Twist, limits: &Limits) -> Range {
    let whole = Range::whole(limits);
    let axis = |wanted: f32, from: f32, reach: f32, low: f32, high: f32| {
        if wanted <= from - reach * (1.0 - EDGE) {
            (low.min(wanted), wanted)
        } else if wanted >= from + reach * (1.0 - EDGE) {
            (wanted, high.max(wanted))
        } else {
            (wanted, wanted)
        }
    };
    let (dv, dw) = (limits.accelerate_m_s2 * WINDOW_S, limits.turn_accelerate_rad_s2 * WINDOW_S);
    let v = axis(wanted.v_m_s, from.v_m_s, dv, 0.0, limits.forward_m_s);
    let w = axis(wanted.w_rad_s, from.w_rad_s, dw, -limits.turn_rad_s, limits.turn_rad_s);
    let (mut low, mut high) = ([whole.low[0]; PIECES], [whole.high[0]; PIECES]);
    (low[0], high[0]) = (Twist::new(v.0, w.0), Twist::new(v.1, w.1));
    Range { low, high }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::Mode;
    use crate::samples::{LOOMO, Sample};
    use sidestep_msgs::clamp_to_window;

    fn samples() -> impl Iterator<Item = Sample> {
        (0..200).map(|number| Sample::artificial(5000 + number))
    }

    fn judge() -> Judge {
        Judge::new(&LOOMO, &Weights::STANDARD, 734)
    }

    fn solved(sample: &Sample) -> Plan {
        let mut planner = Planner::new(&LOOMO, &Weights::STANDARD, 734);
        planner.plan(&sample.cost, sample.goal, sample.from, Mode::Solved)
    }

    /// Costs of 200 proposals above those of the solved plans, sorted; the search finds local minima, so a few lie below.
    fn regrets(propose: impl Fn(&Plan) -> Twist) -> Vec<f32> {
        let mut judge = judge();
        let mut regrets: Vec<f32> = samples()
            .map(|sample| {
                let best = solved(&sample);
                let proposal = clamp_to_window(propose(&best), sample.from, &LOOMO);
                judge.judge(&sample.cost, sample.goal, sample.from, proposal).cost - best.cost
            })
            .collect();
        regrets.sort_by(f32::total_cmp);
        regrets
    }

    /// The solved plan is one of those that begin with its own proposal.
    #[test]
    fn the_proposal_of_a_solved_plan_costs_what_the_plan_costs() {
        let regrets = regrets(|best| best.twist);
        let mean = regrets.iter().map(|regret| regret.abs()).sum::<f32>() / 200.0;
        assert!(mean < 0.03 && regrets[100].abs() < 1e-3, "mean {mean}, median {}", regrets[100]);
        assert!(regrets[20] > -0.05 && regrets[180] < 0.05, "{} {}", regrets[20], regrets[180]);
    }

    #[test]
    fn a_judge_solves_as_a_planner_does_whatever_it_judged_before() {
        let mut judge = judge();
        for sample in samples() {
            judge.judge(&sample.cost, sample.goal, sample.from, Twist::new(0.1, 0.5));
            assert_eq!(judge.solve(&sample.cost, sample.goal, sample.from), solved(&sample));
        }
    }

    #[test]
    fn another_proposal_costs_more() {
        let regrets = regrets(|_| Twist::new(0.2, -1.0));
        let mean = regrets.iter().sum::<f32>() / 200.0;
        assert!(mean > 1.0 && regrets[100] > 0.3, "mean {mean}, median {}", regrets[100]);
        assert!(regrets[20] > -0.05, "{}", regrets[20]);
    }

    #[test]
    fn a_plan_begins_with_what_it_is_judged_for() {
        let mut judge = judge();
        for sample in samples() {
            let proposal = clamp_to_window(Twist::new(0.6, 0.4), sample.from, &LOOMO);
            let plan = judge.judge(&sample.cost, sample.goal, sample.from, proposal);
            let begins = clamp_to_window(plan.twist, sample.from, &LOOMO);
            let gap = (begins.v_m_s - proposal.v_m_s).abs().max((begins.w_rad_s - proposal.w_rad_s).abs());
            assert!(gap < 2e-3, "{begins:?} {proposal:?}");
        }
    }

    #[test]
    fn a_mirrored_proposal_costs_the_same() {
        let mut judge = judge();
        for sample in samples() {
            let proposal = clamp_to_window(Twist::new(0.5, 0.9), sample.from, &LOOMO);
            let plain = judge.judge(&sample.cost, sample.goal, sample.from, proposal);
            let other = sample.mirrored();
            let mirrored = judge.judge(&other.cost, other.goal, other.from, proposal.mirrored());
            assert_eq!(plain.cost.to_bits(), mirrored.cost.to_bits());
        }
    }

    #[test]
    fn garbage_is_judged_as_standing_still() {
        let sample = Sample::artificial(1);
        let mut judge = judge();
        let garbage = judge.judge(&sample.cost, sample.goal, Twist::STOP, Twist::new(f32::NAN, 0.0));
        let stop = judge.judge(&sample.cost, sample.goal, Twist::STOP, Twist::STOP);
        assert_eq!(garbage, stop);
    }
}

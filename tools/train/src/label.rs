//! What the expert would do about a frame: the two labels of every record, made at one place.

use crate::record::Record;
use sidestep_expert::{Config, Effort, Mode, Planner, Weights};
use sidestep_msgs::Robot;

/// The expert that labels, with more time than one that drives; one per thread.
#[derive(Debug, Clone)]
pub(crate) struct Labeller(Planner);

impl Labeller {
    pub(crate) fn new(robot: &Robot) -> Self {
        let candidates = Config::STANDARD.candidates;
        Self(Planner::searching(&robot.limits, &Weights::STANDARD, candidates, Effort::LABEL))
    }

    /// Writes both labels and their costs.
    pub(crate) fn label(&mut self, record: &mut Record) {
        let (cell, from) = (usize::from(record.goal_cell), record.twist());
        let plain = self.0.plan(&record.planning_cost, cell, from, Mode::Plain);
        let solved = self.0.plan(&record.planning_cost, cell, from, Mode::Solved);
        record.label_734 = [plain.twist.v_m_s, plain.twist.w_rad_s];
        record.cost_734 = plain.cost;
        record.label_solved = [solved.twist.v_m_s, solved.twist.w_rad_s];
        record.cost_solved = solved.cost;
    }
}

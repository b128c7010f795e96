//! From the messages of one frame to a proposal.

use crate::config::{Config, ConfigError, Lead};
use crate::planner::{Mode, Plan, Planner};
use crate::problem::HORIZON_STEPS;
use sidestep_msgs::{
    LOCAL_CELLS, Limits, LocalGoal, LocalMap, Pose2, Proposal, Robot, Status, TRAJECTORY_MAX, Twist,
    clamp_to_window,
};

const _: () = assert!(HORIZON_STEPS <= TRAJECTORY_MAX);

/// The pure half of the node.
#[derive(Debug, Clone)]
pub struct Expert {
    planner: Planner,
    limits: Limits,
    config: Config,
}

impl Expert {
    /// Makes the candidates; the only call that allocates.
    ///
    /// # Errors
    /// A value of the configuration out of range.
    pub fn new(config: &Config, robot: &Robot) -> Result<Self, ConfigError> {
        config.check()?;
        let planner = Planner::new(&robot.limits, &config.weights, config.candidates);
        Ok(Self { planner, limits: robot.limits, config: *config })
    }

    /// Answers one frame. `seed` is the policy's proposal for it, used when refining; without it the plan is plain.
    ///
    /// A goal that is not there (arrived, none, hold, lost, no map) passes its status on with standing still.
    /// [`Status::Infeasible`] with standing still where nothing admissible is left, [`Status::Fault`] for input that
    /// cannot be.
    pub fn plan(
        &mut self,
        map: &LocalMap,
        goal: &LocalGoal,
        goal_status: Status,
        seed: Option<Twist>,
        out: &mut Proposal,
    ) -> Status {
        *out = Proposal {
            capture_ns: goal.capture_ns,
            doubt_v_m_s: f32::NAN,
            doubt_w_rad_s: f32::NAN,
            cost: f32::NAN,
            ..Proposal::default()
        };
        if goal_status != Status::Ok {
            return goal_status;
        }
        let cell = goal.cell as usize;
        if !goal.twist.is_finite() || cell >= LOCAL_CELLS {
            return Status::Fault;
        }
        let mode = match (self.config.mode, seed) {
            (Lead::Solved, _) => Mode::Solved,
            (Lead::Refined, Some(seed)) if seed.is_finite() => Mode::Refined(seed),
            _ => Mode::Plain,
        };
        let plan = self.planner.plan(&map.planning_cost, cell, goal.twist, mode);
        out.evaluated = plan.evaluated;
        match self.admissible(plan, map, goal) {
            Some(plan) => {
                self.write(&plan, goal.twist, out);
                Status::Ok
            }
            None => Status::Infeasible,
        }
    }

    /// The plan itself where it keeps the limit, else the best candidate that does.
    fn admissible(&mut self, plan: Plan, map: &LocalMap, goal: &LocalGoal) -> Option<Plan> {
        let limit = self.config.weights.limit;
        if plan.is_admissible(limit) {
            return Some(plan);
        }
        if self.config.mode == Lead::Refined {
            let plain = self.planner.plan(&map.planning_cost, goal.cell as usize, goal.twist, Mode::Plain);
            if plain.is_admissible(limit) {
                return Some(plain);
            }
        }
        self.planner.best_admissible()
    }

    fn write(&self, plan: &Plan, from: Twist, out: &mut Proposal) {
        out.twist = clamp_to_window(plan.twist, from, &self.limits);
        out.cost = plan.cost;
        out.trajectory_count = HORIZON_STEPS as u32;
        let poses: [Pose2; HORIZON_STEPS] = self.planner.trajectory(plan);
        for (index, pose) in poses.iter().enumerate() {
            out.trajectory_x_m[index] = pose.x_m as f32;
            out.trajectory_y_m[index] = pose.y_m as f32;
            out.trajectory_yaw_rad[index] = pose.yaw_rad as f32;
        }
    }
}

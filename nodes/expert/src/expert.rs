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
            // Only a plain plan looks at every candidate.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Sample;
    use sidestep_msgs::LOCAL_GRID;

    fn robot() -> Robot {
        Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
    }

    fn expert(mode: Lead) -> Expert {
        Expert::new(&Config { mode, ..Config::STANDARD }, &robot()).unwrap()
    }

    fn frame(sample: &Sample) -> (LocalMap, LocalGoal) {
        let map = LocalMap { planning_cost: sample.cost, ..LocalMap::default() };
        let goal =
            LocalGoal { capture_ns: 7, cell: sample.goal as u32, twist: sample.from, ..LocalGoal::default() };
        (map, goal)
    }

    #[test]
    fn a_proposal_lies_in_the_window_and_shows_its_trajectory() {
        let limits = robot().limits;
        for mode in [Lead::Plain, Lead::Solved, Lead::Refined] {
            let mut expert = expert(mode);
            for seed in 0..50 {
                let (map, goal) = frame(&Sample::artificial(seed));
                let mut out = Proposal::default();
                let status = expert.plan(&map, &goal, Status::Ok, Some(Twist::new(0.3, 0.1)), &mut out);
                assert!(status == Status::Ok || status == Status::Infeasible, "{status:?}");
                assert_eq!(out.capture_ns, 7);
                assert!(
                    (out.twist.v_m_s - goal.twist.v_m_s).abs() <= 0.3 + 1e-6 || status == Status::Infeasible
                );
                assert!((0.0..=limits.forward_m_s).contains(&out.twist.v_m_s));
                if status == Status::Ok {
                    assert_eq!(out.trajectory_count, 24);
                    let first = (out.trajectory_x_m[0], goal.twist.v_m_s * 0.1);
                    assert!((first.0 - first.1).abs() < 0.02, "{first:?}");
                }
                assert!(out.doubt_v_m_s.is_nan() && out.evaluated > 0);
            }
        }
    }

    #[test]
    fn a_goal_that_is_not_there_passes_its_status_on_and_stands_still() {
        let (map, goal) = frame(&Sample::artificial(1));
        let mut expert = expert(Lead::Plain);
        for status in [Status::Arrived, Status::NoGoal, Status::Hold, Status::Lost, Status::NoMap] {
            let mut out = Proposal::default();
            assert_eq!(expert.plan(&map, &goal, status, None, &mut out), status);
            assert_eq!((out.twist, out.evaluated, out.trajectory_count), (Twist::STOP, 0, 0));
        }
    }

    /// Closed in by cost 1 from 0.2 m ahead at 1 m/s: braking takes 0.5 m, so nothing is admissible.
    #[test]
    fn too_fast_before_a_wall_is_infeasible_and_stops() {
        let (mut map, mut goal) = frame(&Sample::artificial(1));
        for (index, cell) in map.planning_cost.iter_mut().enumerate() {
            let (x_m, _) = LOCAL_GRID.centre(index / 28, index % 28);
            *cell = if x_m > 0.2 { 255 } else { 0 };
        }
        goal.twist = Twist::new(1.0, 0.0);
        for mode in [Lead::Plain, Lead::Solved, Lead::Refined] {
            let mut out = Proposal::default();
            let status = expert(mode).plan(&map, &goal, Status::Ok, Some(Twist::STOP), &mut out);
            assert_eq!((status, out.twist), (Status::Infeasible, Twist::STOP));
        }
    }

    /// A soft obstacle that eq. (6) would cross for its goal: the proposal goes round it or waits before it.
    #[test]
    fn a_plan_over_the_limit_gives_way_to_the_best_that_keeps_it() {
        let mut expert = expert(Lead::Plain);
        let (mut map, mut goal) = frame(&Sample::artificial(1));
        map.planning_cost = std::array::from_fn(|index| if matches!(index / 28, 12 | 13) { 132 } else { 0 });
        (goal.cell, goal.twist) = (13, Twist::new(1.0, 0.0));
        let plan = expert.planner.plan(&map.planning_cost, 13, goal.twist, Mode::Plain);
        let mut out = Proposal::default();
        let status = expert.plan(&map, &goal, Status::Ok, None, &mut out);
        assert!(!plan.is_admissible(0.4) && status == Status::Ok);
        assert!(out.trajectory_x_m[23] < 1.1 && out.cost >= plan.cost, "{plan:?} {out:?}");
    }

    #[test]
    fn garbage_is_a_fault() {
        let (map, mut goal) = frame(&Sample::artificial(1));
        let mut out = Proposal::default();
        goal.cell = u32::MAX;
        assert_eq!(expert(Lead::Plain).plan(&map, &goal, Status::Ok, None, &mut out), Status::Fault);
        (goal.cell, goal.twist) = (0, Twist::new(f32::NAN, 0.0));
        assert_eq!(expert(Lead::Solved).plan(&map, &goal, Status::Ok, None, &mut out), Status::Fault);
        assert_eq!(out.twist, Twist::STOP);
    }
}

//! Two proposals about one frame, and what is kept of them.

use crate::join::Frame;
use crate::picture::picture;
use serde::Serialize;
use sidestep_expert::{HORIZON_STEPS, Judge, Plan};
use sidestep_msgs::{AGE_NEVER, Command, LocalGoal, LocalMap, Pose2, Twist};
use sidestep_report::{Figure, ReportError};
use sidestep_train::{Demonstration, LARGE_V_M_S, LARGE_W_RAD_S};

/// By what frames count as bad.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rank {
    /// Cost of the first proposal above that of the second.
    #[default]
    Regret,
    /// Difference of the proposals, by the thresholds of agreement.
    Disagreement,
}

/// What is kept of every frame compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub(crate) time_s: f64,
    pub(crate) number: u64,
    /// First minus second.
    pub(crate) v_m_s: f32,
    pub(crate) w_rad_s: f32,
    /// `[m/s, rad/s]` the same within the narrowest window.
    pub(crate) near: [f32; 2],
    /// Costs of the best plans that begin with each.
    pub(crate) costs: [f32; 2],
    /// The least cost that is known: of the solved plan or of one of the two.
    pub(crate) optimum: f32,
    pub(crate) doubt: [f32; 2],
    pub(crate) x_m: f32,
    pub(crate) y_m: f32,
}

impl Point {
    /// `[1]` cost of the first above that of the second.
    pub(crate) fn regret(&self) -> f32 {
        self.costs[0] - self.costs[1]
    }

    /// `[1]` cost of the first (0) or the second (1) above the least that is known.
    pub(crate) fn gap(&self, side: usize) -> f32 {
        self.costs[side] - self.optimum
    }

    pub(crate) fn score(&self, rank: Rank) -> f32 {
        match rank {
            Rank::Regret => self.regret(),
            Rank::Disagreement => (self.v_m_s.abs() / LARGE_V_M_S).max(self.w_rad_s.abs() / LARGE_W_RAD_S),
        }
    }
}

/// Two proposals about one frame.
#[derive(Debug)]
pub(crate) struct Pair<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) map: &'a LocalMap,
    pub(crate) goal: &'a LocalGoal,
    pub(crate) twists: [Twist; 2],
    pub(crate) doubt: [f32; 2],
}

/// The plans that begin with the two proposals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judged {
    plans: [Plan; 2],
    optimum: f32,
    ways: [[Pose2; HORIZON_STEPS]; 2],
}

impl Pair<'_> {
    pub(crate) fn judged(&self, judge: &mut Judge) -> Judged {
        let mut one = |twist| {
            let cell = self.goal.cell as usize;
            let plan = judge.judge(&self.map.planning_cost, cell, self.goal.twist, twist);
            (plan, judge.trajectory(&plan))
        };
        let [(first, first_way), (second, second_way)] = self.twists.map(&mut one);
        let best = judge.solve(&self.map.planning_cost, self.goal.cell as usize, self.goal.twist);
        let optimum = best.cost.min(first.cost).min(second.cost);
        Judged { plans: [first, second], optimum, ways: [first_way, second_way] }
    }

    pub(crate) fn point(&self, judged: &Judged, near: [Twist; 2]) -> Point {
        Point {
            time_s: self.frame.time_s,
            number: self.frame.number,
            v_m_s: self.twists[0].v_m_s - self.twists[1].v_m_s,
            w_rad_s: self.twists[0].w_rad_s - self.twists[1].w_rad_s,
            near: [near[0].v_m_s - near[1].v_m_s, near[0].w_rad_s - near[1].w_rad_s],
            costs: judged.plans.map(|plan| plan.cost),
            optimum: judged.optimum,
            doubt: self.doubt,
            x_m: self.map.pose.x_m as f32,
            y_m: self.map.pose.y_m as f32,
        }
    }

    pub(crate) fn shown(&self, judged: &Judged, point: &Point) -> Shown {
        let way = |poses: &[Pose2; HORIZON_STEPS]| poses.iter().map(|pose| (pose.x_m, pose.y_m)).collect();
        Shown {
            time_s: point.time_s,
            frame: point.number,
            v_m_s: self.twists.map(|twist| twist.v_m_s),
            w_rad_s: self.twists.map(|twist| twist.w_rad_s),
            costs: point.costs,
            regret: point.regret(),
            from_v_m_s: self.goal.twist.v_m_s,
            from_w_rad_s: self.goal.twist.w_rad_s,
            goal_m: [self.goal.x_m, self.goal.y_m],
            map: *self.map,
            goal_cell_m: [self.goal.cell_x_m, self.goal.cell_y_m],
            ways: judged.ways.each_ref().map(way),
            command: self.frame.command,
        }
    }

    pub(crate) fn sample(&self) -> Demonstration {
        Demonstration {
            planning_cost: self.map.planning_cost,
            goal_cell: self.goal.cell as u16,
            goal_m: [self.goal.x_m, self.goal.y_m],
            velocity: self.goal.twist,
            partly_unknown: self.map.age.contains(&AGE_NEVER),
            frame: self.frame.number,
            run: self.frame.run,
        }
    }
}

/// A frame worth a picture.
#[derive(Debug, Clone, Serialize)]
pub struct Shown {
    /// `[s]` since the start.
    pub time_s: f64,
    /// Number of the depth frame.
    pub frame: u64,
    /// `[m/s]` of first and second.
    pub v_m_s: [f32; 2],
    /// `[rad/s]` of first and second.
    pub w_rad_s: [f32; 2],
    /// `[1]` J of first and second.
    pub costs: [f32; 2],
    /// `[1]` J of the first above that of the second.
    pub regret: f32,
    /// `[m/s]` u'.
    pub from_v_m_s: f32,
    /// `[rad/s]` u'.
    pub from_w_rad_s: f32,
    /// `[m]` the goal in `base`.
    pub goal_m: [f32; 2],
    #[serde(skip)]
    pub(crate) map: LocalMap,
    #[serde(skip)]
    pub(crate) goal_cell_m: [f32; 2],
    #[serde(skip)]
    pub(crate) ways: [Vec<(f64, f64)>; 2],
    #[serde(skip)]
    pub(crate) command: Option<Command>,
}

impl Shown {
    /// Map, goal, both proposals by name with the best plans that begin with them, and what the arbiter commanded.
    ///
    /// # Errors
    /// Where the picture cannot be made.
    pub fn figure(&self, footprint_m: &[[f32; 2]], names: [&str; 2]) -> Result<Figure, ReportError> {
        picture(self, footprint_m, names)
    }
}

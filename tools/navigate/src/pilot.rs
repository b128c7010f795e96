//! One drive through one course: who leads, with or without arbiter, and what came of it.

use crate::error::NavigateError;
use crate::room::Course;
use serde::Serialize;
use sidestep_drive::{Drive, Lead, Outcome, Setup, Sight};
use sidestep_expert::{Config, Judge, Weights};
use sidestep_msgs::{LOCAL_CELLS, Robot, Status, Twist, clamp_to_window};
use sidestep_policy::Policy;

/// Ticks of 10 ms between two judgements of the command: 0.5 s.
const JUDGED_TICKS: u64 = 50;
/// `[m/s]` and [rad/s] slower than this is standing.
const STANDING: f32 = 0.02;
/// Columns and rows of the rendered depth: half the camera's, which the mapper sees the floor with as well.
pub(crate) const PIXELS: (u32, u32) = (320, 240);

/// Who drives, and how it sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Conditions {
    /// Who leads.
    pub lead: Lead,
    /// Whether the arbiter filters.
    pub arbitrated: bool,
    /// How the robot sees.
    pub sight: Sight,
}

impl Conditions {
    /// For the head of a row.
    #[must_use]
    pub fn label(&self) -> String {
        format!("{}, arbiter {}", self.lead.label(), if self.arbitrated { "on" } else { "off" })
    }
}

/// How a drive ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// At the goal, without contact.
    Reached,
    /// Something was hit.
    Contact,
    /// The time ran out.
    Late,
}

impl Ending {
    pub(crate) fn of(outcome: &Outcome, goals: u32) -> Self {
        match outcome {
            _ if outcome.collisions > 0 => Self::Contact,
            _ if outcome.arrivals >= goals => Self::Reached,
            _ => Self::Late,
        }
    }
}

/// What came of one drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Driven {
    /// How it ended.
    pub ending: Ending,
    /// `[s]` time driven.
    pub time_s: f64,
    /// `[m]` way driven.
    pub distance_m: f64,
    /// `[s]` time spent standing.
    pub standing_s: f64,
    /// Times it came to rest on the way.
    pub stops: u32,
    /// `[m]` smallest gap to anything.
    pub min_clearance_m: f64,
    /// `[1]` sum of J of eq. (6) of the commands judged, every 0.5 s.
    pub cost_sum: f64,
    /// Commands judged.
    pub judged: u64,
    /// In words.
    pub summary: String,
    /// `[m]` where it was, every 0.1 s.
    pub trace_m: Vec<[f64; 2]>,
}

impl Driven {
    /// `[1]` mean J of eq. (6) of the commands judged.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.cost_sum / self.judged.max(1) as f64
    }
}

/// What a drive is made of, without a network.
pub(crate) fn setup(robot: &Robot, course: &Course, conditions: Conditions) -> Setup {
    let mut setup = Setup::led_by(robot.clone(), course.world.clone(), conditions.lead);
    (setup.sim.width_px, setup.sim.height_px) = PIXELS;
    setup.sim.seed = course.seed;
    setup.sight = conditions.sight;
    setup.arbitrated = conditions.arbitrated;
    setup
}

/// What a thread keeps between drives, since a model takes longer to load than a room to cross.
pub(crate) struct Pilot<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) policy: Option<Policy>,
    judge: Judge,
}

impl<'a> Pilot<'a> {
    pub(crate) fn new(robot: &'a Robot, model: &[u8], name: &str) -> Result<Self, NavigateError> {
        let policy = Policy::load(model, name, robot)?;
        Ok(Self {
            robot,
            policy: Some(policy),
            judge: Judge::new(&robot.limits, &Weights::STANDARD, Config::STANDARD.candidates),
        })
    }

    /// A drive that has not begun; [`Self::take_back`] ends it.
    pub(crate) fn begin(&mut self, course: &Course, conditions: Conditions) -> Result<Drive, NavigateError> {
        let mut setup = setup(self.robot, course, conditions);
        // In a graph the network always runs, and drives where the expert cannot; without an arbiter nobody asks it.
        if conditions.arbitrated || conditions.lead.needs_policy() {
            setup.policy = self.policy.take();
            setup.policy_stands_by = true;
        }
        Ok(Drive::new(setup)?)
    }

    pub(crate) fn take_back(&mut self, drive: Drive) {
        self.policy = drive.into_policy().or(self.policy.take());
    }

    /// J of eq. (6) of the best plan that begins with the newest command; `None` where there is nothing to decide.
    pub(crate) fn judged(&mut self, drive: &Drive) -> Option<f64> {
        let (chain, goal) = (drive.chain(), drive.chain().local_goal());
        if chain.statuses()[1] != Status::Ok || goal.cell as usize >= LOCAL_CELLS {
            return None;
        }
        let told = clamp_to_window(drive.command().twist, goal.twist, &self.robot.limits);
        let map = &chain.local_map().planning_cost;
        Some(f64::from(self.judge.judge(map, goal.cell as usize, goal.twist, told).cost))
    }

    /// Drives a course until its goal, a contact or the time limit.
    pub(crate) fn drive(
        &mut self,
        course: &Course,
        conditions: Conditions,
        limit_s: f64,
    ) -> Result<Driven, NavigateError> {
        let goals = course.world.legs_m.len() as u32;
        let mut drive = self.begin(course, conditions)?;
        let (mut stops, mut stood, mut ticks) = (0, true, 0_u64);
        let (mut cost_sum, mut judged) = (0.0, 0);
        while drive.outcome().arrivals < goals
            && drive.outcome().collisions == 0
            && drive.outcome().time_s < limit_s
        {
            drive.tick();
            ticks += 1;
            let stands = is_standing(drive.truth().twist);
            stops += u32::from(stands && !stood);
            stood = stands;
            if ticks.is_multiple_of(JUDGED_TICKS)
                && let Some(cost) = self.judged(&drive)
            {
                cost_sum += cost;
                judged += 1;
            }
        }
        let outcome = drive.outcome();
        let driven = Driven {
            ending: Ending::of(outcome, goals),
            time_s: outcome.time_s,
            distance_m: outcome.distance_m,
            standing_s: outcome.standing_s,
            stops,
            min_clearance_m: f64::from(outcome.min_clearance_m),
            cost_sum,
            judged,
            summary: outcome.summary(),
            trace_m: outcome.trace.iter().map(|point| [point.pose.x_m, point.pose.y_m]).collect(),
        };
        self.take_back(drive);
        Ok(driven)
    }
}

/// Whether a robot neither drives nor turns.
pub(crate) fn is_standing(twist: Twist) -> bool {
    twist.v_m_s.abs() < STANDING && twist.w_rad_s.abs() < STANDING
}

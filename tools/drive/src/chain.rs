//! The nodes, called as the graph calls them, with the headers that the graph would write.

use crate::drive::{DriveError, Setup};
use crate::sight::{Sight, Surroundings};
use sidestep_arbiter::{Arbiter, Lead};
use sidestep_expert::Expert;
use sidestep_goal::Goal;
use sidestep_guard::Guard;
use sidestep_mapper::Mapper;
use sidestep_msgs::{
    Command, DepthFrame, Estop, EstopAction, Header, Limits, LocalGoal, LocalMap, NO_CELL, NearField,
    Odometry, Path, Proposal, Ranges, Reason, SafetyMap, Scan, Status, Twist, VALID_FOR_NS, Winner,
    clamp_to_window,
};
use sidestep_policy::Policy;

/// Number of the run in every header.
const RUN: u64 = 1;

/// What a frame is: depth, a sweep, or what stands there.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Image<'a> {
    /// A depth frame.
    Depth(&'a DepthFrame),
    /// A lidar sweep.
    Scan(&'a Scan),
    /// The solids themselves.
    Known(&'a Surroundings<'a>),
}

/// When a policy that does not lead is asked.
#[derive(Debug, Clone, Copy)]
struct Standby {
    /// Good frames of the lead in a row, and how many are enough for it to drive in any case.
    good: u32,
    enough: u32,
}

impl Standby {
    /// Whether the policy may drive, given how the lead fares.
    fn is_needed(&mut self, lead: Status) -> bool {
        self.good = if lead == Status::Ok { self.good.saturating_add(1) } else { 0 };
        self.good <= self.enough
    }
}

/// Mapper, guard, goal, policy, expert and arbiter with their last messages.
pub struct Chain {
    mapper: Option<Mapper>,
    guard: Option<Guard>,
    goal: Goal,
    expert: Expert,
    policy: Option<Policy>,
    standby: Option<Standby>,
    arbiter: Arbiter,
    lead: Lead,
    refining: bool,
    limits: Limits,
    overruled: Option<Twist>,
    odometry_sequence: u64,
    ranges_sequence: u64,
    operator_token: u64,
    frames: u64,
    local: LocalMap,
    safety: Box<SafetyMap>,
    near: NearField,
    local_goal: LocalGoal,
    proposals: [Proposal; 2],
    statuses: [Status; 4],
}

fn header(sequence: u64, source_frame: u64, now_ns: u64, status: Status) -> Header {
    Header { run: RUN, sequence, source_frame, now_ns, status: status as u32, ..Header::default() }
}

impl Chain {
    /// The nodes of a setup.
    ///
    /// # Errors
    /// [`DriveError`] with the node that refuses its configuration.
    pub fn new(setup: &mut Setup) -> Result<Self, DriveError> {
        let refused = |error: &dyn std::fmt::Display| DriveError::Refused(error.to_string());
        let robot = &setup.robot;
        let mapper = match setup.sight {
            Sight::Camera => Some(Mapper::new(&setup.mapper, robot).map_err(|error| refused(&error))?),
            Sight::Grid | Sight::Noisy => None,
        };
        let guarded = setup.sight == Sight::Camera && robot.camera.is_some();
        let refining = setup.expert.mode == sidestep_expert::Lead::Refined;
        let may_stand_by = setup.policy_stands_by && setup.arbiter.lead == Lead::Expert && !refining;
        let guard = setup.guard.filter(|_| guarded).map(|config| Guard::new(&config, robot)).transpose();
        Ok(Self {
            mapper,
            guard: guard.map_err(|error| refused(&error))?,
            goal: Goal::new(&setup.goal, robot).map_err(|error| refused(&error))?,
            expert: Expert::new(&setup.expert, robot).map_err(|error| refused(&error))?,
            policy: setup.policy.take(),
            standby: may_stand_by.then_some(Standby { good: 0, enough: setup.arbiter.lead_frames }),
            arbiter: Arbiter::new(&setup.arbiter, robot, 0).map_err(|error| refused(&error))?,
            lead: setup.arbiter.lead,
            refining,
            limits: robot.limits,
            overruled: None,
            odometry_sequence: 0,
            ranges_sequence: 0,
            operator_token: 0,
            frames: 0,
            local: LocalMap::default(),
            safety: Box::default(),
            near: NearField::default(),
            local_goal: LocalGoal::default(),
            proposals: [Proposal::default(); 2],
            statuses: [Status::NoMap; 4],
        })
    }

    /// Takes odometry.
    pub fn odometry(&mut self, odometry: &Odometry, now_ns: u64) {
        self.odometry_sequence += 1;
        if let Some(mapper) = &mut self.mapper {
            mapper.odometry(odometry);
        }
        self.goal.odometry(odometry, self.odometry_sequence);
        self.arbiter.odometry(odometry, &header(self.odometry_sequence, 0, now_ns, Status::Ok));
    }

    /// Takes ultrasonic ranges.
    pub fn ranges(&mut self, ranges: &Ranges) {
        self.ranges_sequence += 1;
        if let Some(mapper) = &mut self.mapper {
            mapper.ranges(ranges);
        }
        self.arbiter.ranges(ranges);
    }

    /// Takes a path.
    pub fn path(&mut self, path: &Path) {
        self.goal.path(path);
    }

    /// Says something as the operator.
    pub fn operator(&mut self, action: EstopAction) {
        self.operator_token += 1;
        self.arbiter.estop(&Estop { token: self.operator_token, action: action as u32, _pad: 0 });
    }

    /// Makes both maps of a frame.
    fn look(&mut self, image: Image<'_>) -> Status {
        let status = match (image, &mut self.mapper) {
            (Image::Known(surroundings), _) => {
                surroundings.write(&mut self.local, &mut self.safety);
                return Status::Ok;
            }
            (_, None) => return Status::NoMap,
            (Image::Depth(frame), Some(mapper)) => mapper.depth(frame),
            (Image::Scan(scan), Some(mapper)) => mapper.scan(scan),
        };
        if let Some(mapper) = &self.mapper {
            mapper.write_local(&mut self.local);
            mapper.write_safety(&mut self.safety);
        }
        status
    }

    /// Takes a frame and brings its map, goal and proposals to the arbiter; returns the mapper's status.
    pub(crate) fn frame(&mut self, image: Image<'_>, now_ns: u64) -> Status {
        self.frames += 1;
        let status = self.look(image);
        let goal_status = self.goal.step(&self.local, self.frames, status, &mut self.local_goal);
        let (policy_status, expert_status) = self.propose(goal_status);
        let [policy_out, expert_out] = &mut self.proposals;
        if let Some(wish) = self.overruled {
            let twist = clamp_to_window(wish, self.local_goal.twist, &self.limits);
            (policy_out.twist, expert_out.twist) = (twist, twist);
        }
        let about = |status| header(self.frames, self.frames, now_ns, status);
        if let (Image::Depth(frame), Some(guard)) = (image, &mut self.guard) {
            guard.step(frame, &mut self.near);
            self.arbiter.near_field(&self.near);
        }
        self.arbiter.safety_map(&self.safety, &about(status));
        self.arbiter.local_goal(&self.local_goal, &about(goal_status));
        if let Some(policy_status) = policy_status {
            self.arbiter.proposal(Winner::Policy, policy_out, &about(policy_status));
        }
        self.arbiter.proposal(Winner::Expert, expert_out, &about(expert_status));
        self.statuses = [status, goal_status, policy_status.unwrap_or(Status::NoGoal), expert_status];
        status
    }

    /// Makes the proposals of a frame; the policy's status is `None` where nobody asked it.
    fn propose(&mut self, goal_status: Status) -> (Option<Status>, Status) {
        let Self { local, local_goal: goal, expert, policy, .. } = self;
        let [policy_out, expert_out] = &mut self.proposals;
        let mut ask = || Some(policy.as_mut()?.propose(local, goal, goal_status, policy_out));
        if let Some(standby) = &mut self.standby {
            let status = expert.plan(local, goal, goal_status, None, expert_out);
            return (if standby.is_needed(status) { ask() } else { None }, status);
        }
        let status = ask();
        let seed = (self.refining && status == Some(Status::Ok)).then_some(policy_out.twist);
        (status, expert.plan(local, goal, goal_status, seed, expert_out))
    }

    /// Puts a wish in the place of what both planners propose from the next frame on, within the window of u'; `None`
    /// lets them propose again.
    pub fn overrule(&mut self, wish: Option<Twist>) {
        self.overruled = wish;
    }

    /// The policy, if one took part.
    #[must_use]
    pub fn into_policy(self) -> Option<Policy> {
        self.policy
    }

    /// Frames taken.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Makes the command of a time.
    pub fn command(&mut self, now_ns: u64, out: &mut Command) -> Status {
        self.arbiter.step(now_ns, false, out)
    }

    /// Passes the lead's newest proposal on as it is: the command of a chain without an arbiter.
    pub(crate) fn pass(&self, now_ns: u64, out: &mut Command) {
        let (winner, proposal, status) = match self.lead {
            Lead::Policy => (Winner::Policy, &self.proposals[0], self.statuses[2]),
            Lead::Expert => (Winner::Expert, &self.proposals[1], self.statuses[3]),
        };
        let reason = match status {
            Status::Ok => Reason::Clear,
            Status::Arrived => Reason::Arrived,
            Status::Infeasible | Status::Fault => Reason::UnfitProposals,
            _ => Reason::NoGoal,
        };
        *out = Command {
            valid_until_ns: now_ns.saturating_add(VALID_FOR_NS),
            twist: proposal.twist,
            wish: proposal.twist,
            scale: 1.0,
            winner: winner as u32,
            reason: reason as u32,
            limiting_cell: NO_CELL,
            ..Command::default()
        };
    }

    /// The newest local map.
    #[must_use]
    pub fn local_map(&self) -> &LocalMap {
        &self.local
    }

    /// The newest safety map.
    #[must_use]
    pub fn safety_map(&self) -> &SafetyMap {
        &self.safety
    }

    /// The newest local goal.
    #[must_use]
    pub fn local_goal(&self) -> &LocalGoal {
        &self.local_goal
    }

    /// The newest proposals: of the policy and of the expert.
    #[must_use]
    pub fn proposals(&self) -> &[Proposal; 2] {
        &self.proposals
    }

    /// What mapper, goal, policy and expert said of the newest frame.
    #[must_use]
    pub fn statuses(&self) -> &[Status; 4] {
        &self.statuses
    }
}

//! One step: who wishes what, whether anything forbids it, how much of it is safe, and the command that says so.

use crate::approach::Approach;
use crate::clearance::{FreeSpace, Outline};
use crate::config::{Config, ConfigError, Lead};
use crate::inputs::Inputs;
use crate::limits::{Limiter, Motion};
use crate::operator::{Operator, Standing};
use crate::queue::{Queue, Sent};
use crate::recovery::Recovery;
use crate::search::{Escape, Filtered};
use crate::select::{Selected, Selection};
use crate::tube::Tube;
use crate::way_out::Planner;
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{
    Command, Estop, EstopAction, Header, LocalGoal, NearField, Odometry, Proposal, Ranges, Reason, Robot,
    SafetyMap, Status, Teleop, Twist, VALID_FOR_NS, Winner,
};

/// `[s]` a tick later than this does not allow a larger change of the command.
const LATE_S: f32 = 0.02;
/// `[s]` time of a step whose clock did not run forward.
const TICK_S: f32 = 0.01;
/// `[m/s]` and [rad/s] measured rest.
const REST_M_S: f32 = 0.03;
const REST_RAD_S: f32 = 0.06;

/// All that the arbiter keeps from step to step, as plain bytes, but for the cells of the map.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Memory {
    pub(crate) inputs: Inputs,
    pub(crate) queue: Queue,
    pub(crate) operator: Operator,
    pub(crate) selection: Selection,
    pub(crate) recovery: Recovery,
    pub(crate) escape: Escape,
    pub(crate) approach: Approach,
    pub(crate) last: Motion,
    pub(crate) last_ns: u64,
    pub(crate) source_frame: u64,
    pub(crate) epoch: u32,
    /// 1 while a frame of the lead waits for its answer.
    pub(crate) unanswered: u32,
    /// 1 once a command was sent.
    pub(crate) begun: u32,
    /// 1 in the last step's open loop.
    pub(crate) open_loop: u32,
    /// 1 where an earlier life was ended by force: the base may be rolling.
    pub(crate) restarted: u32,
    /// Zero.
    pub(crate) _pad: u32,
}

/// The velocity arbiter.
#[derive(Debug, Clone)]
pub struct Arbiter {
    pub(crate) config: Config,
    pub(crate) robot: Robot,
    pub(crate) outline: Outline,
    pub(crate) limiter: Limiter,
    pub(crate) tube: Tube,
    pub(crate) planner: Planner,
    pub(crate) space: FreeSpace,
    pub(crate) memory: Memory,
}

/// What a step decided.
pub(crate) struct Verdict {
    pub(crate) winner: Winner,
    pub(crate) wish: Twist,
    pub(crate) filtered: Filtered,
}

/// What a step intends before anything is filtered.
enum Intent {
    Stop { reason: Reason, status: Status },
    Drive(Selected),
}

impl Arbiter {
    /// An arbiter at rest; after a restart (`incarnation` > 0) it brakes to rest first.
    ///
    /// # Errors
    /// A parameter or the robot's outline is out of range.
    pub fn new(config: &Config, robot: &Robot, incarnation: u32) -> Result<Self, ConfigError> {
        config.check()?;
        let outline = Outline::new(robot)?;
        if outline.half_width_m.min(outline.front_m).min(outline.rear_m) <= config.overlap_m {
            let found = f64::from(config.overlap_m);
            return Err(ConfigError {
                key: "overlap_m",
                found,
                needed: "less than the footprint's half-width",
            });
        }
        let tube = Tube::new(config, robot, &outline);
        let restarted = incarnation > 0;
        let memory = Memory {
            operator: Operator::new(restarted),
            restarted: u32::from(restarted),
            ..Memory::zeroed()
        };
        Ok(Self {
            config: config.clone(),
            robot: robot.clone(),
            limiter: Limiter::new(&robot.limits),
            planner: Planner::new(robot, &outline, tube.full_margin_m()),
            tube,
            outline,
            space: FreeSpace::new(config, robot),
            memory,
        })
    }

    /// Forgets the world, as when playback jumps; an emergency stop and a hold stay.
    pub fn reset(&mut self) {
        let before = self.memory;
        self.memory = Memory {
            operator: before.operator,
            last: before.last,
            last_ns: before.last_ns,
            begun: before.begun,
            restarted: before.restarted,
            ..Memory::zeroed()
        };
        self.space.clear();
    }

    /// Takes odometry.
    pub fn odometry(&mut self, odometry: &Odometry, header: &Header) {
        self.memory.inputs.take_odometry(odometry, header);
    }

    /// Takes a safety map; one that the mapper refused only counts as a sign of why the last good one ages.
    pub fn safety_map(&mut self, map: &SafetyMap, header: &Header) {
        if self.memory.inputs.take_map(map, header) {
            self.space.take(map);
        }
    }

    /// Takes a local goal.
    pub fn local_goal(&mut self, goal: &LocalGoal, header: &Header) {
        self.memory.inputs.take_goal(goal, header);
    }

    /// Takes a proposal of [`Winner::Policy`] or [`Winner::Expert`]; returns whether it is the lead's and its frame is
    /// new: then a step is due.
    pub fn proposal(&mut self, from: Winner, proposal: &Proposal, header: &Header) -> bool {
        let inputs = &mut self.memory.inputs;
        let (wish, lead) = match from {
            Winner::Policy => (&mut inputs.policy, self.config.lead == Lead::Policy),
            Winner::Expert => (&mut inputs.expert, self.config.lead == Lead::Expert),
            _ => return false,
        };
        let new = wish.take(proposal, header);
        if lead && new {
            self.memory.unanswered = 1;
        }
        lead && new
    }

    /// Takes ultrasonic ranges.
    pub fn ranges(&mut self, ranges: &Ranges) {
        self.memory.inputs.take_ranges(ranges);
    }

    /// Takes the depth guard's nearest ranges.
    pub fn near_field(&mut self, near: &NearField) {
        self.memory.inputs.take_near_field(near);
    }

    /// Takes the operator's stick.
    pub fn teleop(&mut self, teleop: &Teleop) {
        self.memory.inputs.take_teleop(teleop);
    }

    /// Obeys an operator's word; a reset only at rest. The command names the token of the last word obeyed.
    pub fn estop(&mut self, message: &Estop) {
        let at_rest = self.memory.last.is_rest() && (self.memory.open_loop != 0 || !self.is_rolling());
        let obeyed = self.memory.operator.obey(message, at_rest, self.config.resume);
        if matches!(obeyed, Some(EstopAction::Reset | EstopAction::Resume)) {
            self.memory.recovery.forgive();
            // Somebody has looked how near it is.
            self.memory.approach = Approach::zeroed();
            self.memory.inputs.forgive_frozen();
            let memory = &mut self.memory;
            memory.inputs.release_teleop(memory.last_ns, self.config.teleop_age_s);
        }
    }

    /// Takes up the orders of an earlier life, from the state file.
    pub fn take_up(&mut self, standing: Standing) {
        self.memory.operator.take_up(standing);
    }

    /// The orders that stand: to be written to the state file before the command is sent.
    #[must_use]
    pub fn standing(&self) -> Standing {
        self.memory.operator.standing()
    }

    /// Frame that the last command is about: the winner's; on a stop, the newest map's.
    #[must_use]
    pub fn source_frame(&self) -> u64 {
        self.memory.source_frame
    }

    /// Whether the robot is not known to rest: a rest that nobody measured is not known.
    fn is_rolling(&self) -> bool {
        let inputs = &self.memory.inputs;
        let twist = inputs.odometry.twist;
        !inputs.odometry_stamps.is_known() || twist.v_m_s.abs() > REST_M_S || twist.w_rad_s.abs() > REST_RAD_S
    }

    /// Makes the command of graph time `now_ns`; `open_loop` = the sensors are a recording that no command can change.
    pub fn step(&mut self, now_ns: u64, open_loop: bool, out: &mut Command) -> Status {
        let dt_s = self.begin(now_ns, open_loop);
        let fault = self.memory.inputs.fault(now_ns, open_loop, &self.config, &self.robot);
        let (verdict, status) = match self.intent(fault, now_ns) {
            Intent::Stop { reason, status } => {
                let faulty = fault.is_some() || status == Status::Fault;
                (self.stop(reason, faulty, now_ns, dt_s), status)
            }
            Intent::Drive(selected) => (self.drive(&selected, now_ns, dt_s), Status::Ok),
        };
        let answers = self.answer(verdict.winner);
        self.send(now_ns, verdict.filtered.motion);
        self.describe(now_ns, &verdict, answers, out);
        status
    }

    /// Brings the time forward; returns how long `[s]` the last command has been in force for the limits.
    fn begin(&mut self, now_ns: u64, open_loop: bool) -> f32 {
        let memory = &mut self.memory;
        memory.open_loop = u32::from(open_loop);
        memory.inputs.distrust_future(now_ns);
        let epoch = memory.inputs.odometry.pose_epoch;
        if memory.epoch != epoch {
            memory.epoch = epoch;
            memory.recovery = Recovery::zeroed();
            memory.approach = Approach::zeroed();
        }
        if memory.begun == 0 {
            memory.begun = 1;
            if memory.restarted != 0 {
                // What an earlier life told the base is not known. A base that brakes is faster than it was told, by its
                // lag, and the measurement is older still: to begin from what was measured would speed it up again.
                let measured = Motion::steady(self.limiter.bounded(memory.inputs.odometry.twist));
                let age_s = memory.inputs.odometry_stamps.age_s(now_ns).min(self.config.odometry_age_s);
                let actuator = &self.robot.actuator;
                let late_s = age_s + actuator.dead_time_max_s + actuator.lag_s;
                memory.last = self.limiter.brake(&measured, late_s, false);
            }
            return TICK_S;
        }
        if now_ns < memory.last_ns {
            memory.queue.clear();
            return TICK_S;
        }
        let silent_ns = now_ns - memory.last_ns;
        if silent_ns > VALID_FOR_NS {
            // The base has braked by itself since the last command ran out.
            let braked_s = (silent_ns - VALID_FOR_NS) as f32 * 1e-9;
            memory.last = self.limiter.brake(&memory.last, braked_s.min(10.0), false);
            memory.queue.push(Sent { sent_ns: memory.last_ns + VALID_FOR_NS, twist: Twist::STOP });
        }
        (silent_ns as f32 * 1e-9).min(LATE_S)
    }

    /// The order: latch, hold, start, faults, teleop, goal, lead, other proposal, stop.
    fn intent(&mut self, fault: Option<Reason>, now_ns: u64) -> Intent {
        self.memory.selection.watch(&self.memory.inputs, &self.config, now_ns);
        if self.memory.last.is_rest() && !self.is_rolling() {
            self.memory.operator.rested(self.config.resume);
        }
        // Who starts without odometry cannot know when the robot rests: what is missing is the reason.
        let blind = !self.memory.inputs.odometry_stamps.is_known();
        match self.memory.operator.stop() {
            Some(Reason::Starting) if blind => {}
            Some(reason) => return Intent::Stop { reason, status: Status::Hold },
            None => {}
        }
        if let Some(reason) = fault {
            let status = match reason {
                Reason::NoMap | Reason::StaleMap | Reason::RefusedMap => Status::NoMap,
                _ => Status::Fault,
            };
            return Intent::Stop { reason, status };
        }
        let (memory, config) = (&mut self.memory, &self.config);
        if memory.inputs.teleop.dead_man != 0 {
            if !memory.inputs.teleop_stamps.is_fresh(now_ns, config.teleop_age_s) {
                return Intent::Stop { reason: Reason::StaleTeleop, status: Status::Hold };
            }
            let teleop = &memory.inputs.teleop;
            let twist = Twist::new(teleop.v_m_s, teleop.w_rad_s);
            let frame = memory.inputs.map_frame;
            let winner = Winner::Teleop;
            return Intent::Drive(Selected { winner, twist, source_frame: frame, reason: Reason::Teleop });
        }
        if !memory.inputs.goal_stamps.is_fresh(now_ns, config.goal_age_s) {
            return Intent::Stop { reason: Reason::StaleGoal, status: Status::Fault };
        }
        let goal = memory.inputs.goal_status;
        for (told, reason) in [
            (Status::Arrived, Reason::Arrived),
            (Status::NoGoal, Reason::NoGoal),
            (Status::Lost, Reason::NoGoal),
            (Status::Hold, Reason::Hold),
        ] {
            if goal == told as u32 {
                return Intent::Stop { reason, status: told };
            }
        }
        match memory.selection.select(&memory.inputs, config, now_ns) {
            Ok(selected) => Intent::Drive(selected),
            // Somebody lives and sees no way: the recovery is asked, as when the filter sees none.
            Err(Reason::UnfitProposals) if Selection::is_infeasible(&memory.inputs, config, now_ns) => {
                Intent::Drive(Selected {
                    winner: Winner::Stop,
                    twist: Twist::STOP,
                    source_frame: memory.inputs.map_frame,
                    reason: Reason::UnfitProposals,
                })
            }
            Err(reason) => Intent::Stop { reason, status: Status::Fault },
        }
    }

    /// Which frame the command is about, and whether it answers a new frame of the lead.
    fn answer(&mut self, winner: Winner) -> bool {
        let memory = &mut self.memory;
        let inputs = &memory.inputs;
        let lead = match self.config.lead {
            Lead::Policy => inputs.policy.source_frame,
            Lead::Expert => inputs.expert.source_frame,
        };
        let answers = memory.unanswered != 0;
        memory.unanswered = 0;
        memory.source_frame = match winner {
            _ if answers => lead,
            Winner::Policy => inputs.policy.source_frame,
            Winner::Expert => inputs.expert.source_frame,
            _ => inputs.map_frame,
        };
        answers
    }

    fn send(&mut self, now_ns: u64, motion: Motion) {
        let memory = &mut self.memory;
        memory.last = motion;
        memory.last_ns = now_ns;
        memory.queue.push(Sent { sent_ns: now_ns, twist: motion.twist });
        memory.inputs.told(now_ns, motion.twist);
    }

    fn describe(&self, now_ns: u64, verdict: &Verdict, answers: bool, out: &mut Command) {
        let memory = &self.memory;
        let inputs = &memory.inputs;
        *out = Command {
            valid_until_ns: now_ns.saturating_add(VALID_FOR_NS),
            operator_token: memory.operator.token,
            twist: verdict.filtered.motion.twist,
            wish: verdict.wish,
            scale: verdict.filtered.scale,
            winner: verdict.winner as u32,
            reason: verdict.filtered.reason as u32,
            limiting_cell: verdict.filtered.cell,
            map_age_s: inputs.map_stamps.age_s(now_ns),
            goal_age_s: inputs.goal_stamps.age_s(now_ns),
            policy_age_s: inputs.policy.stamps.age_s(now_ns),
            expert_age_s: inputs.expert.stamps.age_s(now_ns),
            odometry_age_s: inputs.odometry_stamps.age_s(now_ns),
            teleop_age_s: inputs.teleop_stamps.age_s(now_ns),
            answers: u32::from(answers),
            open_loop: memory.open_loop,
            latched: u32::from(memory.operator.standing().latched),
            _pad: 0,
        };
    }
}

//! A robot in an open room whose inputs an event changes, one of them at a time, beside the model that hears the same.

use super::Event;
use super::model::Model;
use crate::fixture::{MS, Stage, TICK, map_of};
use crate::{Arbiter, Config, Resume, Standing};
use sidestep_msgs::{
    Code, Command, Estop, EstopAction, Header, LocalGoal, NearField, Odometry, Proposal, Reason, SafetyMap,
    Status, Teleop, Twist, VALID_FOR_NS, Winner,
};

/// `[m/s]` what each source of wishes wants, to know them apart; slow, so that rest is soon reached.
const POLICY_M_S: f32 = 0.15;
const EXPERT_M_S: f32 = 0.14;
const TELEOP_M_S: f32 = 0.13;
/// Ticks after which a robot that must stop stands: 0.15 m/s and what the limit of jerk adds, at 0.5 m/s^2.
const STOPS_WITHIN: usize = 60;

/// What a source of odometry, maps, proposals or words does until the next event about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    Good,
    Silent,
    Repeated,
    Backward,
    Future,
    Unfit,
    Infeasible,
    Doubtful,
    /// Below the limit of doubt, but not so far below that a doubt would end.
    Unsure,
    Slips,
    Frozen,
}

/// What the operator's stick does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stick {
    Released,
    Held,
    Silent,
    /// Held, and not a number.
    Garbage,
}

/// The robot, its inputs and its model.
#[derive(Clone)]
pub(super) struct Rig {
    config: Config,
    stage: Stage,
    model: Model,
    trail: Vec<Event>,
    map: Box<SafetyMap>,
    odometry_is: Source,
    map_is: Source,
    policy_is: Source,
    expert_is: Source,
    goal_is: Option<Status>,
    field_is: Source,
    stick_is: Stick,
    measured: Odometry,
    pose_epoch: u32,
    map_epoch: u32,
    /// The wish of the stick: what it said while it was held.
    stick_m_s: f32,
    token: u64,
    incarnation: u32,
    /// The state file, as the node keeps it.
    orders: Standing,
    /// Whether a restart still waits for an operator's word.
    must_ask: bool,
    /// The last command of this life.
    before: Option<Command>,
    stopped_ticks: usize,
    /// The reasons shown so far, one bit each.
    pub(super) seen: u64,
}

impl Rig {
    /// Driving, all inputs good.
    pub(super) fn new(config: &Config) -> Self {
        let mut rig = Self {
            config: config.clone(),
            stage: Stage::new(config, &[]),
            model: Model::new(config, false, Standing::default()),
            trail: Vec::new(),
            map: map_of(&[], &sidestep_msgs::Pose2::ORIGIN, 0),
            odometry_is: Source::Good,
            map_is: Source::Good,
            policy_is: Source::Good,
            expert_is: Source::Good,
            goal_is: Some(Status::Ok),
            field_is: Source::Silent,
            stick_is: Stick::Silent,
            measured: Odometry::default(),
            pose_epoch: 0,
            map_epoch: 0,
            stick_m_s: 0.0,
            token: 0,
            incarnation: 0,
            orders: Standing::default(),
            must_ask: false,
            before: None,
            stopped_ticks: 0,
            seen: 0,
        };
        // Long enough for frozen odometry to be told from a base that was not told to move.
        rig.run(60);
        rig
    }

    /// Lets an event happen and time pass.
    pub(super) fn happen(&mut self, event: Event) {
        self.trail.push(event);
        match event {
            Event::Odometry(source) => self.odometry_is = source,
            Event::Map(source) => {
                self.map_is = source;
                self.map_epoch = self.pose_epoch;
            }
            Event::Policy(source) => self.policy_is = source,
            Event::Expert(source) => self.expert_is = source,
            Event::Goal(says) => self.goal_is = says,
            Event::Field(source) => self.field_is = source,
            Event::Stick(stick) => self.stick_is = stick,
            Event::PoseJump => self.pose_epoch += 1,
            Event::Say(action) => {
                self.tick(Some(action));
            }
            Event::PlaybackJump => {
                self.stage.arbiter.reset();
                self.model.jump();
            }
            Event::Restart => self.restart(),
            Event::Wait => {}
        }
        self.run(match event {
            Event::Say(_) => 3,
            Event::Restart | Event::PlaybackJump => 4,
            Event::Field(_) => 16,
            Event::Wait => 52,
            // Longer than the ages of 100 ms, and no multiple of the period of the frames.
            _ => 13,
        });
    }

    fn reason(&self) -> Reason {
        Reason::from_code(self.stage.command.reason).unwrap()
    }

    fn run(&mut self, ticks: usize) {
        for _ in 0..ticks {
            self.tick(None);
        }
    }

    /// The arbiter dies; its successor knows the state file and nothing else.
    fn restart(&mut self) {
        self.incarnation += 1;
        self.stage.arbiter = Arbiter::new(&self.config, &self.stage.robot, self.incarnation).unwrap();
        self.stage.arbiter.take_up(self.orders);
        let orders = Standing { latched: self.model.latched, held: self.model.held };
        self.model = Model::new(&self.config, true, orders);
        self.must_ask = self.config.resume == Resume::Operator;
        self.before = None;
    }

    /// One tick in the order of the node: what came, the state file, the step; then what must hold.
    fn tick(&mut self, word: Option<EstopAction>) {
        let told = self.stage.command;
        self.send_odometry();
        self.send_stick();
        let obeyed = word.is_some_and(|action| self.say(action));
        if (self.stage.now_ns / TICK).is_multiple_of(3) {
            self.stage.frame += 1;
            self.send_frame();
        }
        self.orders = self.stage.arbiter.standing();
        let now_ns = self.stage.now_ns;
        let expected = self.model.expect(now_ns);
        let command = self.stage.step();
        let status = self.stage.status;
        let found = (command.reason, command.winner, status);
        let wanted = (expected.reason as u32, expected.winner as u32, expected.status);
        assert_eq!(found, wanted, "{:?}: {expected:?} {command:?}", self.trail);
        self.check_words(&command, &told, word.filter(|_| obeyed));
        self.check_wish(&command);
        self.check_motion(&command, expected.at_once);
        assert_eq!(command.valid_until_ns, now_ns + VALID_FOR_NS, "{:?}", self.trail);
        self.model.sent(now_ns, command.twist);
        self.before = Some(command);
        self.seen |= 1 << command.reason;
    }

    fn say(&mut self, action: EstopAction) -> bool {
        self.token += 1;
        self.stage.arbiter.estop(&Estop { token: self.token, action: action as u32, _pad: 0 });
        self.model.say(action, self.token)
    }

    /// The latch, its acknowledgement, and the word that a restart waits for: over all lives, without the model.
    fn check_words(&mut self, command: &Command, told: &Command, obeyed: Option<EstopAction>) {
        let (trail, reason) = (&self.trail, self.reason());
        let latched = command.latched != 0;
        assert_eq!((latched, command.operator_token), (self.model.latched, self.model.token), "{trail:?}");
        assert_eq!(latched, reason == Reason::EstopLatched, "{trail:?}: {command:?}");
        assert_eq!((self.orders.latched, self.orders.held), (latched, self.model.held), "{trail:?}");
        if told.latched != 0 && !latched {
            assert_eq!((obeyed, told.twist), (Some(EstopAction::Reset), Twist::STOP), "{trail:?}");
            assert!(self.stage.twist.v_m_s.abs() < 0.03, "{trail:?}: reset while rolling");
        }
        // Whatever was said before the robot stood, unlatched, does not count.
        let word = matches!(obeyed, Some(EstopAction::Reset | EstopAction::Resume));
        let counts = !matches!(reason, Reason::Starting | Reason::EstopLatched | Reason::AwaitOperator);
        self.must_ask =
            self.config.resume == Resume::Operator && latched || self.must_ask && !(word && counts);
        assert!(!self.must_ask || command.winner == Winner::Stop as u32, "{trail:?}: {command:?}");
    }

    /// A winner is fit, and its wish is the command's.
    fn check_wish(&self, command: &Command) {
        let winner = Winner::from_code(command.winner).unwrap();
        let (wish, age_s) = match winner {
            Winner::Policy => (POLICY_M_S, command.policy_age_s),
            Winner::Expert => (EXPERT_M_S, command.expert_age_s),
            Winner::Teleop => (self.stick_m_s, command.teleop_age_s),
            Winner::Stop => (0.0, 0.0),
            Winner::Recovery => panic!("{:?}: nothing is in the way", self.trail),
        };
        assert_eq!(command.wish, Twist::new(wish, 0.0), "{:?}: {command:?}", self.trail);
        let held = winner != Winner::Teleop || self.model.dead_man;
        assert!(age_s <= 0.1 && held, "{:?}: {command:?}", self.trail);
        if winner != Winner::Stop {
            let ages = [command.map_age_s - 0.1, command.odometry_age_s - 0.06];
            assert!(ages.iter().all(|late| *late <= 0.0) && command.latched == 0, "{command:?}");
        }
    }

    /// The limits, the brake, and rest in time.
    fn check_motion(&mut self, command: &Command, at_once: bool) {
        let trail = &self.trail;
        let v = command.twist.v_m_s;
        assert!(
            (0.0..=POLICY_M_S + 0.05).contains(&v) && command.twist.w_rad_s == 0.0,
            "{trail:?}: {command:?}"
        );
        self.stopped_ticks = if command.winner == Winner::Stop as u32 { self.stopped_ticks + 1 } else { 0 };
        assert!(self.stopped_ticks < STOPS_WITHIN || v == 0.0, "{trail:?}: {command:?}");
        let Some(before) = self.before else {
            // A new life brakes from what the base does; it never speeds it up.
            assert!(v <= self.measured.twist.v_m_s.max(0.0) + 1e-6, "{trail:?}: {command:?}");
            return;
        };
        let change = v - before.twist.v_m_s;
        assert!((-0.005 - 1e-6..=0.01 + 1e-6).contains(&change), "{trail:?}: {change}");
        if at_once {
            let hardest = (before.twist.v_m_s - 0.005).max(0.0);
            assert!((v - hardest).abs() < 2e-6, "{trail:?}: {command:?} after {before:?}");
        }
    }

    fn send_odometry(&mut self) {
        let (now_ns, source) = (self.stage.now_ns, self.odometry_is);
        let mut odometry = if source == Source::Frozen { self.measured } else { self.stage.measure() };
        odometry.stamp_ns = now_ns;
        odometry.pose_epoch = self.pose_epoch;
        odometry.slip = u32::from(source == Source::Slips);
        match source {
            Source::Silent => return,
            Source::Repeated => odometry.stamp_ns = self.measured.stamp_ns,
            Source::Backward => odometry.stamp_ns = 500 * MS,
            Source::Future => odometry.stamp_ns = now_ns + 60_000 * MS,
            Source::Unfit => odometry.twist.w_rad_s = f32::NAN,
            _ => {}
        }
        let header = self.stage.header(Status::Ok);
        self.stage.arbiter.odometry(&odometry, &header);
        let fit = source != Source::Unfit;
        if self.model.odometry(odometry.stamp_ns, now_ns, fit, source == Source::Frozen) {
            self.model.measured(odometry.twist, odometry.slip != 0, odometry.pose_epoch);
            self.measured = odometry;
        }
    }

    fn send_stick(&mut self) {
        let (stamp_ns, stick) = (self.stage.now_ns, self.stick_is);
        if stick == Stick::Silent {
            return;
        }
        let dead_man = stick != Stick::Released;
        let v_m_s = if stick == Stick::Garbage { f32::NAN } else { TELEOP_M_S };
        // Nobody wishes what a released stick says.
        self.stick_m_s = match stick {
            Stick::Held => TELEOP_M_S,
            Stick::Garbage if self.model.dead_man => self.stick_m_s,
            _ => 0.0,
        };
        let teleop = Teleop { stamp_ns, v_m_s, w_rad_s: 0.0, dead_man: u32::from(dead_man), _pad: 0 };
        self.stage.arbiter.teleop(&teleop);
        self.model.stick(stamp_ns, stick != Stick::Garbage, dead_man);
    }

    /// What comes with a depth frame.
    fn send_frame(&mut self) {
        let now_ns = self.stage.now_ns;
        let ok = self.stage.header(Status::Ok);
        if self.field_is == Source::Good {
            let range_m = [f32::INFINITY; 64];
            let (left_rad, sector_rad) = (0.48, 0.015);
            self.stage.arbiter.near_field(&NearField { capture_ns: now_ns, range_m, left_rad, sector_rad });
            self.model.field(now_ns);
        }
        if self.map_is != Source::Silent {
            self.send_map(now_ns);
        }
        if let Some(says) = self.goal_is {
            let goal = LocalGoal { capture_ns: now_ns, x_m: 2.0, ..LocalGoal::default() };
            self.stage.arbiter.local_goal(&goal, &Header { status: says as u32, ..ok });
            self.model.goal(now_ns, says);
        }
        for (from, source, v_m_s) in
            [(Winner::Policy, self.policy_is, POLICY_M_S), (Winner::Expert, self.expert_is, EXPERT_M_S)]
        {
            let (said, v_m_s) = match source {
                Source::Silent => continue,
                Source::Infeasible => (Status::Infeasible, 0.0),
                Source::Unfit => (Status::Ok, f32::NAN),
                _ => (Status::Ok, v_m_s),
            };
            let doubt_v_m_s = match source {
                Source::Doubtful => 0.11,
                Source::Unsure => 0.09,
                _ => 0.05,
            };
            let twist = Twist::new(v_m_s, 0.0);
            let proposal = Proposal { capture_ns: now_ns, twist, doubt_v_m_s, ..Proposal::default() };
            self.stage.arbiter.proposal(from, &proposal, &Header { status: said as u32, ..ok });
            let said = if source == Source::Unfit { Status::Fault } else { said };
            self.model.proposal(from, now_ns, said, doubt_v_m_s);
        }
    }

    fn send_map(&mut self, now_ns: u64) {
        let status = if self.map_is == Source::Unfit { Status::RefusedEmpty } else { Status::Ok };
        let known_ns = self.map.capture_ns;
        let capture_ns = match self.map_is {
            Source::Repeated => known_ns,
            Source::Backward => 500 * MS,
            Source::Future => now_ns + 60_000 * MS,
            _ => now_ns,
        };
        (self.map.capture_ns, self.map.base, self.map.pose_epoch) =
            (capture_ns, self.stage.pose, self.map_epoch);
        let header = self.stage.header(status);
        self.stage.arbiter.safety_map(&self.map, &header);
        self.model.map(capture_ns, now_ns, status == Status::Ok, self.map_epoch);
        if self.map_is != Source::Good {
            self.map.capture_ns = known_ns;
        }
    }
}

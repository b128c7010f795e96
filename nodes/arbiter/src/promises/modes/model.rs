//! What the arbiter must say, by the tables of the README: a page that shares no code with what it checks.

use crate::fixture::MS;
use crate::{Config, Lead, Resume, Standing};
use sidestep_msgs::{EstopAction, Reason, Status, Twist, Winner};

/// Why a message was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Bad {
    Repeated,
    Backward,
    Unfit,
}

/// What was heard on one topic: the stamp of the last good message and what came after it.
#[derive(Debug, Clone, Copy, Default)]
struct Heard {
    good_ns: Option<u64>,
    bad: Option<Bad>,
}

impl Heard {
    /// Whether a message was good: fit, newer than the last, and not from the future.
    fn hear(&mut self, stamp_ns: u64, now_ns: u64, fit: bool) -> bool {
        self.bad = match self.good_ns {
            _ if !fit => Some(Bad::Unfit),
            _ if stamp_ns > now_ns + 20 * MS => Some(Bad::Backward),
            Some(good_ns) if stamp_ns < good_ns => Some(Bad::Backward),
            Some(good_ns) if stamp_ns == good_ns => Some(Bad::Repeated),
            _ => None,
        };
        if self.bad.is_none() {
            self.good_ns = Some(stamp_ns);
        }
        self.bad.is_none()
    }

    fn fresh(&self, now_ns: u64, limit_ms: u64) -> bool {
        self.good_ns.is_some_and(|good_ns| now_ns.saturating_sub(good_ns) <= limit_ms * MS)
    }

    /// The reason of a silence, out of five: nothing ever came, nothing came since, repeated, backward, unfit.
    fn fault(&self, now_ns: u64, limit_ms: u64, reasons: [Reason; 5]) -> Option<Reason> {
        let [never, stale, repeated, backward, unfit] = reasons;
        let reason = match self.bad {
            Some(Bad::Repeated) => repeated,
            Some(Bad::Backward) => backward,
            Some(Bad::Unfit) => unfit,
            None if self.good_ns.is_none() => never,
            None => stale,
        };
        (!self.fresh(now_ns, limit_ms)).then_some(reason)
    }
}

/// One of the two proposers.
#[derive(Debug, Clone, Copy, Default)]
struct Proposer {
    heard: Heard,
    /// Status and capture `[ns]` of the newest message, if it was unfit.
    unfit: Option<(Status, u64)>,
    doubt_m_s: f32,
    /// Whether a good message came since the last tick.
    news: bool,
}

impl Proposer {
    fn usable(&self, now_ns: u64) -> bool {
        self.unfit.is_none() && self.heard.fresh(now_ns, 100)
    }

    /// The status of one that lives but cannot be driven.
    fn refusal(&self, now_ns: u64) -> Option<Status> {
        self.unfit.filter(|(_, capture_ns)| now_ns - capture_ns <= 100 * MS).map(|(status, _)| status)
    }
}

/// A command as it must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expected {
    pub(super) reason: Reason,
    pub(super) winner: Winner,
    pub(super) status: Status,
    /// Whether it brakes at once, without limit of jerk.
    pub(super) at_once: bool,
}

/// The modes and all they depend on.
#[derive(Debug, Clone)]
pub(super) struct Model {
    config: Config,
    odometry: Heard,
    map: Heard,
    goal: Heard,
    stick: Heard,
    field: Heard,
    policy: Proposer,
    expert: Proposer,
    goal_says: Status,
    pub(super) dead_man: bool,
    measured: Twist,
    slips: bool,
    map_epoch: u32,
    pose_epoch: u32,
    /// `[ns]` stamps of the oldest and the newest odometry with the same bytes.
    same: (u64, u64),
    /// `[ns]` since when the base is told to move.
    told_ns: Option<u64>,
    frozen: bool,
    pub(super) latched: bool,
    pub(super) held: bool,
    starting: bool,
    awaiting: bool,
    pub(super) token: u64,
    in_doubt: bool,
    other_drives: bool,
    /// `[ns]` since when the lead is good without a break, and its good frames since.
    good: Option<(u64, u32)>,
    last: Twist,
    last_ns: u64,
}

impl Model {
    /// Before the first message.
    pub(super) fn new(config: &Config, restarted: bool, orders: Standing) -> Self {
        Self {
            config: config.clone(),
            odometry: Heard::default(),
            map: Heard::default(),
            goal: Heard::default(),
            stick: Heard::default(),
            field: Heard::default(),
            policy: Proposer::default(),
            expert: Proposer::default(),
            goal_says: Status::Ok,
            dead_man: false,
            measured: Twist::STOP,
            slips: false,
            map_epoch: 0,
            pose_epoch: 0,
            same: (0, 0),
            told_ns: None,
            frozen: false,
            latched: orders.latched,
            held: orders.held,
            starting: restarted,
            awaiting: false,
            token: 0,
            in_doubt: false,
            other_drives: false,
            good: None,
            last: Twist::STOP,
            last_ns: 0,
        }
    }

    /// Playback jumps: what the operator said stays.
    pub(super) fn jump(&mut self) {
        let orders = Standing { latched: self.latched, held: self.held };
        let fresh = Self::new(&self.config, self.starting, orders);
        let (awaiting, token) = (self.awaiting, self.token);
        *self = Self { awaiting, token, last: self.last, last_ns: self.last_ns, ..fresh };
    }

    pub(super) fn odometry(&mut self, stamp_ns: u64, now_ns: u64, fit: bool, same: bool) -> bool {
        let first = self.odometry.good_ns.is_none();
        let good = self.odometry.hear(stamp_ns, now_ns, fit);
        if good {
            self.same.1 = stamp_ns;
            if !same || first {
                self.same.0 = stamp_ns;
                self.frozen = false;
            }
        }
        good
    }

    pub(super) fn measured(&mut self, twist: Twist, slips: bool, epoch: u32) {
        (self.measured, self.slips, self.pose_epoch) = (twist, slips, epoch);
    }

    pub(super) fn map(&mut self, stamp_ns: u64, now_ns: u64, fit: bool, epoch: u32) {
        if self.map.hear(stamp_ns, now_ns, fit) {
            self.map_epoch = epoch;
        }
    }

    pub(super) fn goal(&mut self, stamp_ns: u64, says: Status) {
        if self.goal.hear(stamp_ns, stamp_ns, says != Status::Fault) {
            self.goal_says = says;
        }
    }

    pub(super) fn field(&mut self, stamp_ns: u64) {
        self.field.hear(stamp_ns, stamp_ns, true);
    }

    /// A stick that cannot be understood is at least known to be held.
    pub(super) fn stick(&mut self, stamp_ns: u64, fit: bool, dead_man: bool) {
        let good = self.stick.hear(stamp_ns, stamp_ns, fit);
        self.dead_man = if good { dead_man } else { self.dead_man || dead_man };
    }

    pub(super) fn proposal(&mut self, from: Winner, stamp_ns: u64, said: Status, doubt_m_s: f32) {
        let proposer = if from == Winner::Policy { &mut self.policy } else { &mut self.expert };
        let good = proposer.heard.hear(stamp_ns, stamp_ns, said == Status::Ok);
        proposer.unfit = (said != Status::Ok).then_some((said, stamp_ns));
        if good {
            (proposer.doubt_m_s, proposer.news) = (doubt_m_s, true);
        }
    }

    /// An operator's word; returns whether it is obeyed.
    pub(super) fn say(&mut self, action: EstopAction, token: u64) -> bool {
        match action {
            EstopAction::Stop => self.latched = true,
            EstopAction::Hold => self.held = true,
            EstopAction::Reset if !self.rests() => return false,
            EstopAction::Reset => {
                self.awaiting = self.latched && self.config.resume == Resume::Operator;
                self.latched = false;
            }
            EstopAction::Resume => (self.held, self.awaiting) = (false, false),
        }
        if matches!(action, EstopAction::Reset | EstopAction::Resume) {
            (self.frozen, self.told_ns) = (false, None);
            // Only a stick that fell silent is given up.
            self.dead_man &= self.stick.fresh(self.last_ns, 100);
        }
        self.token = token;
        true
    }

    /// At rest: told so, and measured.
    fn rests(&self) -> bool {
        let still = |twist: Twist, v: f32, w: f32| twist.v_m_s.abs() <= v && twist.w_rad_s.abs() <= w;
        self.odometry.good_ns.is_some() && still(self.last, 1e-4, 1e-4) && still(self.measured, 0.03, 0.06)
    }

    /// What was sent: a base that is told to move must be seen to move.
    pub(super) fn sent(&mut self, now_ns: u64, twist: Twist) {
        let moves = twist.v_m_s.abs() > 0.1 || twist.w_rad_s.abs() > 0.3;
        self.told_ns = if moves { self.told_ns.or(Some(now_ns)) } else { None };
        (self.last, self.last_ns) = (twist, now_ns);
    }

    fn fault(&mut self, now_ns: u64) -> Option<Reason> {
        use Reason as R;
        let odometry =
            [R::NoOdometry, R::StaleOdometry, R::BackwardOdometry, R::BackwardOdometry, R::UnfitOdometry];
        let map = [R::NoMap, R::StaleMap, R::RepeatedMap, R::BackwardMap, R::RefusedMap];
        if let Some(reason) = self.odometry.fault(now_ns, 60, odometry) {
            return Some(reason);
        }
        if self.slips {
            return Some(R::Slip);
        }
        // The dead time, at most 80 ms, and 0.3 s.
        let told = self.told_ns.is_some_and(|told_ns| now_ns - told_ns > 380 * MS);
        self.frozen |= told && self.same.1 - self.same.0 > 100 * MS;
        if self.frozen {
            return Some(R::FrozenOdometry);
        }
        let silent = self.field.good_ns.is_some() && !self.field.fresh(now_ns, 150);
        self.map
            .fault(now_ns, 100, map)
            .or((self.map_epoch != self.pose_epoch).then_some(R::PoseJump))
            .or(silent.then_some(R::StaleNearField))
    }

    /// The lead and the other, with their names.
    fn proposers(&self) -> [(Proposer, Winner); 2] {
        let [policy, expert] = [(self.policy, Winner::Policy), (self.expert, Winner::Expert)];
        if self.config.lead == Lead::Policy { [policy, expert] } else { [expert, policy] }
    }

    /// Whether the lead is good, and since when: watched at every tick, whoever drives.
    fn watch(&mut self, now_ns: u64) -> bool {
        let limit = self.config.doubt_limit_m_s * if self.in_doubt { 0.8 } else { 1.0 };
        self.in_doubt = self.policy.doubt_m_s > limit;
        let [(lead, name), _] = self.proposers();
        let fit = lead.usable(now_ns) && !(name == Winner::Policy && self.in_doubt);
        self.good = match self.good {
            _ if !fit => None,
            None => Some((now_ns, 1)),
            Some((since_ns, frames)) => Some((since_ns, frames + u32::from(lead.news))),
        };
        (self.policy.news, self.expert.news) = (false, false);
        fit
    }

    /// Whose proposal drives.
    fn proposer(&mut self, now_ns: u64, fit: bool) -> Result<(Winner, Reason), Reason> {
        let [(lead, lead_name), (other, other_name)] = self.proposers();
        let back = self.good.is_some_and(|(since_ns, frames)| frames >= 10 || now_ns - since_ns >= 500 * MS);
        // Without another one nobody is waited for.
        self.other_drives = !fit || self.other_drives && !back && other.usable(now_ns);
        if self.other_drives && other.usable(now_ns) {
            Ok((other_name, Reason::OtherProposal))
        } else if lead.usable(now_ns) {
            Ok((lead_name, Reason::Clear))
        } else if lead.refusal(now_ns).or(other.refusal(now_ns)).is_some() {
            Err(Reason::UnfitProposals)
        } else {
            Err(Reason::StaleProposals)
        }
    }

    /// The operator's stop, the strongest first.
    fn stopped(&self) -> Option<Reason> {
        // Who has no odometry cannot know whether the robot rests: that is what is missing.
        let blind = self.odometry.good_ns.is_none();
        let stops = [
            (self.latched, Reason::EstopLatched),
            (self.held, Reason::Hold),
            (self.starting && !blind, Reason::Starting),
            (self.awaiting, Reason::AwaitOperator),
        ];
        stops.into_iter().find_map(|(on, reason)| on.then_some(reason))
    }

    /// What the command of this tick must say.
    pub(super) fn expect(&mut self, now_ns: u64) -> Expected {
        let fault = self.fault(now_ns);
        let fit = self.watch(now_ns);
        if self.starting && self.rests() {
            (self.starting, self.awaiting) = (false, self.config.resume == Resume::Operator);
        }
        let at_once = fault.is_some();
        let stop = |reason, status| {
            let at_once = at_once
                || status == Status::Fault
                || matches!(reason, Reason::EstopLatched | Reason::Starting);
            Expected { reason, winner: Winner::Stop, status, at_once }
        };
        let drive = |winner, reason| Expected { reason, winner, status: Status::Ok, at_once: false };
        if let Some(reason) = self.stopped() {
            return stop(reason, Status::Hold);
        }
        if let Some(reason) = fault {
            let no_map = matches!(reason, Reason::NoMap | Reason::StaleMap | Reason::RefusedMap);
            return stop(reason, if no_map { Status::NoMap } else { Status::Fault });
        }
        if self.dead_man {
            return if self.stick.fresh(now_ns, 100) {
                drive(Winner::Teleop, Reason::Teleop)
            } else {
                stop(Reason::StaleTeleop, Status::Hold)
            };
        }
        if !self.goal.fresh(now_ns, 100) {
            return stop(Reason::StaleGoal, Status::Fault);
        }
        match self.goal_says {
            Status::Arrived => return stop(Reason::Arrived, Status::Arrived),
            Status::NoGoal | Status::Lost => return stop(Reason::NoGoal, self.goal_says),
            Status::Hold => return stop(Reason::Hold, Status::Hold),
            _ => {}
        }
        match self.proposer(now_ns, fit) {
            Ok((winner, reason)) => drive(winner, reason),
            // Whoever lives and sees no way is helped by the recovery: a drive of nobody's.
            Err(reason) if self.sees_no_way(now_ns) => drive(Winner::Stop, reason),
            Err(reason) => stop(reason, Status::Fault),
        }
    }

    fn sees_no_way(&self, now_ns: u64) -> bool {
        [self.policy, self.expert].iter().any(|one| one.refusal(now_ns) == Some(Status::Infeasible))
    }
}

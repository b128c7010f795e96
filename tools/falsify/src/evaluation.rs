//! One evaluation: the real arbiter against one scenario, and how near the robot came to anything while it moved.

use crate::base::Base;
use crate::error::FalsifyError;
use crate::genes::Case;
use crate::scenario::{Scenario, TICKS};
use crate::sensing::{Known, Mail, Moment, Shown, draw_map};
use crate::thing::{Thing, footprint, in_sector};
use serde::Serialize;
use sidestep_arbiter::{Arbiter, Config};
use sidestep_msgs::{
    Command, Header, LocalGoal, Odometry, Pose2, Proposal, Robot, SafetyMap, Status, Twist, Winner,
};
use sidestep_sim::{BEGIN_NS, TICK_NS};

/// Steps of the base in a tick: 2 ms each.
const STEPS_PER_TICK: u64 = 5;
/// `[s]` one of them.
const STEP_S: f64 = TICK_NS as f64 * 1e-9 / STEPS_PER_TICK as f64;
/// `[m/s]` and [rad/s] slower is rest.
const REST: f32 = 1e-3;
/// `[m]` farther away is not told apart.
const FAR_M: f64 = 1.0;
/// Ticks of rest after which nothing more is expected.
const REST_TICKS: u64 = 60;
/// `[s]` a contact is as bad as the way the robot makes in this time.
const IMPACT_S: f64 = 0.1;
/// `[m/s]` no point of the footprint is faster than the limits by more than this part.
const HURRY: f64 = 1.2;

/// A contact of the moving robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Contact {
    /// `[s]` since the beginning.
    pub time_s: f64,
    /// `[m/s]` speed.
    pub v_m_s: f32,
    /// `[rad/s]` turn rate.
    pub w_rad_s: f32,
    /// Number of the obstacle.
    pub thing: usize,
}

/// What came of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Outcome {
    /// `[m]` smallest gap between footprint and obstacles while the robot moved; negative = contact, by the way that
    /// the fastest point of the footprint would make in 0.1 s.
    pub robustness_m: f64,
    /// The contact, if there was one.
    pub contact: Option<Contact>,
    /// Ticks evaluated.
    pub ticks: u64,
}

/// One tick of an evaluation.
#[derive(Debug, Clone, Copy)]
pub struct Trace {
    /// `[s]` since the beginning.
    pub time_s: f64,
    /// Pose in the world.
    pub pose: Pose2,
    /// True velocity.
    pub twist: Twist,
    /// The newest command.
    pub command: Command,
    /// Whether it was made in this tick.
    pub commanded: bool,
    /// `[m]` gap now.
    pub gap_m: f64,
}

/// Evaluates cases; keeps the memory between them.
pub struct Evaluator {
    robot: Robot,
    config: Config,
    map: Box<SafetyMap>,
    polygon: Vec<[f64; 2]>,
    shown: Vec<Shown>,
}

impl Evaluator {
    /// An evaluator of the shipped arbiter with a robot.
    ///
    /// # Errors
    /// The arbiter refuses the robot.
    pub fn new(robot: &Robot) -> Result<Self, FalsifyError> {
        let config = Config::STANDARD;
        Arbiter::new(&config, robot, 0)?;
        Ok(Self {
            robot: robot.clone(),
            config,
            map: Box::default(),
            polygon: Vec::with_capacity(8),
            shown: Vec::with_capacity(16),
        })
    }

    /// The scenario of a case.
    #[must_use]
    pub fn scenario(&self, case: &Case) -> Scenario {
        Scenario::new(case, &self.robot, f64::from(self.config.margin_m))
    }

    /// Evaluates a case; `trace` hears every tick.
    ///
    /// # Errors
    /// The arbiter refuses the robot.
    pub fn evaluate(&mut self, case: &Case, trace: &mut dyn FnMut(&Trace)) -> Result<Outcome, FalsifyError> {
        let scenario = self.scenario(case);
        self.play(&scenario, trace)
    }

    /// Evaluates a scenario, made of a case or by hand.
    ///
    /// # Errors
    /// The arbiter refuses the robot.
    pub fn play(
        &mut self,
        scenario: &Scenario,
        trace: &mut dyn FnMut(&Trace),
    ) -> Result<Outcome, FalsifyError> {
        let arbiter = Arbiter::new(&self.config, &self.robot, 0)?;
        let mut run = Run::new(self, scenario, arbiter);
        for tick in 0..TICKS as u64 {
            run.tick(tick)?;
            trace(&run.trace(tick));
            if run.contact.is_some() || run.is_over(tick) {
                break;
            }
        }
        Ok(run.outcome())
    }
}

/// An evaluation in progress.
struct Run<'a> {
    evaluator: &'a mut Evaluator,
    scenario: &'a Scenario,
    arbiter: Arbiter,
    base: Base,
    history: Vec<Moment>,
    maps: Mail,
    odometry: Mail,
    proposals: Mail,
    known: Option<Known>,
    command: Command,
    commanded: bool,
    dead: bool,
    rest_ticks: u64,
    ticks: u64,
    least_m: f64,
    gap_m: f64,
    slack_m: f64,
    contact: Option<Contact>,
    /// Things that the promise does not speak of any more: movers that left the sector, or came to a robot at rest.
    excused: Vec<bool>,
}

impl<'a> Run<'a> {
    fn new(evaluator: &'a mut Evaluator, scenario: &'a Scenario, arbiter: Arbiter) -> Self {
        let seed = scenario.seed;
        let start = Pose2::new(0.0, 0.0, scenario.yaw_rad);
        let turn_rad_s2 = f64::from(evaluator.robot.limits.turn_accelerate_rad_s2);
        Self {
            arbiter,
            base: Base::new(start, seed, &scenario.base, turn_rad_s2),
            history: Vec::with_capacity(TICKS),
            maps: Mail::new(&scenario.maps, seed, 2),
            odometry: Mail::new(&scenario.odometry, seed, 3),
            proposals: Mail::new(&scenario.proposals, seed, 4),
            known: None,
            command: Command::default(),
            commanded: false,
            dead: false,
            rest_ticks: 0,
            ticks: 0,
            least_m: FAR_M,
            gap_m: FAR_M,
            slack_m: 0.0,
            contact: None,
            excused: vec![false; scenario.things.0.len()],
            evaluator,
            scenario,
        }
    }

    fn tick(&mut self, tick: u64) -> Result<(), FalsifyError> {
        let now_ns = BEGIN_NS + tick * TICK_NS;
        self.ticks = tick + 1;
        self.sense(tick);
        self.commanded = false;
        if self.lives(tick)? {
            self.deliver(tick);
            self.arbiter.step(now_ns, false, &mut self.command);
            self.base.command(&self.command, now_ns, &self.scenario.base);
            self.commanded = true;
        }
        for step in 0..STEPS_PER_TICK {
            let step_ns = now_ns + step * (TICK_NS / STEPS_PER_TICK);
            self.base.step(step_ns, STEP_S, tick, &self.scenario.base);
            self.look((tick * STEPS_PER_TICK + step + 1) as f64 * STEP_S);
            if self.contact.is_some() {
                break;
            }
        }
        Ok(())
    }

    /// Whether the arbiter makes a command now; one that died comes back without what it knew.
    fn lives(&mut self, tick: u64) -> Result<bool, FalsifyError> {
        let r = &self.scenario.restarts;
        if tick >= r.arbiter_from && tick < r.arbiter_from + r.arbiter_ticks {
            self.dead = r.arbiter_dies;
            return Ok(false);
        }
        if self.dead {
            self.dead = false;
            self.arbiter = Arbiter::new(&self.evaluator.config, &self.evaluator.robot, 1)?;
        }
        Ok(true)
    }

    /// Measures, and sends what is due.
    fn sense(&mut self, tick: u64) {
        let drift = &self.scenario.drift;
        let side = if (tick / drift.ticks).is_multiple_of(2) { 1.0 } else { -1.0 };
        let off = |side: f64| Pose2::new(side * drift.x_m, side * drift.y_m, side * drift.yaw_rad);
        let moment = Moment {
            tick,
            pose: self.base.pose,
            believed: self.base.pose.compose(&off(side)),
            remembered: self.base.pose.compose(&off(-side)),
            twist: self.base.twist(),
        };
        self.history.push(moment);
        let concealed = (self.scenario.concealed_s * 1e9) as u64 / TICK_NS;
        let earlier = self.history[tick.saturating_sub(concealed) as usize];
        self.odometry.send(tick, Moment { tick, ..earlier });
        let r = &self.scenario.restarts;
        let mapped = tick < r.mapper_from || tick >= r.mapper_from.saturating_add(r.mapper_ticks);
        if !tick.is_multiple_of(self.scenario.map_period) || !mapped {
            return;
        }
        if tick >= r.mapper_from && self.known.is_none() {
            let (x, y) = moment.pose.transform(r.known_ahead_m, 0.0);
            self.known = Some(Known { centre_m: [x, y], radius_m: r.known_radius_m });
        }
        self.excuse(&moment.pose, tick as f64 * TICK_NS as f64 * 1e-9);
        self.maps.send(tick, Moment { pose: earlier.pose, ..moment });
        self.proposals.send(tick, moment);
    }

    /// Brings the arbiter what has arrived; some of it twice.
    fn deliver(&mut self, tick: u64) {
        let now_ns = BEGIN_NS + tick * TICK_NS;
        let header = |moment: &Moment| Header {
            run: 1,
            sequence: moment.tick + 1,
            source_frame: moment.tick + 1,
            now_ns,
            status: Status::Ok as u32,
            ..Header::default()
        };
        if let Some(moment) = self.odometry.take(tick) {
            let mut odometry = Odometry {
                stamp_ns: BEGIN_NS + moment.tick * TICK_NS,
                pose: moment.believed,
                twist: moment.twist,
                ..Odometry::default()
            };
            // The last bits of a measurement never stand still.
            odometry.pose.x_m += (moment.tick % 2) as f64 * 1e-9;
            for _ in 0..=moment.tick % 2 {
                self.arbiter.odometry(&odometry, &header(&moment));
            }
        }
        if let Some(moment) = self.maps.take(tick) {
            self.draw(&moment);
            for _ in 0..=moment.tick % 2 {
                self.arbiter.safety_map(&self.evaluator.map, &header(&moment));
            }
        }
        if let Some(moment) = self.proposals.take(tick) {
            let capture_ns = BEGIN_NS + moment.tick * TICK_NS;
            let side = if self.scenario.seed.is_multiple_of(2) { 1.0 } else { -1.0 };
            let goal = LocalGoal { capture_ns, x_m: 2.0, y_m: side, ..LocalGoal::default() };
            self.arbiter.local_goal(&goal, &header(&moment));
            let proposal = Proposal { capture_ns, twist: self.wish(tick), ..Proposal::default() };
            self.arbiter.proposal(Winner::Policy, &proposal, &header(&moment));
            self.arbiter.proposal(Winner::Expert, &proposal, &header(&moment));
        }
    }

    /// What the adversary wishes now; it knows the truth.
    fn wish(&self, tick: u64) -> Twist {
        let piece = self.scenario.piece(tick as usize);
        let chased = piece.chases.and_then(|number| self.scenario.things.0.get(number));
        let w = chased.map_or(piece.w_rad_s, |thing| {
            let solid = thing.at(tick as f64 * TICK_NS as f64 * 1e-9);
            let (x, y) = self.base.pose.inverse_transform(solid.x_m, solid.y_m);
            3.0 * libm::atan2(y, x)
        });
        Twist::new(piece.v_m_s as f32, w as f32)
    }

    /// The map of a moment.
    fn draw(&mut self, moment: &Moment) {
        let time_s = moment.tick as f64 * TICK_NS as f64 * 1e-9;
        let Evaluator { robot, map, polygon, shown, .. } = &mut *self.evaluator;
        footprint(robot, &moment.pose, polygon);
        shown.clear();
        for thing in self.scenario.things.0.iter().filter(|thing| !thing.granted) {
            let solid = thing.at(time_s);
            if thing.seen_within_m.is_infinite() || solid.gap_m(polygon) < thing.seen_within_m {
                shown.push(Shown { solid, seen: thing.seen, moving: thing.speed_m_s() > 0.0 });
            }
        }
        map.capture_ns = BEGIN_NS + moment.tick * TICK_NS;
        draw_map(moment, shown, self.known.as_ref(), robot.blind_m(), map);
    }

    /// Excuses the movers that are not in the sector when a map is made.
    fn excuse(&mut self, pose: &Pose2, time_s: f64) {
        let robot = &self.evaluator.robot;
        for (excused, thing) in self.excused.iter_mut().zip(&self.scenario.things.0) {
            *excused |= is_minded(robot, thing) && !in_sector(robot, pose, &thing.at(time_s));
        }
    }

    /// Notes how near everything is, if it can be nearer than anything was before.
    fn look(&mut self, time_s: f64) {
        let twist = self.base.twist();
        let speed = self.speed_m_s(&twist);
        let movers = self.scenario.things.0.iter().map(Thing::speed_m_s).fold(0.0, f64::max);
        self.slack_m -= (speed + movers) * STEP_S;
        if self.slack_m > 0.0 {
            return;
        }
        let evaluator = &mut *self.evaluator;
        footprint(&evaluator.robot, &self.base.pose, &mut evaluator.polygon);
        let radius_m = f64::from(evaluator.robot.radius_m());
        let rests = twist.v_m_s.abs() < REST && twist.w_rad_s.abs() < REST;
        let mut nearest = (FAR_M, 0);
        for (number, thing) in self.scenario.things.0.iter().enumerate().filter(|(_, thing)| thing.exists) {
            let solid = thing.at(time_s);
            if is_minded(&evaluator.robot, thing) {
                self.excused[number] |= rests && solid.gap_m(&evaluator.polygon) <= 0.0;
                if self.excused[number] {
                    continue;
                }
            }
            let apart_m = solid.distance_m([self.base.pose.x_m, self.base.pose.y_m]) - radius_m;
            if apart_m < nearest.0 {
                let gap_m = solid.gap_m(&evaluator.polygon);
                if gap_m < nearest.0 {
                    nearest = (gap_m, number);
                }
            }
        }
        let (gap_m, thing) = nearest;
        self.gap_m = gap_m;
        if rests {
            self.slack_m = 0.0;
            return;
        }
        if gap_m <= 0.0 {
            self.contact = Some(Contact { time_s, v_m_s: twist.v_m_s, w_rad_s: twist.w_rad_s, thing });
            self.least_m = -IMPACT_S * speed;
        }
        self.least_m = self.least_m.min(gap_m);
        self.slack_m = gap_m - self.least_m;
    }

    /// `[m/s]` no point of the footprint is faster.
    fn speed_m_s(&self, twist: &Twist) -> f64 {
        let radius_m = f64::from(self.evaluator.robot.radius_m());
        f64::from(twist.v_m_s.abs()) + f64::from(twist.w_rad_s.abs()) * radius_m
    }

    /// Whether nothing more can happen: long at rest, or nothing within reach.
    fn is_over(&mut self, tick: u64) -> bool {
        let twist = self.base.twist();
        let rests = self.speed_m_s(&twist) < f64::from(REST) && self.command.twist == Twist::STOP;
        self.rest_ticks = if rests { self.rest_ticks + 1 } else { 0 };
        if self.rest_ticks >= REST_TICKS {
            return true;
        }
        let left_s = (TICKS as u64 - tick) as f64 * TICK_NS as f64 * 1e-9;
        let fastest = HURRY * f64::from(self.evaluator.robot.limits.forward_m_s);
        let reach_m = f64::from(self.evaluator.robot.radius_m()) + left_s * fastest + self.least_m;
        let at = [self.base.pose.x_m, self.base.pose.y_m];
        let whole_s = TICKS as f64 * TICK_NS as f64 * 1e-9;
        let mut existing = self.scenario.things.0.iter().filter(|thing| thing.exists);
        existing.all(|thing| thing.solid.distance_m(at) > reach_m + thing.speed_m_s() * whole_s)
    }

    fn trace(&self, tick: u64) -> Trace {
        Trace {
            time_s: (tick + 1) as f64 * TICK_NS as f64 * 1e-9,
            pose: self.base.pose,
            twist: self.base.twist(),
            command: self.command,
            commanded: self.commanded,
            gap_m: self.gap_m,
        }
    }

    fn outcome(&self) -> Outcome {
        Outcome { robustness_m: self.least_m, contact: self.contact, ticks: self.ticks }
    }
}

/// Whether the arbiter is told to mind a thing as a mover.
fn is_minded(robot: &Robot, thing: &Thing) -> bool {
    robot.start.mover_m_s > 0.0 && thing.speed_m_s() > 0.0
}

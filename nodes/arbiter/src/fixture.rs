//! A robot, a world of boxes and a base with dead time, for tests.

use crate::{Arbiter, Config};
use sidestep_msgs::{
    AGE_NEVER, Command, Header, LocalGoal, Odometry, Pose2, Proposal, Robot, SAFETY_CELLS, SAFETY_GRID,
    SAFETY_SIDE, STILL, SafetyMap, Status, Twist, Winner,
};

/// `[ns]` one millisecond.
pub(crate) const MS: u64 = 1_000_000;
/// `[ns]` one tick.
pub(crate) const TICK: u64 = 10 * MS;

/// The shipped Loomo.
pub(crate) fn loomo() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

/// A box in the world: [x0, y0, x1, y1].
pub(crate) type Solid = [f64; 4];

/// `[m]` from a point to the nearest solid.
pub(crate) fn distance_m(solids: &[Solid], x: f64, y: f64) -> f64 {
    let to = |s: &Solid| {
        let (dx, dy) = ((s[0] - x).max(x - s[2]).max(0.0), (s[1] - y).max(y - s[3]).max(0.0));
        dx.hypot_of(dy)
    };
    solids.iter().map(to).fold(f64::INFINITY, f64::min)
}

trait Hypot {
    fn hypot_of(self, other: Self) -> Self;
}

impl Hypot for f64 {
    fn hypot_of(self, other: Self) -> Self {
        libm::hypot(self, other)
    }
}

/// `[m]` from the outline of the robot to the nearest solid, by points every centimetre along its edges.
pub(crate) fn gap_m(robot: &Robot, pose: &Pose2, solids: &[Solid]) -> f64 {
    let polygon = &robot.footprint.polygon_m;
    let mut least = f64::INFINITY;
    for (a, b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let parts = 60;
        for part in 0..=parts {
            let t = f64::from(part) / f64::from(parts);
            let along = |i: usize| f64::from(a[i]) + t * f64::from(b[i] - a[i]);
            let (x, y) = pose.transform(along(0), along(1));
            least = least.min(distance_m(solids, x, y));
        }
    }
    least
}

/// A safety map of the world round a pose of the robot: a cell is occupied if a solid may reach into it, for long.
pub(crate) fn map_of(solids: &[Solid], pose: &Pose2, capture_ns: u64) -> Box<SafetyMap> {
    let mut map: Box<SafetyMap> = bytemuck::zeroed_box();
    map.capture_ns = capture_ns;
    map.base = *pose;
    for index in 0..SAFETY_CELLS {
        let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        let (x, y) = map.frame().transform(f64::from(x), f64::from(y));
        map.occupancy[index] = if distance_m(solids, x, y) < 0.0354 { 250 } else { 10 };
        map.still[index] = STILL;
    }
    map
}

/// Nobody has ever seen what lies in `unseen`.
pub(crate) fn hide(unseen: &[Solid], map: &mut SafetyMap) {
    over(unseen, map, |map, index| map.age[index] = AGE_NEVER);
}

/// Draws what has just come to where it is, as far as it can be seen: near the camera over floor that cannot.
pub(crate) fn draw_movers(movers: &[Solid], blind_m: f32, map: &mut SafetyMap) {
    over(movers, map, |map, index| {
        let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        let (x, y) = map.frame().transform(f64::from(x), f64::from(y));
        let near = libm::hypot(x - map.base.x_m, y - map.base.y_m) < f64::from(blind_m);
        if map.age[index] != AGE_NEVER || near {
            map.age[index] = 0;
            (map.occupancy[index], map.still[index]) = (250, 0);
        }
    });
}

fn over(solids: &[Solid], map: &mut SafetyMap, mut change: impl FnMut(&mut SafetyMap, usize)) {
    for index in 0..SAFETY_CELLS {
        let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        let (x, y) = map.frame().transform(f64::from(x), f64::from(y));
        if distance_m(solids, x, y) < 0.0354 {
            change(map, index);
        }
    }
}

/// An arbiter with all its inputs alive, on a base with dead time and lag.
#[derive(Clone)]
pub(crate) struct Stage {
    pub(crate) robot: Robot,
    pub(crate) arbiter: Arbiter,
    pub(crate) solids: Vec<Solid>,
    /// What nobody has ever seen.
    pub(crate) unseen: Vec<Solid>,
    /// What is on its way now.
    pub(crate) movers: Vec<Solid>,
    pub(crate) now_ns: u64,
    pub(crate) frame: u64,
    pub(crate) pose: Pose2,
    pub(crate) twist: Twist,
    pub(crate) dead_ns: u64,
    pub(crate) brake_m_s2: f32,
    /// Error of the speed, faster or slower, and of the turn rate while it is told to move.
    pub(crate) error: Twist,
    told: Twist,
    pub(crate) wish: Twist,
    pub(crate) goal_status: Status,
    pub(crate) mute: Mute,
    pub(crate) command: Command,
    /// What the last step returned.
    pub(crate) status: Status,
    sent: Vec<(u64, Twist)>,
    dither: u32,
}

/// Inputs that are silent.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Mute {
    pub(crate) map: bool,
    pub(crate) goal: bool,
    pub(crate) policy: bool,
    pub(crate) expert: bool,
    pub(crate) odometry: bool,
}

impl Stage {
    pub(crate) fn new(config: &Config, solids: &[Solid]) -> Self {
        Self::of(config, loomo(), solids, 0)
    }

    pub(crate) fn of(config: &Config, robot: Robot, solids: &[Solid], incarnation: u32) -> Self {
        Self {
            arbiter: Arbiter::new(config, &robot, incarnation).unwrap(),
            brake_m_s2: robot.limits.brake_m_s2,
            robot,
            solids: solids.to_vec(),
            unseen: Vec::new(),
            movers: Vec::new(),
            now_ns: 1000 * MS,
            frame: 0,
            pose: Pose2::ORIGIN,
            twist: Twist::STOP,
            dead_ns: 40 * MS,
            error: Twist::STOP,
            told: Twist::STOP,
            wish: Twist::STOP,
            goal_status: Status::Ok,
            mute: Mute::default(),
            command: Command::default(),
            status: Status::Ok,
            sent: Vec::new(),
            dither: 0,
        }
    }

    pub(crate) fn header(&self, status: Status) -> Header {
        Header { source_frame: self.frame, now_ns: self.now_ns, status: status as u32, ..Header::default() }
    }

    /// The true velocity.
    fn moving(&self) -> Twist {
        let (v, w) = (self.twist.v_m_s, self.twist.w_rad_s);
        let is = |told: f32| told.abs() > 1e-3;
        let by = if is(self.told.v_m_s) { self.error.v_m_s } else { 0.0 };
        let turn = if is(self.told.v_m_s) || is(self.told.w_rad_s) { self.error.w_rad_s } else { 0.0 };
        Twist::new((v.abs() + by).max(0.0).copysign(v), w + turn)
    }

    /// Odometry of the true state; its last bits never stand still.
    pub(crate) fn measure(&mut self) -> Odometry {
        self.dither += 1;
        let mut odometry =
            Odometry { stamp_ns: self.now_ns, pose: self.pose, twist: self.moving(), ..Odometry::default() };
        odometry.pose.x_m += f64::from(self.dither % 2) * 1e-9;
        odometry
    }

    pub(crate) fn proposal(&self) -> Proposal {
        Proposal { capture_ns: self.now_ns, twist: self.wish, ..Proposal::default() }
    }

    /// Gives every input that is not mute; map, goal and proposals every third tick.
    pub(crate) fn feed(&mut self) {
        if !self.mute.odometry {
            let odometry = self.measure();
            self.arbiter.odometry(&odometry, &self.header(Status::Ok));
        }
        if !(self.now_ns / TICK).is_multiple_of(3) {
            return;
        }
        self.frame += 1;
        let ok = self.header(Status::Ok);
        if !self.mute.map {
            let mut map = map_of(&self.solids, &self.pose, self.now_ns);
            hide(&self.unseen, &mut map);
            draw_movers(&self.movers, self.robot.blind_m(), &mut map);
            self.arbiter.safety_map(&map, &ok);
        }
        if !self.mute.goal {
            let goal = LocalGoal {
                capture_ns: self.now_ns,
                x_m: 2.0,
                remaining_m: f32::NAN,
                ..LocalGoal::default()
            };
            self.arbiter.local_goal(&goal, &self.header(self.goal_status));
        }
        let proposal = self.proposal();
        if !self.mute.policy {
            self.arbiter.proposal(Winner::Policy, &proposal, &ok);
        }
        if !self.mute.expert {
            self.arbiter.proposal(Winner::Expert, &proposal, &ok);
        }
    }

    /// One tick: inputs, step, base.
    pub(crate) fn tick(&mut self) -> Command {
        self.feed();
        self.step()
    }

    /// One tick without inputs.
    pub(crate) fn step(&mut self) -> Command {
        let mut command = Command::default();
        self.status = self.arbiter.step(self.now_ns, false, &mut command);
        self.command = command;
        self.sent.push((self.now_ns, command.twist));
        for _ in 0..10 {
            self.advance(MS);
        }
        command
    }

    pub(crate) fn ticks(&mut self, count: usize) -> Command {
        for _ in 0..count {
            self.tick();
        }
        self.command
    }

    /// The base: the last command sent before the dead time, by a first-order lag, braking no harder than it can.
    fn advance(&mut self, by_ns: u64) {
        let dt = by_ns as f32 * 1e-9;
        let known = self.sent.iter().rev().find(|(sent, _)| sent + self.dead_ns <= self.now_ns);
        let told = known.map_or(Twist::STOP, |(_, twist)| *twist);
        self.told = told;
        let follow = 1.0 - libm::expf(-dt / self.robot.actuator.lag_s);
        let change = (told.v_m_s - self.twist.v_m_s) * follow;
        let slowing = change * self.twist.v_m_s < 0.0;
        let most = if slowing { self.brake_m_s2 * dt } else { f32::MAX };
        self.twist.v_m_s += change.clamp(-most, most);
        self.twist.w_rad_s += (told.w_rad_s - self.twist.w_rad_s) * follow;
        self.pose = self.pose.advance(&self.moving(), f64::from(dt));
        self.now_ns += by_ns;
    }

    /// No command comes any more: the base brakes by itself once the last one has run out, along its curve or each axis for
    /// itself, until it rests.
    pub(crate) fn leave_alone(&mut self, is_each_axis: bool) {
        let turn_rad_s2 = self.robot.limits.turn_accelerate_rad_s2;
        for _ in 0..400 {
            let ran_out = self.command.valid_until_ns + self.dead_ns <= self.now_ns;
            if ran_out {
                self.told = Twist::STOP;
                let Twist { v_m_s, w_rad_s } = self.twist;
                let slower = (v_m_s.abs() - self.brake_m_s2 * 0.01).max(0.0);
                let part = if v_m_s.abs() > 1e-4 { slower / v_m_s.abs() } else { 0.0 };
                let turn = (w_rad_s.abs() - turn_rad_s2 * 0.01).max(0.0).copysign(w_rad_s);
                self.twist = Twist::new(v_m_s * part, if is_each_axis { turn } else { w_rad_s * part });
                self.pose = self.pose.advance(&self.twist, 0.01);
                self.now_ns += TICK;
            } else {
                for _ in 0..10 {
                    self.advance(MS);
                }
            }
        }
    }

    /// `[m]` to the nearest solid.
    pub(crate) fn gap_m(&self) -> f64 {
        gap_m(&self.robot, &self.pose, &self.solids)
    }
}

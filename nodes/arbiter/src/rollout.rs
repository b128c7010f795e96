//! Where commands lead a base: members of its identified set side by side, which a processor computes at once.
//!
//! The members differ in dead time, braking and the errors with which they follow what they are told. Each follows the
//! commands on their way, the candidate, then the brake; the commands are the same for all, only their time is not.

use crate::clearance::Heading;
use crate::limits::Limiter;
use crate::tube::{Candidate, Situation};
use sidestep_msgs::{Robot, Twist};

/// `[s]` one step of the simulation.
pub(crate) const STEP_S: f32 = 0.01;
/// Most steps: 8 s, longer than any stop the limits allow.
pub(crate) const STEPS_MAX: usize = 800;
/// `[m/s]` and [rad/s]: slower is rest.
const REST_M_S: f32 = 0.005;
const REST_RAD_S: f32 = 0.01;
/// `[m/s]` and [rad/s]: whoever is told less is told to rest, and does so without an error.
const TOLD: f32 = 1e-3;
/// `[rad]` half of the turn of one step up to which a short series gives sine and cosine.
const SMALL_RAD: f32 = 0.1;

/// How a member comes to rest once the candidate has run out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Stop {
    /// The arbiter commands it, along the curve.
    Told,
    /// Nobody does: each axis stops for itself.
    Alone {
        /// `[s]` from when the candidate was sent.
        after_s: f32,
        /// `[rad/s^2]` fastest change of its turn rate.
        turn_rad_s2: f32,
    },
}

/// A member of the identified set of the actuator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Member {
    /// `[s]` dead time.
    pub(crate) dead_s: f32,
    /// `[m/s^2]` strongest deceleration.
    pub(crate) brake_m_s2: f32,
    /// `[m/s]` how much faster it drives than told to, or slower, but not the other way.
    pub(crate) error_m_s: f32,
    /// `[rad/s]` error of its turn rate while it is told to move.
    pub(crate) error_rad_s: f32,
    pub(crate) stop: Stop,
}

impl Member {
    /// Whether it follows without errors what it is told.
    pub(crate) fn is_faithful(&self) -> bool {
        self.error_m_s == 0.0 && self.error_rad_s == 0.0
    }

    /// Whether two are told the same at the same times.
    fn is_told_like(&self, other: &Self) -> bool {
        self.dead_s.to_bits() == other.dead_s.to_bits() && self.stop == other.stop
    }

    /// `[rad/s]` most that its turn rate changes within a step.
    fn turn_most_rad_s(&self) -> f32 {
        match self.stop {
            Stop::Told => f32::MAX,
            Stop::Alone { turn_rad_s2, .. } => turn_rad_s2 * STEP_S,
        }
    }
}

/// The braking commands that follow a candidate, in steps of [`STEP_S`].
pub(crate) struct Brake {
    twist: Twist,
    speed_m_s: f32,
    along_m_s2: f32,
    hardest_m_s2: f32,
    jerk_m_s3: f32,
    turn_s2: f32,
    now: Twist,
    /// The commands known so far.
    commands: [Twist; STEPS_MAX],
    known: usize,
}

impl Brake {
    pub(crate) fn new(candidate: &Candidate, limiter: &Limiter, robot: &Robot) -> Self {
        let twist = candidate.motion.twist;
        let hardest = limiter.deceleration(twist);
        let along = if candidate.comfort {
            (candidate.motion.acceleration_m_s2 * twist.v_m_s.signum()).max(-hardest)
        } else {
            -hardest
        };
        Self {
            twist,
            speed_m_s: twist.v_m_s.abs(),
            along_m_s2: along,
            hardest_m_s2: hardest,
            jerk_m_s3: robot.limits.comfort_jerk_m_s3,
            turn_s2: robot.limits.turn_accelerate_rad_s2,
            now: twist,
            commands: [Twist::STOP; STEPS_MAX],
            known: 0,
        }
    }

    /// The command of a step; `number` below [`STEPS_MAX`].
    fn at(&mut self, number: usize) -> Twist {
        while self.known <= number {
            self.commands[self.known] = self.next();
            self.known += 1;
        }
        self.commands[number]
    }

    fn next(&mut self) -> Twist {
        let before = self.twist.v_m_s.abs();
        if before < 1e-3 {
            let less = self.turn_s2 * STEP_S;
            self.now.w_rad_s = (self.now.w_rad_s.abs() - less).max(0.0).copysign(self.now.w_rad_s);
            self.now.v_m_s = 0.0;
            return self.now;
        }
        self.along_m_s2 = (self.along_m_s2 - self.jerk_m_s3 * STEP_S).max(-self.hardest_m_s2);
        self.speed_m_s = (self.speed_m_s + self.along_m_s2 * STEP_S).max(0.0);
        let part = self.speed_m_s / before;
        self.now = Twist::new(self.twist.v_m_s * part, self.twist.w_rad_s * part.min(1.0));
        self.now
    }
}

/// What is the same for all members.
pub(crate) struct Course<'a> {
    pub(crate) situation: &'a Situation,
    /// The candidate.
    pub(crate) twist: Twist,
    /// `[s]` how long it holds.
    pub(crate) hold_s: f32,
    /// Part of a difference that the base follows within a step.
    pub(crate) follow: f32,
    /// `[m]` radius of the footprint, widened.
    pub(crate) radius_m: f32,
    /// `[m]` that what moves comes nearer by itself in a step.
    pub(crate) nearer_m: f32,
}

/// Members on their way, in columns. Some of them are at rest already, and are carried along.
pub(crate) struct Rollout<'a, const N: usize> {
    course: &'a Course<'a>,
    members: &'a [Member; N],
    /// Whether a member is told what the one before it is told.
    is_told_like: [bool; N],
    brake_m_s2: [f32; N],
    error_m_s: [f32; N],
    error_rad_s: [f32; N],
    turn_most_rad_s: [f32; N],
    x_m: [f32; N],
    y_m: [f32; N],
    cos: [f32; N],
    sin: [f32; N],
    v_m_s: [f32; N],
    w_rad_s: [f32; N],
    /// How many of the commands on their way have arrived, and steps of the brake.
    arrived: [usize; N],
    braked: [usize; N],
    /// `[m]` most that a point of the footprint moved in the last step.
    pub(crate) step_m: [f32; N],
}

impl<'a, const N: usize> Rollout<'a, N> {
    pub(crate) fn new(course: &'a Course<'a>, members: &'a [Member; N]) -> Self {
        let Situation { at, twist, .. } = course.situation;
        Self {
            course,
            members,
            is_told_like: std::array::from_fn(|member| {
                member.checked_sub(1).is_some_and(|before| members[before].is_told_like(&members[member]))
            }),
            brake_m_s2: members.map(|member| member.brake_m_s2),
            error_m_s: members.map(|member| member.error_m_s),
            error_rad_s: members.map(|member| member.error_rad_s),
            turn_most_rad_s: members.map(|member| member.turn_most_rad_s()),
            x_m: [at.x_m; N],
            y_m: [at.y_m; N],
            cos: [at.cos; N],
            sin: [at.sin; N],
            v_m_s: [twist.v_m_s; N],
            w_rad_s: [twist.w_rad_s; N],
            arrived: [0; N],
            braked: [0; N],
            step_m: [0.0; N],
        }
    }

    pub(crate) fn at(&self, member: usize) -> Heading {
        Heading { x_m: self.x_m[member], y_m: self.y_m[member], cos: self.cos[member], sin: self.sin[member] }
    }

    /// The commands that the members obey at a time: all of `[m/s]`, all of `[rad/s]`.
    pub(crate) fn commands(&mut self, time_s: f32, brake: &mut Brake) -> ([f32; N], [f32; N]) {
        // Columns are filled by loops throughout: a map over an array is a call for every number.
        let (mut v_m_s, mut w_rad_s) = ([0.0f32; N], [0.0f32; N]);
        for member in 0..N {
            if self.is_told_like[member] {
                self.braked[member] = self.braked[member - 1];
                (v_m_s[member], w_rad_s[member]) = (v_m_s[member - 1], w_rad_s[member - 1]);
            } else {
                let command = self.command(member, time_s, brake);
                (v_m_s[member], w_rad_s[member]) = (command.v_m_s, command.w_rad_s);
            }
        }
        (v_m_s, w_rad_s)
    }

    fn command(&mut self, member: usize, time_s: f32, brake: &mut Brake) -> Twist {
        let Course { situation, twist, hold_s, .. } = self.course;
        let Member { dead_s, stop, .. } = self.members[member];
        let begin_s = situation.age_s + dead_s;
        let end_s = match stop {
            Stop::Told => begin_s + hold_s,
            Stop::Alone { after_s, .. } => situation.age_s + after_s,
        };
        if time_s >= end_s {
            self.braked[member] += 1;
            return if stop == Stop::Told { brake.at(self.braked[member] - 1) } else { Twist::STOP };
        }
        if time_s >= begin_s {
            return *twist;
        }
        let pending = &situation.pending[..situation.pending_count.min(situation.pending.len())];
        let arrived = &mut self.arrived[member];
        while pending.get(*arrived).is_some_and(|next| next.sent_s + dead_s <= time_s) {
            *arrived += 1;
        }
        // Before the first known command took effect, the base is assumed to go on as it goes.
        arrived.checked_sub(1).map_or(situation.twist, |last| pending[last].twist)
    }

    /// Whether a member has come to rest at the end of its brake.
    pub(crate) fn rests(&self, member: usize) -> bool {
        let is_slow = self.v_m_s[member].abs() < REST_M_S && self.w_rad_s[member].abs() < REST_RAD_S;
        is_slow && self.braked[member] > 0
    }

    /// Carries all members on by a step, given their commands.
    pub(crate) fn advance(&mut self, command_m_s: &[f32; N], command_rad_s: &[f32; N]) {
        let Course { follow, radius_m, nearer_m, .. } = *self.course;
        let (mut length_m, mut turn_rad) = ([0.0f32; N], [0.0f32; N]);
        // What is chosen is read before: so no number is computed by itself.
        for k in 0..N {
            let (v, w, brake_m_s2) = (self.v_m_s[k], self.w_rad_s[k], self.brake_m_s2[k]);
            let change = (command_m_s[k] - v) * follow;
            let most = if change * v < 0.0 { brake_m_s2 * STEP_S } else { f32::MAX };
            self.v_m_s[k] = v + within(change, most);
            self.w_rad_s[k] = w + within((command_rad_s[k] - w) * follow, self.turn_most_rad_s[k]);
        }
        let mut is_slow = true;
        for k in 0..N {
            let (v, error_m_s, error_rad_s) = (self.v_m_s[k], self.error_m_s[k], self.error_rad_s[k]);
            let drives = command_m_s[k].abs() > TOLD;
            let moves = drives | (command_rad_s[k].abs() > TOLD);
            let speed_m_s = v.abs() + if drives { error_m_s } else { 0.0 };
            let speed_m_s = if speed_m_s < 0.0 { 0.0 } else { speed_m_s };
            length_m[k] = speed_m_s.copysign(v) * STEP_S;
            turn_rad[k] = (self.w_rad_s[k] + if moves { error_rad_s } else { 0.0 }) * STEP_S;
            self.step_m[k] = length_m[k].abs() + turn_rad[k].abs() * radius_m + nearer_m;
            is_slow &= turn_rad[k].abs() <= 2.0 * SMALL_RAD;
        }
        let (mut sin, mut cos) = ([0.0f32; N], [0.0f32; N]);
        if is_slow {
            for k in 0..N {
                (sin[k], cos[k]) = series(0.5 * turn_rad[k]);
            }
        } else {
            // A measured spin beyond any limit.
            for k in 0..N {
                (sin[k], cos[k]) = libm::sincosf(0.5 * turn_rad[k]);
            }
        }
        self.turn(&length_m, &sin, &cos);
    }

    /// Moves along arcs, given sines and cosines of half of each turn.
    fn turn(&mut self, length_m: &[f32; N], half_sin: &[f32; N], half_cos: &[f32; N]) {
        for k in 0..N {
            let (sin, cos) = (half_sin[k], half_cos[k]);
            self.x_m[k] += length_m[k] * (self.cos[k] * cos - self.sin[k] * sin);
            self.y_m[k] += length_m[k] * (self.sin[k] * cos + self.cos[k] * sin);
            let (sin, cos) = (2.0 * sin * cos, 1.0 - 2.0 * sin * sin);
            (self.cos[k], self.sin[k]) =
                (self.cos[k] * cos - self.sin[k] * sin, self.sin[k] * cos + self.cos[k] * sin);
        }
    }
}

/// A number, or what of it lies within `most` of zero.
fn within(number: f32, most: f32) -> f32 {
    let number = if number > most { most } else { number };
    if number < -most { -most } else { number }
}

/// Sine and cosine of an angle up to [`SMALL_RAD`].
fn series(angle_rad: f32) -> (f32, f32) {
    let square = angle_rad * angle_rad;
    let sin = angle_rad * (1.0 - square * (1.0 / 6.0));
    (sin, 1.0 - 0.5 * square + square * square * (1.0 / 24.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clearance::Rows;
    use crate::fixture::loomo;
    use crate::held::Held;
    use crate::limits::Motion;
    use crate::queue::{Pending, SENT_MAX};
    use proptest::prelude::*;
    use sidestep_msgs::SAFETY_SIDE;

    const FREE: Rows = [0; SAFETY_SIDE];

    /// Poses and rest of members on their way, step by step.
    fn ways<const N: usize>(course: &Course<'_>, brake: &Candidate, members: &[Member; N]) -> Vec<[u32; 4]> {
        let robot = loomo();
        let mut brake = Brake::new(brake, &Limiter::new(&robot.limits), &robot);
        let mut rollout = Rollout::new(course, members);
        let mut way = Vec::new();
        for step in 0..300 {
            let (v, w) = rollout.commands(step as f32 * STEP_S, &mut brake);
            way.extend((0..N).map(|member| {
                let at = rollout.at(member);
                [at.x_m.to_bits(), at.y_m.to_bits(), at.sin.to_bits(), u32::from(rollout.rests(member))]
            }));
            rollout.advance(&v, &w);
        }
        way
    }

    /// A situation in the open, of a base that moves at `twist`.
    fn open(twist: Twist) -> Situation {
        Situation {
            at: Heading { x_m: 0.01, y_m: -0.02, cos: 0.8, sin: 0.6 },
            twist,
            age_s: 0.012,
            map_s: 0.0,
            movers: false,
            pending: [Pending::default(); SENT_MAX],
            pending_count: 0,
            margin_m: 0.025,
            error_m: 0.0,
            old_margin_m: 0.025,
            blocked: FREE,
            old: FREE,
            held: Held::NONE,
            taken: FREE,
        }
    }

    /// Nobody commands a base in a curve any more: its turn ends at the rate it can, long before its speed, and both end.
    #[test]
    fn a_base_left_alone_stops_each_axis_for_itself() {
        let robot = loomo();
        let twist = Twist::new(0.9, 1.2);
        let situation = open(twist);
        let course =
            Course { situation: &situation, twist, hold_s: 0.08, follow: 0.1, radius_m: 0.35, nearer_m: 0.0 };
        let stop = Stop::Alone { after_s: 0.08, turn_rad_s2: 3.0 };
        let members = [Member { dead_s: 0.02, brake_m_s2: 0.45, error_m_s: 0.0, error_rad_s: 0.0, stop }];
        let candidate = Candidate { motion: Motion::steady(twist), comfort: true, lately_seen: false };
        let mut brake = Brake::new(&candidate, &Limiter::new(&robot.limits), &robot);
        let mut rollout = Rollout::new(&course, &members);
        let mut stopped = [None; 2];
        for step in 0..400 {
            let before_rad_s = rollout.w_rad_s[0];
            let (v, w) = rollout.commands(step as f32 * STEP_S, &mut brake);
            rollout.advance(&v, &w);
            assert!(before_rad_s - rollout.w_rad_s[0] <= 3.0 * STEP_S + 1e-6);
            for (stopped, speed) in stopped.iter_mut().zip([rollout.v_m_s[0], rollout.w_rad_s[0]]) {
                *stopped = stopped.or((speed < 0.1).then_some(step));
            }
        }
        // From 0.092 s on: 0.8 m/s at 0.45 m/s^2, 1.1 rad/s at 3 rad/s^2.
        let [drive, turn] = stopped.map(Option::unwrap);
        assert!((185..190).contains(&drive) && (45..55).contains(&turn), "{drive} {turn}");
        assert!(rollout.rests(0));
    }

    proptest! {
        /// Side by side or alone, a member goes the same way, bit for bit.
        #[test]
        fn members_side_by_side_go_where_each_goes_alone(
            (v, w) in (-0.2f32..1.0, -1.5f32..1.5),
            (v_now, w_now) in (-0.2f32..1.0, -1.5f32..1.5),
            sent in prop::collection::vec((-0.1f32..0.06, -0.2f32..1.0), 0..5),
            members in prop::array::uniform4((0.02f32..0.1, 0.4f32..1.2, -0.02f32..0.02, -0.05f32..0.05, prop::option::of((0.05f32..0.2, 1.0f32..30.0)))),
            same_dead_time in any::<bool>(),
            comfort in any::<bool>(),
        ) {
            let mut pending = [Pending::default(); SENT_MAX];
            for (pending, (sent_s, v_m_s)) in pending.iter_mut().zip(&sent) {
                *pending = Pending { sent_s: *sent_s, twist: Twist::new(*v_m_s, 0.1) };
            }
            let situation =
                Situation { pending, pending_count: sent.len(), ..open(Twist::new(v_now, w_now)) };
            let twist = Twist::new(v, w);
            let candidate = Candidate { motion: Motion::steady(twist), comfort, lately_seen: false };
            let course = Course {
                situation: &situation,
                twist,
                hold_s: 0.08,
                follow: 0.1,
                radius_m: 0.35,
                nearer_m: 0.0,
            };
            let first_s = members[0].0;
            let members = members.map(|(dead_s, brake_m_s2, error_m_s, error_rad_s, alone)| Member {
                dead_s: if same_dead_time { first_s } else { dead_s },
                brake_m_s2,
                error_m_s,
                error_rad_s,
                stop: alone.map_or(Stop::Told, |(after_s, turn_rad_s2)| Stop::Alone { after_s, turn_rad_s2 }),
            });
            let together = ways(&course, &candidate, &members);
            for (number, member) in members.iter().enumerate() {
                let alone = ways(&course, &candidate, &[*member]);
                let here: Vec<_> = together.iter().skip(number).step_by(4).copied().collect();
                prop_assert_eq!(here, alone);
            }
        }
    }
}

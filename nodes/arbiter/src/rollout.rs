//! Where commands lead a base: members of its identified set side by side, which a processor computes at once.
//!
//! The members differ in dead time and braking. Each follows the commands on their way, the candidate, then the brake;
//! the commands of the brake are the same for all, only their time is not.

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
/// `[rad]` half of the turn of one step up to which a short series gives sine and cosine.
const SMALL_RAD: f32 = 0.1;

/// A member of the identified set of the actuator.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Member {
    /// `[s]` dead time.
    pub(crate) dead_s: f32,
    /// `[m/s^2]` strongest deceleration.
    pub(crate) brake_m_s2: f32,
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
    /// `[m/s]` steady error of the speed.
    pub(crate) tracking_m_s: f32,
    /// `[m]` radius of the footprint, widened.
    pub(crate) radius_m: f32,
    /// `[m]` that what moves comes nearer by itself in a step.
    pub(crate) nearer_m: f32,
}

/// Members on their way, in columns. Some of them are at rest already, and are carried along.
pub(crate) struct Rollout<'a, const N: usize> {
    course: &'a Course<'a>,
    members: &'a [Member; N],
    x_m: [f32; N],
    y_m: [f32; N],
    cos: [f32; N],
    sin: [f32; N],
    v_m_s: [f32; N],
    w_rad_s: [f32; N],
    /// How many of the commands on their way have arrived, and steps of the brake.
    arrived: [usize; N],
    braked: [usize; N],
    /// `[m]` way of the axle.
    pub(crate) path_m: [f32; N],
    /// `[m]` most that a point of the footprint moved in the last step.
    pub(crate) step_m: [f32; N],
}

impl<'a, const N: usize> Rollout<'a, N> {
    pub(crate) fn new(course: &'a Course<'a>, members: &'a [Member; N]) -> Self {
        let Situation { at, twist, .. } = course.situation;
        Self {
            course,
            members,
            x_m: [at.x_m; N],
            y_m: [at.y_m; N],
            cos: [at.cos; N],
            sin: [at.sin; N],
            v_m_s: [twist.v_m_s; N],
            w_rad_s: [twist.w_rad_s; N],
            arrived: [0; N],
            braked: [0; N],
            path_m: [0.0; N],
            step_m: [0.0; N],
        }
    }

    pub(crate) fn at(&self, member: usize) -> Heading {
        Heading { x_m: self.x_m[member], y_m: self.y_m[member], cos: self.cos[member], sin: self.sin[member] }
    }

    /// The commands that the members obey at a time: all of `[m/s]`, all of `[rad/s]`.
    pub(crate) fn commands(&mut self, time_s: f32, brake: &mut Brake) -> ([f32; N], [f32; N]) {
        let commands: [Twist; N] = std::array::from_fn(|member| self.command(member, time_s, brake));
        (commands.map(|command| command.v_m_s), commands.map(|command| command.w_rad_s))
    }

    fn command(&mut self, member: usize, time_s: f32, brake: &mut Brake) -> Twist {
        let Course { situation, twist, hold_s, .. } = self.course;
        let dead_s = self.members[member].dead_s;
        let begin_s = situation.age_s + dead_s;
        if time_s >= begin_s + hold_s {
            self.braked[member] += 1;
            return brake.at(self.braked[member] - 1);
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
        let Course { follow, tracking_m_s, radius_m, nearer_m, .. } = *self.course;
        let (mut length_m, mut turn_rad) = ([0.0f32; N], [0.0f32; N]);
        for k in 0..N {
            let v = self.v_m_s[k];
            let change = (command_m_s[k] - v) * follow;
            let most = if change * v < 0.0 { self.members[k].brake_m_s2 * STEP_S } else { f32::MAX };
            let v = v + change.clamp(-most, most);
            let w = self.w_rad_s[k] + (command_rad_s[k] - self.w_rad_s[k]) * follow;
            (self.v_m_s[k], self.w_rad_s[k]) = (v, w);
            let error = if command_m_s[k].abs() > 1e-3 { tracking_m_s } else { 0.0 };
            length_m[k] = (v + error.copysign(v)) * STEP_S;
            turn_rad[k] = w * STEP_S;
            self.path_m[k] += length_m[k].abs();
            self.step_m[k] = length_m[k].abs() + w.abs() * STEP_S * radius_m + nearer_m;
        }
        let half_rad = turn_rad.map(|turn_rad| 0.5 * turn_rad);
        let half = if half_rad.iter().all(|half_rad| half_rad.abs() <= SMALL_RAD) {
            half_rad.map(series)
        } else {
            // A measured spin beyond any limit.
            half_rad.map(libm::sincosf)
        };
        self.turn(&length_m, &half);
    }

    /// Moves along arcs, given sine and cosine of half of each turn.
    fn turn(&mut self, length_m: &[f32; N], half: &[(f32, f32); N]) {
        for k in 0..N {
            let (sin, cos) = half[k];
            self.x_m[k] += length_m[k] * (self.cos[k] * cos - self.sin[k] * sin);
            self.y_m[k] += length_m[k] * (self.sin[k] * cos + self.cos[k] * sin);
            let (sin, cos) = (2.0 * sin * cos, 1.0 - 2.0 * sin * sin);
            (self.cos[k], self.sin[k]) =
                (self.cos[k] * cos - self.sin[k] * sin, self.sin[k] * cos + self.cos[k] * sin);
        }
    }
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

    proptest! {
        /// Side by side or alone, a member goes the same way, bit for bit.
        #[test]
        fn members_side_by_side_go_where_each_goes_alone(
            (v, w) in (-0.2f32..1.0, -1.5f32..1.5),
            (v_now, w_now) in (-0.2f32..1.0, -1.5f32..1.5),
            sent in prop::collection::vec((-0.1f32..0.06, -0.2f32..1.0), 0..5),
            members in prop::array::uniform4((0.02f32..0.1, 0.4f32..1.2)),
            comfort in any::<bool>(),
        ) {
            let mut pending = [Pending::default(); SENT_MAX];
            for (pending, (sent_s, v_m_s)) in pending.iter_mut().zip(&sent) {
                *pending = Pending { sent_s: *sent_s, twist: Twist::new(*v_m_s, 0.1) };
            }
            let situation = Situation {
                at: Heading { x_m: 0.01, y_m: -0.02, cos: 0.8, sin: 0.6 },
                twist: Twist::new(v_now, w_now),
                age_s: 0.012,
                map_s: 0.0,
                movers: false,
                pending,
                pending_count: sent.len(),
                margin_m: 0.025,
                old_margin_m: 0.025,
                blocked: FREE,
                old: FREE,
                held: Held::NONE,
                taken: FREE,
            };
            let twist = Twist::new(v, w);
            let candidate = Candidate { motion: Motion::steady(twist), comfort, lately_seen: false };
            let course = Course {
                situation: &situation,
                twist,
                hold_s: 0.08,
                follow: 0.1,
                tracking_m_s: 0.01,
                radius_m: 0.35,
                nearer_m: 0.0,
            };
            let members = members.map(|(dead_s, brake_m_s2)| Member { dead_s, brake_m_s2 });
            let together = ways(&course, &candidate, &members);
            for (number, member) in members.iter().enumerate() {
                let alone = ways(&course, &candidate, &[*member]);
                let here: Vec<_> = together.iter().skip(number).step_by(4).copied().collect();
                prop_assert_eq!(here, alone);
            }
        }
    }
}

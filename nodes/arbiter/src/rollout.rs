//! Where commands lead a base: members of its identified set side by side, which a processor computes at once.
//!
//! The members differ in dead time, braking and the errors with which they follow what they are told. Each follows the
//! commands on their way, the candidate, then the brake; the commands are the same for all, only their time is not.

use crate::brake::{Brake, PARTS, Said, TOLD};
use crate::clearance::Heading;
use crate::member::{Fours, LANES, Member, Stop};
use crate::tube::Situation;
use sidestep_msgs::Twist;
use wide::f32x4;

/// `[s]` one step of the simulation.
pub(crate) const STEP_S: f32 = 0.01;
/// Most steps: 8 s, longer than any stop the limits allow.
pub(crate) const STEPS_MAX: usize = 800;
/// Steps that are made before the first of them is looked at: what reads a whole register waits where its numbers were just
/// written one by one.
pub(crate) const STRIDE: usize = 8;
const _: () = assert!(STEPS_MAX.is_multiple_of(STRIDE));
/// `[m/s]` and [rad/s]: slower is rest.
const REST_M_S: f32 = 0.005;
const REST_RAD_S: f32 = 0.01;
/// `[m/s]` and [rad/s]: less is nothing.
const TINY: f32 = 1e-9;
/// `[rad]` half of the turn of one step up to which a short series gives sine and cosine.
const SMALL_RAD: f32 = 0.1;

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

impl Course<'_> {
    /// `[rad/s]` faster than this nobody turns but by an error: each comes nearer to what he is told.
    fn fastest_turn_rad_s(&self) -> f32 {
        let Situation { twist, pending, .. } = self.situation;
        let fastest = self.twist.w_rad_s.abs() + twist.w_rad_s.abs();
        pending.iter().fold(fastest, |fastest, sent| fastest.max(sent.twist.w_rad_s.abs()))
    }
}

/// What four members are told at a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Told {
    pub(crate) v_m_s: f32x4,
    w_rad_s: f32x4,
    /// All bits of a member whose stop has begun and is at its end, none of another.
    rests: f32x4,
}

/// What is true of four members in all steps of a stride, so that less is to be worked out.
#[derive(Debug, Clone, Copy)]
struct Phase {
    /// All are told to drive.
    drive: bool,
    /// Some may be at rest.
    may_rest: bool,
}

/// Where a step of four members begins.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Begin {
    x_m: f32x4,
    y_m: f32x4,
    cos: f32x4,
    sin: f32x4,
    /// `[m]` most that a point of the footprint moved in the step before; infinite for who has come to rest.
    pub(crate) moved_m: f32x4,
    /// All bits of a member that has come to rest at the end of its stop.
    rests: f32x4,
}

impl Begin {
    pub(crate) fn at(&self, lane: usize) -> Heading {
        let of = |column: &f32x4| column.as_array()[lane];
        Heading { x_m: of(&self.x_m), y_m: of(&self.y_m), cos: of(&self.cos), sin: of(&self.sin) }
    }

    pub(crate) fn rests(&self, lane: usize) -> bool {
        self.rests.as_array()[lane].to_bits() != 0
    }
}

/// Four members on their way.
#[derive(Debug, Clone, Copy)]
struct Four {
    x_m: f32x4,
    y_m: f32x4,
    cos: f32x4,
    sin: f32x4,
    v_m_s: f32x4,
    w_rad_s: f32x4,
    moved_m: f32x4,
    /// `[m/s]` and [rad/s] most that braking and turn rate change within a step.
    brake_m_s: f32x4,
    turn_rad_s: f32x4,
    error_m_s: f32x4,
    error_rad_s: f32x4,
}

impl Four {
    fn new(situation: &Situation, members: &[Member; LANES]) -> Self {
        let Situation { at, twist, .. } = situation;
        let each = |of: fn(&Member) -> f32| f32x4::new(members.each_ref().map(of));
        Self {
            x_m: f32x4::splat(at.x_m),
            y_m: f32x4::splat(at.y_m),
            cos: f32x4::splat(at.cos),
            sin: f32x4::splat(at.sin),
            v_m_s: f32x4::splat(twist.v_m_s),
            w_rad_s: f32x4::splat(twist.w_rad_s),
            moved_m: f32x4::ZERO,
            brake_m_s: each(|member| member.brake_m_s2 * STEP_S),
            turn_rad_s: each(|member| member.turn_rad_s2() * STEP_S),
            error_m_s: each(|member| member.error_m_s),
            error_rad_s: each(|member| member.error_rad_s),
        }
    }

    /// Where they are before a step in which they are told something.
    #[inline]
    fn begin(&self, told: &Told, phase: Phase) -> Begin {
        let (x_m, y_m, cos, sin) = (self.x_m, self.y_m, self.cos, self.sin);
        if !phase.may_rest {
            return Begin { x_m, y_m, cos, sin, moved_m: self.moved_m, rests: f32x4::ZERO };
        }
        let is_slow = self.v_m_s.abs().simd_lt(f32x4::splat(REST_M_S))
            & self.w_rad_s.abs().simd_lt(f32x4::splat(REST_RAD_S));
        let rests = is_slow & told.rests;
        let moved_m = rests.bitselect(f32x4::splat(f32::INFINITY), self.moved_m);
        Begin { x_m, y_m, cos, sin, moved_m, rests }
    }

    #[inline]
    fn advance(&mut self, told: &Told, phase: Phase, course: &Course<'_>, is_gentle: bool) {
        let (follow, step_s) = (f32x4::splat(course.follow), f32x4::splat(STEP_S));
        let change = (told.v_m_s - self.v_m_s) * follow;
        let brakes = (change * self.v_m_s).simd_lt(f32x4::ZERO);
        let change = brakes.bitselect(within(change, self.brake_m_s), change);
        self.v_m_s = flushed(self.v_m_s + change);
        self.w_rad_s =
            flushed(self.w_rad_s + within((told.w_rad_s - self.w_rad_s) * follow, self.turn_rad_s));
        let (mut error_m_s, mut error_rad_s) = (self.error_m_s, self.error_rad_s);
        if !phase.drive {
            let drives = told.v_m_s.abs().simd_gt(f32x4::splat(TOLD));
            let moves = drives | told.w_rad_s.abs().simd_gt(f32x4::splat(TOLD));
            (error_m_s, error_rad_s) = (drives & error_m_s, moves & error_rad_s);
        }
        // In this order NaN is NaN.
        let speed_m_s = f32x4::ZERO.fast_max(self.v_m_s.abs() + error_m_s);
        let way_m = speed_m_s * step_s;
        let turn_rad = (self.w_rad_s + error_rad_s) * step_s;
        self.moved_m = way_m + turn_rad.abs() * f32x4::splat(course.radius_m) + f32x4::splat(course.nearer_m);
        let length_m = way_m | (self.v_m_s & f32x4::splat(-0.0));
        let half_rad = turn_rad * f32x4::splat(0.5);
        self.turn(length_m, if is_gentle { series(half_rad) } else { half_turn(turn_rad) });
    }

    /// Moves along arcs, given sines and cosines of half of each turn.
    #[inline]
    fn turn(&mut self, length_m: f32x4, (half_sin, half_cos): (f32x4, f32x4)) {
        let (cos, sin, twice) = (self.cos, self.sin, half_sin + half_sin);
        self.x_m += length_m * (cos * half_cos - sin * half_sin);
        self.y_m += length_m * (sin * half_cos + cos * half_sin);
        let (turn_sin, turn_cos) = (twice * half_cos, f32x4::ONE - twice * half_sin);
        self.cos = cos * turn_cos - sin * turn_sin;
        self.sin = sin * turn_cos + cos * turn_sin;
    }
}

/// Members on their way. Some of them are at rest already, and are carried along.
pub(crate) struct Rollout<'a, const FOURS: usize> {
    course: &'a Course<'a>,
    members: &'a Fours<FOURS>,
    fours: [Four; FOURS],
    /// The steps that were made last: what everyone was told, and where each began.
    pub(crate) told: [[Told; FOURS]; STRIDE],
    pub(crate) begins: [[Begin; FOURS]; STRIDE],
    phases: [Phase; FOURS],
    /// Whether nobody ever turns faster than a short series can tell.
    is_gentle: bool,
    /// Number of the next step.
    next: u32,
    /// Of each member how many of the commands on their way have arrived, and with which step its stop begins.
    arrived: [[usize; LANES]; FOURS],
    stops: [[u32; LANES]; FOURS],
}

impl<'a, const FOURS: usize> Rollout<'a, FOURS> {
    pub(crate) fn new(course: &'a Course<'a>, members: &'a Fours<FOURS>) -> Self {
        let fours = members.each_ref().map(|members| Four::new(course.situation, members));
        let told = Told { v_m_s: f32x4::ZERO, w_rad_s: f32x4::ZERO, rests: f32x4::ZERO };
        let phase = Phase { drive: false, may_rest: false };
        let errors = members.as_flattened().iter().map(|member| member.error_rad_s.abs());
        let most_rad_s = course.fastest_turn_rad_s() + errors.fold(0.0, f32::max);
        Self {
            course,
            members,
            fours,
            told: [[told; FOURS]; STRIDE],
            begins: [fours.each_ref().map(|four| four.begin(&told, phase)); STRIDE],
            phases: [phase; FOURS],
            is_gentle: 0.5 * most_rad_s * STEP_S < 0.99 * SMALL_RAD,
            next: 0,
            arrived: [[0; LANES]; FOURS],
            stops: [[u32::MAX; LANES]; FOURS],
        }
    }

    /// Makes the next steps.
    pub(crate) fn stride(&mut self, brake: &mut Brake) {
        self.tell(brake);
        // A copy, which a processor keeps in its registers.
        let mut fours = self.fours;
        for (begins, told) in self.begins.iter_mut().zip(&self.told) {
            for (((four, begin), told), phase) in fours.iter_mut().zip(begins).zip(told).zip(&self.phases) {
                *begin = four.begin(told, *phase);
                four.advance(told, *phase, self.course, self.is_gentle);
            }
        }
        self.fours = fours;
        self.next += STRIDE as u32;
    }

    /// Works out what everyone is told.
    fn tell(&mut self, brake: &mut Brake) {
        let mut before: Option<Member> = None;
        let mut said = Said::STOP;
        for four in 0..FOURS {
            let mut saids = [said; LANES];
            let mut phase = Phase { drive: true, may_rest: false };
            for (lane, to) in saids.iter_mut().enumerate() {
                let member = self.members[four][lane];
                if before.is_none_or(|before| !before.is_told_like(&member)) {
                    said = self.say(four, lane, brake);
                }
                before = Some(member);
                *to = said;
                phase.drive &= said.drives();
                phase.may_rest |= said.may_rest();
            }
            self.phases[four] = phase;
            for (part, steps) in self.told.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let each = |of: fn(&Said) -> &[f32x4; PARTS]| {
                    f32x4::transpose(saids.each_ref().map(|said| of(said)[part]))
                };
                let (v_m_s, w_rad_s, rests) =
                    (each(|said| &said.v_m_s), each(|said| &said.w_rad_s), each(|said| &said.rests));
                for (step, told) in steps.iter_mut().enumerate() {
                    told[four] = Told { v_m_s: v_m_s[step], w_rad_s: w_rad_s[step], rests: rests[step] };
                }
            }
        }
    }

    /// What a member is told in the next steps.
    fn say(&mut self, four: usize, lane: usize, brake: &mut Brake) -> Said {
        if let Some(number) = self.next.checked_sub(self.stops[four][lane]) {
            return match self.members[four][lane].stop {
                Stop::Told => brake.stride(number as usize),
                Stop::Alone { .. } => Said::STOP,
            };
        }
        let (mut v_m_s, mut w_rad_s, mut stops) = ([0.0; STRIDE], [0.0; STRIDE], [0.0; STRIDE]);
        for step in 0..STRIDE {
            let number = self.next + step as u32;
            let twist = self.command(four, lane, number, brake);
            (v_m_s[step], w_rad_s[step]) = (twist.v_m_s, twist.w_rad_s);
            stops[step] = f32::from_bits(if number >= self.stops[four][lane] { u32::MAX } else { 0 });
        }
        Said::new(&v_m_s, &w_rad_s, &stops)
    }

    /// What a member is told at a step.
    fn command(&mut self, four: usize, lane: usize, step: u32, brake: &mut Brake) -> Twist {
        let Course { situation, twist, hold_s, .. } = self.course;
        let member = self.members[four][lane];
        let time_s = step as f32 * STEP_S;
        if time_s >= member.stops_s(situation.age_s, *hold_s) {
            let first = &mut self.stops[four][lane];
            *first = (*first).min(step);
            return if member.stop == Stop::Told { brake.at((step - *first) as usize) } else { Twist::STOP };
        }
        if time_s >= situation.age_s + member.dead_s {
            return *twist;
        }
        let pending = &situation.pending[..situation.pending_count.min(situation.pending.len())];
        let arrived = &mut self.arrived[four][lane];
        while pending.get(*arrived).is_some_and(|next| next.sent_s + member.dead_s <= time_s) {
            *arrived += 1;
        }
        // Before the first known command took effect, the base is assumed to go on as it goes.
        arrived.checked_sub(1).map_or(situation.twist, |last| pending[last].twist)
    }
}

/// A speed, or zero where it is so small that a processor is slow with its square; NaN is NaN.
#[inline]
fn flushed(speed: f32x4) -> f32x4 {
    speed.abs().simd_le(f32x4::splat(TINY)).bitselect(f32x4::ZERO, speed)
}

/// A number, or what of it lies within `most` of zero; NaN is NaN.
#[inline]
fn within(number: f32x4, most: f32x4) -> f32x4 {
    number.fast_clamp(-most, most)
}

/// Sine and cosine of half of a turn.
#[inline]
fn half_turn(turn_rad: f32x4) -> (f32x4, f32x4) {
    let half = turn_rad * f32x4::splat(0.5);
    if half.abs().simd_le(f32x4::splat(SMALL_RAD)).all() {
        return series(half);
    }
    // A measured spin beyond any limit.
    (f32x4::new(half.to_array().map(libm::sinf)), f32x4::new(half.to_array().map(libm::cosf)))
}

/// Sine and cosine of a small angle.
#[inline]
fn series(angle: f32x4) -> (f32x4, f32x4) {
    let square = angle * angle;
    let sin = angle * (f32x4::ONE - square * f32x4::splat(1.0 / 6.0));
    let cos = f32x4::ONE - square * (f32x4::splat(0.5) - square * f32x4::splat(1.0 / 24.0));
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clearance::Rows;
    use crate::fixture::loomo;
    use crate::held::Held;
    use crate::limits::{Limiter, Motion};
    use crate::queue::{Pending, SENT_MAX};
    use crate::tube::Candidate;
    use proptest::prelude::*;
    use sidestep_msgs::SAFETY_SIDE;

    const FREE: Rows = [0; SAFETY_SIDE];

    /// Poses and rest of members on their way: 304 steps of one after those of the other.
    fn ways<const FOURS: usize>(
        course: &Course<'_>,
        candidate: &Candidate,
        members: &Fours<FOURS>,
    ) -> Vec<Vec<(Heading, bool)>> {
        let robot = loomo();
        let mut brake = Brake::new(candidate, &Limiter::new(&robot.limits), &robot);
        let mut rollout = Rollout::new(course, members);
        let mut ways = vec![Vec::new(); LANES * FOURS];
        for _ in 0..38 {
            rollout.stride(&mut brake);
            for begins in &rollout.begins {
                for (place, way) in ways.iter_mut().enumerate() {
                    let (begin, lane) = (&begins[place / LANES], place % LANES);
                    way.push((begin.at(lane), begin.rests(lane)));
                }
            }
        }
        ways
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
        let twist = Twist::new(0.9, 1.2);
        let situation = open(twist);
        let course =
            Course { situation: &situation, twist, hold_s: 0.08, follow: 0.1, radius_m: 0.35, nearer_m: 0.0 };
        let stop = Stop::Alone { after_s: 0.08, turn_rad_s2: 3.0 };
        let member = Member { dead_s: 0.02, brake_m_s2: 0.45, error_m_s: 0.0, error_rad_s: 0.0, stop };
        let candidate = Candidate { motion: Motion::steady(twist), comfort: true, lately_seen: false };
        let way = &ways(&course, &candidate, &[[member; LANES]])[0];
        let speeds = way.windows(2).map(|pair| {
            let ((from, _), (to, _)) = (pair[0], pair[1]);
            let turned = from.cos * to.sin - from.sin * to.cos;
            [libm::hypotf(to.x_m - from.x_m, to.y_m - from.y_m), libm::asinf(turned)].map(|it| it / STEP_S)
        });
        let mut stopped = [None; 2];
        let mut before_rad_s = twist.w_rad_s;
        for (step, [drive, turn]) in speeds.enumerate() {
            assert!(before_rad_s - turn <= 3.0 * STEP_S + 1e-3, "{step}: {before_rad_s} {turn}");
            before_rad_s = turn;
            for (stopped, speed) in stopped.iter_mut().zip([drive, turn]) {
                *stopped = stopped.or((speed < 0.1).then_some(step));
            }
        }
        // From 0.092 s on: 0.8 m/s at 0.45 m/s^2, 1.1 rad/s at 3 rad/s^2.
        let [drive, turn] = stopped.map(Option::unwrap);
        assert!((185..190).contains(&drive) && (45..55).contains(&turn), "{drive} {turn}");
        assert!(way.last().unwrap().1 && !way[drive].1);
    }

    /// A spin beyond any limit, as an odometry may tell: turned by sine and cosine, as one within them is by their series.
    #[test]
    fn any_turn_is_one_by_its_sine_and_cosine() {
        for half in [1e-12f32, 0.01, 0.0999, 0.1001, 0.7, -3.0] {
            let (sin, cos) = half_turn(f32x4::splat(2.0 * half));
            let off = (sin.as_array()[3] - libm::sinf(half))
                .abs()
                .max((cos.as_array()[0] - libm::cosf(half)).abs());
            assert!(off < 1e-6, "{half}: {off}");
        }
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
            let together = ways(&course, &candidate, &[members, [members[1]; LANES]]);
            for (way, member) in together.iter().zip(members.iter().chain([&members[1]; LANES])) {
                let alone = ways(&course, &candidate, &[[*member; LANES]]);
                prop_assert_eq!(way, &alone[LANES - 1]);
            }
        }
    }
}

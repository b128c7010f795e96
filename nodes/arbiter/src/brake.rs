//! What members of the identified set are told, a stride of steps at a time, and the brake that follows a candidate.

use crate::limits::Limiter;
use crate::rollout::{STEP_S, STEPS_MAX, STRIDE};
use crate::tube::Candidate;
use sidestep_msgs::{Robot, Twist};
use wide::f32x4;

/// Registers that hold a number of each step of a stride.
pub(crate) const PARTS: usize = STRIDE / 4;
const _: () = assert!(STRIDE.is_multiple_of(4));
/// `[m/s]` and [rad/s]: whoever is told less is told to rest, and does so without an error.
pub(crate) const TOLD: f32 = 1e-3;

/// What a member is told in the steps of a stride.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Said {
    pub(crate) v_m_s: [f32x4; PARTS],
    pub(crate) w_rad_s: [f32x4; PARTS],
    /// All bits of a step whose stop has begun and is at its end, none of another.
    pub(crate) rests: [f32x4; PARTS],
}

impl Said {
    /// To stop, of who is told so all the time.
    pub(crate) const STOP: Self = Self {
        v_m_s: [f32x4::ZERO; PARTS],
        w_rad_s: [f32x4::ZERO; PARTS],
        rests: [f32x4::splat(f32::from_bits(u32::MAX)); PARTS],
    };

    /// Speeds and turn rates; `stops` has all bits of a step whose stop has begun.
    pub(crate) fn new(v_m_s: &[f32; STRIDE], w_rad_s: &[f32; STRIDE], stops: &[f32; STRIDE]) -> Self {
        let [v_m_s, w_rad_s, stops] = [v_m_s, w_rad_s, stops].map(|numbers| {
            let parts = numbers.as_chunks().0;
            std::array::from_fn(|part| f32x4::new(parts[part]))
        });
        let is_zero = |part: usize| (v_m_s[part].abs() + w_rad_s[part].abs()).simd_le(f32x4::ZERO);
        Self { v_m_s, w_rad_s, rests: std::array::from_fn(|part| is_zero(part) & stops[part]) }
    }

    /// Whether it is to drive at each step.
    pub(crate) fn drives(&self) -> bool {
        self.v_m_s.iter().all(|v_m_s| v_m_s.abs().simd_gt(f32x4::splat(TOLD)).all())
    }

    /// Whether it may be at rest at the end of its stop.
    pub(crate) fn may_rest(&self) -> bool {
        self.rests.iter().any(|rests| rests.any())
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
    v_m_s: [f32; STEPS_MAX],
    w_rad_s: [f32; STEPS_MAX],
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
            v_m_s: [0.0; STEPS_MAX],
            w_rad_s: [0.0; STEPS_MAX],
            known: 0,
        }
    }

    /// The command of a step; `number` below [`STEPS_MAX`].
    pub(crate) fn at(&mut self, number: usize) -> Twist {
        self.know(number + 1);
        Twist::new(self.v_m_s[number], self.w_rad_s[number])
    }

    /// The commands of a stride, from a step of the stop on.
    pub(crate) fn stride(&mut self, number: usize) -> Said {
        // One more, so that nobody waits for what was just written.
        self.know(number + 2 * STRIDE);
        let of = |commands: &[f32; STEPS_MAX]| {
            let next = commands.get(number..).and_then(|next| next.first_chunk());
            next.copied().unwrap_or([0.0; STRIDE])
        };
        Said::new(&of(&self.v_m_s), &of(&self.w_rad_s), &[f32::from_bits(u32::MAX); STRIDE])
    }

    /// Works out the commands before a step.
    fn know(&mut self, end: usize) {
        while self.known < end.min(STEPS_MAX) {
            let next = self.next();
            (self.v_m_s[self.known], self.w_rad_s[self.known]) = (next.v_m_s, next.w_rad_s);
            self.known += 1;
        }
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

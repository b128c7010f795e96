//! Eq. (6) for sixteen candidates at once: the unicycle rolled out, looked up and summed.
//!
//! The same source is compiled for plain, AVX2 and AVX-512 registers and chosen at start. It uses additions,
//! multiplications, divisions and square roots only, which IEEE 754 rounds in one way, lanes do not mix, and Rust
//! never contracts to fused operations: the kernels give the same bits (a test compares them).

use crate::candidates::{PIECE_STEPS, PIECES, Pieces};
use crate::problem::{Problem, STEP_S, corner_index};
use sidestep_msgs::{LOCAL_GRID, Twist};

/// Candidates rolled out side by side.
pub(crate) const LANES: usize = 16;
/// 1.5 * 2^23: adding it leaves the nearest integer in the low bits.
const ROUND: f32 = 12_582_912.0;
/// `[m]` inside this distance from the goal the heading to it fades out, since it is undefined at the goal.
const FADE_M: f32 = 0.25;

/// Sixteen candidates.
#[repr(align(64))]
#[derive(Debug, Clone)]
pub(crate) struct Group {
    /// `[m/s]` target speed, by piece and lane.
    v: [[f32; LANES]; PIECES],
    /// `[rad/s]` target turn rate.
    w: [[f32; LANES]; PIECES],
}

impl Group {
    /// Sixteen times standing still.
    pub(crate) const STOP: Self = Self { v: [[0.0; LANES]; PIECES], w: [[0.0; LANES]; PIECES] };

    pub(crate) fn set(&mut self, lane: usize, pieces: &Pieces) {
        for (piece, twist) in pieces.iter().enumerate() {
            self.v[piece][lane] = twist.v_m_s;
            self.w[piece][lane] = twist.w_rad_s;
        }
    }

    pub(crate) fn get(&self, lane: usize) -> Pieces {
        std::array::from_fn(|piece| Twist::new(self.v[piece][lane], self.w[piece][lane]))
    }
}

/// What came of sixteen candidates.
#[repr(align(64))]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scores {
    /// J of eq. (6) with the limit as penalty.
    pub(crate) cost: [f32; LANES],
    /// `[1/255]` largest planning cost met.
    pub(crate) worst: [f32; LANES],
}

impl Scores {
    pub(crate) const NONE: Self = Self { cost: [f32::INFINITY; LANES], worst: [f32::INFINITY; LANES] };
}

// Plain selections: one machine instruction each, unlike the NaN rules of f32::min and max; nothing here is NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn clipped(value: f32, least: f32, most: f32) -> f32 {
    smaller(larger(value, least), most)
}

/// Cell and part of a cell along one axis: low bits and remainder, for a position counted in ringed cells.
#[inline(always)]
fn split(position: f32) -> (u32, f32) {
    let inside = clipped(position, 0.0, 29.0);
    let shifted = (inside - 0.5) + ROUND;
    (shifted.to_bits() & 31, inside - (shifted - ROUND))
}

/// `[1/255]` planning cost at a point of `base`, bilinear between cell centres.
#[inline(always)]
pub(crate) fn look_up(problem: &Problem, x_m: f32, y_m: f32) -> f32 {
    const PER_M: f32 = 10.0;
    // Cell centres lie half a cell off the edges; the ring adds one.
    const REAR: f32 = 0.5 - LOCAL_GRID.rear_m * PER_M;
    const RIGHT: f32 = 0.5 - LOCAL_GRID.right_m * PER_M;
    let (forward, part_x) = split(x_m * PER_M + REAR);
    let (left, part_y) = split(y_m * PER_M + RIGHT);
    let place = problem.corners.0[corner_index(forward, left)];
    let byte = |shift: u32| ((place >> shift) & 255) as i32 as f32;
    let (behind_right, behind_left, ahead_right, ahead_left) = (byte(0), byte(8), byte(16), byte(24));
    let behind = behind_right + part_y * (behind_left - behind_right);
    let ahead = ahead_right + part_y * (ahead_left - ahead_right);
    behind + part_x * (ahead - behind)
}

/// Sine and cosine of the turn within one step (at most 0.6 rad), to 1e-6.
#[inline(always)]
fn small_sin_cos(turn: f32) -> (f32, f32) {
    let t = turn * turn;
    let sin = turn * (1.0 - t * (1.0 / 6.0) * (1.0 - t * (1.0 / 20.0) * (1.0 - t * (1.0 / 42.0))));
    let cos = 1.0 - t * 0.5 * (1.0 - t * (1.0 / 12.0) * (1.0 - t * (1.0 / 30.0)));
    (sin, cos)
}

/// |angle| of the direction (along, across), 0 to pi, to 4e-6; 0 for no direction.
#[inline(always)]
fn bearing(along: f32, across: f32) -> f32 {
    use std::f32::consts::{FRAC_PI_2, PI};
    let (a, b) = (along.abs(), across.abs());
    let part = smaller(a, b) / larger(larger(a, b), 1e-20);
    let t = part * part;
    // Minimax polynomial of atan on [0, 1] (after Hastings, Approximations for Digital Computers).
    let atan = part
        * (0.999_977_26
            + t * (-0.332_623_47
                + t * (0.193_543_46 + t * (-0.116_432_87 + t * (0.052_653_32 + t * -0.011_721_2)))));
    let acute = if b > a { FRAC_PI_2 - atan } else { atan };
    if along < 0.0 { PI - acute } else { acute }
}

/// Position, heading and velocity of sixteen robots.
struct Lanes {
    x: [f32; LANES],
    y: [f32; LANES],
    cos: [f32; LANES],
    sin: [f32; LANES],
    v: [f32; LANES],
    w: [f32; LANES],
}

/// Rolls out one group; the one source of all kernels.
#[inline(always)]
fn roll(problem: &Problem, group: &Group, scores: &mut Scores) {
    let from = problem.from;
    let mut s = Lanes {
        x: [0.0; LANES],
        y: [0.0; LANES],
        cos: [1.0; LANES],
        sin: [0.0; LANES],
        v: [from.v_m_s; LANES],
        w: [from.w_rad_s; LANES],
    };
    let limit = problem.weights.limit * 255.0;
    let (mut sum, mut excess, mut change, mut worst) =
        ([0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
    for ((steps, target_v), target_w) in PIECE_STEPS.into_iter().zip(&group.v).zip(&group.w) {
        for _ in 0..steps {
            for i in 0..LANES {
                let dv = clipped(target_v[i] - s.v[i], -problem.step.v_m_s, problem.step.v_m_s);
                let dw = clipped(target_w[i] - s.w[i], -problem.step.w_rad_s, problem.step.w_rad_s);
                let (v, w) = (s.v[i] + dv, s.w[i] + dw);
                let turn = w * STEP_S;
                let (sin, cos) = small_sin_cos(turn);
                let cos_next = s.cos[i] * cos - s.sin[i] * sin;
                let sin_next = s.sin[i] * cos + s.cos[i] * sin;
                // The chord of the arc: mean of both headings, lengthened to sin(a)/a of the half turn.
                let half_step = (0.5 * STEP_S) * v * (1.0 + turn * turn * (1.0 / 12.0));
                let x = s.x[i] + half_step * (s.cos[i] + cos_next);
                let y = s.y[i] + half_step * (s.sin[i] + sin_next);
                let met = look_up(problem, x, y);
                sum[i] += met;
                excess[i] += larger(met - limit, 0.0);
                worst[i] = larger(worst[i], met);
                change[i] += (dv * dv + dw * dw).sqrt();
                (s.x[i], s.y[i], s.cos[i], s.sin[i], s.v[i], s.w[i]) = (x, y, cos_next, sin_next, v, w);
            }
        }
    }
    let weights = &problem.weights;
    for i in 0..LANES {
        let (dx, dy) = (problem.goal_x_m - s.x[i], problem.goal_y_m - s.y[i]);
        let distance = (dx * dx + dy * dy).sqrt();
        let heading = bearing(s.cos[i] * dx + s.sin[i] * dy, s.cos[i] * dy - s.sin[i] * dx);
        let fade = smaller(distance * (1.0 / FADE_M), 1.0);
        scores.cost[i] = (sum[i] + weights.penalty * excess[i]) * (1.0 / 255.0)
            + weights.distance_per_m * distance
            + weights.heading_per_rad * heading * fade
            + weights.change * change[i];
    }
    scores.worst = worst;
}

#[inline(always)]
fn roll_all(problem: &Problem, groups: &[Group], scores: &mut [Scores]) {
    for (group, score) in groups.iter().zip(scores) {
        roll(problem, group, score);
    }
}

/// Which registers the rollout uses; the answers are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kernel {
    Plain,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Kernel {
    /// Those that this processor can run, the fastest last.
    pub(crate) fn available() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let more = [
            std::is_x86_feature_detected!("avx2").then_some(Self::Avx2),
            std::is_x86_feature_detected!("avx512f").then_some(Self::Avx512),
        ];
        #[cfg(not(target_arch = "x86_64"))]
        let more = [None, None];
        std::iter::once(Self::Plain).chain(more.into_iter().flatten())
    }

    /// The fastest one.
    pub(crate) fn best() -> Self {
        Self::available().last().unwrap_or(Self::Plain)
    }

    /// Evaluates groups of candidates.
    #[inline]
    pub(crate) fn evaluate(self, problem: &Problem, groups: &[Group], scores: &mut [Scores]) {
        match self {
            Self::Plain => roll_plain(problem, groups, scores),
            #[cfg(target_arch = "x86_64")]
            #[allow(
                unsafe_code,
                reason = "`available` names a kernel only where the processor has its instructions"
            )]
            Self::Avx2 => unsafe { roll_avx2(problem, groups, scores) },
            #[cfg(target_arch = "x86_64")]
            #[allow(
                unsafe_code,
                reason = "`available` names a kernel only where the processor has its instructions"
            )]
            Self::Avx512 => unsafe { roll_avx512(problem, groups, scores) },
        }
    }
}

fn roll_plain(problem: &Problem, groups: &[Group], scores: &mut [Scores]) {
    roll_all(problem, groups, scores);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn roll_avx2(problem: &Problem, groups: &[Group], scores: &mut [Scores]) {
    roll_all(problem, groups, scores);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn roll_avx512(problem: &Problem, groups: &[Group], scores: &mut [Scores]) {
    roll_all(problem, groups, scores);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bearing_is_that_of_atan2() {
        for degree in -180..=180 {
            let angle = (degree as f32).to_radians();
            let (sin, cos) = libm::sincosf(angle);
            assert!((bearing(cos, sin) - angle.abs()).abs() < 4e-6, "{degree}: {}", bearing(cos, sin));
        }
        assert!(bearing(0.0, 0.0).abs() < 1e-9);
    }

    #[test]
    fn the_small_turn_is_that_of_libm() {
        for milli in -600..=600 {
            let turn = milli as f32 * 1e-3;
            let (sin, cos) = small_sin_cos(turn);
            assert!((sin - libm::sinf(turn)).abs() < 2e-6 && (cos - libm::cosf(turn)).abs() < 2e-6, "{turn}");
        }
    }
}

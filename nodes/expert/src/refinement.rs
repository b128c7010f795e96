//! Pattern search: improves a candidate in all its six numbers, sixteen probes at a time.

use crate::candidates::{PIECES, Pieces};
use crate::problem::Problem;
use crate::rollout::{Group, Kernel, LANES, Scores};
use sidestep_msgs::{Limits, Twist};

/// Largest step of the search, as part of the range.
const STEP_FIRST: f32 = 0.25;
/// The step shrinks by this where no probe of a round is better.
const SHRINK: f32 = 0.6;
/// Below this step the search has converged.
const STEP_LAST: f32 = 0.004;

/// A candidate with its worth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scored {
    pub(crate) pieces: Pieces,
    pub(crate) cost: f32,
    /// `[1/255]`
    pub(crate) worst: f32,
}

/// Parts of the range by which a probe moves (v, w) of each piece.
type Direction = [[f32; 2]; PIECES];

/// Directions of even rounds: each of the six numbers alone, all speeds, all turn rates. Both ways each.
const ALONE: [Direction; LANES / 2] = [
    [[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]],
    [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]],
    [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
    [[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
    [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]],
    [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]],
    [[1.0, 0.0], [1.0, 0.0], [1.0, 0.0]],
    [[0.0, 1.0], [0.0, 1.0], [0.0, 1.0]],
];

/// Directions of odd rounds: numbers that trade with each other. Both ways each.
const TOGETHER: [Direction; LANES / 2] = [
    [[0.0, 1.0], [0.0, -1.0], [0.0, 0.0]],
    [[0.0, 0.0], [0.0, 1.0], [0.0, -1.0]],
    [[0.0, 1.0], [0.0, 1.0], [0.0, 0.0]],
    [[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]],
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]],
    [[1.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
    [[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]],
    [[1.0, -1.0], [0.0, 0.0], [0.0, 0.0]],
];

/// What a search may choose from: the least and the largest velocity of each piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Range {
    pub(crate) low: Pieces,
    pub(crate) high: Pieces,
}

impl Range {
    /// Everything that a robot can do driving forward.
    pub(crate) fn whole(limits: &Limits) -> Self {
        let (v, w) = (limits.forward_m_s, limits.turn_rad_s);
        Self { low: [Twist::new(0.0, -w); PIECES], high: [Twist::new(v, w); PIECES] }
    }

    /// The nearest pieces within the range.
    pub(crate) fn clamped(&self, pieces: &Pieces) -> Pieces {
        std::array::from_fn(|piece| {
            let (low, high) = (self.low[piece], self.high[piece]);
            Twist::new(
                pieces[piece].v_m_s.clamp(low.v_m_s, high.v_m_s),
                pieces[piece].w_rad_s.clamp(low.w_rad_s, high.w_rad_s),
            )
        })
    }
}

fn moved(pieces: &Pieces, parts: &Direction, step: f32, limits: &Limits, range: &Range) -> Pieces {
    range.clamped(&std::array::from_fn(|piece| {
        let [v, w] = parts[piece];
        Twist::new(
            pieces[piece].v_m_s + v * step * limits.forward_m_s,
            pieces[piece].w_rad_s + w * step * limits.turn_rad_s,
        )
    }))
}

/// The lane of lowest cost, the first of equals.
pub(crate) fn best_lane(scores: &Scores) -> usize {
    let mut best = 0;
    for lane in 1..LANES {
        if scores.cost[lane] < scores.cost[best] {
            best = lane;
        }
    }
    best
}

/// Improves `start` for at most `rounds` rounds of sixteen probes; never worse. Returns the rounds used.
pub(crate) fn improve(
    kernel: Kernel,
    problem: &Problem,
    limits: &Limits,
    range: &Range,
    start: &mut Scored,
    rounds: usize,
) -> usize {
    let (mut group, mut scores) = ([Group::STOP], [Scores::NONE]);
    let mut step = STEP_FIRST;
    let mut directions = [&ALONE, &TOGETHER];
    for round in 0..rounds {
        if step < STEP_LAST {
            return round;
        }
        for (number, parts) in directions[0].iter().enumerate() {
            group[0].set(2 * number, &moved(&start.pieces, parts, step, limits, range));
            group[0].set(2 * number + 1, &moved(&start.pieces, parts, -step, limits, range));
        }
        kernel.evaluate(problem, &group, &mut scores);
        let lane = best_lane(&scores[0]);
        if scores[0].cost[lane] < start.cost {
            *start = Scored {
                pieces: group[0].get(lane),
                cost: scores[0].cost[lane],
                worst: scores[0].worst[lane],
            };
        } else {
            step *= SHRINK;
            directions.swap(0, 1);
        }
    }
    rounds
}

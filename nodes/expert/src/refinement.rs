//! Pattern search: improves a candidate in all its six numbers, sixteen probes at a time.

use crate::candidates::{PIECES, Pieces};
use crate::problem::Problem;
use crate::rollout::{Group, Kernel, LANES, Scores};
use sidestep_msgs::{Limits, Twist};

/// Largest step of the search, as part of the range.
const STEP_FIRST: f32 = 0.25;
/// Below this step the search has converged.
const STEP_LAST: f32 = 0.004;

/// A candidate with its worth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scored {
    pub(crate) pieces: Pieces,
    pub(crate) cost: f32,
    /// [1/255]
    pub(crate) worst: f32,
}

/// The direction of probe `lane`, as parts of the range of (v, w) per piece.
///
/// Each of the six numbers up and down, then all speeds and all turn rates together.
const fn direction(lane: usize) -> [[f32; 2]; PIECES] {
    let sign = if lane % 2 == 0 { 1.0 } else { -1.0 };
    let mut parts = [[0.0; 2]; PIECES];
    let number = lane / 2;
    if number < 2 * PIECES {
        parts[number / 2][number % 2] = sign;
    } else {
        let mut piece = 0;
        while piece < PIECES {
            parts[piece][number - 2 * PIECES] = sign;
            piece += 1;
        }
    }
    parts
}

/// The directions of all probes.
const DIRECTIONS: [[[f32; 2]; PIECES]; LANES] = {
    let mut all = [[[0.0; 2]; PIECES]; LANES];
    let mut lane = 0;
    while lane < LANES {
        all[lane] = direction(lane);
        lane += 1;
    }
    all
};

fn moved(pieces: &Pieces, parts: &[[f32; 2]; PIECES], step: f32, limits: &Limits) -> Pieces {
    std::array::from_fn(|piece| {
        let [v, w] = parts[piece];
        Twist::new(
            (pieces[piece].v_m_s + v * step * limits.forward_m_s).clamp(0.0, limits.forward_m_s),
            (pieces[piece].w_rad_s + w * step * limits.turn_rad_s).clamp(-limits.turn_rad_s, limits.turn_rad_s),
        )
    })
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
    start: &mut Scored,
    rounds: usize,
) -> usize {
    let (mut group, mut scores) = ([Group::STOP], [Scores::NONE]);
    let mut step = STEP_FIRST;
    for round in 0..rounds {
        if step < STEP_LAST {
            return round;
        }
        for (lane, parts) in DIRECTIONS.iter().enumerate() {
            group[0].set(lane, &moved(&start.pieces, parts, step, limits));
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
            step *= 0.5;
        }
    }
    rounds
}

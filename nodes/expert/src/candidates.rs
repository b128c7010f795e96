//! The candidates of eq. (6): which velocities are tried, in which order.
//!
//! A candidate is three pieces of target velocity, approached within the limits of acceleration. The list is one
//! endless sequence and a count takes its beginning, so more candidates contain fewer and can never be worse. It
//! holds standing still, full speed ahead, then pairs that mirror each other, by turns an arc (one target) and a
//! two-piece candidate; both fill their ranges with the R sequence of M. Roberts (low discrepancy, additions only).

use crate::rollout::{Group, LANES};
use sidestep_msgs::{Limits, Twist};

/// Pieces of a candidate.
pub const PIECES: usize = 3;
/// `[0.1 s]` length of each piece: knots at 0, 0.6 and 1.2 s, where more freedom no longer pays (measured).
pub const PIECE_STEPS: [usize; PIECES] = [6, 6, 12];

/// Target velocities of the three pieces.
pub(crate) type Pieces = [Twist; PIECES];

/// 1/g and its powers, g the root of x^3 = x + 1: steps of the sequence in two dimensions.
const STEPS_2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
/// The same in four dimensions, g the root of x^5 = x + 1.
const STEPS_4: [f64; 4] =
    [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_275_692_9, 0.538_597_256_787_331_3];

/// Point number `index` of the sequence, one coordinate.
fn spread(index: usize, step: f64) -> f32 {
    let position = 0.5 + (index as f64 + 1.0) * step;
    (position - position.floor()) as f32
}

/// Stretches [0, 1] beyond both ends and clips: the best velocities often lie on a limit.
fn stretched(part: f32, below: f32, above: f32) -> f32 {
    (part * (1.0 + below + above) - below).clamp(0.0, 1.0)
}

/// The left half of pair number `pair`.
fn left_of_pair(pair: usize, limits: &Limits) -> Pieces {
    let (v, w) = (limits.forward_m_s, limits.turn_rad_s);
    let index = pair / 2;
    if pair.is_multiple_of(2) {
        let speed = v * stretched(spread(index, STEPS_2[0]), 0.1, 0.3);
        let turn = w * stretched(spread(index, STEPS_2[1]), 0.0, 0.2);
        return [Twist::new(speed, turn); PIECES];
    }
    let part = STEPS_4.map(|step| spread(index, step));
    let first = Twist::new(v * stretched(part[0], 0.1, 0.3), w * stretched(part[1], 0.0, 0.2));
    let later = Twist::new(v * stretched(part[2], 0.1, 0.3), w * (2.0 * stretched(part[3], 0.1, 0.1) - 1.0));
    if index.is_multiple_of(2) { [first, later, later] } else { [first, first, later] }
}

/// Candidate number `index` of the sequence.
pub(crate) fn candidate(index: usize, limits: &Limits) -> Pieces {
    match index {
        0 => [Twist::STOP; PIECES],
        1 => [Twist::new(limits.forward_m_s, 0.0); PIECES],
        _ => {
            let left = left_of_pair(index / 2 - 1, limits);
            if index.is_multiple_of(2) { left } else { left.map(|twist| twist.mirrored()) }
        }
    }
}

/// Candidates in lanes; the last group is filled up by standing still.
pub(crate) fn groups(numbers: impl ExactSizeIterator<Item = usize>, limits: &Limits) -> Vec<Group> {
    let mut groups = vec![Group::STOP; numbers.len().div_ceil(LANES)];
    for (place, number) in numbers.enumerate() {
        groups[place / LANES].set(place % LANES, &candidate(number, limits));
    }
    groups
}

/// The numbers of the first `count` candidates of the sequence that are arcs: one target all along.
#[must_use]
pub fn arc_numbers(count: usize) -> Vec<usize> {
    let is_arc = |number: &usize| *number < 2 || (number / 2 - 1).is_multiple_of(2);
    (0..).filter(is_arc).take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::LOOMO;

    #[test]
    fn candidates_come_in_mirrored_pairs_within_the_limits() {
        for index in 2..10_000 {
            let pieces = candidate(index, &LOOMO);
            assert_eq!(pieces.map(|twist| twist.mirrored()), candidate(index ^ 1, &LOOMO));
            for twist in pieces {
                assert!(
                    (0.0..=LOOMO.forward_m_s).contains(&twist.v_m_s)
                        && twist.w_rad_s.abs() <= LOOMO.turn_rad_s
                );
            }
        }
    }

    #[test]
    fn half_of_the_734_are_arcs() {
        let arcs = (0..734)
            .filter(|&index| candidate(index, &LOOMO).iter().all(|t| *t == candidate(index, &LOOMO)[0]));
        assert!((366..=370).contains(&arcs.count()));
    }
}

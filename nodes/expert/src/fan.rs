//! The candidates as curves on the floor, for whoever looks on.

use crate::candidates::candidate;
use crate::planner::follow;
use crate::problem::{HORIZON_STEPS, STEP_S};
use sidestep_msgs::{Limits, Twist};

/// Steps from one point of a curve to the next.
const STRIDE: usize = 4;

/// About `shown` of the first `candidates` candidates, in mirrored pairs, rolled out from a velocity: points (x, y) in metres
/// in `base`, the first at the robot, one per 0.4 s.
///
/// Empty for a velocity that is not finite.
#[must_use]
pub fn fan(limits: &Limits, candidates: usize, shown: usize, from: Twist) -> Vec<Vec<[f32; 2]>> {
    if !from.is_finite() {
        return Vec::new();
    }
    let step = Twist::new(limits.accelerate_m_s2 * STEP_S, limits.turn_accelerate_rad_s2 * STEP_S);
    let pairs = candidates / 2;
    // An odd stride takes arcs and candidates of two pieces by turns.
    let every = (pairs / (shown / 2).max(1)).max(1) | 1;
    let indices = (0..pairs).step_by(every).flat_map(|pair| [2 * pair, 2 * pair + 1]);
    let curve = |index| {
        let poses = follow(&candidate(index, limits), from, step);
        let points = poses.iter().skip(STRIDE - 1).step_by(STRIDE);
        std::iter::once([0.0; 2]).chain(points.map(|pose| [pose.x_m as f32, pose.y_m as f32])).collect()
    };
    indices.map(curve).collect()
}

const _: () = assert!(HORIZON_STEPS.is_multiple_of(STRIDE));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::LOOMO;

    #[test]
    fn a_fan_is_symmetric_within_reach_and_of_about_the_number_asked_for() {
        let curves = fan(&LOOMO, 734, 150, Twist::new(0.5, 0.0));
        assert!((130..=170).contains(&curves.len()), "{}", curves.len());
        for pair in curves.chunks_exact(2).skip(1) {
            for (left, right) in pair[0].iter().zip(&pair[1]) {
                assert!((left[0] - right[0]).abs() < 1e-5 && (left[1] + right[1]).abs() < 1e-5, "{pair:?}");
            }
        }
        for curve in &curves {
            let end = curve[curve.len() - 1];
            assert_eq!(curve.len(), 1 + HORIZON_STEPS / STRIDE);
            assert!(libm::hypotf(end[0], end[1]) <= 2.4 * LOOMO.forward_m_s + 1e-3, "{end:?}");
        }
        assert!(fan(&LOOMO, 734, 150, Twist::new(f32::NAN, 0.0)).is_empty());
    }
}

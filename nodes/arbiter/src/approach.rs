//! How much nearer to what stands too near the robot has come by its own motion: what the errors of its base are granted
//! there is granted once, not at each start anew.

use bytemuck::{Pod, Zeroable};
use sidestep_msgs::Pose2;

/// `[m]` a longer way from one step to the next is a jump of the pose, not a motion.
const JUMP_M: f64 = 0.05;

/// The last pose, and what was taken.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Approach {
    /// In `odom`.
    last: Pose2,
    /// `[m]` nearer than where the robot came too near, or than the farthest since.
    pub(crate) taken_m: f32,
    /// 1 once there is a last pose.
    is_known: u32,
}

impl Approach {
    /// Notes a pose; `room_m` tells the widening with which the robot stands free at one, `full_m` at most. Both poses are
    /// asked of the same map, so that what a map shows anew is no motion.
    pub(crate) fn note(&mut self, pose: &Pose2, full_m: f32, room_m: impl Fn(&Pose2) -> f32) {
        let now_m = room_m(pose);
        if now_m >= full_m {
            self.taken_m = 0.0;
        } else if self.is_known != 0 && pose.distance_m(&self.last) < JUMP_M {
            self.taken_m = (self.taken_m + room_m(&self.last) - now_m).max(0.0);
        }
        (self.last, self.is_known) = (*pose, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall in the way of x: nearer adds up, farther takes off, and only a full widening forgives. A jump and what is
    /// seen anew are no motion.
    #[test]
    fn what_was_taken_adds_up_until_nothing_is_near() {
        let mut approach = Approach::zeroed();
        let mut wall_m = 0.02f32;
        for (x_m, moves_m, expected_m) in [
            (0.0, 0.0, 0.0),
            (0.001, 0.0, 0.001),
            (0.002, 0.0, 0.002),
            (0.002, -0.01, 0.002),
            (0.0005, 0.0, 0.0005),
            (-0.003, 0.0, 0.0),
            (-0.002, 0.0, 0.001),
            (-0.1, 0.2, 0.0),
            (-0.1, -0.2, 0.0),
            (0.0, 0.0, 0.0),
        ] {
            wall_m += moves_m;
            approach.note(&Pose2::new(x_m, 0.0, 0.0), 0.028, |pose| (wall_m - pose.x_m as f32).min(0.028));
            assert!((approach.taken_m - expected_m).abs() < 1e-6, "{x_m}: {approach:?}");
        }
    }
}

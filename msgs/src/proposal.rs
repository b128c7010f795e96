//! What policy and expert would like to do.

use crate::geometry::Twist;
use crate::layout::{ZeroCopySend, record};
use crate::robot::Limits;

/// Most poses of a proposed trajectory.
pub const TRAJECTORY_MAX: usize = 32;
/// `[s]` the window of the label: a proposal is a velocity reachable within this time from u'.
pub const WINDOW_S: f32 = 0.3;

record! {
    /// A wish for the velocity of the base; only the arbiter turns it into a command.
    ///
    /// Frame: `base`; trajectory in `base` at `capture_ns`. Writers: `policy` and `expert`, each on its own topic.
    /// Reader: `arbiter`.
    pub struct Proposal("sidestep/Proposal/1") {
        /// `[ns]` graph time of the map that this answers.
        pub capture_ns: u64,
        /// The proposed velocity, within the window around u'.
        pub twist: Twist,
        /// `[m/s]` expected error of v; NaN where the proposer has no measure of doubt.
        pub doubt_v_m_s: f32,
        /// `[rad/s]` expected error of w; NaN where the proposer has no measure of doubt.
        pub doubt_w_rad_s: f32,
        /// `[1]` cost J of eq. (6) of the proposal; NaN for the policy.
        pub cost: f32,
        /// Candidates evaluated; 0 for the policy.
        pub evaluated: u32,
        /// `[0, 32]` poses used in the trajectory.
        pub trajectory_count: u32,
        /// Zero.
        pub _pad: u32,
        /// `[m]` x of each pose, one per 0.1 s, the first at 0.1 s.
        pub trajectory_x_m: [f32; TRAJECTORY_MAX],
        /// `[m]` y of each pose.
        pub trajectory_y_m: [f32; TRAJECTORY_MAX],
        /// `[rad]` yaw of each pose.
        pub trajectory_yaw_rad: [f32; TRAJECTORY_MAX],
    }
}

/// Clamps a wish to what can be reached from `from` within [`WINDOW_S`], and to the limits of speed and turn rate.
///
/// One function for both proposers, so that a comparison compares like with like.
#[must_use]
pub fn clamp_to_window(wish: Twist, from: Twist, limits: &Limits) -> Twist {
    let dv = limits.accelerate_m_s2 * WINDOW_S;
    let dw = limits.turn_accelerate_rad_s2 * WINDOW_S;
    Twist {
        v_m_s: wish
            .v_m_s
            .clamp(from.v_m_s - dv, from.v_m_s + dv)
            .clamp(-limits.reverse_m_s, limits.forward_m_s),
        w_rad_s: wish
            .w_rad_s
            .clamp(from.w_rad_s - dw, from.w_rad_s + dw)
            .clamp(-limits.turn_rad_s, limits.turn_rad_s),
    }
}

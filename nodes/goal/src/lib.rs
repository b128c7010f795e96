//! The goal: turns a path or a person into the one local goal per map that policy and expert head for.
//!
//! Inputs: `path`, `target`, `odometry` as they come, and one `local_map` per step. Output: one `LocalGoal` per step,
//! in `base` at the map's capture stamp, with its cell after the projection of paper eq. (3) and with the velocity that
//! policy and expert must use for this frame. All numbers of an answer are finite, except that `remaining_m` is NaN
//! where there is no path.
//!
//! Promises: progress along a path never runs back; a waypoint never lies in an obstacle; a mirrored world gives the
//! mirrored cell; no allocation after construction; no panic for any input.

mod config;
mod facing;
mod follower;
mod goal;
mod node;
mod projection;
mod sight;
mod standby;
#[cfg(test)]
mod tests;
mod track;

pub use config::{Config, ConfigError};
pub use goal::Goal;
pub use node::run;
pub use projection::{Projection, Side, project};

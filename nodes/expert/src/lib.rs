//! The expert: the model-based planner of paper eq. (6), which teaches the policy and drives beside it.
//!
//! It minimises the sum of planning cost, distance and heading to the local goal and change of velocity over 24 steps
//! of 0.1 s, by evaluating 734 candidates (*plain*), by improving the best four of them (*solved*), or by improving
//! what the policy proposes (*refined*). Input: `local_map` and `local_goal` of one frame; output: one `Proposal`.
//!
//! Promises: the same bytes on every machine and every kernel; a mirrored problem gives the mirrored answer exactly;
//! no allocation after construction; no panic for any input.

mod candidates;
mod config;
mod evolution;
mod expert;
mod fan;
mod judge;
mod node;
mod pairing;
mod planner;
mod problem;
mod refinement;
mod rollout;
#[cfg(test)]
mod samples;
#[cfg(test)]
mod tests;

pub use candidates::{PIECE_STEPS, PIECES, arc_numbers};
pub use config::{Config, ConfigError, Lead, Weights};
pub use expert::Expert;
pub use fan::fan;
pub use judge::Judge;
pub use node::run;
pub use pairing::{Frame, Pairing};
pub use planner::{Effort, Mode, Plan, Planner};
pub use problem::{HORIZON_STEPS, STEP_S, UNKNOWN_COST};

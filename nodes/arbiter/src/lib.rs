//! The velocity arbiter: every command that moves the robot passes here, whoever wishes it.
//!
//! Takes proposals, the operator's words, the safety map and odometry; [`Arbiter::step`] answers with one command, at
//! most as fast as the robot can stop on cells that are known to be free, within the limits of the robot, with a
//! reason. Doubt means stop: an input that is old, repeats, runs backward or carries garbage ends in a brake.
//!
//! Pure: time is an argument, nothing is allocated after construction, the same calls give the same bytes, and no
//! bytes of any input can make it panic.

mod ahead;
mod approach;
mod arbiter;
mod brake;
mod clearance;
mod config;
mod drive;
#[cfg(test)]
mod fixture;
mod freshness;
mod gap;
mod held;
mod inputs;
mod limits;
mod maneuver;
mod member;
mod movers;
mod node;
mod operator;
#[cfg(test)]
mod promises;
mod queue;
mod recovery;
mod rollout;
mod search;
mod select;
mod standing;
mod state;
mod stencil;
mod tube;
mod wave;
mod way_out;

pub use arbiter::Arbiter;
pub use config::{Config, ConfigError, Lead, Resume};
pub use node::run;
pub use operator::Standing;
pub use standing::carry_orders;

//! The simulated robot: it stands where camera, base and localiser will stand.
//!
//! A [`World`] of upright blocks and columns, a [`Simulator`] with the dynamics of a small differential drive, a
//! stereo camera, a lidar, ultrasonic sensors, odometry that drifts, and people. Time and commands come from outside;
//! the same seed and the same calls give the same bytes. The node publishes all that in real time or in lockstep.

mod barn;
mod base;
mod config;
mod drawing;
#[cfg(test)]
mod fixtures;
mod generated;
mod motion;
mod node;
mod office;
mod people;
mod planar;
mod random;
mod raster;
mod ros_map;
mod schedule;
mod simulator;
#[cfg(test)]
mod simulator_tests;
mod solid;
mod stereo;
mod timeline;
mod world;
mod world_file;

pub use barn::{barn_selection, barn_worlds};
pub use config::{Config, ConfigError};
pub use drawing::{draw, near, seen_from};
pub use node::run;
pub use office::FREE_M;
pub use people::Walker;
pub use random::{Random, mix};
pub use simulator::Simulator;
pub use solid::{Outline, Solid};
pub use timeline::{BEGIN_NS, Event, TICK_NS, TICKS_PER_RANGES, Timeline};
pub use world::{CLEARANCE_MAX_M, World, WorldError, resample};

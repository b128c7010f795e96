//! The mapper: depth frames, lidar sweeps and ultrasonic readings become one rolling occupancy grid in `odom`, and from
//! it a map to plan on and a map to be safe with.
//!
//! Contract: [`Mapper::depth`] or [`Mapper::scan`] takes one frame and answers with a status, whatever its bytes are;
//! [`Mapper::write_local`] and [`Mapper::write_safety`] then fill the messages. A refused frame leaves the memory as it
//! was, with the capture stamp of the last good frame, so that every age limit downstream still works. No step
//! allocates; equal inputs give equal bytes on every machine.

mod config;
mod evidence;
mod footprint;
mod grid;
mod history;
mod mapper;
mod node;
mod planning;
mod projection;
mod sonar;
mod state;
mod sweep;
mod view;

pub use config::{Config, ConfigError};
pub use grid::{CELL_M, SIDE as GRID_SIDE};
pub use mapper::Mapper;
pub use node::run;
pub use planning::{CLEAR_BELOW, UNKNOWN_COST, Widening, planning_cost};

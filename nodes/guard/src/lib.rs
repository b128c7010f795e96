//! The depth guard: 64 sectors of nearest range straight from a depth frame, without map, memory or odometry.
//!
//! It shares no code with the mapper: what one of them overlooks through an error of its own, the other still sees.
//! Contract: [`Guard::step`] answers every frame with a status. A sector is a range where enough pixels stand in the way
//! within a few centimetres of each other, infinite where the sector was seen and nothing stands there, NaN where it was
//! not seen. A refused frame is a field of NaN with the stamp 0, which no reader can take for a look. The step keeps
//! nothing: equal frames give equal bytes on every machine. It does not allocate, and no input makes it panic.

mod config;
mod fan;
mod frame;
mod guard;
mod node;
mod tally;

pub use config::{Config, ConfigError};
pub use guard::Guard;
pub use node::run;

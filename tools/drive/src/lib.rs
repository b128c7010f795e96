//! The whole chain in one process on simulated time: simulator, mapper, goal, expert, policy, arbiter.
//!
//! The steps are those of the graph, in the order of lockstep: odometry and ranges every 10 ms, a command every 10 ms; at
//! the time of each frame the map, the goal, the proposals and the command that answers it. Equal setups drive equal
//! drives, bit for bit.
//!
//! With [`Sight::Grid`] the maps are drawn from the world itself, without camera and mapper: a hundred times real time.
//! With [`Sight::Noisy`] they err as the mapper's do.

mod chain;
mod drive;
mod noise;
mod outcome;
mod sight;

pub use chain::Chain;
pub use drive::{Drive, DriveError, Lead, Setup};
pub use noise::{BANDS, GROWN_M, NEAR_M, Outlook, SHRUNK_M, UNDER, body};
pub use outcome::{Outcome, TracePoint};
pub use sight::Sight;

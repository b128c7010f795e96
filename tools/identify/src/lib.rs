//! How a base follows its commands, measured: dead time, lag, braking, tracking, and its watchdog.
//!
//! [`Series`] holds what was sent and what moved, from a recording or a live run. [`Identification`] fits every step
//! test in it with the model that the arbiter assumes ([`Response`]: dead time, first-order lag, a limit of
//! acceleration), and says what the robot file does not contain. [`Watchdog`] says how long after the end of a
//! command's validity a base began to brake by itself. Everything but reading the file is a function of its arguments.

mod block;
mod edge;
mod error;
mod fit;
mod identification;
mod response;
mod series;
mod spread;
mod steady;
mod watchdog;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use block::actuator_block;
pub use edge::{Axis, Kind};
pub use error::IdentifyError;
pub use identification::{Finding, Identification, LimitedBy, Test};
pub use response::Response;
pub use series::{Moved, Sent, Series};
pub use spread::Spread;
pub use watchdog::{BRAKES_WITHIN_S, Lapse, Onset, Verdict, Watchdog};

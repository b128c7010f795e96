//! The player: the only reader of recordings, and the driver of a graph that runs on one.
//!
//! [`Info`] says what a file holds, [`Messages`] and [`Ordered`] give its messages byte for byte, [`Schedule`] says
//! when each is due. A file that was cut is read up to its last whole chunk; damaged and hostile files end in a clear
//! error and never in a panic or a large allocation.

mod chunk;
mod config;
mod error;
mod feed;
mod info;
mod message;
mod node;
mod recording;
mod recover;
mod scan;
mod schedule;

#[cfg(test)]
mod tests;

pub use config::Config;
pub use error::PlayerError;
pub use feed::{Feed, Next, PLAYED, Played};
pub use info::{ChannelInfo, Info, attachment};
pub use message::Entry;
pub use node::run;
pub use recording::{Messages, Ordered};
pub use recover::{Salvage, salvage};
pub use schedule::Schedule;

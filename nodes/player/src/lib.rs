//! The player: the only reader of recordings, and the driver of a graph that runs on one.
//!
//! [`Info`] says what a file holds, [`Messages`] and [`Ordered`] give its messages byte for byte, [`Schedule`] says
//! when each is due. A file that was cut is read up to its last whole chunk; damaged and hostile files end in a clear
//! error and never in a panic or a large allocation.

mod beats;
mod chunk;
mod config;
mod error;
mod feed;
mod foreign;
mod info;
mod key;
mod lengths;
mod message;
mod node;
mod recording;
mod recover;
mod scan;
mod schedule;
mod selection;

#[cfg(test)]
mod tests;

pub use config::Config;
pub use error::PlayerError;
pub use feed::{Feed, Next, PLAYED, Played};
pub use foreign::{ForeignChannel, ForeignEnd, ForeignMessage, read_foreign};
pub use info::{ChannelInfo, Info, attachment};
pub use key::{Control, KEYS_SOCKET, Key};
pub use message::Entry;
pub use node::run;
pub use recording::{Messages, Ordered};
pub use recover::{Salvage, salvage};
pub use schedule::Schedule;
pub use selection::Selection;

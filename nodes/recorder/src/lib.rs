//! The recorder: every message of the graph into one MCAP file, whatever happens to the graph or the disk.
//!
//! [`Writer`] turns messages into the file format, [`DiskFile`] gives the file its name, [`Queue`] stands between the
//! thread that empties the inboxes and the one that writes. A kill loses at most the last second; a full disk ends the
//! recording with a message, keeps the file, and the drive goes on.

mod config;
mod copying;
mod depth;
mod error;
mod file;
mod layout;
mod name;
mod node;
mod queue;
mod writer;

pub use config::Config;
pub use copying::Copying;
pub use error::RecordError;
pub use file::DiskFile;
pub use layout::layout_text;
pub use name::{file_name, kernel_class};
pub use node::run;
pub use queue::{Finish, Queue, QueueRoom, Report};
pub use writer::{Origin, Writer};

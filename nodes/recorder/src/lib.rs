//! The recorder: every message of the graph into MCAP files, whatever happens to the graph or the disk.
//!
//! [`Writer`] turns messages into the file format, [`Files`] puts one complete file after the other and keeps the black
//! box beside them, [`Queue`] stands between the thread that empties the inboxes and the one that writes. A kill loses at
//! most the last second; a full disk ends the recording with a message, keeps the file, and the drive goes on.

mod black_box;
mod config;
mod copying;
mod depth;
mod error;
mod file;
mod files;
mod filter;
mod foreign;
mod frames;
mod layout;
mod name;
mod node;
mod progress;
mod queue;
mod ring;
mod space;
mod splice;
mod stream;
mod trouble;
mod view;
mod writer;

pub use config::Config;
pub use copying::Copying;
pub use error::RecordError;
pub use file::DiskFile;
pub use files::Files;
pub use filter::Filter;
pub use foreign::BagWriter;
pub use layout::layout_text;
pub use name::kernel_class;
pub use node::{record_beside, run};
pub use progress::Progress;
pub use queue::{Lost, Queue, QueueRoom, Report, Sink};
pub use view::{Fan, VIEW_CHANNELS, View, ViewChannel, ViewSettings, depth_image_schema};
pub use writer::{Origin, Writer};

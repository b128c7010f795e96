//! Real depth without a robot: a folder of depth images becomes a recording.
//!
//! [`Source`] gives the messages of a driver (depth, odometry, path), [`import_folder`] writes them through the
//! recorder. Images with poses keep them; images without are placed one by one by the floor that they show.

mod error;
mod files;
mod floor;
mod placing;
mod recording;
mod source;
mod way;

#[cfg(test)]
mod tests;

pub use error::ImportError;
pub use files::Intrinsics;
pub use floor::camera_over_floor;
pub use placing::Up;
pub use recording::{DEPTH_DELAY_NS, Sender, Summary, import_folder};
pub use source::{FIRST_NS, ODOMETRY_NS, Options, Placing, Source};
pub use way::way;

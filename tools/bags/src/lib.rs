//! ROS 2 bags in and out, without ROS.
//!
//! [`import_bag`] turns a bag (an MCAP file or a folder of them) into a recording, [`export_bag`] a recording into a
//! bag. Messages are plain CDR; the few types that say what a robot saw and where it was are written down here.

mod bagfile;
mod cdr;
mod choice;
mod error;
mod export;
mod gather;
mod import;
mod listing;
mod messages;
mod occupancy;
mod options;
mod raster;
mod rigid;
mod rvl;
mod schemas;
mod survey;
mod sweep;
mod track;
mod tree;

#[cfg(test)]
mod tests;

pub use bagfile::BagTotals;
pub use error::BagError;
pub use export::{ExportSummary, export_bag};
pub use import::import_bag;
pub use listing::is_bag;
pub use options::{BagOptions, BagSummary};

//! Training: a dataset of labelled maps, a network that learns them, a model file, and a figure for how well.
//!
//! Commands: [`dataset`], [`demonstrations`], [`train`]. All of them give the same bytes for any number of
//! threads; `train` also after an interruption. File formats: the dataset ([`Header`], [`Record`]) and ONNX with the
//! contract of `sidestep-policy`.

mod artificial;
mod checkpoint;
mod demonstration;
mod difference;
mod drives;
mod error;
mod frozen;
mod generate;
mod gradient;
mod head;
mod label;
mod layer;
mod line;
mod mixture;
mod optimiser;
mod parameters;
mod planes;
mod products;
mod random;
mod record;
mod trainer;

pub use artificial::{Scene, scene};
pub use demonstration::{Demonstration, demonstrations};
pub use difference::{
    Difference, Errors, LARGE_V_M_S, LARGE_W_RAD_S, WINDOWS_S, caught, combined_doubt, is_large,
    within_window,
};
pub use drives::DriveProfile;
pub use error::TrainError;
pub use frozen::{FROZEN_SETS, FrozenSet, frozen_sets};
pub use generate::{DatasetOptions, Frames, dataset};
pub use mixture::Mixture;
pub use optimiser::Schedule;
pub use parameters::{ConvolutionSize, Shape};
pub use random::Random;
pub use record::{Dataset, Header, MAGIC, PARTLY_UNKNOWN, RECORDS_AT, Record, Source, VERSION};
pub use trainer::{Progress, TrainOptions, TrainReport, train};

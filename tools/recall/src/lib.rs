//! What perception is worth: how often an object is known by the moment at which the arbiter's tube would first touch it.
//!
//! The arbiter promises that a tube never covers a cell that is not known free. Of what stands in such a cell and was
//! called free it knows nothing, so that the promise is worth what mapper and guard recall. Here the robot drives straight
//! at one object of a [`Class`], through rendered stereo depth, the real mapper and the real guard, and they are asked at
//! the last moment at which a brake still helps ([`reach_m`]). A trial depends on nothing but its class, speed, number and
//! the seed.

mod class;
mod error;
mod judge;
mod measure;
mod reach;
mod scene;
mod trial;

pub use class::{CLASSES, Class};
pub use error::RecallError;
pub use measure::{Options, Recall, Row, Speed, measure, speeds_m_s};
pub use reach::reach_m;
pub use trial::{Seen, Witness};

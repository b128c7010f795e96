//! An adversary of the arbiter: it looks for obstacles, wishes, delays, restarts and a base that make the robot touch
//! something.
//!
//! The claim: while its assumptions hold, a moving robot never touches anything static that its map knew, or could not
//! call free; where the robot file names a speed of movers, nor what moves no faster in the camera's sector. A search that
//! finds nothing proves little by itself; the same search finds a contact within minutes when any one [`Assumption`] is
//! relaxed. An evaluation is at most 3 s of the real arbiter's ticks against a base that is the one its tube simulates,
//! with every value anywhere in the identified set, and depends on nothing but its [`Case`].

mod assumption;
mod base;
mod error;
mod evaluation;
mod genes;
mod picture;
mod scenario;
mod search;
mod sensing;
mod thing;

pub use assumption::Assumption;
pub use error::FalsifyError;
pub use evaluation::{Contact, Evaluator, Outcome, Trace};
pub use genes::Case;
pub use picture::picture;
pub use scenario::{Actuation, Channel, Drift, GENES, Piece, Restarts, Scenario, TICKS};
pub use search::{CLIMB, Found, Search, SearchOptions, search};
pub use thing::{Thing, Things};

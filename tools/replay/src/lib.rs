//! The nodes of a recording again, in one process: every step with the inputs and the time that its header names, and
//! every byte of its outputs compared.
//!
//! A step's header says what was taken since the step before, and its one time: with the state records that is all a pure
//! step knows. Outputs of recorded steps are found in the file, never guessed; what cannot be replayed (before the first
//! state, after a lost input) is counted by reason and never called a difference. With a changed model, robot, setting or
//! lead, nodes further down take the changed outputs, and the report says by how much each field moved. The loop stays
//! open: recorded sensors do not answer to changed commands.

mod error;
mod fields;
mod nodes;
mod proposers;
mod replay;
mod report;
mod runner;
mod settings;
mod store;

pub use error::ReplayError;
pub use replay::replay;
pub use report::{Change, Difference, NodeTally, Report};
pub use settings::{Origin, Settings};

//! Every table and figure of the paper about one frame at a time, for a model and the data that it was trained and held
//! out on: Table I, Figs. 3, 5, 6a and 6b, Table II, and how far the model's doubt can be trusted.
//!
//! [`evaluate`] measures through the deployed inference path, [`Evaluation::report`] draws. The paper's numbers stand beside
//! ours with their machine and year.

mod answers;
mod cases;
mod doubt;
mod error;
mod evaluation;
mod gap;
mod oracle;
mod page;
mod plots;
mod samples;
mod table1;
mod timing;

pub use cases::Case;
pub use doubt::{Axis, Doubt, Reliability};
pub use error::EvaluateError;
pub use evaluation::{EvaluateOptions, Evaluation, evaluate};
pub use gap::{Curve, Equals, Gap, Regrets};
pub use oracle::Oracle;
pub use samples::samples_report;
pub use table1::{Labels, SetTable, Windowed};
pub use timing::Timing;

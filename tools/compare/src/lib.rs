//! Where policy and expert, or two models, disagree in recordings, and what it costs.
//!
//! [`compare`] reads one recording (policy against expert) or two of the same sensors (policy of A against policy of B),
//! joins the proposals by the frame that they are about, and measures them by one rule: their difference within windows
//! of 0.1 and 0.3 s, and the cost of eq. (6) of the best plan that begins with each. Only summaries are kept, and the few
//! frames worth a picture. [`Comparison`] gives text, JSON and a report; frames can be mined as training samples.

mod comparison;
mod conduct;
mod error;
mod figures;
mod frames;
mod join;
mod keep;
mod page;
mod picture;
mod source;
mod text;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use comparison::{Comparison, Mine, Options, compare};
pub use conduct::{Conduct, Episodes, Outcome, Takeover};
pub use error::CompareError;
pub use figures::{Ages, Agreement, Figures, Regret, WindowErrors};
pub use frames::{Rank, Shown};
pub use join::Coverage;
pub use source::Origin;

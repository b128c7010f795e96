//! Why an evaluation stopped.

use sidestep_policy::ModelError;
use sidestep_report::ReportError;
use sidestep_train::TrainError;

/// Why an evaluation cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A dataset that does not fit.
    #[error(transparent)]
    Data(#[from] TrainError),
    /// A model that does not fit.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Nothing to evaluate on.
    #[error(
        "no held-out dataset; needed: at least one that the model was not trained on, made by `sidestep dataset`"
    )]
    NoData,
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Report(#[from] ReportError),
}

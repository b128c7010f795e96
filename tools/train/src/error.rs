//! Why training stopped: what was found, what is needed, what to do.

/// Why a dataset, a training run or an evaluation cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file that would be written over.
    #[error("{path}: a file of this name exists; name another one, or remove it")]
    Exists {
        /// The file.
        path: String,
    },
    /// A file is no dataset, or one that does not fit.
    #[error("dataset {path}: found {found}, needed {needed}; make it with `sidestep dataset`")]
    Dataset {
        /// The file.
        path: String,
        /// What the file holds.
        found: String,
        /// What is needed.
        needed: String,
    },
    /// Held-out data that are not those that figures were measured on.
    #[error(
        "{path}: its content is {found:016x}, needed {needed:016x}: this build makes other maps, drives or labels than \
         the one whose figures are published, or the robot is another one; compare only what was measured on the same"
    )]
    Frozen {
        /// The file.
        path: String,
        /// Its hash.
        found: u64,
        /// That of the set.
        needed: u64,
    },
    /// A checkpoint of another run.
    #[error("checkpoint {path}: found {found}, needed {needed}; remove it to start again")]
    Checkpoint {
        /// The file.
        path: String,
        /// What the file holds.
        found: String,
        /// What is needed.
        needed: String,
    },
    /// An option out of range.
    #[error("{option} is {found}, needed: {needed}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        found: String,
        /// The range.
        needed: &'static str,
    },
    /// A drive that cannot begin.
    #[error("demonstrations: {detail}")]
    Drive {
        /// What a node says.
        detail: String,
    },
    /// The loss is not finite.
    #[error(
        "training diverged after {samples} samples; lower the learning rate or resume from an earlier checkpoint"
    )]
    Diverged {
        /// Samples seen.
        samples: u64,
    },
    /// The model made or named does not work.
    #[error(transparent)]
    Model(#[from] sidestep_policy::ModelError),
}

//! What can go wrong between a node and the world: found, needed, remedy.

/// Why a node ended without being asked to.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// Configuration, robot, world or model cannot be used; starting again would not help.
    #[error("{0}")]
    Configuration(String),
    /// A file could not be read or written.
    #[error("{path}: {source}; {remedy}")]
    File {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// The transport refused.
    #[error("topic {topic}: cannot {action}: {detail}; {remedy}")]
    Transport {
        /// The topic, or the domain.
        topic: String,
        /// What was tried.
        action: &'static str,
        /// What iceoryx2 said.
        detail: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Started by hand: the environment that the launcher gives is missing.
    #[error(
        "environment variable {variable} is {found}, needed: {needed}; nodes are started by `sidestep run`"
    )]
    Environment {
        /// The variable.
        variable: &'static str,
        /// What it holds.
        found: String,
        /// What it must hold.
        needed: &'static str,
    },
    /// A lockstep driver waited in vain.
    #[error(
        "{node} did not answer {what} for {waited_s:.1} s of host time; see its own lines, or leave lockstep"
    )]
    Silent {
        /// Who.
        node: &'static str,
        /// What the driver said.
        what: String,
        /// How long it waited.
        waited_s: f64,
    },
    /// Input or output was lost for good, though the drive went on.
    #[error("{0}")]
    Lost(String),
}

impl NodeError {
    /// A refusal of the transport.
    pub(crate) fn transport(topic: &str, action: &'static str, detail: impl std::fmt::Debug) -> Self {
        let remedy = "is the run still alive, and made by the same version of sidestep?";
        Self::Transport { topic: topic.into(), action, detail: format!("{detail:?}"), remedy }
    }

    /// The exit code of the command line: 2 for configuration, 3 for input and output.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Configuration(_) | Self::Environment { .. } => 2,
            Self::File { .. } | Self::Transport { .. } | Self::Silent { .. } | Self::Lost(_) => 3,
        }
    }
}

//! Why a model was refused: what was found, what is needed, what to do about it.

/// Why a policy model cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The file cannot be opened or read.
    #[error("model {model}: cannot be read: {detail}; name a file written by `sidestep train`")]
    Read {
        /// The model.
        model: String,
        /// What the system says.
        detail: String,
    },
    /// The bytes are no ONNX protobuf.
    #[error("model {model}: not an ONNX file: {detail}; name a file written by `sidestep train`")]
    Format {
        /// The model.
        model: String,
        /// What the decoder says.
        detail: String,
    },
    /// Metadata, an input, an output or an operator is not as the contract says.
    #[error("model {model}: {what} is {found}, needed: {needed}; {remedy}")]
    Contract {
        /// The model.
        model: String,
        /// What does not fit.
        what: String,
        /// What the file holds.
        found: String,
        /// What the contract asks for.
        needed: String,
        /// What helps.
        remedy: &'static str,
    },
    /// The inference engine refuses the graph.
    #[error("model {model}: the graph cannot be run: {detail}; export it with `sidestep train`")]
    Engine {
        /// The model.
        model: String,
        /// What the engine says.
        detail: String,
    },
    /// The network does not compute what its maker recorded.
    #[error(
        "model {model}: self-test gives {found:?}, the file promises {needed:?} within {tolerance}; \
         the file is damaged or this machine computes wrongly: export or copy it again"
    )]
    SelfTest {
        /// The model.
        model: String,
        /// `[m/s, rad/s, m/s, rad/s]` command and doubt computed here.
        found: [f32; 4],
        /// `[m/s, rad/s, m/s, rad/s]` command and doubt in the metadata.
        needed: [f32; 4],
        /// `[m/s, rad/s]` largest difference allowed.
        tolerance: f32,
    },
}

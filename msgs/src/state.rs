//! All that a step keeps from one call to the next, so that a recording can be replayed from its middle.

use crate::layout::{ZeroCopySend, record};

/// Room for the mapper's state.
pub const MAPPER_STATE_BYTES: usize = 800 * 1024;
/// Room for the goal's state.
pub const GOAL_STATE_BYTES: usize = 32 * 1024;
/// Room for the arbiter's state.
pub const ARBITER_STATE_BYTES: usize = 32 * 1024;

record! {
    /// State of `mapper` after a step. Writer: `mapper`. Reader: recorder.
    pub struct MapperState("sidestep/MapperState/1") {
        /// Sequence of the output whose step left this state.
        pub after_sequence: u64,
        /// Bytes used.
        pub size: u64,
        /// Plain bytes; their layout belongs to the version of the program named in the recording.
        pub bytes: [u8; MAPPER_STATE_BYTES],
    }
}

record! {
    /// State of `goal` after a step. Writer: `goal`. Reader: recorder.
    pub struct GoalState("sidestep/GoalState/1") {
        /// Sequence of the output whose step left this state.
        pub after_sequence: u64,
        /// Bytes used.
        pub size: u64,
        /// Plain bytes.
        pub bytes: [u8; GOAL_STATE_BYTES],
    }
}

record! {
    /// State of `arbiter` after a step. Writer: `arbiter`. Reader: recorder.
    pub struct ArbiterState("sidestep/ArbiterState/1") {
        /// Sequence of the output whose step left this state.
        pub after_sequence: u64,
        /// Bytes used.
        pub size: u64,
        /// Plain bytes.
        pub bytes: [u8; ARBITER_STATE_BYTES],
    }
}

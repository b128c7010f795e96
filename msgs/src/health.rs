//! The heartbeat of a node.

use crate::layout::{ZeroCopySend, codes, record};
use crate::topics::TOPICS_MAX;

codes! {
    /// What a node says of itself.
    pub enum NodeState {
        /// Opening its topics.
        Starting = 0 "starting",
        /// Ready, and no input yet.
        Ready = 1 "ready",
        /// Stepping.
        Running = 2 "running",
        /// Leaving.
        Stopping = 3 "stopping",
    }
}

record! {
    /// A node's account of its own loop, 40 Hz.
    ///
    /// Writer: each node, on `health/<node>`. Readers: launcher, arbiter, recorder.
    pub struct Health("sidestep/Health/1") {
        /// Steps made.
        pub cycles: u64,
        /// Steps that took longer than the budget of the graph file.
        pub misses: u64,
        /// Source frame of the last step.
        pub last_frame: u64,
        /// `[s]` longest step since the previous heartbeat, host time.
        pub worst_step_s: f32,
        /// `[s]` mean step since the start, host time.
        pub mean_step_s: f32,
        /// [`NodeState`].
        pub state: u32,
        /// [`crate::Status`] of the last step.
        pub status: u32,
        /// Messages sent per topic of the table.
        pub sent: [u64; TOPICS_MAX],
        /// Messages per topic that the node wanted and never got (gaps in the sequence of a reader of all).
        pub lost: [u64; TOPICS_MAX],
        /// Messages per topic passed over by a reader of the newest.
        pub skipped: [u64; TOPICS_MAX],
    }
}

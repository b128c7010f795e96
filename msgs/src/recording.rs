//! Names inside a recording, so that whoever writes one and whoever reads one agree.
//!
//! A recording is an MCAP file. Each topic of the table has a channel of its name whose messages are the bytes of the
//! header followed by the bytes of the message. Depth is the exception: the pixels stand once, as an image any viewer
//! shows, on `depth`; header and all other fields stand on [`DEPTH_REST_CHANNEL`]; both together are the message.

use crate::depth::DepthFrame;
use crate::layout::{ZeroCopySend, record};
use std::mem::offset_of;

record! {
    /// What the recorder has begun and kept. Writer: `recorder`, at each change. Readers: nodes that keep a state (a new file
    /// asks them for it, so that the file can be replayed), tools.
    pub struct Recording("sidestep/Recording/1") {
        /// Files begun by this life of the recorder; each raise asks for the states.
        pub files: u64,
        /// Snapshots of the black box written, on whatever ground.
        pub snapshots: u64,
        /// Token of the last [`Snapshot`] whose file is complete; 0 = none.
        pub snapshot_token: u64,
        /// `[s]` how far back the black box reaches.
        pub held_s: f32,
        /// Zero.
        pub _pad: u32,
    }
}

record! {
    /// The wish to keep the last seconds: the recorder writes its black box into a file of its own.
    ///
    /// Writer: the operator. Reader: `recorder`, which names the token in [`Recording`].
    pub struct Snapshot("sidestep/Snapshot/1") {
        /// Drawn by the operator's command, to know its acknowledgement.
        pub token: u64,
    }
}

/// Message encoding of a channel that carries header and message as they are in memory, little-endian.
pub const RAW_ENCODING: &str = "sidestep.raw";
/// Schema encoding of the text that lists the fields of a message.
pub const LAYOUT_ENCODING: &str = "sidestep.layout";
/// Channel of the depth frame without its pixels.
pub const DEPTH_REST_CHANNEL: &str = "depth/raw";
/// Bytes of a depth frame before its pixels.
pub const DEPTH_REST_BYTES: usize = offset_of!(DepthFrame, pixels);
/// Channel metadata: hash of the message's layout, hexadecimal.
pub const LAYOUT_HASH_KEY: &str = "layout_hash";
/// Metadata record with what the recording was made from.
pub const ORIGIN_RECORD: &str = "sidestep";
/// In [`ORIGIN_RECORD`]: `[ns]` to add to host time (CLOCK_MONOTONIC) for wall time.
pub const MONO_TO_WALL_KEY: &str = "mono_to_wall_ns";
/// Metadata record, written at the end, with the number of messages per topic that the recorder lost.
pub const LOST_RECORD: &str = "sidestep.lost";

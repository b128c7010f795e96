//! Names inside a recording, so that whoever writes one and whoever reads one agree.
//!
//! A recording is an MCAP file. Each topic of the table has a channel of its name whose messages are the bytes of the
//! header followed by the bytes of the message. Depth is the exception: the pixels stand once, as an image any viewer
//! shows, on `depth`; header and all other fields stand on [`DEPTH_REST_CHANNEL`]; both together are the message.

use crate::depth::DepthFrame;
use std::mem::offset_of;

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

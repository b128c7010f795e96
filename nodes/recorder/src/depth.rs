//! A depth frame in two parts: an image that any viewer shows, and the rest.
//!
//! Pixels are by far the largest part of a recording, so they stand there once. Both parts together are the exact
//! message, whatever its bytes: an image holds either the used pixels (the rest of the array is zero, as the message
//! promises) or, for a frame that breaks that promise, the whole array.

use crate::view::FileTime;
use foxglove::messages::RawImage;
use sidestep_msgs::{DEPTH_REST_BYTES, DepthFrame};
use std::mem::offset_of;

/// Columns and rows of the image that stands for a frame which does not keep to its own size.
const WHOLE: (usize, usize) = (640, 480);

fn number(frame: &[u8], offset: usize) -> u32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&frame[offset..offset + 4]);
    u32::from_le_bytes(bytes)
}

/// Columns and rows to store: the frame's own where the pixels beyond them are zero, else the whole array.
fn stored_size(frame: &[u8]) -> (usize, usize) {
    let width = number(frame, offset_of!(DepthFrame, width)) as usize;
    let height = number(frame, offset_of!(DepthFrame, height)) as usize;
    let fits = (1..=WHOLE.0).contains(&width) && (1..=WHOLE.1).contains(&height);
    let unused_from = DEPTH_REST_BYTES + 2 * width.saturating_mul(height);
    if fits && frame[unused_from..].iter().all(|&byte| byte == 0) { (width, height) } else { WHOLE }
}

/// The image of a depth frame, given as the bytes of a [`DepthFrame`].
pub(crate) fn image(frame: &[u8], time: &FileTime) -> RawImage {
    let (width, height) = stored_size(frame);
    let mut stamp = [0; 8];
    stamp.copy_from_slice(&frame[..8]);
    let capture_ns = u64::from_le_bytes(stamp);
    RawImage {
        timestamp: time.stamp(capture_ns),
        frame_id: "camera".into(),
        width: width as u32,
        height: height as u32,
        encoding: "16UC1".into(),
        step: 2 * width as u32,
        data: frame[DEPTH_REST_BYTES..DEPTH_REST_BYTES + 2 * width * height].to_vec().into(),
    }
}

const _: () = assert!(offset_of!(DepthFrame, capture_ns) == 0);
const _: () =
    assert!(cfg!(target_endian = "little"), "recordings are little-endian, as the messages in memory");

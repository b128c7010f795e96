//! The schema text of a channel: the layout of its messages, field by field, so that anything can decode them.

use sidestep_msgs::{Field, Header, Message, Primitive};
use std::fmt::Write;

fn primitive_name(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::U8 => "u8",
        Primitive::U16 => "u16",
        Primitive::U32 => "u32",
        Primitive::U64 => "u64",
        Primitive::I32 => "i32",
        Primitive::F32 => "f32",
        Primitive::F64 => "f64",
        Primitive::Record => "record",
    }
}

/// One line per field: offset from the start of the record, primitive or record name, count, dotted name.
fn list(text: &mut String, fields: &[Field], base: usize, prefix: &str) {
    for field in fields {
        let kind = match field.primitive {
            Primitive::Record => field.record_name,
            plain => primitive_name(plain),
        };
        // A text in memory cannot fail to take more text.
        let _ = writeln!(text, "{} {kind} {} {prefix}{}", base + field.offset, field.count, field.name);
        if field.primitive == Primitive::Record {
            list(text, field.record, base + field.offset, &format!("{prefix}{}.", field.name));
        }
    }
}

/// The layout of a record that holds the header and then the first `message_bytes` of a message `M`.
///
/// For an array of records the fields of its first element are listed; the others follow at equal distance.
#[must_use]
pub fn layout_text<M: Message>(message_bytes: usize) -> String {
    let header_bytes = size_of::<Header>();
    let mut text = String::new();
    let _ = writeln!(text, "# little-endian; offset kind count name");
    let _ = writeln!(text, "record {} bytes {}", M::NAME, header_bytes + message_bytes);
    let _ = writeln!(text, "hash {:016x} header {:016x}", M::LAYOUT_HASH, Header::LAYOUT_HASH);
    list(&mut text, Header::FIELDS, 0, "header.");
    let held: Vec<Field> = M::FIELDS.iter().filter(|field| field.offset < message_bytes).copied().collect();
    list(&mut text, &held, header_bytes, "");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{DEPTH_REST_BYTES, DepthFrame, Odometry};
    use std::mem::offset_of;

    #[test]
    fn every_field_is_named_with_its_place_behind_the_header() {
        let text = layout_text::<Odometry>(size_of::<Odometry>());
        let yaw = size_of::<Header>() + offset_of!(Odometry, pose) + 16;
        assert!(text.contains(&format!("{yaw} f64 1 pose.yaw_rad")), "{text}");
        assert!(text.contains("0 u64 1 header.run"), "{text}");
        assert!(text.contains(&format!("bytes {}", size_of::<Header>() + size_of::<Odometry>())), "{text}");
    }

    #[test]
    fn the_rest_of_a_depth_frame_lists_no_pixels() {
        let text = layout_text::<DepthFrame>(DEPTH_REST_BYTES);
        assert!(text.contains("camera.rotation_xyzw") && !text.contains("pixels"), "{text}");
    }
}

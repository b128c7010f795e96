//! Protobuf by hand, as far as flat messages and their descriptors need it.

/// Wire type of numbers of varying length.
const VARINT: u64 = 0;
/// Wire type of doubles.
const FIXED_64: u64 = 1;
/// Wire type of texts and messages.
const LENGTH: u64 = 2;

fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn key(bytes: &mut Vec<u8>, tag: u64, wire: u64) {
    varint(bytes, tag << 3 | wire);
}

/// A whole number.
pub(crate) fn whole(bytes: &mut Vec<u8>, tag: u64, value: u64) {
    key(bytes, tag, VARINT);
    varint(bytes, value);
}

/// A double.
pub(crate) fn double(bytes: &mut Vec<u8>, tag: u64, value: f64) {
    key(bytes, tag, FIXED_64);
    bytes.extend_from_slice(&value.to_le_bytes());
}

/// A text or an encoded message.
pub(crate) fn block(bytes: &mut Vec<u8>, tag: u64, value: &[u8]) {
    key(bytes, tag, LENGTH);
    varint(bytes, value.len() as u64);
    bytes.extend_from_slice(value);
}

/// Types of fields, by their number in `FieldDescriptorProto`.
pub(crate) const DOUBLE: u64 = 1;
pub(crate) const INT_64: u64 = 3;
pub(crate) const UINT_64: u64 = 4;
pub(crate) const INT_32: u64 = 5;
pub(crate) const STRING: u64 = 9;
pub(crate) const MESSAGE: u64 = 11;

/// One field of a message, for its descriptor.
pub(crate) struct FieldShape<'a> {
    pub(crate) name: &'a str,
    pub(crate) tag: u64,
    pub(crate) kind: u64,
    /// Full name of the message type, else empty.
    pub(crate) type_name: &'a str,
}

/// `FileDescriptorProto` of a file with one message.
pub(crate) fn file(package: &str, message: &str, imports: &[&str], fields: &[FieldShape]) -> Vec<u8> {
    let optional = 1;
    let mut shape = Vec::new();
    block(&mut shape, 1, message.as_bytes());
    for field in fields {
        let mut one = Vec::new();
        block(&mut one, 1, field.name.as_bytes());
        whole(&mut one, 3, field.tag);
        whole(&mut one, 4, optional);
        whole(&mut one, 5, field.kind);
        if !field.type_name.is_empty() {
            block(&mut one, 6, field.type_name.as_bytes());
        }
        block(&mut shape, 2, &one);
    }
    let mut file = Vec::new();
    let path = format!("{}/{}.proto", package.replace('.', "/"), message.to_lowercase());
    block(&mut file, 1, path.as_bytes());
    block(&mut file, 2, package.as_bytes());
    for import in imports {
        block(&mut file, 3, import.as_bytes());
    }
    block(&mut file, 4, &shape);
    block(&mut file, 12, b"proto3");
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_those_of_the_encoding_guide() {
        // protobuf.dev/programming-guides/encoding: field 1 = 150, field 2 = "testing".
        let mut bytes = Vec::new();
        whole(&mut bytes, 1, 150);
        block(&mut bytes, 2, b"testing");
        double(&mut bytes, 3, 1.0);
        let expected =
            [&[0x08, 0x96, 0x01, 0x12, 0x07][..], b"testing", &[0x19, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]].concat();
        assert_eq!(bytes, expected);
    }
}

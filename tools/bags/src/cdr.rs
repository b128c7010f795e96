//! Common Data Representation: the bytes of a ROS 2 message behind their four bytes of encapsulation.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};

/// Bytes of encapsulation before the message: two that name the representation, two of options.
const ENCAPSULATION: usize = 4;

/// Why the bytes of a message are not that message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum CdrError {
    #[error("XCDR2 (encapsulation 00 {0:02x})")]
    Xcdr2(u8),
    #[error("bytes that are no CDR (they begin with {0})")]
    Encapsulation(String),
    #[error("a broken message ({0})")]
    Broken(String),
}

/// Reads a message, or the first part of one; what follows is not looked at.
pub(crate) fn decode<'a, T: Deserialize<'a>>(data: &'a [u8]) -> Result<T, CdrError> {
    let broken = |error: cdr_encoding::Error| CdrError::Broken(error.to_string());
    match data.split_at_checked(ENCAPSULATION) {
        Some(([0, 0, _, _], body)) => {
            cdr_encoding::from_bytes::<T, BigEndian>(body).map(|(message, _)| message).map_err(broken)
        }
        Some(([0, 1, _, _], body)) => {
            cdr_encoding::from_bytes::<T, LittleEndian>(body).map(|(message, _)| message).map_err(broken)
        }
        Some(([0, id @ 6..=11, _, _], _)) => Err(CdrError::Xcdr2(*id)),
        _ => {
            let first = data.iter().take(ENCAPSULATION).map(|byte| format!("{byte:02x}"));
            Err(CdrError::Encapsulation(first.collect::<Vec<_>>().join(" ")))
        }
    }
}

/// Writes a message, little-endian, into `bytes`, whose former content goes.
pub(crate) fn encode<T: Serialize>(message: &T, bytes: &mut Vec<u8>) -> Result<(), CdrError> {
    bytes.clear();
    bytes.extend_from_slice(&[0, 1, 0, 0]);
    cdr_encoding::to_writer::<T, LittleEndian, _>(bytes, message)
        .map_err(|error| CdrError::Broken(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Image, TransformMessage};

    #[test]
    fn a_length_that_no_file_could_hold_is_refused_without_taking_the_memory() {
        let mut bytes = Vec::new();
        let image = Image { height: 1, width: 2, data: &[1, 2, 3, 4], ..Image::default() };
        encode(&image, &mut bytes).unwrap();
        assert_eq!(decode::<Image>(&bytes).unwrap(), image);
        let length = bytes.len() - 8;
        bytes[length..length + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(decode::<Image>(&bytes), Err(CdrError::Broken(_))));
        // A list of four thousand million transforms.
        assert!(matches!(
            decode::<TransformMessage>(&[0, 1, 0, 0, 255, 255, 255, 255]),
            Err(CdrError::Broken(_))
        ));
    }

    #[test]
    fn both_byte_orders_are_read_and_the_later_representation_is_named() {
        let number = |bytes: &[u8]| decode::<u32>(bytes);
        assert_eq!(number(&[0, 1, 0, 0, 7, 0, 0, 0]), Ok(7));
        assert_eq!(number(&[0, 0, 0, 0, 0, 0, 0, 7]), Ok(7));
        for id in 6..=11 {
            assert_eq!(number(&[0, id, 0, 0, 7, 0, 0, 0]), Err(CdrError::Xcdr2(id)));
        }
        assert_eq!(number(&[9, 9]), Err(CdrError::Encapsulation("09 09".into())));
    }
}

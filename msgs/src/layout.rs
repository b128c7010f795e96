//! How a message describes itself: field by field, so that two builds that disagree refuse each other.
//!
//! iceoryx2 compares only name, size and alignment of a type; two swapped fields of equal size would be read as
//! garbage. The layout hash covers names, types and offsets. It travels as service attribute and in recordings.

pub(crate) use iceoryx2::prelude::ZeroCopySend;

/// A number as it lies in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Primitive {
    /// 8 bits, unsigned.
    U8,
    /// 16 bits, unsigned.
    U16,
    /// 32 bits, unsigned.
    U32,
    /// 64 bits, unsigned.
    U64,
    /// 32 bits, signed.
    I32,
    /// IEEE 754 single.
    F32,
    /// IEEE 754 double.
    F64,
    /// Another structure of this crate, named by [`Field::record`].
    Record,
}

/// One field of a message.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Name in Rust, C, Python and recordings.
    pub name: &'static str,
    /// First byte, counted from the start of the message.
    pub offset: usize,
    /// Bytes taken.
    pub size: usize,
    /// Kind of each element.
    pub primitive: Primitive,
    /// Elements: 1 for a plain field.
    pub count: usize,
    /// Fields of the nested structure, where `primitive` is [`Primitive::Record`].
    pub record: &'static [Field],
    /// Name of the nested structure, else empty.
    pub record_name: &'static str,
}

/// What a field may be made of.
pub(crate) trait Plain {
    /// Kind of one element.
    const PRIMITIVE: Primitive;
    /// Number of elements.
    const COUNT: usize = 1;
    /// Fields, for a nested structure.
    const RECORD: &'static [Field] = &[];
    /// Name, for a nested structure.
    const RECORD_NAME: &'static str = "";
}

macro_rules! plain {
    ($($type:ty => $kind:ident),*) => { $(impl Plain for $type { const PRIMITIVE: Primitive = Primitive::$kind; })* };
}
plain!(u8 => U8, u16 => U16, u32 => U32, u64 => U64, i32 => I32, f32 => F32, f64 => F64);

impl<T: Plain, const N: usize> Plain for [T; N] {
    const PRIMITIVE: Primitive = T::PRIMITIVE;
    const COUNT: usize = N * T::COUNT;
    const RECORD: &'static [Field] = T::RECORD;
    const RECORD_NAME: &'static str = T::RECORD_NAME;
}

/// A message: plain bytes with a versioned name and a layout that can be compared.
pub trait Message: ZeroCopySend + bytemuck::Pod + std::fmt::Debug {
    /// Versioned name, as iceoryx2 and recordings know it.
    const NAME: &'static str;
    /// All fields, in order, padding included.
    const FIELDS: &'static [Field];
    /// Hash of names, types and offsets.
    const LAYOUT_HASH: u64;
}

/// A number in a message that stands for one of a few named values.
pub trait Code: Copy + Sized + 'static {
    /// All values.
    const ALL: &'static [Self];
    /// The number in the message.
    fn code(self) -> u32;
    /// The name in texts and reports.
    fn label(self) -> &'static str;
    /// The value, or `None` for bytes that mean nothing.
    fn from_code(code: u32) -> Option<Self> {
        Self::ALL.iter().copied().find(|value| value.code() == code)
    }
}

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0100_0000_01b3;

const fn mix(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

const fn mix_fields(mut hash: u64, fields: &[Field]) -> u64 {
    let mut i = 0;
    while i < fields.len() {
        let field = &fields[i];
        hash = mix(hash, field.name.as_bytes());
        hash = mix(hash, &(field.offset as u64).to_le_bytes());
        hash = mix(hash, &(field.size as u64).to_le_bytes());
        hash = mix(hash, &[field.primitive as u8]);
        hash = mix_fields(hash, field.record);
        i += 1;
    }
    hash
}

/// FNV-1a over the name and every field's name, offset, size and kind.
#[must_use]
pub const fn layout_hash(name: &str, fields: &[Field]) -> u64 {
    mix_fields(mix(FNV_OFFSET, name.as_bytes()), fields)
}

/// Declares a structure of plain bytes with its self-description; without a name it can only be part of a message.
macro_rules! record {
    ($(#[$meta:meta])* $vis:vis struct $name:ident $(($type_name:literal))? {
        $($(#[$field_meta:meta])* $field_vis:vis $field:ident: $type:ty,)*
    }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Zeroable, bytemuck::Pod, ZeroCopySend)]
        $(#[type_name($type_name)])?
        $vis struct $name { $($(#[$field_meta])* $field_vis $field: $type,)* }

        impl $crate::layout::Plain for $name {
            const PRIMITIVE: $crate::layout::Primitive = $crate::layout::Primitive::Record;
            const RECORD: &'static [$crate::layout::Field] = &[$($crate::layout::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                size: std::mem::size_of::<$type>(),
                primitive: <$type as $crate::layout::Plain>::PRIMITIVE,
                count: <$type as $crate::layout::Plain>::COUNT,
                record: <$type as $crate::layout::Plain>::RECORD,
                record_name: <$type as $crate::layout::Plain>::RECORD_NAME,
            }),*];
            const RECORD_NAME: &'static str = stringify!($name);
        }

        $(impl $crate::layout::Message for $name {
            const NAME: &'static str = $type_name;
            const FIELDS: &'static [$crate::layout::Field] = <$name as $crate::layout::Plain>::RECORD;
            const LAYOUT_HASH: u64 = $crate::layout::layout_hash($type_name, Self::FIELDS);
        })?

        const _: () = assert!(std::mem::align_of::<$name>() <= 8);

        impl Default for $name {
            fn default() -> Self {
                bytemuck::Zeroable::zeroed()
            }
        }
    };
}
pub(crate) use record;

/// Declares named values for a `u32` in a message.
macro_rules! codes {
    ($(#[$meta:meta])* $vis:vis enum $name:ident { $($(#[$value_meta:meta])* $value:ident = $code:literal $label:literal,)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        $vis enum $name { $($(#[$value_meta])* $value = $code,)* }

        impl $crate::layout::Code for $name {
            const ALL: &'static [Self] = &[$($name::$value),*];
            fn code(self) -> u32 {
                self as u32
            }
            fn label(self) -> &'static str {
                match self { $($name::$value => $label,)* }
            }
        }
    };
}
pub(crate) use codes;

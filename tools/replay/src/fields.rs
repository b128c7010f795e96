//! Messages field by field, by what they say of themselves.

use sidestep_msgs::{Field, Message, Primitive, Topic, TopicVisitor, visit_topics};
use std::collections::BTreeMap;
use std::convert::Infallible;

/// The fields of every topic, by position in the table.
pub(crate) struct Fields(Vec<&'static [Field]>);

impl TopicVisitor for Fields {
    type Error = Infallible;

    fn visit<M: Message>(&mut self, _: Topic<M>) -> Result<(), Infallible> {
        self.0.push(M::FIELDS);
        Ok(())
    }
}

impl Fields {
    pub(crate) fn of_all_topics() -> Self {
        let mut fields = Self(Vec::new());
        let Ok(()) = visit_topics(&mut fields);
        fields
    }

    /// The first field in which two messages of a topic differ: its name and both values.
    pub(crate) fn first_difference(&self, topic: usize, one: &[u8], other: &[u8]) -> Option<[String; 3]> {
        let mut found = None;
        walk(self.0[topic], 0, &mut String::new(), &mut |name, place, primitive| {
            let bytes = place..place + width(primitive);
            if found.is_none() && one[bytes.clone()] != other[bytes.clone()] {
                let value = |message: &[u8]| number(primitive, &message[bytes.clone()]).to_string();
                found = Some([name.to_owned(), value(one), value(other)]);
            }
        });
        found
    }

    /// Adds how far two messages of a topic are apart, by field; elements of an array count under one name.
    pub(crate) fn add_distances(
        &self,
        topic: usize,
        one: &[u8],
        other: &[u8],
        sums: &mut BTreeMap<String, Distance>,
    ) {
        let mut here: BTreeMap<String, (Option<f64>, u64)> = BTreeMap::new();
        walk(self.0[topic], 0, &mut String::new(), &mut |name, place, primitive| {
            let bytes = place..place + width(primitive);
            if one[bytes.clone()] == other[bytes.clone()] {
                return;
            }
            let apart = (number(primitive, &one[bytes.clone()]) - number(primitive, &other[bytes])).abs();
            let plain = name.split('[').next().unwrap_or(name).to_owned();
            let (most, count) = here.entry(plain).or_default();
            // Codes, stamps and counts are no quantities, and an age may be infinite.
            if apart.is_finite() && is_quantity(primitive) {
                *most = Some(most.unwrap_or(0.0).max(apart));
            }
            *count += 1;
        });
        for (name, (most, values)) in here {
            let distance = sums.entry(name).or_default();
            distance.messages += 1;
            distance.values += values;
            if let Some(most) = most {
                distance.measured += 1;
                distance.sum += most;
                distance.most = distance.most.max(most);
            }
        }
    }
}

/// How far a field of a topic moved over a recording.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Distance {
    /// Messages in which it moved.
    pub(crate) messages: u64,
    /// Values that moved, where the field is an array.
    pub(crate) values: u64,
    /// Messages among those whose distance is a number.
    pub(crate) measured: u64,
    /// Sum over messages of the largest distance within each.
    pub(crate) sum: f64,
    /// The largest distance.
    pub(crate) most: f64,
}

/// Whether a distance between two values means something.
fn is_quantity(primitive: Primitive) -> bool {
    matches!(primitive, Primitive::U8 | Primitive::F32 | Primitive::F64)
}

fn width(primitive: Primitive) -> usize {
    match primitive {
        Primitive::U8 => 1,
        Primitive::U16 => 2,
        Primitive::U32 | Primitive::I32 | Primitive::F32 => 4,
        Primitive::U64 | Primitive::F64 => 8,
        Primitive::Record => 0,
    }
}

fn number(primitive: Primitive, bytes: &[u8]) -> f64 {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let whole = u64::from_le_bytes(wide);
    match primitive {
        Primitive::I32 => f64::from(whole as u32 as i32),
        Primitive::F32 => f64::from(f32::from_bits(whole as u32)),
        Primitive::F64 => f64::from_bits(whole),
        _ => whole as f64,
    }
}

/// Shows every number of a message: name with indices, first byte, kind.
fn walk(fields: &[Field], base: usize, name: &mut String, show: &mut impl FnMut(&str, usize, Primitive)) {
    for field in fields {
        let start = name.len();
        if start > 0 {
            name.push('.');
        }
        name.push_str(field.name);
        let step = field.size / field.count.max(1);
        for index in 0..field.count {
            let end = name.len();
            if field.count > 1 {
                name.push_str(&format!("[{index}]"));
            }
            let place = base + field.offset + index * step;
            if field.primitive == Primitive::Record {
                walk(field.record, place, name, show);
            } else {
                show(name, place, field.primitive);
            }
            name.truncate(end);
        }
        name.truncate(start);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{COMMAND, Command, LOCAL_MAP, LocalMap, Twist};

    #[test]
    fn a_difference_is_named_with_its_field_and_both_values() {
        let fields = Fields::of_all_topics();
        let one = Command { twist: Twist::new(0.25, 0.5), ..Command::default() };
        let other = Command { twist: Twist::new(0.25, -0.5), ..Command::default() };
        let (one, other) = (bytemuck::bytes_of(&one), bytemuck::bytes_of(&other));
        assert_eq!(fields.first_difference(COMMAND.index, one, one), None);
        let [name, a, b] = fields.first_difference(COMMAND.index, one, other).unwrap();
        assert_eq!((name.as_str(), a.as_str(), b.as_str()), ("twist.w_rad_s", "0.5", "-0.5"));
    }

    #[test]
    fn distances_count_messages_and_values() {
        let fields = Fields::of_all_topics();
        let one = LocalMap::default();
        let mut other = one;
        other.occupancy[3] = 10;
        other.occupancy[700] = 4;
        let mut sums = BTreeMap::new();
        for _ in 0..2 {
            fields.add_distances(
                LOCAL_MAP.index,
                bytemuck::bytes_of(&one),
                bytemuck::bytes_of(&other),
                &mut sums,
            );
        }
        let distance = Distance { messages: 2, values: 4, measured: 2, sum: 20.0, most: 10.0 };
        assert_eq!(sums.into_iter().collect::<Vec<_>>(), vec![("occupancy".to_owned(), distance)]);
    }
}

//! What was read of the file and may still be an input of a step to come.

use sidestep_msgs::{DEPTH, SCAN, TOPICS, Taken};
use sidestep_player::Entry;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Frames kept; the mapper answers one within some hundred milliseconds.
const FRAMES: usize = 64;
/// Other messages kept per topic: some 15 s of the fastest.
const MESSAGES: usize = 2048;

/// Incarnation of the writer, and sequence.
pub(crate) type Key = (u32, u64);

/// The newest messages of every topic.
#[derive(Debug)]
pub(crate) struct Store(Vec<BTreeMap<Key, Rc<Entry>>>);

/// What became of the wish for the inputs of a step.
#[derive(Debug)]
pub(crate) enum Inputs {
    /// All are there, in the order of the topic table, then by sequence.
    There(Vec<Rc<Entry>>),
    /// This topic lacks one that may still come.
    Waiting(usize),
    /// The header does not say which messages of this topic were taken.
    Uncountable(usize),
}

/// The sequences that an entry of a header names; `None` where it does not say which.
fn sequences(taken: &Taken) -> Option<Vec<u64>> {
    let span = taken.last.checked_sub(taken.first)?;
    match u64::from(taken.count) {
        // A header that claims more than is kept names nothing.
        count if count > MESSAGES as u64 => None,
        count if count.checked_sub(1) == Some(span) => Some((taken.first..=taken.last).collect()),
        2 => Some(vec![taken.first, taken.last]),
        _ => None,
    }
}

impl Store {
    pub(crate) fn new() -> Self {
        Self(TOPICS.iter().map(|_| BTreeMap::new()).collect())
    }

    pub(crate) fn put(&mut self, entry: Rc<Entry>) {
        let shelf = &mut self.0[entry.topic];
        let most = if [DEPTH.index, SCAN.index].contains(&entry.topic) { FRAMES } else { MESSAGES };
        shelf.insert((entry.header.incarnation, entry.header.sequence), entry);
        while shelf.len() > most {
            shelf.pop_first();
        }
    }

    pub(crate) fn get(&self, topic: usize, key: Key) -> Option<&Rc<Entry>> {
        self.0[topic].get(&key)
    }

    /// The newest message of a topic about a frame.
    pub(crate) fn about(&self, topic: usize, source_frame: u64) -> Option<&Rc<Entry>> {
        self.0[topic].values().rev().take(8).find(|entry| entry.header.source_frame == source_frame)
    }

    /// The messages that a header names.
    pub(crate) fn inputs(&self, taken: &[Taken]) -> Inputs {
        let mut found = Vec::with_capacity(taken.len());
        for taken in taken {
            let topic = taken.topic as usize;
            let Some(wanted) = sequences(taken).filter(|_| topic < self.0.len()) else {
                return Inputs::Uncountable(topic.min(self.0.len() - 1));
            };
            for sequence in wanted {
                let Some(entry) = self.get(topic, (taken.incarnation, sequence)) else {
                    return Inputs::Waiting(topic);
                };
                found.push(Rc::clone(entry));
            }
        }
        Inputs::There(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_names_its_messages_or_says_that_it_does_not() {
        let taken = |first, last, count| Taken { first, last, count, incarnation: 0, topic: 1, _pad: 0 };
        assert_eq!(sequences(&taken(4, 6, 3)), Some(vec![4, 5, 6]));
        assert_eq!(sequences(&taken(4, 9, 2)), Some(vec![4, 9]));
        assert_eq!(sequences(&taken(7, 7, 1)), Some(vec![7]));
        assert_eq!(sequences(&taken(4, 9, 3)), None);
        assert_eq!(sequences(&taken(9, 4, 2)), None);
    }
}

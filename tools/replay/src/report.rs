//! What came of a replay, as text and as JSON.

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// One node's steps.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct NodeTally {
    /// Steps in the recording.
    pub recorded: u64,
    /// Steps made again and compared.
    pub compared: u64,
    /// Steps among those with an output that differs.
    pub differing: u64,
    /// Steps that could not be made again, by reason.
    pub passed_over: BTreeMap<String, u64>,
    /// State records compared.
    pub states: u64,
    /// State records among those that differ.
    pub states_differing: u64,
}

/// The first difference of a replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The topic.
    pub topic: &'static str,
    /// Incarnation of the writer.
    pub incarnation: u32,
    /// Sequence: the step's name.
    pub sequence: u64,
    /// The frame it is about.
    pub source_frame: u64,
    /// The field.
    pub field: String,
    /// Its value in the recording.
    pub recorded: String,
    /// Its value now.
    pub replayed: String,
}

/// How far a field moved where something was changed on purpose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// The topic.
    pub topic: &'static str,
    /// The field; elements of an array under one name.
    pub field: String,
    /// Messages in which it moved.
    pub messages: u64,
    /// Share of the topic's compared messages.
    pub share: f64,
    /// Mean over those messages of the largest distance within each, in the unit of the field; `None` for codes and counts.
    pub mean: Option<f64>,
    /// The largest distance.
    pub most: Option<f64>,
}

/// What came of a replay.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// By node, in the order of the data.
    pub nodes: Vec<(&'static str, NodeTally)>,
    /// The first difference.
    pub first: Option<Difference>,
    /// Where something was changed on purpose: what moved, and by how much.
    pub changes: Vec<Change>,
    /// `[s]` graph time from the first to the last step.
    pub recorded_s: f64,
    /// Where the file ends early.
    pub damage: Option<String>,
}

impl Report {
    /// Steps in the recording.
    #[must_use]
    pub fn recorded(&self) -> u64 {
        self.nodes.iter().map(|(_, tally)| tally.recorded).sum()
    }

    /// Steps made again and compared.
    #[must_use]
    pub fn compared(&self) -> u64 {
        self.nodes.iter().map(|(_, tally)| tally.compared).sum()
    }

    /// Steps and states that differ.
    #[must_use]
    pub fn differing(&self) -> u64 {
        self.nodes.iter().map(|(_, tally)| tally.differing + tally.states_differing).sum()
    }

    /// For a person.
    #[must_use]
    pub fn text(&self) -> String {
        let head = ["node", "steps", "compared", "differ", "states", "st.differ"];
        let mut text = String::new();
        let mut row = |cells: [String; 6]| {
            let [name, rest @ ..] = cells;
            let rest = rest.map(|cell| format!("{cell:>9}")).join(" ");
            // A text in memory cannot fail to take more text.
            let _ = writeln!(text, "{name:<9} {rest}");
        };
        row(head.map(str::to_owned));
        for (name, tally) in &self.nodes {
            let NodeTally { recorded, compared, differing, states, states_differing, .. } = tally;
            let numbers = [recorded, compared, differing, states, states_differing].map(u64::to_string);
            let [a, b, c, d, e] = numbers;
            row([(*name).to_owned(), a, b, c, d, e]);
        }
        let share = 100.0 * self.compared() as f64 / self.recorded().max(1) as f64;
        let _ = writeln!(text, "compared {share:.2} % of all steps of {:.1} s", self.recorded_s);
        for (name, tally) in &self.nodes {
            for (why, count) in &tally.passed_over {
                let _ = writeln!(text, "not replayable: {count} of {name}: {why}");
            }
        }
        if let Some(damage) = &self.damage {
            let _ = writeln!(text, "the file ends early: {damage}");
        }
        for change in &self.changes {
            let Change { topic, field, messages, share, mean, most } = change;
            let share = 100.0 * share;
            let far = mean
                .zip(*most)
                .map_or(String::new(), |(mean, most)| format!(", mean {mean:.4}, most {most:.4}"));
            let _ = writeln!(text, "changed: {topic}.{field} in {messages} messages ({share:.1} %){far}");
        }
        if let Some(first) = self.first.as_ref().filter(|_| self.changes.is_empty()) {
            let Difference { topic, incarnation, sequence, source_frame, field, recorded, replayed } = first;
            let _ = writeln!(
                text,
                "first difference: {topic} {sequence} (incarnation {incarnation}, frame {source_frame}): {field} \
                 is {replayed}, recorded {recorded}"
            );
        }
        text
    }
}

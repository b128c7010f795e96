//! The way through a file: messages to the nodes that wait for them, outputs to their comparison.

use crate::error::ReplayError;
use crate::fields::{Distance, Fields};
use crate::nodes::{KINDS, Output};
use crate::report::{Change, Difference, Report};
use crate::runner::{Runner, Turn};
use crate::settings::Settings;
use crate::store::Store;
use crossbeam::channel::{Receiver, bounded};
use sidestep_msgs::{Header, TOPICS};
use sidestep_player::{Entry, Info, Messages, PlayerError};
use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;

/// Messages read ahead; the largest has 0.6 MB.
const READ_AHEAD: usize = 64;

/// Reads in a thread of its own: decompression takes as long as mapping does.
fn read_ahead(path: &Path) -> Result<Receiver<Result<Entry, PlayerError>>, ReplayError> {
    let messages = Messages::open(path)?;
    let (give, ahead) = bounded(READ_AHEAD);
    let read = move || {
        for entry in messages {
            if give.send(entry).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("replay-reader".into()).spawn(read).map_err(ReplayError::Thread)?;
    Ok(ahead)
}

/// What was found so far.
struct Findings {
    fields: Fields,
    first: Option<Difference>,
    /// By topic: messages compared, and distances by field.
    moved: BTreeMap<usize, (u64, BTreeMap<String, Distance>)>,
}

/// Where two outputs differ: field, recorded, replayed.
fn difference(fields: &Fields, recorded: &Entry, made: &Output) -> Option<[String; 3]> {
    if recorded.message != made.bytes {
        return fields.first_difference(made.topic, &recorded.message, &made.bytes);
    }
    let header = &recorded.header;
    let pairs = [
        ("header.source_frame", header.source_frame, made.source_frame),
        ("header.status", u64::from(header.status), u64::from(made.status)),
    ];
    let (name, was, is) = pairs.into_iter().find(|(_, was, is)| was != is)?;
    Some([name.to_owned(), was.to_string(), is.to_string()])
}

impl Findings {
    /// Compares the outputs of a step; whether any differs.
    fn compare(&mut self, outputs: &[(Rc<Entry>, Output)], changed: bool) -> bool {
        let mut differs = false;
        for (recorded, made) in outputs {
            if changed {
                let (count, distances) = self.moved.entry(made.topic).or_default();
                *count += 1;
                self.fields.add_distances(made.topic, &recorded.message, &made.bytes, distances);
            }
            let Some([field, was, is]) = difference(&self.fields, recorded, made) else { continue };
            differs = true;
            self.first.get_or_insert_with(|| Difference {
                topic: TOPICS[made.topic].name,
                incarnation: recorded.header.incarnation,
                sequence: recorded.header.sequence,
                source_frame: recorded.header.source_frame,
                field,
                recorded: was,
                replayed: is,
            });
        }
        differs
    }

    fn changes(&self) -> Vec<Change> {
        let mut changes = Vec::new();
        for (topic, (count, distances)) in &self.moved {
            for (field, distance) in distances {
                let measured = distance.measured > 0;
                changes.push(Change {
                    topic: TOPICS[*topic].name,
                    field: field.clone(),
                    messages: distance.messages,
                    share: distance.messages as f64 / (*count).max(1) as f64,
                    mean: measured.then(|| distance.sum / distance.measured as f64),
                    most: measured.then_some(distance.most),
                });
            }
        }
        changes
    }
}

/// A replay in progress.
struct Replay {
    runners: Vec<Runner>,
    store: Store,
    findings: Findings,
    changed: bool,
    refine_from_now: bool,
    newest_ns: u64,
    span: Option<(u64, u64)>,
}

impl Replay {
    fn new(settings: &Settings, topics: &[String]) -> Result<Self, ReplayError> {
        let recorded = |kind: &&_| {
            let kind: &crate::nodes::Kind = kind;
            topics.iter().any(|topic| topic == TOPICS[kind.outputs[0]].name)
        };
        let runner = |kind| Ok(Runner::new(kind, (kind.make)(settings)?));
        let runners: Result<Vec<_>, ReplayError> = KINDS.iter().filter(recorded).map(runner).collect();
        let findings = Findings { fields: Fields::of_all_topics(), first: None, moved: BTreeMap::new() };
        Ok(Self {
            runners: runners?,
            store: Store::new(),
            findings,
            changed: settings.changed,
            refine_from_now: settings.graph.lead() == "refined" && settings.recorded_lead != "refined",
            newest_ns: 0,
            span: None,
        })
    }

    fn take(&mut self, entry: Entry) {
        self.newest_ns = self.newest_ns.max(entry.logged_ns);
        let entry = Rc::new(entry);
        let of_a_node = self.runners.iter_mut().any(|runner| runner.offer(&entry));
        // Where something was changed, what a node wrote is known to others only when it is made again.
        if !of_a_node || !self.changed {
            self.store.put(entry);
        }
        self.go_on();
    }

    /// Makes every step whose inputs are there.
    fn go_on(&mut self) {
        for place in 0..self.runners.len() {
            loop {
                let runner = &mut self.runners[place];
                let turn = runner.turn(&self.store, self.newest_ns, self.refine_from_now, !self.changed);
                match turn {
                    Turn::Waiting => break,
                    Turn::PassedOver(outputs) => outputs.into_iter().for_each(|entry| self.publish(entry)),
                    Turn::Made(outputs) => self.compare(place, outputs),
                }
            }
        }
    }

    fn publish(&mut self, entry: Rc<Entry>) {
        if self.changed {
            self.store.put(entry);
        }
    }

    fn compare(&mut self, place: usize, outputs: Vec<(Rc<Entry>, Output)>) {
        if let Some((entry, _)) = outputs.first() {
            let now_ns = entry.header.now_ns;
            let (from, to) = self.span.unwrap_or((now_ns, now_ns));
            self.span = Some((from.min(now_ns), to.max(now_ns)));
        }
        let differs = self.findings.compare(&outputs, self.changed);
        self.runners[place].tally.differing += u64::from(differs);
        if self.changed {
            for (recorded, made) in outputs {
                let (source_frame, status) = (made.source_frame, made.status);
                let header = Header { source_frame, status, ..recorded.header };
                let logged_ns = recorded.logged_ns;
                self.store.put(Rc::new(Entry { topic: made.topic, header, message: made.bytes, logged_ns }));
            }
        }
    }
}

/// Replays a recording.
///
/// # Errors
/// [`ReplayError`]; damage within the file is told by the report.
pub fn replay(path: &Path, settings: &Settings) -> Result<Report, ReplayError> {
    let info = Info::read(path)?;
    let topics: Vec<String> = info
        .channels
        .iter()
        .filter(|channel| channel.count > 0)
        .map(|channel| channel.topic.clone())
        .collect();
    let mut replay = Replay::new(settings, &topics)?;
    if replay.runners.is_empty() {
        let remedy = "record a drive of the graph; sensors alone can be played: `sidestep play`";
        return Err(ReplayError::Missing { path: path.to_path_buf(), what: "output of a node", remedy });
    }
    for entry in read_ahead(path)? {
        replay.take(entry?);
    }
    // Nothing comes any more: what is still awaited was lost, node after node.
    replay.newest_ns = u64::MAX;
    for _ in 0..KINDS.len() {
        replay.go_on();
    }
    let (from, to) = replay.span.unwrap_or_default();
    Ok(Report {
        nodes: replay.runners.iter().map(|runner| (runner.kind.name, runner.tally.clone())).collect(),
        first: replay.findings.first.take(),
        changes: replay.findings.changes(),
        recorded_s: (to - from) as f64 * 1e-9,
        damage: info.damage,
    })
}

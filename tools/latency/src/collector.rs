//! Latencies of a drive from the stamps that travel with each frame, live or from a recording.

use crate::distribution::{Distribution, Figures};
use crate::frames::Frames;
use sidestep_msgs::{
    COMMAND, Clock, ClockMode, Code, Command, DEPTH, DepthFrame, Header, SCAN, STAGES, Stage, StageStamp,
};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Frames remembered, so that a stage counts once although several messages carry its stamps.
const ROOM: usize = 256;
/// The stages with a step of their own.
const STEPPING: [Stage; 5] = [Stage::Mapper, Stage::Goal, Stage::Policy, Stage::Expert, Stage::Arbiter];

/// Epoch and number of the frames whose stamp of one stage was counted.
#[derive(Debug, Clone)]
struct Seen(Vec<(u32, u64)>);

impl Seen {
    fn new() -> Self {
        Self(vec![(0, 0); ROOM])
    }

    /// Whether this is new.
    fn note(&mut self, epoch: u32, frame: u64) -> bool {
        let place = &mut self.0[frame as usize % ROOM];
        let is_new = *place != (epoch, frame);
        *place = (epoch, frame);
        is_new
    }
}

/// A stage's step as it was counted: for traces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Passed {
    pub(crate) stage: Stage,
    pub(crate) frame: u64,
    pub(crate) stamp: StageStamp,
}

/// Latencies of a drive.
///
/// Stage: from receive to send. Hop: from the previous send to receive. Depth to command: from the send of a frame to
/// the send of the first command that is about it or a later one. Age at the wheels: graph time from the exposure to
/// the command that first answers it; capture to send: the driver's part of it.
#[derive(Debug, Clone)]
pub struct Collector {
    stages: [Distribution; STEPPING.len()],
    hops: [Distribution; STEPPING.len()],
    depth_to_command: Distribution,
    capture_to_send: Distribution,
    age_at_wheels: Distribution,
    frames: Frames,
    seen: [Seen; STAGES],
}

/// The stages whose output a stage waits for.
fn previous(stage: Stage) -> &'static [Stage] {
    match stage {
        Stage::Depth => &[],
        Stage::Mapper => &[Stage::Depth],
        Stage::Goal => &[Stage::Mapper],
        Stage::Policy | Stage::Expert => &[Stage::Goal],
        Stage::Arbiter => &[Stage::Policy, Stage::Expert],
    }
}

impl Collector {
    /// Nothing collected yet; `budgets_ms` names what a stage, a hop (`hop_mapper`) or the whole may take.
    #[must_use]
    pub fn new(budgets_ms: &BTreeMap<String, f64>) -> Self {
        let budget = |name: &str| budgets_ms.get(name).copied();
        Self {
            stages: STEPPING.map(|stage| Distribution::new(budget(stage.label()))),
            hops: STEPPING.map(|stage| Distribution::new(budget(&format!("hop_{}", stage.label())))),
            depth_to_command: Distribution::new(budget("depth_to_command")),
            capture_to_send: Distribution::new(budget("capture_to_send")),
            age_at_wheels: Distribution::new(budget("age_at_wheels")),
            frames: Frames::new(),
            seen: std::array::from_fn(|_| Seen::new()),
        }
    }

    /// Takes a word of the driver on graph time.
    pub fn clock(&mut self, clock: &Clock) {
        self.frames.pace(clock.mode != ClockMode::Lockstep.code());
    }

    /// Takes the header of a message of a topic of the table; each topic in its own order.
    pub fn header(&mut self, topic: usize, header: &Header) {
        self.passed(topic, header, |_| ());
    }

    /// As [`Collector::header`], and shows each step that is counted.
    pub(crate) fn passed(&mut self, topic: usize, header: &Header, mut show: impl FnMut(Passed)) {
        self.frames.enter(header.epoch);
        let is_frame = topic == DEPTH.index || topic == SCAN.index;
        let frame = if is_frame { header.sequence } else { header.source_frame };
        if frame == 0 {
            return;
        }
        let stamp = |stage: Stage| header.stages[stage as usize];
        let depth = stamp(Stage::Depth);
        if depth.send_ns != 0 {
            self.frames.sent(frame, depth.send_ns, &mut |time_ns| self.depth_to_command.add(time_ns));
            if self.seen[Stage::Depth as usize].note(header.epoch, frame) {
                show(Passed { stage: Stage::Depth, frame, stamp: depth });
            }
        }
        for (place, &stage) in STEPPING.iter().enumerate() {
            let at = stamp(stage);
            if at.send_ns == 0 || !self.seen[stage as usize].note(header.epoch, frame) {
                continue;
            }
            self.stages[place].add(at.send_ns.saturating_sub(at.receive_ns));
            let left_ns = previous(stage).iter().map(|&stage| stamp(stage).send_ns).max().unwrap_or(0);
            if left_ns != 0 {
                self.hops[place].add(at.receive_ns.saturating_sub(left_ns));
            }
            show(Passed { stage, frame, stamp: at });
        }
        let sent_ns = stamp(Stage::Arbiter).send_ns;
        if topic == COMMAND.index && sent_ns != 0 {
            self.frames.answered(frame, sent_ns, &mut |time_ns| self.depth_to_command.add(time_ns));
        }
    }

    /// Takes a depth frame beside its header: how old it was when it was sent, in graph time.
    pub fn depth(&mut self, capture_ns: u64, header: &Header) {
        self.capture_to_send.add(header.now_ns.saturating_sub(capture_ns));
    }

    /// Takes a command beside its header: how old what it answers is, in graph time.
    pub fn command(&mut self, command: &Command) {
        if command.answers != 0 && command.map_age_s.is_finite() {
            self.age_at_wheels.add((f64::from(command.map_age_s.max(0.0)) * 1e9) as u64);
        }
    }

    /// Name and figures of everything collected: stages, depth to command, hops, ages.
    #[must_use]
    pub fn figures(&self) -> Vec<(String, Figures)> {
        let labels = || STEPPING.iter().map(|stage| stage.label());
        let stages = labels().zip(&self.stages).map(|(name, times)| (name.to_owned(), times.figures()));
        let hops = labels().zip(&self.hops).map(|(name, times)| (format!("hop_{name}"), times.figures()));
        let whole = [
            ("depth_to_command", &self.depth_to_command),
            ("capture_to_send", &self.capture_to_send),
            ("age_at_wheels", &self.age_at_wheels),
        ]
        .map(|(name, times)| (name.to_owned(), times.figures()));
        stages.chain(whole).chain(hops).collect()
    }

    /// Samples above their budget, all kinds together.
    #[must_use]
    pub fn misses(&self) -> u64 {
        self.figures().iter().map(|(_, figures)| figures.misses).sum()
    }

    /// As a table for a person; kinds without a sample are left out.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<17} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7}\n",
            "latency [ms]", "count", "p50", "p90", "p99", "p99.9", "max", "budget", "misses"
        );
        let cell = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.3}"));
        for (name, figures) in self.figures() {
            let Figures { count, p50, p90, p99, p999, max, budget, misses } = figures;
            if count == 0 {
                continue;
            }
            let [p50, p90, p99, p999, max, budget] = [p50, p90, p99, p999, max, budget].map(cell);
            // A text in memory cannot fail to take more text.
            let _ = writeln!(
                text,
                "{name:<17} {count:>7} {p50:>8} {p90:>8} {p99:>8} {p999:>8} {max:>8} {budget:>8} {misses:>7}"
            );
        }
        text
    }

    /// For a machine: an object with one entry per kind, in milliseconds (SPEC section 8, `latency_ms`).
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let entries = self.figures().into_iter();
        entries
            .map(|(name, figures)| (name, serde_json::json!(figures)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}

/// `[ns]` the capture stamp of a depth frame given as bytes.
pub(crate) fn capture_ns(frame: &[u8]) -> Option<u64> {
    let place = std::mem::offset_of!(DepthFrame, capture_ns);
    Some(u64::from_le_bytes(frame.get(place..place + 8)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{EXPERT_COMMAND, LOCAL_MAP, POLICY_COMMAND};

    const MS: u64 = 1_000_000;

    /// The stamps of frame `number`: a stage takes 1 ms, a hop half a millisecond.
    fn header(number: u64, last: &[Stage]) -> Header {
        let mut header = Header { source_frame: number, sequence: number, ..Header::default() };
        let sent_ns = number * 33 * MS;
        header.stages[0] = StageStamp { receive_ns: sent_ns - MS, send_ns: sent_ns };
        for &stage in last {
            let level = [0, 1, 2, 3, 3, 4][stage as usize];
            let receive_ns = sent_ns + (level - 1) * MS * 3 / 2 + MS / 2;
            header.stages[stage as usize] = StageStamp { receive_ns, send_ns: receive_ns + MS };
        }
        header
    }

    #[test]
    fn stages_and_hops_are_counted_once_per_frame_whatever_carries_their_stamps() {
        use Stage::{Arbiter, Expert, Goal, Mapper, Policy};
        let budgets = BTreeMap::from([("mapper".to_owned(), 0.5), ("goal".to_owned(), 2.0)]);
        let mut collector = Collector::new(&budgets);
        for frame in 1..=40 {
            collector.header(DEPTH.index, &header(frame, &[]));
            collector.header(LOCAL_MAP.index, &header(frame, &[Mapper]));
            collector.header(EXPERT_COMMAND.index, &header(frame, &[Mapper, Goal, Expert]));
            collector.header(POLICY_COMMAND.index, &header(frame, &[Mapper, Goal, Policy]));
            for _ in 0..3 {
                collector.header(COMMAND.index, &header(frame, &[Mapper, Goal, Policy, Arbiter]));
            }
        }
        for (name, figures) in collector.figures() {
            let needed = match name.as_str() {
                "capture_to_send" | "age_at_wheels" => continue,
                "depth_to_command" => 6.0,
                hop if hop.starts_with("hop_") => 0.5,
                _ => 1.0,
            };
            assert_eq!(figures.count, 40, "{name}");
            assert!((figures.p50.unwrap() / needed - 1.0).abs() < 2e-3, "{name}: {figures:?}");
        }
        assert_eq!(collector.misses(), 40);
        let json = collector.json();
        assert_eq!(json["mapper"]["misses"], 40);
        assert_eq!(json["goal"]["budget"], 2.0);
        for key in ["count", "p50", "p90", "p99", "p999", "max", "budget", "misses"] {
            assert!(json["depth_to_command"].get(key).is_some(), "{key}");
        }
        let table = collector.table();
        assert!(table.contains("hop_arbiter") && !table.contains("age_at_wheels"), "{table}");
    }

    #[test]
    fn a_looping_playback_counts_each_epoch_anew() {
        let mut collector = Collector::new(&BTreeMap::new());
        for epoch in 1..=2 {
            for frame in 1..=20 {
                let command = header(frame, &[Stage::Mapper, Stage::Goal, Stage::Policy, Stage::Arbiter]);
                collector.header(COMMAND.index, &Header { epoch, ..command });
            }
        }
        assert_eq!(collector.json()["depth_to_command"]["count"], 40);
        assert_eq!(collector.json()["arbiter"]["count"], 40);
    }
}

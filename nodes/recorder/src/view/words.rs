//! What changes, as lines of a log: reasons of the arbiter, statuses and lives of the nodes, words of the operator.

use super::Seen;
use super::channels::LOG;
use super::figures::label;
use super::file_time::FileTime;
use super::sheet::Sheet;
use foxglove::messages::{Log, log::Level};
use sidestep_msgs::{
    COMMAND, Code, ESTOP, EXPERT_COMMAND, EstopAction, LOCAL_GOAL, LOCAL_MAP, NodeState, POLICY_COMMAND,
    Reason, Status, TOPICS_MAX, TRUTH, Winner, health_topic,
};

/// What was said last.
pub(crate) struct Words {
    /// Reason and winner of the newest command.
    command: Option<(u32, u32)>,
    /// By topic: status or state, and life of the writer.
    nodes: [Option<(u32, u32)>; TOPICS_MAX],
    collisions: u32,
}

impl Default for Words {
    fn default() -> Self {
        Self { command: None, nodes: [None; TOPICS_MAX], collisions: 0 }
    }
}

fn reason_level(reason: u32) -> Level {
    match Reason::from_code(reason) {
        Some(
            Reason::EstopLatched | Reason::Slip | Reason::PoseJump | Reason::Emergency | Reason::BoxedIn,
        ) => Level::Error,
        Some(
            Reason::Clear
            | Reason::Slowed
            | Reason::Straight
            | Reason::Yielding
            | Reason::Rotating
            | Reason::Teleop
            | Reason::Arrived
            | Reason::NoGoal
            | Reason::Hold
            | Reason::Starting
            | Reason::AwaitOperator
            | Reason::ScanRotation
            | Reason::Advance,
        ) => Level::Info,
        _ => Level::Warning,
    }
}

fn status_level(status: u32) -> Level {
    match Status::from_code(status) {
        Some(Status::Ok | Status::NoGoal | Status::Arrived | Status::Hold) => Level::Info,
        Some(Status::Fault) | None => Level::Error,
        _ => Level::Warning,
    }
}

impl Words {
    pub(crate) fn take(&mut self, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        let now_ns = seen.header.now_ns;
        let mut say = |level: Level, name: &str, message: String| {
            let line = Log {
                timestamp: time.stamp(now_ns),
                level: level as i32,
                message,
                name: name.into(),
                ..Log::default()
            };
            sheet.put(LOG, &line);
        };
        let index = seen.row.index;
        if let Some(command) = seen.read(COMMAND) {
            let words = (command.reason, command.winner);
            if self.command.replace(words) != Some(words) {
                let (reason, winner) = (label::<Reason>(command.reason), label::<Winner>(command.winner));
                let text = format!("{reason} (winner {winner}, scale {:.2})", command.scale);
                say(reason_level(command.reason), seen.row.writer, text);
            }
        } else if [LOCAL_MAP.index, LOCAL_GOAL.index, POLICY_COMMAND.index, EXPERT_COMMAND.index]
            .contains(&index)
        {
            let words = (seen.header.status, seen.header.incarnation);
            if self.nodes[index].replace(words) != Some(words) {
                say(status_level(words.0), seen.row.writer, label::<Status>(words.0).into());
            }
        } else if let Some(node) = seen.row.name.strip_prefix("health/")
            && let Some(health) = health_topic(node).and_then(|topic| seen.read(topic))
        {
            let words = (health.state, seen.header.incarnation);
            let before = self.nodes[index].replace(words);
            if before != Some(words) {
                let restarted = before.is_some_and(|(_, life)| life != words.1);
                let level = if restarted { Level::Warning } else { Level::Info };
                say(level, node, format!("{}, life {}", label::<NodeState>(words.0), words.1));
            }
        } else if let Some(estop) = seen.read(ESTOP) {
            say(Level::Warning, "operator", label::<EstopAction>(estop.action).into());
        } else if let Some(truth) = seen.read(TRUTH)
            && truth.collisions != std::mem::replace(&mut self.collisions, truth.collisions)
            && truth.collisions > 0
        {
            say(Level::Error, "sim", format!("contact number {}", truth.collisions));
        }
    }
}

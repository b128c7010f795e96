//! The one table of topics: type, writer, rate and quality of service of everything that crosses a process border.
//!
//! One writer per topic, enforced by the transport. Safe overflow everywhere: a writer never waits for a reader.
//! A reader of the newest takes a buffer of one; a reader of all takes the whole buffer and counts gaps.

use crate::layout::Message;
use std::marker::PhantomData;

/// Room for topics in [`crate::Health`].
pub const TOPICS_MAX: usize = 40;

/// A row of the table without its type.
#[derive(Debug, Clone, Copy)]
pub struct TopicRow {
    /// Position in the table; inputs are handled in this order.
    pub index: usize,
    /// Name of the service and of the channel in recordings.
    pub name: &'static str,
    /// Versioned name of the message.
    pub type_name: &'static str,
    /// Hash of the message's layout.
    pub layout_hash: u64,
    /// Bytes of the message.
    pub size: usize,
    /// The one node (or kind of driver) that writes it.
    pub writer: &'static str,
    /// `[Hz]` nominal rate; 0 = on demand.
    pub rate_hz: f32,
    /// Messages kept per reader.
    pub buffer: usize,
    /// Messages a reader may hold at once.
    pub borrow: usize,
    /// Messages a late reader gets.
    pub history: usize,
    /// Most readers at once.
    pub readers: usize,
}

/// A typed name of a row: what an inbox or outbox is opened with.
#[derive(Debug)]
pub struct Topic<M> {
    /// Position in the table.
    pub index: usize,
    message: PhantomData<fn() -> M>,
}

impl<M> Clone for Topic<M> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<M> Copy for Topic<M> {}

impl<M: Message> Topic<M> {
    /// The row of this topic.
    #[must_use]
    pub fn row(&self) -> &'static TopicRow {
        &TOPICS[self.index]
    }
}

/// Something to do for each topic with its type, where code must know the types of all: services, recorder, player.
pub trait TopicVisitor {
    /// What goes wrong.
    type Error;
    /// Called once per topic, in the order of the table.
    ///
    /// # Errors
    /// Whatever the visitor finds; the visit ends there.
    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), Self::Error>;
}

macro_rules! topics {
    ($($(#[$meta:meta])* $key:ident: $message:ident = $index:literal $name:literal by $writer:literal
        at $rate:literal Hz, buffer $buffer:literal, borrow $borrow:literal, history $history:literal, readers $readers:literal;)*) => {
        $($(#[$meta])* pub const $key: Topic<crate::$message> = Topic { index: $index, message: PhantomData };)*

        /// All topics; the index of a row is its position.
        pub static TOPICS: &[TopicRow] = &[$(TopicRow {
            index: $index,
            name: $name,
            type_name: <crate::$message as Message>::NAME,
            layout_hash: <crate::$message as Message>::LAYOUT_HASH,
            size: std::mem::size_of::<crate::$message>(),
            writer: $writer,
            rate_hz: $rate,
            buffer: $buffer,
            borrow: $borrow,
            history: $history,
            readers: $readers,
        }),*];

        /// Shows every topic with its type to a visitor, in the order of the table.
        ///
        /// # Errors
        /// The first error of the visitor.
        pub fn visit_topics<V: TopicVisitor>(visitor: &mut V) -> Result<(), V::Error> {
            $(visitor.visit($key)?;)*
            Ok(())
        }
    };
}

topics! {
    /// Graph time.
    CLOCK: Clock = 0 "clock" by "driver" at 1.0 Hz, buffer 64, borrow 2, history 1, readers 16;
    /// Pose and velocity.
    ODOMETRY: Odometry = 1 "odometry" by "driver" at 100.0 Hz, buffer 128, borrow 2, history 1, readers 8;
    /// Ultrasonic sensors.
    RANGES: Ranges = 2 "ranges" by "driver" at 20.0 Hz, buffer 32, borrow 2, history 1, readers 6;
    /// Depth frames.
    DEPTH: DepthFrame = 3 "depth" by "driver" at 30.0 Hz, buffer 4, borrow 1, history 0, readers 7;
    /// Lidar sweeps.
    SCAN: Scan = 4 "scan" by "driver" at 30.0 Hz, buffer 8, borrow 1, history 0, readers 4;
    /// Path to follow.
    PATH: Path = 5 "path" by "driver" at 0.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Person to follow.
    TARGET: Target = 6 "target" by "driver" at 30.0 Hz, buffer 16, borrow 2, history 1, readers 6;
    /// What the simulator knows.
    TRUTH: Truth = 7 "truth" by "sim" at 100.0 Hz, buffer 128, borrow 2, history 1, readers 4;
    /// The operator's stick.
    TELEOP: Teleop = 8 "teleop" by "operator" at 20.0 Hz, buffer 16, borrow 2, history 0, readers 4;
    /// Emergency stop, reset, hold, resume.
    ESTOP: Estop = 9 "estop" by "operator" at 0.0 Hz, buffer 16, borrow 2, history 0, readers 4;
    /// Nearest ranges straight from depth.
    NEAR_FIELD: NearField = 10 "near_field" by "guard" at 30.0 Hz, buffer 16, borrow 2, history 1, readers 6;
    /// The map to plan on.
    LOCAL_MAP: LocalMap = 11 "local_map" by "mapper" at 30.0 Hz, buffer 16, borrow 2, history 1, readers 8;
    /// The map to be safe with.
    SAFETY_MAP: SafetyMap = 12 "safety_map" by "mapper" at 30.0 Hz, buffer 16, borrow 2, history 1, readers 6;
    /// The point to head for.
    LOCAL_GOAL: LocalGoal = 13 "local_goal" by "goal" at 30.0 Hz, buffer 16, borrow 2, history 1, readers 8;
    /// The policy's proposal.
    POLICY_COMMAND: Proposal = 14 "policy_command" by "policy" at 30.0 Hz, buffer 32, borrow 2, history 0, readers 8;
    /// The expert's proposal.
    EXPERT_COMMAND: Proposal = 15 "expert_command" by "expert" at 30.0 Hz, buffer 32, borrow 2, history 0, readers 8;
    /// The velocity command.
    COMMAND: Command = 16 "command" by "arbiter" at 130.0 Hz, buffer 64, borrow 2, history 0, readers 8;
    /// State of the mapper.
    STATE_MAPPER: MapperState = 17 "state/mapper" by "mapper" at 0.1 Hz, buffer 4, borrow 1, history 1, readers 2;
    /// State of the goal node.
    STATE_GOAL: GoalState = 18 "state/goal" by "goal" at 0.1 Hz, buffer 4, borrow 1, history 1, readers 2;
    /// State of the arbiter.
    STATE_ARBITER: ArbiterState = 19 "state/arbiter" by "arbiter" at 0.1 Hz, buffer 4, borrow 1, history 1, readers 2;
    /// Heartbeat of `sim`.
    HEALTH_SIM: Health = 20 "health/sim" by "sim" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `player`.
    HEALTH_PLAYER: Health = 21 "health/player" by "player" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of a driver that is neither `sim` nor `player`.
    HEALTH_DRIVER: Health = 22 "health/driver" by "driver" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `mapper`.
    HEALTH_MAPPER: Health = 23 "health/mapper" by "mapper" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `goal`.
    HEALTH_GOAL: Health = 24 "health/goal" by "goal" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `policy`.
    HEALTH_POLICY: Health = 25 "health/policy" by "policy" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `expert`.
    HEALTH_EXPERT: Health = 26 "health/expert" by "expert" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `arbiter`.
    HEALTH_ARBITER: Health = 27 "health/arbiter" by "arbiter" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `recorder`.
    HEALTH_RECORDER: Health = 28 "health/recorder" by "recorder" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// Heartbeat of `guard`.
    HEALTH_GUARD: Health = 29 "health/guard" by "guard" at 40.0 Hz, buffer 8, borrow 2, history 1, readers 6;
    /// The wish to keep the last seconds.
    SNAPSHOT: Snapshot = 30 "snapshot" by "operator" at 0.0 Hz, buffer 4, borrow 1, history 0, readers 4;
    /// What the recorder has begun and kept.
    RECORDING: Recording = 31 "recording" by "recorder" at 0.0 Hz, buffer 4, borrow 1, history 1, readers 16;
}

const _: () = assert!(TOPICS.len() <= TOPICS_MAX);

/// The row with this name.
#[must_use]
pub fn topic_named(name: &str) -> Option<&'static TopicRow> {
    TOPICS.iter().find(|row| row.name == name)
}

/// The heartbeat topic of a node, or `None` for a name that is no node.
#[must_use]
pub fn health_topic(node: &str) -> Option<Topic<crate::Health>> {
    let row = TOPICS.iter().find(|row| row.name.strip_prefix("health/") == Some(node))?;
    Some(Topic { index: row.index, message: PhantomData })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_index_of_a_topic_is_its_position() {
        for (position, row) in TOPICS.iter().enumerate() {
            assert_eq!(row.index, position, "{}", row.name);
        }
    }

    #[test]
    fn names_are_unique() {
        for row in TOPICS {
            assert_eq!(TOPICS.iter().filter(|other| other.name == row.name).count(), 1, "{}", row.name);
        }
    }

    #[test]
    fn only_the_arbiter_writes_commands_and_nobody_but_arbiter_and_tools_could() {
        let command = topic_named("command").unwrap();
        assert_eq!(command.writer, "arbiter");
        assert_eq!(TOPICS.iter().filter(|row| row.writer == "arbiter").count(), 3);
    }
}

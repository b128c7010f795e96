//! One node under supervision: alive, hung, dead, swept, started again.

use crate::child::{self, RunNames, Usage};
use crate::external::FirstWord;
use crate::manifest::{NodePlan, Restart, Supervision};
use crate::space::cause_of;
use sidestep_bus::{Inbox, Keep, Link, NodeError, Step};
use sidestep_msgs::{Health, NodeState, TOPICS_MAX, health_topic};
use std::os::unix::process::ExitStatusExt;
use std::process::Child;

/// Where a node is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Started, no heartbeat yet.
    Starting,
    /// Beating.
    Running,
    /// Ended; what it left in shared memory is not yet swept.
    Dead,
    /// Swept; waits for its next start.
    Waiting,
    /// Will not be started again.
    Ended,
}

/// What happened to a node, for the log and the summary.
#[derive(Debug, Clone)]
pub(crate) struct Event {
    /// `[ns]` host time.
    pub(crate) host_ns: u64,
    /// The node.
    pub(crate) node: String,
    /// What happened.
    pub(crate) what: String,
}

/// A node under supervision.
#[derive(Debug)]
pub(crate) struct Watched {
    /// How to start it.
    pub(crate) plan: NodePlan,
    /// Where it is in its life.
    pub(crate) phase: Phase,
    /// The process.
    pub(crate) child: Option<Child>,
    /// Restarts so far.
    pub(crate) incarnation: u32,
    /// How it last ended.
    pub(crate) exit: Option<String>,
    /// Exit code of the last end, where it had one.
    pub(crate) exit_code: Option<i32>,
    /// Its newest heartbeat.
    pub(crate) health: Option<Health>,
    /// Messages sent, lost and skipped per topic in earlier incarnations.
    past: [[u64; TOPICS_MAX]; 3],
    usage_past: Usage,
    sampled: Usage,
    heartbeat: Option<Inbox<Health>>,
    /// Whether this incarnation beats; a program that never does is not blamed for its silence.
    beats: bool,
    /// For a program of its own, until it speaks.
    first_word: Option<FirstWord>,
    since_ns: u64,
    beat_ns: u64,
    due_ns: u64,
    died_ns: u64,
    restarts_in_row: u32,
}

impl Watched {
    /// A node that is not started yet.
    ///
    /// # Errors
    /// [`NodeError::Transport`] where its heartbeat cannot be read.
    pub(crate) fn new(plan: NodePlan, link: &Link) -> Result<Self, NodeError> {
        let heartbeat = health_topic(&plan.name).map(|topic| link.inbox(topic, Keep::Newest)).transpose()?;
        Ok(Self {
            plan,
            phase: Phase::Waiting,
            child: None,
            incarnation: 0,
            exit: None,
            exit_code: None,
            health: None,
            past: [[0; TOPICS_MAX]; 3],
            usage_past: Usage::default(),
            sampled: Usage::default(),
            heartbeat,
            beats: false,
            first_word: None,
            since_ns: 0,
            beat_ns: 0,
            due_ns: 0,
            died_ns: 0,
            restarts_in_row: 0,
        })
    }

    /// Starts it, if it waits and its pause is over.
    pub(crate) fn start_when_due(&mut self, names: &RunNames, link: &Link, now_ns: u64) -> Option<Event> {
        if self.phase != Phase::Waiting || now_ns < self.due_ns {
            return None;
        }
        if self.exit.is_some() {
            self.incarnation += 1;
        }
        self.beats = false;
        let is_external = !self.plan.command.is_empty();
        self.first_word = is_external.then(|| FirstWord::listen(link, &self.plan.writes));
        match child::start(&self.plan, names, self.incarnation) {
            Ok(child) => {
                self.child = Some(child);
                self.phase = Phase::Starting;
                (self.since_ns, self.beat_ns) = (now_ns, now_ns);
                (self.incarnation > 0)
                    .then(|| self.event(now_ns, format!("started again, incarnation {}", self.incarnation)))
            }
            Err(error) => {
                self.phase = Phase::Ended;
                let program = self.plan.command.first().map_or("sidestep", String::as_str);
                Some(self.event(now_ns, format!("cannot start {program}: {error}; given up")))
            }
        }
    }

    /// Takes note of a heartbeat, or of the first message of a program without one; true when a starting node is ready.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub(crate) fn take_sign(&mut self, step: &mut Step, now_ns: u64) -> Result<bool, NodeError> {
        let mut ready = self.take_heartbeat(step, now_ns)?;
        if let Some(first_word) = &mut self.first_word {
            ready |= first_word.is_spoken(step)?;
        }
        ready &= self.phase == Phase::Starting;
        if ready {
            self.phase = Phase::Running;
            self.first_word = None;
        }
        Ok(ready)
    }

    /// Whether the newest heartbeat says that the node has started.
    fn take_heartbeat(&mut self, step: &mut Step, now_ns: u64) -> Result<bool, NodeError> {
        let Some(inbox) = &mut self.heartbeat else { return Ok(false) };
        let Some(message) = inbox.newest(step)? else { return Ok(false) };
        if self.child.is_none() || message.header().incarnation != self.incarnation {
            return Ok(false);
        }
        self.beat_ns = now_ns;
        self.beats = true;
        self.health = Some(*message);
        Ok(message.state != NodeState::Starting as u32)
    }

    /// Kills it if it gave no sign of life for too long.
    pub(crate) fn kill_when_hung(&mut self, limits: &Supervision, now_ns: u64) -> Option<Event> {
        let silent_ms = now_ns.saturating_sub(self.beat_ns) / 1_000_000;
        let what = match self.phase {
            Phase::Running if self.beats && silent_ms > limits.hang_ms => "hung: no heartbeat",
            Phase::Starting if silent_ms > limits.start_ms && self.first_word.is_some() => {
                "not ready in time: neither a message nor a heartbeat"
            }
            Phase::Starting if silent_ms > limits.start_ms => "not ready in time: no heartbeat",
            _ => return None,
        };
        let child = self.child.as_ref()?;
        child::signal(child, libc::SIGKILL);
        // Counted from here on, so that one hang gives one event.
        self.beat_ns = now_ns;
        Some(self.event(now_ns, format!("{what} for {silent_ms} ms; killed")))
    }

    /// Forgives silence up to now: the supervisor itself was late.
    pub(crate) fn forgive(&mut self, now_ns: u64) {
        self.beat_ns = now_ns;
    }

    /// Takes note of its end.
    pub(crate) fn reap(&mut self, step: &mut Step, limits: &Supervision, now_ns: u64) -> Option<Event> {
        let child = self.child.as_mut()?;
        let status = child.try_wait().ok().flatten()?;
        self.child = None;
        self.hear_last_words(step);
        self.died_ns = now_ns;
        self.usage_past.cpu_s += self.sampled.cpu_s;
        self.sampled.cpu_s = 0.0;
        self.keep_counts();
        let ending = child::ending(status);
        self.exit_code = status.code();
        self.exit = Some(ending.clone());
        let lived_s = now_ns.saturating_sub(self.since_ns) as f64 * 1e-9;
        if lived_s > limits.window_s {
            self.restarts_in_row = 0;
        }
        // A node that refuses its configuration would refuse it again.
        let hopeless =
            self.exit_code == Some(2) || self.plan.moves_time || self.restarts_in_row >= limits.restarts_most;
        self.phase = if self.plan.restart == Restart::Never || hopeless { Phase::Ended } else { Phase::Dead };
        let over = self.phase == Phase::Ended && self.exit_code != Some(0);
        let what = if over { "ended and given up" } else { "ended" };
        let cause = cause_of(status.signal()).map_or_else(String::new, |cause| format!("; {cause}"));
        Some(self.event(now_ns, format!("{what}: {ending} after {lived_s:.1} s{cause}")))
    }

    /// Takes note of an end that was asked for.
    pub(crate) fn leave(&mut self, step: &mut Step) {
        let Some(child) = &mut self.child else { return };
        if let Ok(Some(status)) = child.try_wait() {
            self.child = None;
            self.hear_last_words(step);
            self.exit_code = status.code();
            self.exit = Some(child::ending(status));
            self.phase = Phase::Ended;
        }
    }

    /// Whether it ended before a host time, so that a sweep begun then has seen all it left.
    pub(crate) fn died_before(&self, host_ns: u64) -> bool {
        self.phase == Phase::Dead && self.died_ns <= host_ns
    }

    /// Its litter is gone: it may start after its pause.
    pub(crate) fn swept(&mut self, limits: &Supervision, now_ns: u64) {
        if self.phase != Phase::Dead {
            return;
        }
        // The first restart in a row is immediate, then the pause doubles.
        let doublings = self.restarts_in_row.saturating_sub(1).min(20);
        let pause_ms = if self.restarts_in_row == 0 {
            0
        } else {
            (limits.delay_ms << doublings).min(limits.delay_most_ms)
        };
        self.restarts_in_row += 1;
        self.due_ns = now_ns + pause_ms * 1_000_000;
        self.phase = Phase::Waiting;
    }

    /// Goes back to before its first start, in a fresh domain.
    ///
    /// # Errors
    /// [`NodeError::Transport`] where its heartbeat cannot be read there.
    pub(crate) fn move_to(&mut self, link: &Link) -> Result<(), NodeError> {
        self.heartbeat =
            health_topic(&self.plan.name).map(|topic| link.inbox(topic, Keep::Newest)).transpose()?;
        if self.phase != Phase::Ended {
            self.phase = Phase::Waiting;
            self.due_ns = 0;
            self.exit.get_or_insert_with(|| "moved to a fresh domain".to_owned());
        }
        Ok(())
    }

    /// Looks at what the process has used; what a killed process used after the last look is not counted.
    pub(crate) fn sample_usage(&mut self) {
        if let Some(child) = &self.child {
            self.sampled = child::usage(child.id());
        }
    }

    /// Processor time over all incarnations, and memory as last sampled.
    pub(crate) fn usage(&self) -> Usage {
        Usage { cpu_s: self.usage_past.cpu_s + self.sampled.cpu_s, pss_mb: self.sampled.pss_mb }
    }

    /// Messages of a topic: sent, lost, skipped, over all incarnations.
    pub(crate) fn counts(&self, topic: usize) -> [u64; 3] {
        let now = self
            .health
            .map_or([0; 3], |health| [health.sent[topic], health.lost[topic], health.skipped[topic]]);
        std::array::from_fn(|kind| self.past[kind][topic] + now[kind])
    }

    /// An event of this node.
    pub(crate) fn event(&self, host_ns: u64, what: String) -> Event {
        Event { host_ns, node: self.plan.name.clone(), what }
    }

    /// The last heartbeat of a process that is gone holds its final counts; read later, they would count twice.
    fn hear_last_words(&mut self, step: &mut Step) {
        let Some(Ok(Some(message))) = self.heartbeat.as_mut().map(|inbox| inbox.newest(step)) else { return };
        if message.header().incarnation == self.incarnation {
            self.health = Some(*message);
        }
    }

    fn keep_counts(&mut self) {
        if let Some(health) = self.health.take() {
            for topic in 0..TOPICS_MAX {
                self.past[0][topic] += health.sent[topic];
                self.past[1][topic] += health.lost[topic];
                self.past[2][topic] += health.skipped[topic];
            }
        }
    }
}

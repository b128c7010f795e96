//! What the launcher learns from the topics while the graph drives.

use crate::failure::Failure;
use crate::manifest::Graph;
use sidestep_bus::{Inbox, Keep, Link, Step, host_ns};
use sidestep_latency::Collector;
use sidestep_msgs::{
    CLOCK, COMMAND, Clock, Code, Command, DEPTH, DepthFrame, EXPERT_COMMAND, Header, POLICY_COMMAND,
    Proposal, Reason, TRUTH, Truth, Winner,
};
use std::collections::BTreeMap;
use std::time::Duration;

/// `[ns]` the command must be zero for this long to count as standing.
const REST_NS: u64 = 300_000_000;

struct Inboxes {
    link: Link,
    clock: Inbox<Clock>,
    depth: Inbox<DepthFrame>,
    commands: Inbox<Command>,
    policy: Inbox<Proposal>,
    expert: Inbox<Proposal>,
    truth: Inbox<Truth>,
}

impl Inboxes {
    fn open(link: &Link) -> Result<Self, Failure> {
        Ok(Self {
            clock: link.inbox(CLOCK, Keep::Newest)?,
            depth: link.inbox(DEPTH, Keep::All)?,
            commands: link.inbox(COMMAND, Keep::All)?,
            policy: link.inbox(POLICY_COMMAND, Keep::All)?,
            expert: link.inbox(EXPERT_COMMAND, Keep::All)?,
            truth: link.inbox(TRUTH, Keep::Newest)?,
            link: link.join()?,
        })
    }
}

/// What was seen on the topics of a run.
pub(crate) struct Monitor {
    inboxes: Inboxes,
    step: Step,
    /// Latencies per stage.
    pub(crate) latency: Collector,
    /// The simulated world, where there is one.
    pub(crate) truth: Option<Truth>,
    /// Commands seen.
    pub(crate) ticks: u64,
    /// Commands that differ from the wish for safety's sake.
    pub(crate) modified: u64,
    /// Times that the robot was stopped, by the reason it began with.
    pub(crate) stops: BTreeMap<&'static str, u64>,
    /// Commands per reason.
    pub(crate) reasons: BTreeMap<&'static str, u64>,
    /// Commands per winner.
    pub(crate) winners: BTreeMap<&'static str, u64>,
    /// `[ns]` host time at which all nodes were ready.
    pub(crate) began_ns: Option<u64>,
    /// Whether any command said that its sensors are a recording.
    pub(crate) open_loop: bool,
    /// `[ns]` graph time of the first and the newest command that count.
    span_ns: Option<(u64, u64)>,
    budgets_ms: BTreeMap<String, f64>,
    ended_ns: Option<u64>,
    moved_ns: u64,
    stopped: bool,
}

impl Monitor {
    /// Starts to listen.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn new(link: &Link, graph: &Graph) -> Result<Self, Failure> {
        Ok(Self {
            inboxes: Inboxes::open(link)?,
            step: Step::new(),
            latency: Collector::new(&graph.budgets_ms),
            truth: None,
            ticks: 0,
            modified: 0,
            stops: BTreeMap::new(),
            reasons: BTreeMap::new(),
            winners: BTreeMap::new(),
            began_ns: None,
            open_loop: false,
            span_ns: None,
            budgets_ms: graph.budgets_ms.clone(),
            ended_ns: None,
            moved_ns: host_ns(),
            stopped: true,
        })
    }

    /// Listens in another domain from now on.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn move_to(&mut self, link: &Link) -> Result<(), Failure> {
        self.inboxes = Inboxes::open(link)?;
        Ok(())
    }

    /// The drive begins: frames from before every node was ready do not count.
    pub(crate) fn begin(&mut self, now_ns: u64) {
        self.began_ns = Some(now_ns);
        self.latency = Collector::new(&self.budgets_ms);
    }

    /// The drive is over: what the nodes do while they leave does not count.
    pub(crate) fn end(&mut self) {
        self.ended_ns = Some(host_ns());
    }

    /// `[s]` host time from all nodes ready to the end of the drive.
    pub(crate) fn host_time_s(&self) -> f64 {
        let ended_ns = self.ended_ns.unwrap_or_else(host_ns);
        self.began_ns.map_or(0.0, |began_ns| ended_ns.saturating_sub(began_ns) as f64 * 1e-9)
    }

    /// Takes what arrived.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn look(&mut self) -> Result<(), Failure> {
        self.inboxes.link.look(&mut self.step)?;
        if let Some(truth) = self.inboxes.truth.newest(&mut self.step)? {
            self.truth = Some(*truth);
        }
        let latency = &mut self.latency;
        let counts = self.ended_ns.is_none();
        if let Some(clock) = self.inboxes.clock.newest(&mut self.step)? {
            latency.clock(&clock);
        }
        while let Some(message) = self.inboxes.depth.next(&mut self.step)? {
            counts.then(|| latency.depth(message.capture_ns, message.header()));
        }
        while let Some(message) = self.inboxes.policy.next(&mut self.step)? {
            counts.then(|| latency.header(POLICY_COMMAND.index, message.header()));
        }
        while let Some(message) = self.inboxes.expert.next(&mut self.step)? {
            counts.then(|| latency.header(EXPERT_COMMAND.index, message.header()));
        }
        while let Some(message) = self.inboxes.commands.next(&mut self.step)? {
            let (command, header) = (*message, *message.header());
            self.command(&command, &header);
        }
        Ok(())
    }

    fn command(&mut self, command: &Command, header: &Header) {
        let reason = Reason::from_code(command.reason).map_or("unknown", Reason::label);
        let winner = Winner::from_code(command.winner).map_or("unknown", Winner::label);
        let standing = command.twist.v_m_s == 0.0 && command.twist.w_rad_s == 0.0;
        if !standing {
            self.moved_ns = host_ns();
        }
        if self.began_ns.is_none() || self.ended_ns.is_some() {
            return;
        }
        self.latency.header(COMMAND.index, header);
        self.latency.command(command);
        self.ticks += 1;
        self.span_ns = Some((self.span_ns.map_or(header.now_ns, |(first_ns, _)| first_ns), header.now_ns));
        self.open_loop |= command.open_loop != 0;
        *self.reasons.entry(reason).or_default() += 1;
        *self.winners.entry(winner).or_default() += 1;
        self.modified += u64::from(command.scale < 1.0 && command.winner != Winner::Stop as u32);
        if standing && !self.stopped {
            *self.stops.entry(reason).or_default() += 1;
        }
        self.stopped = standing;
    }

    /// Graph time from the first command that counts to the newest.
    pub(crate) fn graph_time(&self) -> Duration {
        let (first_ns, last_ns) = self.span_ns.unwrap_or_default();
        Duration::from_nanos(last_ns.saturating_sub(first_ns))
    }

    /// Whether the newest commands told the robot to stand.
    pub(crate) fn at_rest(&self) -> bool {
        host_ns().saturating_sub(self.moved_ns) > REST_NS
    }
}

//! A node's connection to the graph, and its loop.

use crate::boot::Boot;
use crate::clock::{GraphClock, host_ns};
use crate::domain::{DomainName, Services};
use crate::error::NodeError;
use crate::inbox::{Inbox, Keep};
use crate::outbox::Outbox;
use crate::step::Step;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{
    CallbackProgression, FileDescriptor, FileDescriptorBased, Node, SignalHandlingMode,
    SynchronousMultiplexing, WaitSet, WaitSetBuilder, ipc,
};
use sidestep_msgs::{
    CLOCK, Clock, Health, Message, NodeState, RECORDING, Recording, TOPICS_MAX, Topic, health_topic,
};
use std::cell::{Cell, RefCell};
use std::io::Read;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::rc::Rc;
use std::time::Duration;

/// `[ns]` host time between heartbeats.
const HEARTBEAT_NS: u64 = 25_000_000;

/// `[Hz]` a topic that is at most this frequent has its history handed out by the heartbeat.
const RARE_HZ: f32 = 1.0;

/// Messages per topic, shared by all inboxes and outboxes of a node.
#[derive(Debug)]
pub struct Counters {
    pub(crate) sent: [Cell<u64>; TOPICS_MAX],
    pub(crate) lost: [Cell<u64>; TOPICS_MAX],
    pub(crate) skipped: [Cell<u64>; TOPICS_MAX],
}

impl Counters {
    fn new() -> Self {
        let zeros = || std::array::from_fn(|_| Cell::new(0));
        Self { sent: zeros(), lost: zeros(), skipped: zeros() }
    }
}

/// SIGTERM and SIGINT as something to wait on.
#[derive(Debug)]
struct Stop {
    descriptor: FileDescriptor,
    pipe: UnixStream,
}

impl FileDescriptorBased for Stop {
    fn file_descriptor(&self) -> &FileDescriptor {
        &self.descriptor
    }
}

impl SynchronousMultiplexing for Stop {}

impl Stop {
    fn new() -> Result<Self, NodeError> {
        let failed = |source| NodeError::File {
            path: "signal pipe".into(),
            source,
            remedy: "raise the limit of open files",
        };
        let (pipe, writer) = UnixStream::pair().map_err(failed)?;
        pipe.set_nonblocking(true).map_err(failed)?;
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::low_level::pipe::register(signal, writer.try_clone().map_err(failed)?)
                .map_err(failed)?;
        }
        let descriptor = FileDescriptor::non_owning_new(pipe.as_raw_fd())
            .ok_or_else(|| failed(std::io::Error::from(std::io::ErrorKind::InvalidInput)))?;
        Ok(Self { descriptor, pipe })
    }

    fn asked(&self) -> bool {
        matches!((&self.pipe).read(&mut [0; 8]), Ok(bytes) if bytes > 0)
    }
}

/// What the loop counts for the heartbeat.
#[derive(Debug, Default)]
struct Cycle {
    cycles: u64,
    misses: u64,
    last_frame: u64,
    status: u32,
    worst_ns: u64,
    total_ns: u64,
}

/// A node's connection to the graph.
pub struct Link {
    services: Services,
    counters: Rc<Counters>,
    run: u64,
    incarnation: u32,
    budget_ns: u64,
    clock_inbox: Inbox<Clock>,
    clock: GraphClock,
    health: Option<Outbox<Health>>,
    wakes: Vec<Listener<ipc::Service>>,
    tick_ns: Option<u64>,
    /// Nothing happens before the driver's first word.
    waits: Cell<bool>,
    /// Writers of rare topics: a reader that joins late gets the newest message at the next heartbeat.
    rare: RefCell<Vec<Rc<dyn UpdateConnections>>>,
    /// For a node that keeps a state: a recorder that begins a file asks for it.
    files: RefCell<Option<Inbox<Recording>>>,
    /// Incarnation of the recorder that spoke last, and the files that it had begun.
    files_begun: (u32, u64),
    /// `[ns]` host time at which [`Link::look`] meets late readers next.
    meet_ns: u64,
    // Dropped last: everything above lives in it.
    node: Rc<Node<ipc::Service>>,
}

impl Link {
    /// Connects the node that the launcher started.
    ///
    /// # Errors
    /// [`NodeError::Transport`] where the run is gone or was made by another version.
    pub fn open(boot: &Boot) -> Result<Self, NodeError> {
        let mut link = Self::attach(&boot.domain, &boot.node, boot.run, boot.incarnation)?;
        link.budget_ns = boot.budget_s()?.map_or(u64::MAX, |seconds| (seconds * 1e9) as u64);
        link.waits.set(boot.is_lockstep()?);
        match health_topic(&boot.node) {
            Some(topic) => link.with_heartbeat(topic),
            None => Ok(link),
        }
    }

    /// Beats on a topic while the loop runs.
    ///
    /// # Errors
    /// As [`Link::open`].
    pub fn with_heartbeat(mut self, topic: Topic<Health>) -> Result<Self, NodeError> {
        self.health = Some(self.outbox(topic)?);
        Ok(self)
    }

    /// Connects a tool that is no node of the graph: it reads, or writes an operator's topic.
    ///
    /// # Errors
    /// As [`Link::open`].
    pub fn attach(domain: &DomainName, name: &str, run: u64, incarnation: u32) -> Result<Self, NodeError> {
        Self::on(Rc::new(domain.node(name)?), run, incarnation)
    }

    /// A second link of the same process, with clocks and counters of its own.
    ///
    /// # Errors
    /// As [`Link::open`].
    pub fn join(&self) -> Result<Self, NodeError> {
        Self::on(self.node.clone(), self.run, self.incarnation)
    }

    fn on(node: Rc<Node<ipc::Service>>, run: u64, incarnation: u32) -> Result<Self, NodeError> {
        let services = Services::of(node.clone());
        let counters = Rc::new(Counters::new());
        let clock_inbox =
            Inbox::new(CLOCK, Keep::Newest, services.subscriber(CLOCK, Keep::Newest)?, counters.clone());
        Ok(Self {
            services,
            counters,
            run,
            incarnation,
            budget_ns: u64::MAX,
            clock_inbox,
            clock: GraphClock::default(),
            health: None,
            wakes: Vec::new(),
            tick_ns: None,
            waits: Cell::new(false),
            rare: RefCell::default(),
            files: RefCell::default(),
            files_begun: (0, 0),
            meet_ns: 0,
            node,
        })
    }

    /// Opens a topic for reading.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn inbox<M: Message>(&self, topic: Topic<M>, keep: Keep) -> Result<Inbox<M>, NodeError> {
        Ok(Inbox::new(topic, keep, self.services.subscriber(topic, keep)?, self.counters.clone()))
    }

    /// Opens a topic for writing; a topic has one writer, and the transport refuses a second.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn outbox<M: Message>(&self, topic: Topic<M>) -> Result<Outbox<M>, NodeError> {
        let (publisher, notifier) = self.services.publisher(topic)?;
        let publisher = Rc::new(publisher);
        if topic.index == CLOCK.index {
            // Whoever moves time waits for nobody's word.
            self.waits.set(false);
        }
        if topic.row().name.starts_with("state/") {
            *self.files.borrow_mut() = Some(self.inbox(RECORDING, Keep::Newest)?);
        }
        if topic.row().history > 0 && topic.row().rate_hz <= RARE_HZ {
            self.rare.borrow_mut().push(publisher.clone());
        }
        Ok(Outbox::new(topic, publisher, notifier, self.counters.clone(), (self.run, self.incarnation)))
    }

    /// Wakes the loop at each message of a topic.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn wake_on<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        self.wakes.push(self.services.listener(topic.row().name)?);
        Ok(())
    }

    /// Wakes the loop each `period` of graph time, also in lockstep, where the driver's word moves time.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn tick_every(&mut self, period: Duration) -> Result<(), NodeError> {
        self.tick_ns = Some(period.as_nanos() as u64);
        self.wake_on(CLOCK)
    }

    /// Reads the clocks once, for a tool that looks at its inboxes at its own pace instead of running a loop; what it
    /// wrote on rare topics is handed to readers that came since.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn look(&mut self, step: &mut Step) -> Result<(), NodeError> {
        step.published = true;
        let host = host_ns();
        if host >= self.meet_ns {
            self.meet_ns = host + HEARTBEAT_NS;
            self.meet_late_readers()?;
        }
        self.read_clock(step, host)
    }

    fn meet_late_readers(&self) -> Result<(), NodeError> {
        let failed = |error| NodeError::transport("heartbeat", "meet new readers", error);
        self.rare.borrow().iter().try_for_each(|writer| writer.update_connections().map_err(failed))
    }

    /// What the inboxes lost and skipped and the outboxes sent.
    #[must_use]
    pub fn counters(&self) -> Rc<Counters> {
        self.counters.clone()
    }

    /// Steps at each wake until asked to stop by SIGTERM or SIGINT, with a heartbeat beside.
    ///
    /// # Errors
    /// What the step returns, or [`NodeError::Transport`].
    pub fn run(self, mut step_node: impl FnMut(&mut Step) -> Result<(), NodeError>) -> Result<(), NodeError> {
        self.run_while(|step| step_node(step).map(|()| true))
    }

    /// As [`Link::run`], and ends when the step returns false.
    ///
    /// # Errors
    /// As [`Link::run`].
    pub fn run_while(
        mut self,
        mut step_node: impl FnMut(&mut Step) -> Result<bool, NodeError>,
    ) -> Result<(), NodeError> {
        let failed = |error: &dyn std::fmt::Debug| NodeError::transport("wait set", "attach", error);
        let wakes = std::mem::take(&mut self.wakes);
        let waitset: WaitSet<ipc::Service> = WaitSetBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create()
            .map_err(|error| failed(&error))?;
        let stop = Stop::new()?;
        let mut guards = vec![waitset.attach_notification(&stop).map_err(|error| failed(&error))?];
        for listener in &wakes {
            guards.push(waitset.attach_notification(listener).map_err(|error| failed(&error))?);
        }
        let mut step = Step::new();
        let mut cycle = Cycle::default();
        let mut next_tick_ns = 0;
        let mut next_beat_ns = 0;
        self.beat(&mut next_beat_ns, NodeState::Ready, &mut cycle)?;
        loop {
            let timeout = self.timeout(&step, next_tick_ns, next_beat_ns);
            let woken = waitset.wait_and_process_once_with_timeout(
                |_| {
                    // Drained whatever woke us: a listener left full would wake for ever.
                    for listener in &wakes {
                        let _ = listener.try_wait(|_| ());
                    }
                    CallbackProgression::Continue
                },
                timeout,
            );
            woken.map_err(|error| NodeError::transport("wait set", "wait", error))?;
            if stop.asked() {
                break;
            }
            if !self.turn(&mut step, &mut next_tick_ns, &mut cycle, &mut step_node)? {
                break;
            }
            let state = if cycle.cycles > 0 { NodeState::Running } else { NodeState::Ready };
            if host_ns() >= next_beat_ns {
                self.beat(&mut next_beat_ns, state, &mut cycle)?;
            }
        }
        self.beat(&mut next_beat_ns, NodeState::Stopping, &mut cycle)
    }

    /// One wake: reads the clocks once, steps, counts.
    fn turn(
        &mut self,
        step: &mut Step,
        next_tick_ns: &mut u64,
        cycle: &mut Cycle,
        step_node: &mut impl FnMut(&mut Step) -> Result<bool, NodeError>,
    ) -> Result<bool, NodeError> {
        let host = host_ns();
        self.read_clock(step, host)?;
        if self.is_waiting() {
            return Ok(true);
        }
        if let Some(period_ns) = self.tick_ns {
            // A driver's first word can set graph time far back: a tick further off than a period belongs to the old time.
            let elsewhere = *next_tick_ns > step.now_ns + period_ns;
            step.tick = elsewhere || step.now_ns >= *next_tick_ns;
            if step.tick {
                // After a stall the missed ticks are not made up for.
                *next_tick_ns = step.now_ns - step.now_ns % period_ns + period_ns;
            }
        }
        if step.wake_at_ns.is_some_and(|wake_ns| step.now_ns >= wake_ns) {
            step.wake_at_ns = None;
        }
        let go_on = step_node(step)?;
        step.epoch_raised = false;
        if step.published {
            let spent_ns = host_ns() - host;
            cycle.cycles += 1;
            cycle.misses += u64::from(spent_ns > self.budget_ns);
            cycle.last_frame = step.source_frame();
            cycle.status = step.status as u32;
            cycle.worst_ns = cycle.worst_ns.max(spent_ns);
            cycle.total_ns += spent_ns;
        }
        Ok(go_on)
    }

    /// Whether time has not begun: in lockstep, before the driver's first word.
    fn is_waiting(&self) -> bool {
        self.waits.get() && !self.clock.lockstep()
    }

    fn read_clock(&mut self, step: &mut Step, host: u64) -> Result<(), NodeError> {
        // The clock is read outside the record of inputs: `now` in the header is its effect.
        let mut aside = Step::new();
        let mut raised = false;
        if let Some(word) = self.clock_inbox.newest(&mut aside)? {
            raised = self.clock.take(*word);
            step.clock_sequence = word.header().sequence;
        }
        step.begin(self.clock.graph_ns(host), host);
        step.epoch = self.clock.epoch();
        step.epoch_raised |= raised;
        step.open_loop = self.clock.open_loop();
        step.lockstep = self.clock.lockstep();
        if let Some(files) = self.files.get_mut()
            && let Some(word) = files.newest(&mut aside)?
        {
            let begun = (word.header().incarnation, word.files);
            if begun != self.files_begun {
                step.owe_state();
            }
            self.files_begun = begun;
        }
        Ok(())
    }

    fn timeout(&self, step: &Step, next_tick_ns: u64, next_beat_ns: u64) -> Duration {
        let host = host_ns();
        let beat = Duration::from_nanos(next_beat_ns.saturating_sub(host));
        if self.is_waiting() {
            return beat;
        }
        let tick = self.tick_ns.and_then(|_| self.clock.until(next_tick_ns, host));
        let wish = step.wake_at_ns.and_then(|wake_ns| self.clock.until(wake_ns, host));
        [tick, wish].into_iter().flatten().fold(beat, Duration::min)
    }

    fn beat(&mut self, next_beat_ns: &mut u64, state: NodeState, cycle: &mut Cycle) -> Result<(), NodeError> {
        *next_beat_ns = host_ns() + HEARTBEAT_NS;
        self.meet_late_readers()?;
        let Some(outbox) = &mut self.health else { return Ok(()) };
        let mut aside = Step::new();
        let host = host_ns();
        aside.begin(self.clock.graph_ns(host), host);
        aside.epoch = self.clock.epoch();
        let counters = &self.counters;
        outbox.send(&mut aside, |health| {
            *health = Health {
                cycles: cycle.cycles,
                misses: cycle.misses,
                last_frame: cycle.last_frame,
                worst_step_s: cycle.worst_ns as f32 * 1e-9,
                mean_step_s: (cycle.total_ns as f64 * 1e-9 / cycle.cycles.max(1) as f64) as f32,
                state: state as u32,
                status: cycle.status,
                sent: std::array::from_fn(|i| counters.sent[i].get()),
                lost: std::array::from_fn(|i| counters.lost[i].get()),
                skipped: std::array::from_fn(|i| counters.skipped[i].get()),
            };
        })?;
        cycle.worst_ns = 0;
        Ok(())
    }
}

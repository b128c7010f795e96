//! Starts the nodes, watches them, starts them again, stops them in order.

use crate::child::{self, RunNames};
use crate::failure::Failure;
use crate::manifest::{Graph, NodePlan, Time};
use crate::watched::{Event, Phase, Watched};
use sidestep_bus::{Domain, Link, Step, host_ns, pause};
use std::process::Child;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Pace of the supervisor's own loop.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// `[ns]` a supervisor that was itself away for longer does not blame its nodes.
const LATE_NS: u64 = 60_000_000;
/// `[ns]` time a sweeper has.
const SWEEP_NS: u64 = 1_500_000_000;
/// Sweeps that may fail in a row before the run moves to a fresh domain.
const SWEEPS_MOST: u32 = 3;
/// `[ns]` time a node has to leave after SIGTERM.
const LEAVE_NS: u64 = 1_500_000_000;
/// `[ns]` the same for a recorder, which waits for the disk.
const LEAVE_SLOW_NS: u64 = 8_000_000_000;
/// `[ns]` host time between looks at processor time and memory.
const USAGE_NS: u64 = 1_000_000_000;
/// Stop order after the proposers: whoever protects the robot leaves late, the recorder last.
const STOP_ORDER: &[&str] = &["goal", "mapper", "guard", "player", "sim", "driver", "arbiter", "recorder"];

/// Counts the wishes of the user (SIGINT, SIGTERM) that the run should end.
#[derive(Debug, Clone)]
pub(crate) struct Wishes(Arc<AtomicUsize>);

impl Wishes {
    /// Listens from now on.
    ///
    /// # Errors
    /// Exit code 3 where the system refuses.
    pub(crate) fn listen() -> Result<Self, Failure> {
        let count = Arc::new(AtomicUsize::new(0));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            let count = count.clone();
            // SAFETY: an atomic addition is async-signal-safe.
            #[allow(unsafe_code, reason = "the second wish must differ from the first; flags cannot count")]
            let registered = unsafe {
                signal_hook::low_level::register(signal, move || {
                    count.fetch_add(1, Ordering::SeqCst);
                })
            };
            registered.map_err(|error| Failure::io(format!("cannot listen to signal {signal}: {error}")))?;
        }
        Ok(Self(count))
    }

    /// How often the user asked.
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }
}

#[derive(Debug)]
enum Sweeper {
    Idle,
    Working { child: Child, since_ns: u64 },
}

/// What the loop must do next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// All is well, or being mended.
    GoOn,
    /// Shared memory cannot be cleaned: leave it behind.
    FreshDomain,
}

/// The nodes of a run.
pub(crate) struct Supervisor {
    /// The nodes, consumers first.
    pub(crate) nodes: Vec<Watched>,
    /// What happened so far.
    pub(crate) events: Vec<Event>,
    graph: Graph,
    names: RunNames,
    link: Link,
    step: Step,
    sweeper: Sweeper,
    sweeps_failed: u32,
    looked_ns: u64,
    usage_due_ns: u64,
    // Dropped last: wipes the shared memory.
    domain: Domain,
}

impl Supervisor {
    /// Makes a domain and gets ready to start the nodes.
    ///
    /// # Errors
    /// Exit code 3 where shared memory or the run's folder refuse.
    pub(crate) fn new(graph: Graph, run: u64) -> Result<Self, Failure> {
        let domain = Domain::create(run)?;
        graph.write(&domain.name.root)?;
        let link = Link::attach(&domain.name, "supervisor", run, 0)?;
        let nodes =
            graph.nodes.iter().cloned().map(|plan| Watched::new(plan, &link)).collect::<Result<_, _>>()?;
        let names = RunNames { domain: domain.name.clone(), run };
        let (step, events, now_ns) = (Step::new(), Vec::new(), host_ns());
        let sweeper = Sweeper::Idle;
        let usage_due_ns = now_ns;
        Ok(Self {
            nodes,
            events,
            graph,
            names,
            link,
            step,
            sweeper,
            sweeps_failed: 0,
            looked_ns: now_ns,
            usage_due_ns,
            domain,
        })
    }

    /// A link into the run, for the monitor.
    pub(crate) fn link(&self) -> &Link {
        &self.link
    }

    /// The folder of the run.
    pub(crate) fn folder(&self) -> &std::path::Path {
        &self.names.domain.root
    }

    /// What moves graph time.
    pub(crate) fn time(&self) -> Time {
        self.graph.time
    }

    /// Whether every node beats.
    pub(crate) fn all_ready(&self) -> bool {
        self.nodes.iter().all(|node| matches!(node.phase, Phase::Running | Phase::Ended))
    }

    /// The first node that will not come back though the drive needs it; nobody needs a recorder.
    pub(crate) fn given_up(&self) -> Option<&Watched> {
        use crate::manifest::Restart;
        let needed = |node: &&Watched| match node.plan.name.as_str() {
            "recorder" => false,
            "player" => node.exit_code != Some(0),
            "driver" => node.plan.restart == Restart::Always && node.exit_code != Some(0),
            _ => node.plan.restart == Restart::Always,
        };
        self.nodes.iter().filter(needed).find(|node| node.phase == Phase::Ended)
    }

    /// Whether a player, or a driver that is not to be started again, has come to the end of what it had.
    pub(crate) fn source_ended(&self) -> bool {
        let ended = |node: &&Watched| node.phase == Phase::Ended && node.exit_code == Some(0);
        self.nodes.iter().filter(ended).any(|node| ["player", "driver"].contains(&node.plan.name.as_str()))
    }

    /// Where the recorder writes, by its own word; a file that was not ended in order has kept its working name.
    pub(crate) fn recording(&self) -> Option<String> {
        let word = std::fs::read_to_string(self.names.domain.root.join("recording")).ok()?;
        let unfinished = format!("{}.active", word.trim());
        let is_unfinished = std::path::Path::new(&unfinished).exists();
        Some(if is_unfinished { unfinished } else { word.trim().to_owned() })
    }

    fn tell(&mut self, event: Event) {
        crate::output::note(format!("{:>8} | {}", event.node, event.what));
        self.events.push(event);
    }

    /// One look at everything.
    ///
    /// # Errors
    /// Exit code 3 where the transport fails.
    pub(crate) fn look(&mut self) -> Result<Verdict, Failure> {
        pause(LOOK_EVERY);
        let now_ns = host_ns();
        let late = now_ns - self.looked_ns > LATE_NS;
        self.looked_ns = now_ns;
        self.link.look(&mut self.step)?;
        let mut events = Vec::new();
        for node in &mut self.nodes {
            events.extend(node.reap(&mut self.step, &self.graph.supervision, now_ns));
            node.take_sign(&mut self.step, now_ns)?;
            if late {
                node.forgive(now_ns);
            }
            events.extend(node.kill_when_hung(&self.graph.supervision, now_ns));
            events.extend(node.start_when_due(&self.names, &self.link, now_ns));
        }
        if now_ns >= self.usage_due_ns {
            self.usage_due_ns = now_ns + USAGE_NS;
            self.sample_usage();
        }
        events.into_iter().for_each(|event| self.tell(event));
        Ok(self.sweep(now_ns))
    }

    /// Looks at processor time and memory of every node.
    pub(crate) fn sample_usage(&mut self) {
        self.nodes.iter_mut().for_each(Watched::sample_usage);
    }

    /// Cleans up after the dead, one sweeper at a time.
    fn sweep(&mut self, now_ns: u64) -> Verdict {
        match &mut self.sweeper {
            Sweeper::Idle => {
                if self.nodes.iter().any(|node| node.phase == Phase::Dead) {
                    match child::start_sweeper(&self.names) {
                        Ok(child) => self.sweeper = Sweeper::Working { child, since_ns: now_ns },
                        Err(_) => self.sweeps_failed += 1,
                    }
                }
            }
            Sweeper::Working { child, since_ns } => {
                let (ended, late) = (child.try_wait().ok().flatten(), now_ns - *since_ns > SWEEP_NS);
                let since_ns = *since_ns;
                if late && ended.is_none() {
                    let _ = child.kill();
                    let _ = child.wait();
                }
                if let Some(status) = ended {
                    self.sweeper = Sweeper::Idle;
                    self.finish_sweep(status.success(), since_ns, now_ns);
                } else if late {
                    self.sweeper = Sweeper::Idle;
                    self.finish_sweep(false, since_ns, now_ns);
                }
            }
        }
        if self.sweeps_failed >= SWEEPS_MOST { Verdict::FreshDomain } else { Verdict::GoOn }
    }

    fn finish_sweep(&mut self, clean: bool, since_ns: u64, now_ns: u64) {
        if !clean {
            self.sweeps_failed += 1;
            return;
        }
        self.sweeps_failed = 0;
        for node in &mut self.nodes {
            // A node that died after the sweep began waits for the next one.
            if node.died_before(since_ns) {
                node.swept(&self.graph.supervision, now_ns);
            }
        }
    }

    /// Leaves the shared memory behind and starts every node in a fresh domain.
    ///
    /// # Errors
    /// Exit code 3 where no domain can be made.
    pub(crate) fn move_to_fresh_domain(&mut self) -> Result<(), Failure> {
        let event = Event {
            host_ns: host_ns(),
            node: "launcher".into(),
            what: "shared memory cannot be cleaned; every node starts again in a fresh domain".into(),
        };
        self.tell(event);
        self.kill_all();
        let run = self.names.run + 1;
        let domain = Domain::create(run)?;
        self.graph.write(&domain.name.root)?;
        // Whoever ordered the robot to stay ordered this run, wherever it goes on.
        let carried = sidestep_arbiter::carry_orders(&self.names.domain.root, &domain.name.root);
        carried.map_err(|error| Failure::io(format!("{}: {error}", domain.name.root.display())))?;
        self.names = RunNames { domain: domain.name.clone(), run };
        self.link = Link::attach(&domain.name, "supervisor", run, 0)?;
        for node in &mut self.nodes {
            node.move_to(&self.link)?;
        }
        self.domain = domain;
        self.sweeps_failed = 0;
        self.looked_ns = host_ns();
        Ok(())
    }

    /// Kills what still runs, at once.
    pub(crate) fn kill_all(&mut self) {
        if let Sweeper::Working { child, .. } = &mut self.sweeper {
            let _ = child.kill();
            let _ = child.wait();
        }
        self.sweeper = Sweeper::Idle;
        for node in &mut self.nodes {
            if let Some(child) = &mut node.child {
                let _ = child.kill();
            }
        }
        for node in &mut self.nodes {
            if let Some(mut child) = node.child.take() {
                let _ = child.wait();
            }
        }
    }

    /// Asks the nodes to leave, proposers first, then in the order of their duty; kills whoever does not.
    ///
    /// `at_rest` says whether the robot stands; `wishes` beyond `heard` end the patience.
    pub(crate) fn stop(&mut self, wishes: &Wishes, heard: usize, mut at_rest: impl FnMut() -> bool) {
        if self.graph.time == Time::Lockstep {
            // Without its driver graph time stands, and so does the robot.
            let drivers = self.names_of(NodePlan::is_driver);
            self.leave(&drivers, wishes, heard);
        }
        let others = self.names_of(|plan| !plan.is_driver() && !STOP_ORDER.contains(&plan.name.as_str()));
        self.leave(&others, wishes, heard);
        let deadline_ns = host_ns() + 3_000_000_000;
        while self.graph.time == Time::Real
            && !at_rest()
            && host_ns() < deadline_ns
            && wishes.count() <= heard
        {
            pause(LOOK_EVERY);
        }
        for name in STOP_ORDER {
            let named = self.names_of(|plan| plan.name == *name || *name == "driver" && plan.is_driver());
            self.leave(&named, wishes, heard);
        }
        self.kill_all();
    }

    fn names_of(&self, wanted: impl Fn(&NodePlan) -> bool) -> Vec<String> {
        self.nodes
            .iter()
            .map(|node| &node.plan)
            .filter(|plan| wanted(plan))
            .map(|plan| plan.name.clone())
            .collect()
    }

    fn leave(&mut self, names: &[String], wishes: &Wishes, heard: usize) {
        let concerned = |node: &Watched| names.contains(&node.plan.name) && node.child.is_some();
        for node in self.nodes.iter().filter(|node| concerned(node)) {
            if let Some(child) = &node.child {
                child::signal(child, libc::SIGTERM);
            }
        }
        let slow = names.iter().any(|name| name == "recorder");
        let deadline_ns = host_ns() + if slow { LEAVE_SLOW_NS } else { LEAVE_NS };
        while self.nodes.iter().any(concerned) && host_ns() < deadline_ns && wishes.count() <= heard {
            let now_ns = host_ns();
            let _ = self.link.look(&mut self.step);
            for node in self.nodes.iter_mut().filter(|node| names.contains(&node.plan.name)) {
                let _ = node.take_sign(&mut self.step, now_ns);
                node.leave(&mut self.step);
            }
            pause(Duration::from_millis(1));
        }
    }
}

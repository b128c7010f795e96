//! `sidestep run`: validates, starts, watches, stops, reports.

use crate::failure::Failure;
use crate::keyboard::Keyboard;
use crate::manifest::{Graph, Time};
use crate::monitor::Monitor;
use crate::notify::Notifier;
use crate::report;
use crate::supervisor::{Supervisor, Verdict, Wishes};
use sidestep_bus::{host_ns, wall_ns};
use std::path::PathBuf;
use std::time::Duration;

/// What the user asked for.
#[derive(Debug, Clone, Default)]
pub(crate) struct Options {
    /// Name of a built-in graph, or a path.
    pub(crate) graph: String,
    /// Length of the drive; without it, until the user ends it.
    pub(crate) time: Option<Duration>,
    /// Folder for the recording.
    pub(crate) record: Option<PathBuf>,
    /// Who drives.
    pub(crate) lead: Option<String>,
    /// A model instead of the embedded one.
    pub(crate) model: Option<PathBuf>,
    /// `NODE.KEY=VALUE`.
    pub(crate) settings: Vec<String>,
    /// Missed latency budgets count as failure.
    pub(crate) gate_latency: bool,
    /// File for the machine-readable summary.
    pub(crate) json: Option<PathBuf>,
    /// Whether a simulated drive must reach a goal to count as done.
    pub(crate) must_arrive: bool,
    /// Whether keys of the terminal are for the player.
    pub(crate) keys: bool,
}

/// How a run came to its end.
#[derive(Debug)]
pub(crate) enum End {
    /// The time was over.
    Time,
    /// The user asked.
    User,
    /// A driver said that its recording is over.
    SourceEnded,
    /// A node will not come back.
    GivenUp {
        /// The node.
        node: String,
        /// How it ended.
        ending: String,
        /// Its exit code.
        code: Option<i32>,
    },
}

/// Text of a path as a TOML string.
pub(crate) fn quoted(path: &std::path::Path) -> String {
    toml::Value::String(path.display().to_string()).to_string()
}

impl Options {
    fn load(&self) -> Result<Graph, Failure> {
        let mut settings = self.settings.clone();
        if let Some(lead) = &self.lead {
            settings.push(format!("lead=\"{lead}\""));
        }
        if let Some(model) = &self.model {
            settings.push(format!("policy.model={}", quoted(model)));
        }
        if let Some(folder) = &self.record {
            settings.push(format!("recorder.folder={}", quoted(folder)));
        }
        Graph::load(&self.graph, &settings)
    }
}

/// A number for the run: time and process, short enough for the names of sockets.
fn run_number() -> u64 {
    let milliseconds = wall_ns() / 1_000_000;
    ((milliseconds << 8) | u64::from(std::process::id() & 0xff)) & 0xffff_ffff_ffff
}

/// Runs a graph to its end.
///
/// # Errors
/// Exit code 1 where what was asked did not hold, 2 for configuration, 3 where input or output failed or was lost.
pub(crate) fn run(options: &Options) -> Result<(), Failure> {
    let graph = options.load()?;
    crate::external::find_programs(&graph)?;
    crate::space::check_shared_memory()?;
    let wishes = Wishes::listen()?;
    let mut supervisor = Supervisor::new(graph.clone(), run_number())?;
    let mut monitor = Monitor::new(supervisor.link(), &graph)?;
    let mut notifier = Notifier::from_environment();
    let mut keyboard = if options.keys { Keyboard::take() } else { None };
    let ended = drive(options, &mut supervisor, &mut monitor, &mut notifier, &wishes, &mut keyboard);
    drop(keyboard);
    notifier.stopping();
    supervisor.sample_usage();
    monitor.end();
    let heard = wishes.count();
    if ended.is_ok() && heard < 2 {
        supervisor.stop(&wishes, heard.max(1), || monitor.look().is_err() || monitor.at_rest());
    }
    supervisor.kill_all();
    let end = ended?;
    let summary = report::Summary::of(&graph, &supervisor, &monitor, &end);
    crate::output::line(&summary.text());
    if let Some(path) = &options.json {
        crate::output::json(path, &summary.json())?;
    }
    summary.verdict(options)
}

/// From the first start to the reason for the end.
fn drive(
    options: &Options,
    supervisor: &mut Supervisor,
    monitor: &mut Monitor,
    notifier: &mut Notifier,
    wishes: &Wishes,
    keyboard: &mut Option<Keyboard>,
) -> Result<End, Failure> {
    let mut deadline_ns = None;
    loop {
        keyboard.iter_mut().for_each(|keyboard| keyboard.pass_on(supervisor.folder()));
        if supervisor.look()? == Verdict::FreshDomain {
            supervisor.move_to_fresh_domain()?;
            monitor.move_to(supervisor.link())?;
        }
        monitor.look()?;
        notifier.alive(host_ns());
        if wishes.count() > 0 {
            return Ok(End::User);
        }
        if let Some(node) = supervisor.given_up() {
            let ending = node.exit.clone().unwrap_or_else(|| "could not be started".to_owned());
            return Ok(End::GivenUp { node: node.plan.name.clone(), ending, code: node.exit_code });
        }
        if supervisor.source_ended() {
            return Ok(End::SourceEnded);
        }
        if deadline_ns.is_none() && supervisor.all_ready() {
            let now_ns = host_ns();
            monitor.begin(now_ns);
            notifier.ready();
            deadline_ns = Some(options.time.map_or(u64::MAX, |time| now_ns + time.as_nanos() as u64));
        }
        let over = match (supervisor.time(), options.time) {
            (Time::Lockstep, time) => time.is_some_and(|time| monitor.graph_time() >= time),
            (Time::Real, _) => deadline_ns.is_some_and(|deadline_ns| host_ns() >= deadline_ns),
        };
        if over {
            return Ok(End::Time);
        }
    }
}

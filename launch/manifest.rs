//! The graph file: which nodes run, with what configuration, budgets and restart policy.

use crate::external::{External, beside};
use crate::failure::Failure;
use serde::Deserialize;
use sidestep_msgs::{Robot, TopicRow};
use std::collections::BTreeMap;
use std::path::Path;

/// Graph files that travel in the binary, by name.
pub(crate) const GRAPHS: &[(&str, &str)] = &[
    ("sim", include_str!("graphs/sim.toml")),
    ("robot", include_str!("graphs/robot.toml")),
    ("play", include_str!("graphs/play.toml")),
];

/// Robot files that travel in the binary, by name.
pub(crate) const ROBOTS: &[(&str, &str)] =
    &[("loomo", include_str!("robots/loomo.toml")), ("jackal", include_str!("robots/jackal.toml"))];

/// Nodes that stand where the robot's own drivers stand, and move graph time in lockstep.
pub(crate) const DRIVERS: &[&str] = &["sim", "player", "driver"];

/// Who drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Lead {
    /// The network.
    Policy,
    /// The expert's best of 734.
    Expert,
    /// The expert's refined best four.
    Solved,
    /// The policy's proposal, improved by the expert.
    Refined,
}

/// What happens after a stop that was not asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Resume {
    /// The robot drives on when everything is well again.
    Auto,
    /// An operator must say `sidestep reset`.
    Operator,
}

/// What moves graph time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Time {
    /// Host time, or a player.
    Real,
    /// The driver, once everybody has answered.
    Lockstep,
}

/// What happens when a node ends without being asked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Restart {
    /// Started again.
    Always,
    /// Left ended; the drive goes on without it.
    Never,
}

/// How restarts are paced.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Supervision {
    /// `[ms]` silence of a heartbeat after which a node counts as hung and is killed.
    pub(crate) hang_ms: u64,
    /// `[ms]` time a node has from its start to its first heartbeat.
    pub(crate) start_ms: u64,
    /// `[ms]` pause before the second restart in a row; doubles with each further one.
    pub(crate) delay_ms: u64,
    /// `[ms]` longest pause.
    pub(crate) delay_most_ms: u64,
    /// Restarts within the window after which a node is given up.
    pub(crate) restarts_most: u32,
    /// `[s]` the window; a node that lived this long starts its count afresh.
    pub(crate) window_s: f64,
}

/// A node of this program.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry<C> {
    /// What to do when it ends.
    restart: Restart,
    /// Cores it may use; empty = all.
    #[serde(default)]
    cpus: Vec<usize>,
    /// Real-time priority (SCHED_FIFO), 1 to 99; 0 = none.
    #[serde(default)]
    priority: u8,
    /// How much it gives way to the others, 0 to 19.
    #[serde(default)]
    nice: u8,
    /// Whether its memory is kept from being paged out.
    #[serde(default)]
    lock_memory: bool,
    /// The node's own configuration.
    config: C,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nodes {
    sim: Option<Entry<sidestep_sim::Config>>,
    player: Option<Entry<sidestep_player::Config>>,
    mapper: Option<Entry<sidestep_mapper::Config>>,
    guard: Option<Entry<sidestep_guard::Config>>,
    goal: Option<Entry<sidestep_goal::Config>>,
    policy: Option<Entry<sidestep_policy::Config>>,
    expert: Option<Entry<sidestep_expert::Config>>,
    arbiter: Option<Entry<sidestep_arbiter::Config>>,
    recorder: Option<Entry<sidestep_recorder::Config>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    robot: String,
    lead: Lead,
    #[allow(dead_code, reason = "read for its type: the arbiter reads the resolved file itself")]
    resume: Resume,
    time: Time,
    supervision: Supervision,
    budgets_ms: BTreeMap<String, f64>,
    nodes: Nodes,
    #[serde(default)]
    external: BTreeMap<String, External>,
}

/// How to start one node.
#[derive(Debug, Clone)]
pub(crate) struct NodePlan {
    /// Its name.
    pub(crate) name: String,
    /// Program and arguments; empty = this program.
    pub(crate) command: Vec<String>,
    /// What to do when it ends.
    pub(crate) restart: Restart,
    /// Cores it may use; empty = all.
    pub(crate) cpus: Vec<usize>,
    /// Real-time priority; 0 = none.
    pub(crate) priority: u8,
    /// How much it gives way to the others.
    pub(crate) nice: u8,
    /// Whether its memory is kept from being paged out.
    pub(crate) lock_memory: bool,
    /// Whether it moves graph time in lockstep: started again, time would begin anew.
    pub(crate) moves_time: bool,
    /// Topics on which a program of its own shows that it is ready.
    pub(crate) writes: Vec<&'static TopicRow>,
}

impl NodePlan {
    /// Whether it stands where the robot's own drivers stand: it leaves after the robot stands.
    pub(crate) fn is_driver(&self) -> bool {
        DRIVERS.contains(&self.name.as_str()) || self.writes.iter().any(|row| row.writer == "driver")
    }
}

/// Files of a run, by name.
type ModelFiles = Vec<(&'static str, Vec<u8>)>;

/// A checked graph.
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    /// Name or path it came from.
    pub(crate) origin: String,
    /// The file with every `--set` applied.
    pub(crate) text: String,
    /// The robot file.
    pub(crate) robot_text: String,
    /// Which policy model drives, for recordings.
    pub(crate) model: ModelFiles,
    /// The robot.
    pub(crate) robot: Robot,
    /// Who drives.
    pub(crate) lead: Lead,
    /// What moves graph time.
    pub(crate) time: Time,
    /// Restart pacing.
    pub(crate) supervision: Supervision,
    /// `[ms]` latency budget per stage.
    pub(crate) budgets_ms: BTreeMap<String, f64>,
    /// Nodes in the order of the data.
    pub(crate) nodes: Vec<NodePlan>,
}

/// A text from the binary by its name, or a file.
fn read(kind: &str, built_in: &[(&str, &str)], origin: &str) -> Result<String, Failure> {
    if let Some((_, text)) = built_in.iter().find(|(name, _)| *name == origin) {
        return Ok((*text).to_owned());
    }
    std::fs::read_to_string(origin).map_err(|error| {
        let names: Vec<_> = built_in.iter().map(|(name, _)| *name).collect();
        Failure::usage(format!("{kind} {origin}: {error}; give a path, or one of: {}", names.join(", ")))
    })
}

/// A robot by its built-in name or path, with the text of its file.
///
/// # Errors
/// Exit code 2 with line and column, or with key, found and needed.
pub(crate) fn robot_named(origin: &str) -> Result<(Robot, String), Failure> {
    let text = read("robot", ROBOTS, origin)?;
    let robot = Robot::from_toml(origin, &text).map_err(|error| Failure::usage(error.to_string()))?;
    Ok((robot, text))
}

/// Applies `NODE.KEY=VALUE`, or `KEY=VALUE` for a key of the whole graph.
fn apply(table: &mut toml::Table, setting: &str) -> Result<(), Failure> {
    let wrong =
        |why: &str| Failure::usage(format!("--set {setting}: {why}; needed: NODE.KEY=VALUE or KEY=VALUE"));
    let (path, value) = setting.split_once('=').ok_or_else(|| wrong("no ="))?;
    // A value that is not TOML is meant as text.
    let value = format!("v = {value}")
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut parsed| parsed.remove("v"))
        .unwrap_or_else(|| toml::Value::String(value.to_owned()));
    let Some((node, key)) = path.split_once('.') else {
        table.insert(path.to_owned(), value);
        return Ok(());
    };
    let place = match node {
        "supervision" | "budgets_ms" => table.get_mut(node),
        _ => table
            .get_mut("nodes")
            .and_then(|nodes| nodes.get_mut(node))
            .and_then(|entry| entry.get_mut("config")),
    };
    let place =
        place.and_then(toml::Value::as_table_mut).ok_or_else(|| wrong("no such node in this graph"))?;
    let (parents, last) = key.rsplit_once('.').map_or((None, key), |(parents, last)| (Some(parents), last));
    let mut place = place;
    for parent in parents.into_iter().flat_map(|parents| parents.split('.')) {
        place =
            place.get_mut(parent).and_then(toml::Value::as_table_mut).ok_or_else(|| wrong("no such key"))?;
    }
    place.insert(last.to_owned(), value);
    Ok(())
}

/// The text of a graph file with settings applied.
///
/// # Errors
/// Exit code 2 with the setting and what is wrong with it.
pub(crate) fn with_settings(origin: &str, text: &str, settings: &[String]) -> Result<String, Failure> {
    let wrong = |error: &dyn std::fmt::Display| Failure::usage(format!("graph {origin}: {error}"));
    let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| wrong(&error))?;
    if settings.iter().any(|setting| setting.starts_with("recorder.folder=")) {
        add_recorder(&mut table);
    }
    settings.iter().try_for_each(|setting| apply(&mut table, setting))?;
    toml::to_string(&table).map_err(|error| wrong(&error))
}

impl Graph {
    /// Reads, resolves and checks a graph file.
    ///
    /// # Errors
    /// Exit code 2 with file, line, column, what was found and what is allowed.
    pub(crate) fn load(origin: &str, settings: &[String]) -> Result<Self, Failure> {
        let mut text = read("graph", GRAPHS, origin)?;
        // Parsed as it stands first, so that line and column are those of the file.
        let mut file = Self::parse(origin, &text)?;
        if !settings.is_empty() {
            text = with_settings(origin, &text, settings)?;
            file = Self::parse(&format!("{origin} with --set {}", settings.join(" --set ")), &text)?;
        }
        let robot_text = read("robot", ROBOTS, &beside(origin, &file.robot))?;
        let robot =
            Robot::from_toml(&file.robot, &robot_text).map_err(|error| Failure::usage(error.to_string()))?;
        if robot.camera.is_none() && file.nodes.guard.take().is_some() {
            text = without_guard(origin, &text)?;
        }
        let nodes = plans(&file, origin)?;
        check(&file.nodes).map_err(|why| Failure::usage(format!("graph {origin}: {why}")))?;
        Ok(Self {
            origin: origin.to_owned(),
            text,
            robot_text,
            model: model_files(file.nodes.policy.as_ref())?,
            robot,
            lead: file.lead,
            time: file.time,
            supervision: file.supervision,
            budgets_ms: file.budgets_ms,
            nodes,
        })
    }

    fn parse(origin: &str, text: &str) -> Result<File, Failure> {
        toml::from_str(text).map_err(|error| Failure::usage(format!("graph {origin}: {error}")))
    }

    /// Writes the resolved files where the nodes will look for them.
    ///
    /// # Errors
    /// Exit code 3 with the path.
    pub(crate) fn write(&self, root: &Path) -> Result<(), Failure> {
        let texts = [("graph.toml", &self.text), ("robot.toml", &self.robot_text)];
        let files = texts.into_iter().map(|(name, text)| (name, text.as_bytes()));
        let model = self.model.iter().map(|(name, bytes)| (*name, bytes.as_slice()));
        for (name, bytes) in files.chain(model) {
            let path = root.join(name);
            std::fs::write(&path, bytes)
                .map_err(|error| Failure::io(format!("{}: {error}", path.display())))?;
        }
        Ok(())
    }
}

/// The graph of a robot without a camera: its guard would have nothing to look at.
fn without_guard(origin: &str, text: &str) -> Result<String, Failure> {
    let refused = |error: &dyn std::fmt::Display| Failure::usage(format!("graph {origin}: {error}"));
    let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| refused(&error))?;
    if let Some(nodes) = table.get_mut("nodes").and_then(toml::Value::as_table_mut) {
        nodes.remove("guard");
    }
    toml::to_string(&table).map_err(|error| refused(&error))
}

/// Gives a graph without a recorder that of the first built-in graph: who names a folder for recordings wants one.
fn add_recorder(table: &mut toml::Table) {
    let shipped = GRAPHS[0].1.parse::<toml::Table>().ok();
    let recorder = shipped.as_ref().and_then(|graph| graph.get("nodes")?.get("recorder")).cloned();
    let nodes = table.get_mut("nodes").and_then(toml::Value::as_table_mut);
    if let (Some(nodes), Some(recorder)) = (nodes, recorder) {
        nodes.entry("recorder").or_insert(recorder);
    }
}

/// What says which model drives, by name and content, and the model itself where the binary does not hold it.
fn model_files(policy: Option<&Entry<sidestep_policy::Config>>) -> Result<ModelFiles, Failure> {
    let Some(Entry { config, .. }) = policy else { return Ok(Vec::new()) };
    let bytes = config.bytes().map_err(|error| Failure::usage(error.to_string()))?;
    let embedded = config.model.is_empty();
    let name = toml::Value::String(if embedded { "embedded" } else { &config.model }.to_owned());
    let text = format!("model = {name}\nhash = \"{:016x}\"\n", sidestep_policy::fingerprint(&bytes));
    let onnx = (!embedded).then(|| ("model.onnx", bytes.into_owned()));
    Ok([("model.toml", text.into_bytes())].into_iter().chain(onnx).collect())
}

fn plan<C>(name: &str, entry: &Entry<C>) -> NodePlan {
    NodePlan {
        name: name.to_owned(),
        command: Vec::new(),
        restart: entry.restart,
        cpus: entry.cpus.clone(),
        priority: entry.priority,
        nice: entry.nice,
        lock_memory: entry.lock_memory,
        moves_time: false,
        writes: Vec::new(),
    }
}

/// Asks every node whether it would take its configuration.
fn check(nodes: &Nodes) -> Result<(), String> {
    fn ask<C, E: ToString>(
        entry: Option<&Entry<C>>,
        check: impl Fn(&C) -> Result<(), E>,
    ) -> Result<(), String> {
        entry.map_or(Ok(()), |entry| check(&entry.config).map_err(|error| error.to_string()))
    }
    ask(nodes.sim.as_ref(), sidestep_sim::Config::check)?;
    ask(nodes.player.as_ref(), sidestep_player::Config::check)?;
    ask(nodes.mapper.as_ref(), sidestep_mapper::Config::check)?;
    ask(nodes.guard.as_ref(), sidestep_guard::Config::check)?;
    ask(nodes.goal.as_ref(), sidestep_goal::Config::check)?;
    ask(nodes.expert.as_ref(), sidestep_expert::Config::check)?;
    ask(nodes.arbiter.as_ref(), sidestep_arbiter::Config::check)?;
    ask(nodes.recorder.as_ref(), sidestep_recorder::Config::check)
}

/// Consumers first: whoever writes finds its readers waiting.
fn plans(file: &File, origin: &str) -> Result<Vec<NodePlan>, Failure> {
    let nodes = &file.nodes;
    let mut plans: Vec<NodePlan> = [
        nodes.recorder.as_ref().map(|entry| plan("recorder", entry)),
        nodes.arbiter.as_ref().map(|entry| plan("arbiter", entry)),
        nodes.expert.as_ref().map(|entry| plan("expert", entry)),
        nodes.policy.as_ref().map(|entry| plan("policy", entry)),
        nodes.goal.as_ref().map(|entry| plan("goal", entry)),
        nodes.guard.as_ref().map(|entry| plan("guard", entry)),
        nodes.mapper.as_ref().map(|entry| plan("mapper", entry)),
        nodes.player.as_ref().map(|entry| plan("player", entry)),
        nodes.sim.as_ref().map(|entry| plan("sim", entry)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let (leader, led) = match file.lead {
        Lead::Policy => ("policy", nodes.policy.is_some()),
        Lead::Expert | Lead::Solved | Lead::Refined => ("expert", nodes.expert.is_some()),
    };
    if nodes.arbiter.is_some() && !led && !file.external.contains_key(leader) {
        let lead = format!("{:?}", file.lead).to_lowercase();
        return Err(Failure::usage(format!(
            "graph {origin}: lead is {lead}, and there is no node {leader}; add it or name another lead"
        )));
    }
    for (name, external) in &file.external {
        if plans.iter().any(|plan| plan.name == *name) {
            let why = format!("graph {origin}: {name} stands both in [nodes] and in [external]; keep one");
            return Err(Failure::usage(why));
        }
        plans.push(external.plan(name, origin)?);
    }
    let drivers = plans.iter_mut().filter(|plan| DRIVERS.contains(&plan.name.as_str()));
    drivers.for_each(|plan| plan.moves_time = file.time == Time::Lockstep);
    let drivers = plans.iter().filter(|plan| plan.moves_time).count();
    if file.time == Time::Lockstep && drivers != 1 {
        let found = if drivers == 0 { "no driver" } else { "two drivers" };
        return Err(Failure::usage(format!(
            "graph {origin}: time is \"lockstep\" with {found}; needed: one of sim, player and [external.driver]"
        )));
    }
    if plans.is_empty() {
        return Err(Failure::usage(format!("graph {origin}: no nodes; add at least one table [nodes.NAME]")));
    }
    Ok(plans)
}

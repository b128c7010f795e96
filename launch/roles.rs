//! What this program becomes when the launcher starts it again as a node.

use crate::failure::Failure;
use sidestep_bus::{Boot, DomainName, GraphFile, NodeError, environment, sweep};
use sidestep_msgs::{Limits, Robot};
use sidestep_recorder::{Fan, ViewSettings};
use std::sync::Arc;

/// Candidates of the expert that a view shows.
const FAN_CURVES: usize = 150;

type Role = fn(&Boot) -> Result<(), NodeError>;

/// Every node of this program and its entry.
const ROLES: &[(&str, Role)] = &[
    ("sim", sidestep_sim::run),
    ("player", sidestep_player::run),
    ("mapper", sidestep_mapper::run),
    ("guard", sidestep_guard::run),
    ("goal", sidestep_goal::run),
    ("policy", sidestep_policy::run),
    ("expert", sidestep_expert::run),
    ("arbiter", sidestep_arbiter::run),
    ("recorder", record),
];

/// What an expert of so many candidates (by default as shipped) weighs, for views: nodes do not know each other.
fn fan_of(limits: Limits, candidates: Option<usize>) -> Fan {
    let candidates = candidates.unwrap_or(sidestep_expert::Config::STANDARD.candidates);
    Arc::new(move |goal| sidestep_expert::fan(&limits, candidates, FAN_CURVES, goal.twist))
}

/// Robot and candidates of a live run, from the files that its launcher keeps beside it.
///
/// # Errors
/// Exit code 3 where the run has just ended.
pub(crate) fn view_of(run: &DomainName) -> Result<ViewSettings, Failure> {
    let read = |name: &str| {
        let path = run.root.join(name);
        let text = std::fs::read_to_string(&path);
        text.map_err(|error| Failure::io(format!("{}: {error}; has the run just ended?", path.display())))
    };
    let robot = Robot::from_toml("robot.toml", &read("robot.toml")?);
    let robot = robot.map_err(|error| Failure::io(error.to_string()))?;
    let expert = GraphFile::parse("graph.toml", &read("graph.toml")?)?.config("expert");
    let candidates = expert.ok().map(|config: sidestep_expert::Config| config.candidates);
    let fan = fan_of(robot.limits, candidates);
    Ok(ViewSettings { shown: true, footprint_m: robot.footprint.polygon_m, fan: Some(fan) })
}

/// The recorder shows what the expert of its graph weighs.
fn record(boot: &Boot) -> Result<(), NodeError> {
    let mut expert = boot.clone();
    expert.node = "expert".into();
    let config: Option<sidestep_expert::Config> = expert.config().ok();
    let fan = fan_of(boot.robot()?.limits, config.map(|config| config.candidates));
    sidestep_recorder::run(boot, Some(fan))
}

/// Runs a node until it is asked to stop.
///
/// # Errors
/// Exit code 2 for a name that is no node or a configuration that it refuses, 3 where input or output fail.
pub(crate) fn run_node(name: &str) -> Result<(), Failure> {
    let role = ROLES.iter().find(|(role, _)| *role == name).ok_or_else(|| {
        let names: Vec<_> = ROLES.iter().map(|(role, _)| *role).collect();
        Failure::usage(format!("no node is named {name}; one of: {}", names.join(", ")))
    })?;
    crate::child::stay_in_memory();
    let boot = Boot::from_environment(name)?;
    Ok(role.1(&boot)?)
}

/// Cleans up after killed nodes, in a process of its own.
///
/// # Errors
/// Exit code 3 where something could not be cleaned.
pub(crate) fn run_sweeper() -> Result<(), Failure> {
    let text = |name: &'static str| {
        std::env::var(name).map_err(|_| Failure::usage(format!("{name} is not set; the launcher sets it")))
    };
    let domain = DomainName { prefix: text(environment::DOMAIN)?, root: text(environment::ROOT)?.into() };
    Ok(sweep(&domain)?)
}

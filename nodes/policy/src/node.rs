//! The policy in the graph: one proposal per local goal, on the map that the goal names.

use crate::{Config, KeptMaps};
use sidestep_bus::{Boot, Keep, Link, NodeError};
use sidestep_msgs::{Code, LOCAL_GOAL, LOCAL_MAP, LocalMap, POLICY_COMMAND, Stage, Status};

/// Answers goals until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with what the model has and what is needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config = boot.config::<Config>()?;
    let refused = |error: crate::ModelError| NodeError::Configuration(error.to_string());
    let mut policy = config.load(&boot.robot()?).map_err(refused)?;
    if let Some(warning) = policy.warning() {
        warn(warning);
    }
    let mut kept = KeptMaps::default();
    let no_map = LocalMap::default();

    let mut link = Link::open(boot)?;
    let mut maps = link.inbox(LOCAL_MAP, Keep::All)?;
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest)?;
    let mut proposals = link.outbox(POLICY_COMMAND)?;
    link.wake_on(LOCAL_GOAL)?;
    link.run(|step| {
        if step.epoch_raised() {
            kept.forget();
        }
        maps.each(step, |map, header| kept.keep(map, header.sequence))?;
        let Some(goal) = goals.newest(step)? else { return Ok(()) };
        let goal_status = Status::from_code(goal.header().status).unwrap_or(Status::Fault);
        let map = kept.of(&goal);
        step.follow(goal.header(), Stage::Policy);
        proposals.send_with(step, |out| match map {
            Some(map) => policy.propose(map, &goal, goal_status, out),
            None => policy.propose(&no_map, &goal, Status::NoMap, out),
        })
    })
}

/// One line for the operator: the launcher shows what a node says on standard error.
#[allow(clippy::print_stderr, reason = "a node's log is its standard error")]
fn warn(line: &str) {
    eprintln!("policy: {line}");
}

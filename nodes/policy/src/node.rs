//! The policy in the graph: one proposal per local goal.

use crate::Config;
use sidestep_bus::{Boot, Keep, Link, NodeError, Received};
use sidestep_msgs::{Code, LOCAL_GOAL, LOCAL_MAP, LocalMap, POLICY_COMMAND, Proposal, Stage, Status};

/// Infers until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with what the model is and what is needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    let mut policy =
        config.load(&boot.robot()?).map_err(|error| NodeError::Configuration(error.to_string()))?;
    if let Some(warning) = policy.warning() {
        eprintln!("{warning}");
    }

    let mut link = Link::open(boot)?;
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest)?;
    let mut maps = link.inbox(LOCAL_MAP, Keep::All)?;
    let mut proposals = link.outbox(POLICY_COMMAND)?;
    link.wake_on(LOCAL_GOAL)?;
    let mut map: Option<Received<LocalMap>> = None;
    link.run(|step| {
        let Some(goal) = goals.newest(step)? else { return Ok(()) };
        while map.as_ref().is_none_or(|map| map.header().sequence < goal.map_sequence) {
            let Some(next) = maps.next(step)? else { break };
            map = Some(next);
        }
        let named = map.as_ref().filter(|map| map.header().sequence == goal.map_sequence);
        step.follow(goal.header(), Stage::Policy);
        let goal_status = Status::from_code(goal.header().status).unwrap_or(Status::Fault);
        proposals.send_with(step, |out| match named {
            Some(map) => policy.propose(map, &goal, goal_status, out),
            None => {
                *out = Proposal { capture_ns: goal.capture_ns, ..Proposal::default() };
                Status::NoMap
            }
        })
    })
}

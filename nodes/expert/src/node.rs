//! The expert in the graph: one proposal per local goal, on the map that the goal names.

use crate::pairing::Pairing;
use crate::{Config, Expert, Lead};
use sidestep_bus::{Boot, Keep, Link, NodeError};
use sidestep_msgs::{
    Code, EXPERT_COMMAND, LOCAL_GOAL, LOCAL_MAP, LocalMap, POLICY_COMMAND, Proposal, Stage, Status,
};

/// Answers goals until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config = boot.config::<Config>()?.led_by(&boot.lead()?);
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut expert = Expert::new(&config, &boot.robot()?).map_err(refused)?;
    let refines = config.mode == Lead::Refined;
    let mut pairing = Pairing::new(refines.then_some(config.policy_wait_ns));
    let no_map = LocalMap::default();

    let mut link = Link::open(boot)?;
    let mut maps = link.inbox(LOCAL_MAP, Keep::All)?;
    let mut goals = link.inbox(LOCAL_GOAL, Keep::Newest)?;
    let mut policies = if refines { Some(link.inbox(POLICY_COMMAND, Keep::Newest)?) } else { None };
    let mut proposals = link.outbox(EXPERT_COMMAND)?;
    link.wake_on(LOCAL_GOAL)?;
    if refines {
        link.wake_on(POLICY_COMMAND)?;
    }
    link.run(|step| {
        if step.epoch_raised() {
            pairing.reset();
        }
        maps.each(step, |map, header| pairing.map(map, header))?;
        if let Some(goal) = goals.newest(step)? {
            let deadline_ns = pairing.goal(&goal, goal.header(), step.now_ns());
            step.wake_at(deadline_ns);
        }
        if let Some(inbox) = &mut policies
            && let Some(proposal) = inbox.newest(step)?
        {
            pairing.policy(&proposal, proposal.header());
        }
        let Some((frame, seed)) = pairing.ready(step.now_ns()) else { return Ok(()) };
        let goal_status = Status::from_code(frame.header.status).unwrap_or(Status::Fault);
        let mut out = Proposal::default();
        let status = match pairing.map_of(&frame.goal) {
            Some(map) => expert.plan(map, &frame.goal, goal_status, seed, &mut out),
            None => expert.plan(&no_map, &frame.goal, Status::NoMap, None, &mut out),
        };
        step.follow(&frame.header, Stage::Expert);
        step.status(status);
        proposals.send(step, |message| *message = out)
    })
}

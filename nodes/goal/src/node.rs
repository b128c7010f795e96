//! The goal in the graph: one local goal per local map.

use crate::{Config, Goal};
use sidestep_bus::{Boot, Keep, Link, NodeError, Outbox, Step};
use sidestep_msgs::{
    Code, GoalState, LOCAL_GOAL, LOCAL_MAP, LocalGoal, ODOMETRY, PATH, STATE_GOAL, Stage, Status, TARGET,
};

/// Says what the goal keeps after a step; 0 = at its birth.
fn tell(
    states: &mut Outbox<GoalState>,
    step: &mut Step,
    goal: &Goal,
    after_sequence: u64,
) -> Result<(), NodeError> {
    states.send(step, |state| {
        state.after_sequence = after_sequence;
        state.size = goal.state(&mut state.bytes) as u64;
    })
}

/// Answers maps until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut goal = Goal::new(&config, &boot.robot()?).map_err(refused)?;

    let mut link = Link::open(boot)?;
    let mut odometry = link.inbox(ODOMETRY, Keep::Newest)?;
    let mut paths = link.inbox(PATH, Keep::All)?;
    let mut targets = link.inbox(TARGET, Keep::Newest)?;
    let mut maps = link.inbox(LOCAL_MAP, Keep::Newest)?;
    let mut goals = link.outbox(LOCAL_GOAL)?;
    let mut states = link.outbox(STATE_GOAL)?;
    link.wake_on(LOCAL_MAP)?;
    let mut birth = Step::new();
    link.look(&mut birth)?;
    tell(&mut states, &mut birth, &goal, 0)?;
    link.run(|step| {
        if step.epoch_raised() {
            goal.reset();
        }
        let Some(map) = maps.newest(step)? else { return Ok(()) };
        if let Some(message) = odometry.newest(step)? {
            goal.odometry(&message, message.header().sequence);
        }
        paths.each(step, |path, _| goal.path(path))?;
        if let Some(message) = targets.newest(step)? {
            goal.target(&message);
        }
        let header = map.header();
        let map_status = Status::from_code(header.status).unwrap_or(Status::Fault);
        let mut out = LocalGoal::default();
        let status = goal.step(&map, header.sequence, map_status, &mut out);
        step.follow(header, Stage::Goal);
        step.status(status);
        goals.send(step, |message| *message = out)?;
        if step.owes_state() {
            tell(&mut states, step, &goal, goals.next_sequence() - 1)?;
        }
        Ok(())
    })
}

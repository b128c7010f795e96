//! The arbiter in the graph: a command every tick, and one more when the lead's proposal of a new frame arrives.

mod inlets;

use crate::standing::StandingFile;
use crate::{Arbiter, Config};
use inlets::Inlets;
use sidestep_bus::{Boot, Link, NodeError, Outbox, Step};
use sidestep_msgs::{
    ArbiterState, COMMAND, EXPERT_COMMAND, NEAR_FIELD, POLICY_COMMAND, SAFETY_MAP, STATE_ARBITER, Stage,
};
use std::time::Duration;

/// Says what the arbiter keeps after a step; 0 = at its birth.
fn tell(
    states: &mut Outbox<ArbiterState>,
    step: &mut Step,
    arbiter: &Arbiter,
    after_sequence: u64,
) -> Result<(), NodeError> {
    states.send(step, |state| {
        state.after_sequence = after_sequence;
        state.size = arbiter.state(&mut state.bytes) as u64;
    })
}

/// Commands until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let resume = boot.graph_text("resume")?;
    let config = boot.config::<Config>()?.under(boot.lead_winner()?, resume.as_deref());
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut arbiter = Arbiter::new(&config, &boot.robot()?, boot.incarnation).map_err(refused)?;
    let mut standing = StandingFile::at(&config.latch_file, &boot.domain.root);
    arbiter.take_up(standing.orders());
    let mut link = Link::open(boot)?;
    let mut inputs = Inlets::open(&link, boot)?;
    let mut commands = link.outbox(COMMAND)?;
    let mut states = link.outbox(STATE_ARBITER)?;
    link.wake_on(POLICY_COMMAND)?;
    link.wake_on(EXPERT_COMMAND)?;
    if boot.is_lockstep()? {
        link.wake_on(SAFETY_MAP)?;
        link.wake_on(NEAR_FIELD)?;
    }
    link.tick_every(Duration::from_millis(10))?;
    let mut birth = Step::new();
    link.look(&mut birth)?;
    tell(&mut states, &mut birth, &arbiter, 0)?;
    link.run(|step| {
        if step.epoch_raised() {
            arbiter.reset();
        }
        if !inputs.take(step, &mut arbiter)? && !step.is_tick() {
            return Ok(());
        }
        standing.keep(arbiter.standing());
        let (now_ns, open_loop) = (step.now_ns(), step.is_open_loop());
        commands.send_about(step, Stage::Arbiter, &inputs.seen, |out| {
            let status = arbiter.step(now_ns, open_loop, out);
            (status, arbiter.source_frame())
        })?;
        if step.owes_state() {
            tell(&mut states, step, &arbiter, commands.next_sequence() - 1)?;
        }
        Ok(())
    })
}

//! The guard in the graph: one near field per depth frame.

use crate::{Config, Guard};
use sidestep_bus::{Boot, Keep, Link, NodeError};
use sidestep_msgs::{DEPTH, NEAR_FIELD};

/// Guards until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut guard = Guard::new(&config, &boot.robot()?).map_err(refused)?;

    let mut link = Link::open(boot)?;
    let mut depth = link.inbox(DEPTH, Keep::Newest)?;
    let mut fields = link.outbox(NEAR_FIELD)?;
    link.wake_on(DEPTH)?;
    link.run(|step| {
        let Some(frame) = depth.newest(step)? else { return Ok(()) };
        step.about(frame.header());
        fields.send_with(step, |out| guard.step(&frame, out))
    })
}

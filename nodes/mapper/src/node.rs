//! The mapper in the graph: one local map and one safety map per depth frame or sweep.

use crate::{Config, Mapper};
use sidestep_bus::{Boot, Keep, Keepsake, Link, NodeError, Outbox, Step};
use sidestep_msgs::{
    DEPTH, LOCAL_MAP, MAPPER_STATE_BYTES, MapperState, ODOMETRY, RANGES, SAFETY_MAP, SCAN, STATE_MAPPER,
    Stage,
};

/// Says what the mapper keeps after a step; 0 = at its birth.
fn tell(
    states: &mut Outbox<MapperState>,
    step: &mut Step,
    mapper: &Mapper,
    after_sequence: u64,
) -> Result<(), NodeError> {
    states.send(step, |state| {
        state.after_sequence = after_sequence;
        state.size = mapper.state(&mut state.bytes) as u64;
    })
}

/// Maps until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with key, found and needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let mut config: Config = boot.config()?;
    // The operator granted the disc at the start of the run; a mapper that starts again must see for itself.
    config.grant_start_disc &= boot.incarnation == 0;
    let refused = |error: crate::ConfigError| NodeError::Configuration(error.to_string());
    let mut mapper = Mapper::new(&config, &boot.robot()?).map_err(refused)?;

    // What an earlier life has seen still stands where it stood: odometry went on, and ages are kept.
    let mut keepsake = Keepsake::new(boot, MAPPER_STATE_BYTES);
    if let Some(memory) = keepsake.read().filter(|_| boot.incarnation > 0) {
        mapper.restore(&memory);
    }

    let mut link = Link::open(boot)?;
    let mut depth = link.inbox(DEPTH, Keep::Newest)?;
    let mut scan = link.inbox(SCAN, Keep::Newest)?;
    let mut odometry = link.inbox(ODOMETRY, Keep::All)?;
    let mut ranges = link.inbox(RANGES, Keep::All)?;
    let mut local = link.outbox(LOCAL_MAP)?;
    let mut safety = link.outbox(SAFETY_MAP)?;
    let mut states = link.outbox(STATE_MAPPER)?;
    link.wake_on(DEPTH)?;
    link.wake_on(SCAN)?;
    let mut birth = Step::new();
    link.look(&mut birth)?;
    tell(&mut states, &mut birth, &mapper, 0)?;
    link.run(|step| {
        if step.epoch_raised() {
            mapper.reset();
        }
        let frame = depth.newest(step)?;
        // One frame per step: a sweep beside a depth frame waits for the next wake.
        let sweep = if frame.is_none() { scan.newest(step)? } else { None };
        if frame.is_none() && sweep.is_none() {
            return Ok(());
        }
        odometry.each(step, |message, _| mapper.odometry(message))?;
        ranges.each(step, |message, _| mapper.ranges(message))?;
        if let Some(frame) = &frame {
            step.follow(frame.header(), Stage::Mapper);
            step.status(mapper.depth(frame));
        } else if let Some(sweep) = &sweep {
            step.follow(sweep.header(), Stage::Mapper);
            step.status(mapper.scan(sweep));
        }
        local.send(step, |map| mapper.write_local(map))?;
        safety.send(step, |map| mapper.write_safety(map))?;
        keepsake.keep(step, |bytes| mapper.state(bytes));
        if step.owes_state() {
            tell(&mut states, step, &mapper, local.next_sequence() - 1)?;
        }
        Ok(())
    })
}

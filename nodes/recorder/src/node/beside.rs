//! A second recorder beside a run that lives: a tool of which no node knows.

use super::{lost, origin, start, taps::Taps};
use crate::{Config, RecordError, Report, ViewSettings};
use sidestep_bus::{DomainName, Link, NodeError, Step, host_ns, live_domains};
use sidestep_msgs::COMMAND;
use std::path::Path;
use std::time::Duration;

/// `[ns]` host time between two looks whether the run lives.
const LOOK_EVERY_NS: u64 = 250_000_000;

/// Records a live run until SIGINT or SIGTERM, its end, or for a span of host time; `begun` is told the first file.
///
/// # Errors
/// [`NodeError::Configuration`] for settings out of range, [`NodeError::Transport`] where a topic takes no further reader,
/// [`NodeError::Lost`] where the recording could not begin, ended early or misses messages.
pub fn record_beside(
    domain: &DomainName,
    config: &Config,
    view: ViewSettings,
    time: Option<Duration>,
    begun: impl FnOnce(&Path),
) -> Result<Report, NodeError> {
    config.check().map_err(NodeError::Configuration)?;
    let folder = domain.root.file_name().unwrap_or_default().to_string_lossy();
    let run = u64::from_str_radix(&folder, 16).unwrap_or(0);
    let mut link = Link::attach(domain, &format!("record-{}", std::process::id()), run, 0)?;
    let mut taps = Taps::open(&link, config)?;
    link.wake_on(COMMAND)?;
    let (mut queue, _, path) = start(config, origin(config, (run, 0), domain.files(), view)?)?;
    begun(&path);
    let until_ns = time.map_or(u64::MAX, |time| host_ns().saturating_add(time.as_nanos() as u64));
    let mut look_ns = 0;
    let lives = || live_domains().contains(domain);
    let ended = link.run_while(|step| {
        taps.drain(step, &mut queue)?;
        let now_ns = host_ns();
        let mut goes_on = now_ns < until_ns && !queue.has_failed();
        if now_ns >= look_ns {
            look_ns = now_ns + LOOK_EVERY_NS;
            goes_on &= lives();
        }
        Ok(goes_on)
    });
    // Shared memory that goes in the middle of a step is the end of the run.
    let ended = ended.and_then(|()| taps.drain(&mut Step::new(), &mut queue));
    let report = queue.stop().map_err(|error| lost(&error))?;
    ended.or_else(|error| if lives() { Err(error) } else { Ok(()) })?;
    let path = report.path.clone();
    match report.missing() {
        Some(detail) => Err(lost(&RecordError::Lost { path, detail })),
        None => Ok(report),
    }
}

//! Empties the inbox of every topic into the queue to the disk, until asked to stop, and says what it has begun and kept.

mod beside;
mod taps;
mod voice;

pub use beside::record_beside;

use crate::{
    Config, Fan, Files, Origin, Progress, Queue, QueueRoom, RecordError, ViewSettings, kernel_class,
};
use sidestep_bus::{Bookmark, Boot, Link, NodeError, Step, host_ns, wall_ns};
use sidestep_msgs::{COMMAND, RECORDING, Recording};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use taps::Taps;
use voice::Voice;

fn lost(error: &RecordError) -> NodeError {
    NodeError::Lost(error.to_string())
}

/// What a recording says of the run, with the files of the run and those that the settings name within.
fn origin(
    config: &Config,
    (run, incarnation): (u64, u32),
    mut attachments: Vec<(String, Vec<u8>)>,
    view: ViewSettings,
) -> Result<Origin, NodeError> {
    for path in &config.attach {
        let bytes = std::fs::read(path).map_err(|source| NodeError::File {
            path: path.display().to_string(),
            source,
            remedy: "name files that exist in recorder.attach",
        })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        attachments.push((name, bytes));
    }
    let metadata = [
        ("version", env!("CARGO_PKG_VERSION").into()),
        ("run", run.to_string()),
        ("incarnation", incarnation.to_string()),
        ("kernel_class", kernel_class().into()),
        ("machine", std::env::consts::ARCH.into()),
    ];
    Ok(Origin {
        mono_to_wall_ns: wall_ns().saturating_sub(host_ns()) as i64,
        metadata: metadata.map(|(key, value): (&str, String)| (key.into(), value)).into(),
        attachments,
        flush_period_ns: config.flush_period_ns(),
        view,
    })
}

/// Starts the writer thread in a folder.
fn start(config: &Config, origin: Origin) -> Result<(Queue, Arc<Progress>, PathBuf), NodeError> {
    let filter = config.filter().map_err(NodeError::Configuration)?;
    let files = Files::begin(config, filter, origin, wall_ns()).map_err(|error| lost(&error))?;
    let (progress, path) = (files.progress(), files.path().to_path_buf());
    let room = QueueRoom { small: config.queue_small, large: config.queue_large };
    Ok((Queue::start(files, room).map_err(|error| lost(&error))?, progress, path))
}

/// Records the run that this process belongs to; `fan` shows what the expert weighs.
///
/// # Errors
/// [`NodeError::Lost`] where the recording could not begin, ended early or misses messages; the drive never waits for it.
pub fn run(boot: &Boot, fan: Option<Fan>) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    config.check().map_err(NodeError::Configuration)?;
    let view = ViewSettings { shown: config.view, footprint_m: boot.robot()?.footprint.polygon_m, fan };
    let origin = origin(&config, (boot.run, boot.incarnation), boot.domain.files(), view)?;
    let (mut queue, progress, path) = start(&config, origin)?;
    if path != Path::new("") {
        let _ = std::fs::write(boot.domain.root.join("recording"), path.display().to_string());
    }
    let mut link = Link::open(boot)?;
    let mut taps = Taps::open(&link, &config)?;
    let outbox = link.outbox(RECORDING)?;
    let said = Recording { files: 0, snapshots: 0, snapshot_token: 0, held_s: 0.0, _pad: 0 };
    let mut voice = Voice { outbox, progress, said, word: boot.domain.root.join("snapshot") };
    // Not woken by the frame itself: whoever turns it into a command goes first, and the rings hold it meanwhile.
    link.wake_on(COMMAND)?;
    let bookmark = boot.is_lockstep()?.then(|| Bookmark::write(boot));
    link.run(|step| {
        taps.drain(step, &mut queue)?;
        // A driver that moves time waits while the queue has no room for what would follow.
        bookmark
            .iter()
            .filter(|_| queue.has_room())
            .for_each(|bookmark| bookmark.tell(step.clock_sequence()));
        voice.tell(step)
    })?;
    // What was sent while this node was asked to stop.
    taps.drain(&mut Step::new(), &mut queue)?;
    let report = queue.stop().map_err(|error| lost(&error))?;
    if let Some(missing) = report.missing() {
        eprintln!("the recording misses messages: {missing}");
    }
    report.check().map_err(|error| lost(&error))
}

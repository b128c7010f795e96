//! Recording beside a run, and keeping its black box.

use crate::failure::Failure;
use crate::look::{join, only_run, runs};
use crate::roles::view_of;
use clap::Args;
use sidestep_bus::{DomainName, Keep, Link, NodeError, Outbox, Step, host_ns, pause};
use sidestep_msgs::{RECORDING, Recording, SNAPSHOT, Snapshot, Stage, topic_named};
use sidestep_recorder::{Config, record_beside};
use std::path::PathBuf;
use std::time::Duration;

/// `[ns]` time the recorder has to write its black box.
const WRITE_NS: u64 = 30_000_000_000;
/// `[ns]` time to hear of a recorder at all.
const HEAR_NS: u64 = 2_000_000_000;
/// `[ns]` pause before the same message is said again.
const REPEAT_NS: u64 = 100_000_000;
/// Niceness: who drives goes first.
const NICE: u8 = 10;

/// What to record.
#[derive(Debug, Args)]
pub(crate) struct RecordArguments {
    /// Folder of the recording.
    #[arg(long, default_value = "recordings")]
    folder: PathBuf,
    /// Topics to record, names or patterns such as "state/*"; without it all.
    #[arg(long, num_args = 1.., value_delimiter = ',')]
    topics: Vec<String>,
    /// Topics not to record, names or patterns.
    #[arg(long, num_args = 1.., value_delimiter = ',')]
    exclude: Vec<String>,
    /// `[s]` begins the next file after this time.
    #[arg(long, default_value_t = 0.0)]
    split_s: f64,
    /// `[MB]` begins the next file after this size.
    #[arg(long, default_value_t = 0)]
    split_mb: u64,
    /// `[MB]` ends in order when the disk has less left.
    #[arg(long, default_value_t = 500)]
    free_mb_least: u64,
    /// How long; without it until Ctrl-C or the end of the run.
    #[arg(long = "for", value_parser = crate::duration)]
    time: Option<Duration>,
}

/// Says what a refused reader means here.
fn refused(error: NodeError) -> Failure {
    match &error {
        NodeError::Transport { topic, action: "read it", .. } => {
            let most = topic_named(topic).map_or(0, |row| row.readers);
            let why = format!(
                "topic {topic}: no room for a further recorder, at most {most} readers; end another `sidestep record` or \
                 leave the topic out with --exclude {topic}"
            );
            Failure::io(why)
        }
        _ => error.into(),
    }
}

/// Records the newest run beside whatever else runs.
///
/// # Errors
/// Exit code 2 for options, 3 where no run lives, the disk refuses or messages were lost.
pub(crate) fn record(arguments: RecordArguments) -> Result<(), Failure> {
    let config = Config {
        topics: arguments.topics,
        exclude: arguments.exclude,
        split_mb: arguments.split_mb,
        split_s: arguments.split_s,
        free_mb_least: arguments.free_mb_least,
        ..Config::plain(arguments.folder)
    };
    config.check().map_err(Failure::usage)?;
    let run = runs()?.remove(0);
    crate::child::give_way(0, NICE);
    let begun = |path: &std::path::Path| crate::output::note(format!("recording: {}", path.display()));
    let report = record_beside(&run, &config, view_of(&run)?, arguments.time, begun).map_err(refused)?;
    crate::output::line(&format!("{}: {} messages in all, none lost", report.path.display(), report.written));
    Ok(())
}

/// The black box of a run, by the graph file that the launcher left: `[MB]`, `None` where there is no recorder.
fn black_box_mb(run: &DomainName) -> Option<i64> {
    let text = std::fs::read_to_string(run.root.join("graph.toml")).ok()?;
    let graph: toml::Table = text.parse().ok()?;
    let path = ["recorder", "config", "black_box_mb"];
    path.iter().try_fold(graph.get("nodes")?, |value, key| value.get(key))?.as_integer()
}

/// Asks the recorder of a run to write its black box, and waits until the file is complete.
///
/// # Errors
/// Exit code 2 where several runs live, 3 where none does, there is no black box, or nobody acknowledges.
pub(crate) fn snapshot() -> Result<(), Failure> {
    let run = only_run()?;
    match black_box_mb(&run) {
        None => return Err(Failure::io("this run has no recorder, needed: one; name a graph that has it")),
        Some(0) => {
            return Err(Failure::io(
                "the black box is off; start the run with --set recorder.black_box_mb=256",
            ));
        }
        Some(_) => {}
    }
    let mut link = join(&run, "snapshot")?;
    let mut recordings = link.inbox(RECORDING, Keep::Newest)?;
    let mut outbox = turn(&link)?;
    let (token, began_ns) = (host_ns() | 1, host_ns());
    let mut step = Step::new();
    let mut heard: Option<Recording> = None;
    let mut due_ns = 0;
    while host_ns() - began_ns < if heard.is_some() { WRITE_NS } else { HEAR_NS } {
        link.look(&mut step)?;
        if host_ns() >= due_ns {
            due_ns = host_ns() + REPEAT_NS;
            step.originate(0, Stage::Arbiter);
            outbox.send(&mut step, |snapshot| *snapshot = Snapshot { token })?;
        }
        if let Some(word) = recordings.newest(&mut step)? {
            heard = Some(*word);
            if word.snapshot_token == token {
                let path = std::fs::read_to_string(run.root.join("snapshot")).unwrap_or_default();
                crate::output::line(&format!("snapshot: {path}, the last {:.1} s", word.held_s));
                return Ok(());
            }
        }
        pause(Duration::from_millis(5));
    }
    let why = match heard {
        None => "no recorder was heard within 2 s; is it alive? see `sidestep top`",
        Some(_) => {
            "the snapshot was not written within 30 s; the recorder's own lines say why, as a full disk"
        }
    };
    Err(Failure::io(why))
}

/// Waits for its turn to write: whoever asks holds the topic until it has its answer.
fn turn(link: &Link) -> Result<Outbox<Snapshot>, Failure> {
    let until_ns = host_ns() + HEAR_NS;
    loop {
        match link.outbox(SNAPSHOT) {
            Ok(outbox) => return Ok(outbox),
            Err(error) if host_ns() >= until_ns => return Err(error.into()),
            Err(_) => pause(Duration::from_millis(5)),
        }
    }
}

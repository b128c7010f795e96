//! `sidestep recover`: what can be saved of a file that was cut or damaged, into a complete one.

use crate::failure::Failure;
use clap::Args;
use sidestep_player::{PlayerError, Salvage, salvage};
use sidestep_recorder::{Copying, RecordError};
use std::path::{Path, PathBuf};

/// What to save, and where.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// An .mcap or .mcap.active file, of whatever program; it stays as it is.
    file: PathBuf,
    /// The file to write; without it NAME-recovered.mcap beside FILE.
    out: Option<PathBuf>,
    /// Writes the same as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Reading or writing went wrong.
struct Broken(String);

impl From<PlayerError> for Broken {
    fn from(error: PlayerError) -> Self {
        Self(error.to_string())
    }
}

impl From<RecordError> for Broken {
    fn from(error: RecordError) -> Self {
        Self(error.to_string())
    }
}

impl From<Broken> for Failure {
    fn from(Broken(message): Broken) -> Self {
        Self::io(message)
    }
}

/// `drive.mcap.active` and `drive.mcap` become `drive-recovered.mcap`.
fn name_beside(file: &Path) -> PathBuf {
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = name.trim_end_matches(".active").trim_end_matches(".mcap");
    file.with_file_name(format!("{stem}-recovered.mcap"))
}

/// Saves what can be read of a file.
///
/// # Errors
/// Exit code 2 where the output exists, 3 where a file cannot be read or written, or something was lost.
pub(crate) fn recover(arguments: &Arguments) -> Result<(), Failure> {
    let file = &arguments.file;
    let out = arguments.out.clone().unwrap_or_else(|| name_beside(file));
    crate::output::refuse_existing(&out)?;
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    let salvaged = copy(file, &out)?;
    crate::output::line(&text(&salvaged, file, &out));
    if let Some(path) = &arguments.json {
        let mut value = serde_json::to_value(&salvaged).unwrap_or_default();
        value["path"] = out.display().to_string().into();
        crate::output::json(path, &value)?;
    }
    if salvaged.is_lossy() {
        let damage = salvaged.damage.as_deref().unwrap_or("records that no file may hold");
        return Err(Failure::io(format!(
            "recording {}: not all of it could be saved: {damage}",
            file.display()
        )));
    }
    Ok(())
}

fn copy(file: &Path, out: &Path) -> Result<Salvage, Broken> {
    // Looked at before anything is made: a file that is no MCAP leaves nothing behind.
    sidestep_player::Info::read(file)?;
    let mut copy = Copying::create(out)?;
    let salvaged = salvage(file, |record| copy.write(record).map_err(Broken::from))?;
    copy.complete()?;
    Ok(salvaged)
}

fn text(salvaged: &Salvage, file: &Path, out: &Path) -> String {
    let Salvage { messages, duration_s, attachments, unverified, passed_over, unread_bytes, .. } = *salvaged;
    let mut text = format!(
        "{}: {messages} messages over {duration_s:.3} s and {attachments} files within were saved",
        out.display()
    );
    let mut add = |part: String| {
        text.push('\n');
        text.push_str(&part);
    };
    if unverified > 0 {
        add(format!("  of these {unverified} stand in a chunk that was cut, whose sum cannot be checked"));
    }
    match &salvaged.damage {
        Some(damage) => add(format!("  {}: {damage}", file.display())),
        None if salvaged.is_lossy() => add(format!("  {}: has its end mark", file.display())),
        None => add(format!("  {}: is complete", file.display())),
    }
    if passed_over > 0 {
        add(format!(
            "  {passed_over} chunks or records that are damaged, or belong to no channel, were passed over"
        ));
    }
    if unread_bytes > 0 {
        add(format!("  the last {unread_bytes} bytes could not be read whole"));
    }
    if let Some(missing) = salvaged.missing.filter(|missing| *missing > 0) {
        add(format!("  {missing} messages that its summary counts are lost"));
    }
    if !salvaged.is_lossy() {
        add("  nothing that it holds was lost".into());
    }
    text
}

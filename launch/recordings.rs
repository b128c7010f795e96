//! Commands about recordings: play one into a graph, say what one holds.

use crate::failure::Failure;
use crate::run::{Options, quoted};
use sidestep_player::{Info, PlayerError};
use std::path::Path;

/// A setting that cannot be is usage, everything else about a recording is input.
fn failure(error: &PlayerError) -> Failure {
    match error {
        PlayerError::Setting { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

/// The run that plays a recording.
///
/// # Errors
/// Exit code 3 where the recording cannot be read.
pub(crate) fn play(
    file: &Path,
    rate: f64,
    repeat: bool,
    offset_s: f64,
    run: Options,
) -> Result<Options, Failure> {
    Info::read(file).map_err(|error| failure(&error))?;
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut settings = vec![
        format!("player.file={}", quoted(&absolute)),
        format!("player.rate={rate:?}"),
        format!("player.repeat={repeat}"),
        format!("player.start_offset_s={offset_s:?}"),
    ];
    settings.extend(run.settings);
    Ok(Options { settings, ..run })
}

/// Says what a recording holds.
///
/// # Errors
/// Exit code 3 where it cannot be read.
pub(crate) fn info(file: &Path, json: Option<&Path>) -> Result<(), Failure> {
    let info = Info::read(file).map_err(|error| failure(&error))?;
    crate::output::line(info.text().trim_end());
    let Some(path) = json else { return Ok(()) };
    crate::output::json(path, &serde_json::to_value(&info).unwrap_or_default())
}

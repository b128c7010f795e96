//! Commands about recordings: say what one holds, make one of images, its latencies.

use crate::failure::Failure;
use crate::manifest::Graph;
use sidestep_player::{Info, PlayerError};
use std::path::Path;

/// A setting that cannot be is usage, everything else about a recording is input.
fn failure(error: &PlayerError) -> Failure {
    match error {
        PlayerError::Setting { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
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

/// Latencies of a recording, against the budgets of the built-in graph, with a trace for Perfetto if asked.
///
/// # Errors
/// Exit code 1 with `gate` where a budget was missed, 3 where the recording cannot be read.
pub(crate) fn latency(
    file: &Path,
    json: Option<&Path>,
    trace: Option<&Path>,
    gate: bool,
) -> Result<(), Failure> {
    let budgets = Graph::load("sim", &[])?.budgets_ms;
    let (figures, steps) = sidestep_latency::analyse(file, &budgets).map_err(|error| failure(&error))?;
    crate::output::line(figures.table().trim_end());
    if let Some(path) = json {
        crate::output::json(path, &figures.json())?;
    }
    if let Some(path) = trace {
        crate::output::may_write(path)?;
        let failed = |error: std::io::Error| Failure::io(format!("{}: {error}", path.display()));
        let mut out = std::io::BufWriter::new(std::fs::File::create(path).map_err(failed)?);
        steps.write(&mut out).map_err(failed)?;
        crate::output::line(&format!("{}: open it in ui.perfetto.dev", path.display()));
    }
    if gate && figures.misses() > 0 {
        return Err(Failure::unmet("latency budgets were missed; the table above says where"));
    }
    Ok(())
}

//! Commands about recordings: play one into a graph, say what one holds.

use crate::failure::Failure;
use crate::manifest::Graph;
use crate::run::{Options, quoted};
use sidestep_msgs::DEPTH;
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
    let info = Info::read(file).map_err(|error| failure(&error))?;
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut settings = vec![
        format!("player.file={}", quoted(&absolute)),
        format!("player.rate={rate:?}"),
        format!("player.repeat={repeat}"),
        format!("player.start_offset_s={offset_s:?}"),
    ];
    settings.extend(ages(&info));
    settings.extend(run.settings);
    Ok(Options { settings, ..run })
}

/// Frame periods for which map, goal and proposals may be believed.
const AGE_FRAMES: f64 = 3.0;
/// `[Hz]` the frame rate that the age limits of the shipped graphs are made for; slower cameras need longer ones.
const AGE_RATE_HZ: f64 = 30.0;

/// Age limits of the arbiter in periods of the recording's frames, where these come more slowly than a graph expects.
fn ages(info: &Info) -> Vec<String> {
    let frames = info.channels.iter().find(|channel| channel.topic == DEPTH.row().name && channel.count > 1);
    let Some(rate_hz) = frames.map(|channel| channel.rate_hz).filter(|rate_hz| *rate_hz < 0.9 * AGE_RATE_HZ)
    else {
        return Vec::new();
    };
    let age_s = AGE_FRAMES / rate_hz;
    ["map", "goal", "proposal"].map(|input| format!("arbiter.{input}_age_s={age_s:.3}")).to_vec()
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

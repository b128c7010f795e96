//! Commands about recordings: say what one holds, make one of images, its latencies.

use crate::failure::Failure;
use crate::manifest::Graph;
use clap::Args;
use sidestep_import::{ImportError, Placing, Up, import_folder};
use sidestep_player::{Info, PlayerError};
use std::path::{Path, PathBuf};

/// What to import.
#[derive(Debug, Args)]
pub(crate) struct ImportArguments {
    /// Folder with depth/NUMBER.png (16 bits), K.txt and, where known, poses.txt (4x4 camera to world).
    folder: PathBuf,
    /// Recording to write.
    out: PathBuf,
    /// `[Hz]` an image is stamped with its number divided by this.
    #[arg(long, default_value_t = 30.0)]
    rate: f64,
    /// `[m]` one unit of a pixel.
    #[arg(long, default_value_t = 0.001)]
    metres_per_unit: f32,
    /// No poses: each image is placed by the floor it shows, on its own.
    #[arg(long)]
    floor_fit: bool,
    /// Axis of the poses' world that points up: y or z.
    #[arg(long, default_value = "y", value_parser = ["y", "z"])]
    up: String,
    /// fx,fy,cx,cy in pixels, where there is no K.txt.
    #[arg(long, value_delimiter = ',', num_args = 1)]
    intrinsics: Vec<f64>,
}

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

/// Turns a folder of depth images into a recording.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn import(arguments: ImportArguments) -> Result<(), Failure> {
    let intrinsics = match arguments.intrinsics[..] {
        [] => None,
        [fx_px, fy_px, cx_px, cy_px] => Some(sidestep_import::Intrinsics { fx_px, fy_px, cx_px, cy_px }),
        _ => {
            let found = arguments.intrinsics.len();
            return Err(Failure::usage(format!("--intrinsics has {found} numbers, needed: fx,fy,cx,cy")));
        }
    };
    let placing = if arguments.floor_fit {
        Placing::FloorFit { seed: 1 }
    } else {
        Placing::Poses { up: if arguments.up == "z" { Up::Z } else { Up::Y }, floor_m: None }
    };
    let options = sidestep_import::Options {
        folder: arguments.folder,
        metres_per_unit: arguments.metres_per_unit,
        rate_hz: arguments.rate,
        intrinsics,
        placing,
    };
    let summary = import_folder(&options, &arguments.out)
        .map_err(|error: ImportError| Failure::io(error.to_string()))?;
    crate::output::line(&format!(
        "{}: {} images over {:.1} s and {:.1} m, {} left out for want of a floor",
        summary.path.display(),
        summary.images,
        summary.duration_s,
        summary.distance_m,
        summary.unplaced
    ));
    Ok(())
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

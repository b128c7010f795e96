//! Commands that bring data of others in and take ours out: folders of depth images and ROS 2 bags.

use crate::failure::Failure;
use clap::Args;
use sidestep_bags::{BagError, BagOptions, export_bag, import_bag, is_bag};
use sidestep_import::{Intrinsics, Placing, Up, import_folder};
use sidestep_msgs::Isometry;
use std::path::PathBuf;

/// What to import.
#[derive(Debug, Args)]
#[command(
    after_help = "A bag that was cut or damaged is imported as far as it can be read; the summary says where \
                        it ends, and the exit code is 3."
)]
pub(crate) struct ImportArguments {
    /// Folder with depth/NUMBER.png (16 bits), K.txt and, where known, poses.txt (4x4 camera to world);
    /// or a ROS 2 bag: an .mcap file, or the folder of a bag.
    source: PathBuf,
    /// Recording to write.
    out: PathBuf,
    /// fx,fy,cx,cy in pixels, where there is no K.txt or camera_info.
    #[arg(long, value_delimiter = ',', num_args = 1)]
    intrinsics: Vec<f64>,
    /// No poses: each image is placed by the floor it shows, on its own.
    #[arg(long)]
    floor_fit: bool,
    #[command(flatten, next_help_heading = "Folder of depth images")]
    folder: FolderArguments,
    #[command(flatten, next_help_heading = "ROS 2 bag")]
    bag: BagArguments,
}

#[derive(Debug, Args)]
struct FolderArguments {
    /// `[Hz]` an image is stamped with its number divided by this.
    #[arg(long, default_value_t = 30.0)]
    rate: f64,
    /// `[m]` one unit of a pixel.
    #[arg(long, default_value_t = 0.001)]
    metres_per_unit: f32,
    /// Axis of the poses' world that points up: y or z.
    #[arg(long, default_value = "y", value_parser = ["y", "z"])]
    up: String,
}

#[derive(Debug, Args)]
struct BagArguments {
    /// Topic of the depth images; without it the only one.
    #[arg(long, value_name = "TOPIC")]
    depth_topic: Option<String>,
    /// Topic of the camera's calibration; without it the one beside the images.
    #[arg(long, value_name = "TOPIC")]
    camera_info_topic: Option<String>,
    /// Topic of lidar sweeps; without it the only one, where there is no depth.
    #[arg(long, value_name = "TOPIC")]
    scan_topic: Option<String>,
    /// Topic of the odometry; without it the only one, or the transforms from odom to the base.
    #[arg(long, value_name = "TOPIC")]
    odometry_topic: Option<String>,
    /// Frame on the floor below the robot; without it base_footprint, or the child frame of the odometry.
    #[arg(long, value_name = "FRAME")]
    base_frame: Option<String>,
    /// FORWARD,LEFT,UP,PITCH of the sensor in metres and degrees down, where no transforms say it.
    #[arg(long, value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    mount: Vec<f32>,
    /// Stamps of the messages (header), or the times at which they were recorded (arrival).
    #[arg(long, default_value = "header", value_parser = ["header", "arrival"])]
    stamps: String,
}

/// What to export.
#[derive(Debug, Args)]
pub(crate) struct ExportArguments {
    /// An .mcap or .mcap.active file.
    file: PathBuf,
    /// Bag to write: a folder with metadata.yaml, or a single file where the name ends in .mcap.
    out: PathBuf,
}

fn failure(error: &BagError) -> Failure {
    if error.is_usage() { Failure::usage(error.to_string()) } else { Failure::io(error.to_string()) }
}

/// Turns a folder of depth images or a ROS 2 bag into a recording.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file, and 3 for a bag that could not be read to its end.
pub(crate) fn import(arguments: ImportArguments) -> Result<(), Failure> {
    crate::output::refuse_existing(&arguments.out)?;
    let intrinsics = match arguments.intrinsics[..] {
        [] => None,
        [fx_px, fy_px, cx_px, cy_px] => Some(Intrinsics { fx_px, fy_px, cx_px, cy_px }),
        _ => {
            let found = arguments.intrinsics.len();
            return Err(Failure::usage(format!("--intrinsics has {found} numbers, needed: fx,fy,cx,cy")));
        }
    };
    if is_bag(&arguments.source) {
        return bag(arguments, intrinsics);
    }
    let folder = arguments.folder;
    let placing = if arguments.floor_fit {
        Placing::FloorFit { seed: 1 }
    } else {
        Placing::Poses { up: if folder.up == "z" { Up::Z } else { Up::Y }, floor_m: None }
    };
    let options = sidestep_import::Options {
        folder: arguments.source,
        metres_per_unit: folder.metres_per_unit,
        rate_hz: folder.rate,
        intrinsics,
        placing,
    };
    let summary = import_folder(&options, &arguments.out).map_err(|error| failure(&error.into()))?;
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

fn bag(arguments: ImportArguments, intrinsics: Option<Intrinsics>) -> Result<(), Failure> {
    let bag = arguments.bag;
    let mount = match bag.mount[..] {
        [] => None,
        [forward_m, left_m, up_m, pitch] => {
            Some(Isometry::camera(forward_m, left_m, up_m, pitch.to_radians())).filter(Isometry::is_valid)
        }
        _ => None,
    };
    if mount.is_none() && !bag.mount.is_empty() {
        let found = bag.mount.iter().map(f32::to_string).collect::<Vec<_>>().join(",");
        return Err(Failure::usage(format!("--mount is {found}, needed: FORWARD,LEFT,UP,PITCH")));
    }
    let options = BagOptions {
        source: arguments.source,
        depth_topic: bag.depth_topic,
        camera_info_topic: bag.camera_info_topic,
        scan_topic: bag.scan_topic,
        odometry_topic: bag.odometry_topic,
        base_frame: bag.base_frame,
        intrinsics,
        mount,
        arrival_stamps: bag.stamps == "arrival",
        floor_fit: arguments.floor_fit.then_some(1),
    };
    let summary = import_bag(&options, &arguments.out).map_err(|error| failure(&error))?;
    crate::output::line(&summary.text());
    if summary.damage.is_empty() {
        return Ok(());
    }
    Err(Failure::io(format!(
        "{}: not all of the bag could be read; {} holds what could",
        options.source.display(),
        summary.path.display()
    )))
}

/// Turns a recording into a ROS 2 bag.
///
/// # Errors
/// Exit code 3 where the recording cannot be read to its end or the bag cannot be written.
pub(crate) fn export(arguments: &ExportArguments) -> Result<(), Failure> {
    crate::output::refuse_existing(&arguments.out)?;
    let summary = export_bag(&arguments.file, &arguments.out).map_err(|error| failure(&error))?;
    let totals = &summary.totals;
    for (topic, count) in &totals.messages {
        crate::output::line(&format!("  {topic:<32} {count:>8} msgs"));
    }
    let duration_s = (totals.last_ns - totals.first_ns) as f64 * 1e-9;
    crate::output::line(&format!("{}: {duration_s:.1} s", totals.path.display()));
    match summary.damage {
        None => Ok(()),
        Some(damage) => Err(Failure::io(format!("{}: {damage}", arguments.file.display()))),
    }
}

//! What a person may say about a bag, and what an import says in return.

use sidestep_import::Intrinsics;
use sidestep_msgs::Isometry;
use std::fmt::Write as _;
use std::path::PathBuf;

/// What to import, and how; what is `None` is told from the bag.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BagOptions {
    /// An .mcap file, or the folder of a bag.
    pub source: PathBuf,
    /// Topic of the depth images.
    pub depth_topic: Option<String>,
    /// Topic of the camera's calibration.
    pub camera_info_topic: Option<String>,
    /// Topic of the lidar sweeps; beside depth they are taken only if named.
    pub scan_topic: Option<String>,
    /// Topic of the odometry.
    pub odometry_topic: Option<String>,
    /// Frame on the floor below the robot.
    pub base_frame: Option<String>,
    /// The camera, instead of its camera_info.
    pub intrinsics: Option<Intrinsics>,
    /// Pose of the sensor in `body`, instead of the transforms.
    pub mount: Option<Isometry>,
    /// Times of arrival are taken for the stamps of the messages, which are wrong.
    pub arrival_stamps: bool,
    /// No poses: each image is placed by the floor that it shows; the seed of the fit.
    pub floor_fit: Option<u64>,
}

/// What an import of a bag made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BagSummary {
    /// The recording.
    pub path: PathBuf,
    /// Depth frames in it.
    pub frames: usize,
    /// Lidar sweeps in it.
    pub sweeps: usize,
    /// `[s]` from the first frame or sweep to the last.
    pub duration_s: f64,
    /// `[m]` way of the robot.
    pub distance_m: f64,
    /// Which topics were taken, one line each.
    pub chosen: Vec<String>,
    /// What was changed or left out, one line each.
    pub notes: Vec<String>,
    /// Where the bag could not be read to its end.
    pub damage: Vec<String>,
}

impl BagSummary {
    /// As text for a person.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        // A text in memory cannot fail to take more text.
        for line in self.chosen.iter().chain(&self.notes) {
            let _ = writeln!(text, "  {line}");
        }
        for line in &self.damage {
            let _ = writeln!(text, "  cut: {line}");
        }
        let Self { frames, sweeps, duration_s, distance_m, .. } = self;
        let sweeps = if *sweeps > 0 { format!("{sweeps} sweeps, ") } else { String::new() };
        let _ = write!(
            text,
            "{}: {frames} images, {sweeps}{duration_s:.1} s, {distance_m:.1} m",
            self.path.display()
        );
        text
    }
}

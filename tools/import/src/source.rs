//! A folder of depth images as the messages of a driver.

use crate::error::ImportError;
use crate::files::{self, Image, Intrinsics, Rigid};
use crate::floor::camera_over_floor;
use crate::placing::{Placed, Up, place, turn_upright};
use crate::way::way;
use sidestep_msgs::{DepthFrame, Isometry, Odometry, Path, Pose2, Twist, wrap_angle};
use std::path::PathBuf;

/// `[ns]` odometry of an import comes at 100 Hz.
pub const ODOMETRY_NS: u64 = 10_000_000;
/// `[ns]` graph time of image number 0: stamps of zero mean nothing to a graph.
pub const FIRST_NS: u64 = 1_000_000_000;
/// Images that the height of the floor is found from.
const FLOOR_IMAGES: usize = 25;

/// Where the camera was at each image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Placing {
    /// `poses.txt` says it.
    Poses {
        /// The axis of its world that points up.
        up: Up,
        /// `[m]` the floor along that axis; `None` = found from the images.
        floor_m: Option<f64>,
    },
    /// Nothing says it: each image is placed by its floor, and belongs to a pose epoch of its own.
    FloorFit {
        /// Seed of the fit.
        seed: u64,
    },
}

/// What to import, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The folder: `depth/NUMBER.png` or `NUMBER.png`, `K.txt`, `poses.txt`.
    pub folder: PathBuf,
    /// `[m]` of one unit of a pixel.
    pub metres_per_unit: f32,
    /// `[Hz]` an image is stamped with its number divided by this.
    pub rate_hz: f64,
    /// The camera; `None` = `K.txt` says it.
    pub intrinsics: Option<Intrinsics>,
    /// Where the camera was.
    pub placing: Placing,
}

/// A folder of depth images, checked and placed.
#[derive(Debug, Clone)]
pub struct Source {
    images: Vec<Image>,
    intrinsics: Intrinsics,
    metres_per_unit: f32,
    rate_hz: f64,
    placed: Vec<Placed>,
    fit_seed: Option<u64>,
    floor_m: f64,
}

impl Source {
    /// Reads what is needed to place every image.
    ///
    /// # Errors
    /// [`ImportError`] with path, found, needed and remedy.
    pub fn open(options: &Options) -> Result<Self, ImportError> {
        let folder = &options.folder;
        if !(options.rate_hz > 0.0 && options.rate_hz <= 1000.0) {
            let needed = "more than 0, at most 1000 images a second";
            return Err(ImportError::Setting { option: "--rate", found: options.rate_hz, needed });
        }
        let images = files::images(folder)?;
        let intrinsics = options.intrinsics.map_or_else(|| files::intrinsics(folder), Ok)?;
        let standing = Placed { base: Pose2::ORIGIN, camera: Isometry::default() };
        let mut source = Self {
            placed: vec![standing; images.len()],
            images,
            intrinsics,
            metres_per_unit: options.metres_per_unit,
            rate_hz: options.rate_hz,
            fit_seed: None,
            floor_m: 0.0,
        };
        match options.placing {
            Placing::FloorFit { seed } => source.fit_seed = Some(seed),
            Placing::Poses { up, floor_m } => {
                let poses = files::poses(folder, source.images.len())?;
                let upright: Vec<Rigid> = poses.iter().map(|pose| turn_upright(up, pose)).collect();
                source.floor_m = floor_m.map_or_else(|| source.find_floor(&upright), Ok)?;
                source.placed = upright.iter().map(|pose| place(pose, source.floor_m)).collect();
            }
        }
        Ok(source)
    }

    /// The height that most points lie at, among those well below the camera.
    fn find_floor(&self, poses: &[Rigid]) -> Result<f64, ImportError> {
        let mut counts = std::collections::BTreeMap::<i64, u64>::new();
        let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
        let stride = self.images.len().div_ceil(FLOOR_IMAGES);
        for (image, pose) in self.images.iter().zip(poses).step_by(stride) {
            files::read_pixels(&image.path, &mut frame)?;
            let width = frame.width as usize;
            for (at, &pixel) in frame.used_pixels().iter().enumerate().step_by(7) {
                let z_m = f64::from(pixel) * f64::from(self.metres_per_unit);
                if pixel == u16::MAX || !(0.3..=4.0).contains(&z_m) {
                    continue;
                }
                let x = ((at % width) as f64 - self.intrinsics.cx_px) / self.intrinsics.fx_px;
                let y = ((at / width) as f64 - self.intrinsics.cy_px) / self.intrinsics.fy_px;
                let up = pose.rotation[2];
                let below_m = z_m * (up[0] * x + up[1] * y + up[2]);
                if below_m < -0.2 {
                    // Centimetres.
                    let height_m = pose.translation_m[2] + below_m;
                    *counts.entry(libm::floor(height_m * 100.0) as i64).or_default() += 1;
                }
            }
        }
        let around = |cm: i64| (cm - 2..=cm + 2).map(|cm| counts.get(&cm).copied().unwrap_or(0)).sum::<u64>();
        let most = counts.keys().map(|&cm| around(cm)).max().unwrap_or(0);
        // A table top may hold as many points as the floor; the floor is the lowest of the crowded heights.
        let floor = counts.keys().copied().filter(|&cm| 2 * around(cm) > most).collect::<Vec<_>>();
        let lowest = floor.iter().copied().take_while(|&cm| cm - floor[0] < 10).max_by_key(|&cm| around(cm));
        let centre_cm = lowest.ok_or_else(|| {
            let remedy = "give the height of the floor in the world of the poses";
            ImportError::content(&self.images[0].path, "no point below the camera", "a floor in view", remedy)
        })?;
        let near = || {
            (centre_cm - 2..=centre_cm + 2).filter_map(|cm| Some((cm as f64 + 0.5, *counts.get(&cm)? as f64)))
        };
        let (sum, weight) =
            near().fold((0.0, 0.0), |(sum, weight), (cm, count)| (sum + cm * count, weight + count));
        Ok(sum / weight / 100.0)
    }

    /// Number of images.
    #[must_use]
    pub fn len(&self) -> usize {
        self.images.len()
    }

    /// Whether there is no image; never true for a folder that was opened.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }

    /// `[m]` height of the floor in the world of the poses.
    #[must_use]
    pub fn floor_m(&self) -> f64 {
        self.floor_m
    }

    /// `[ns]` capture stamp of an image.
    #[must_use]
    pub fn capture_ns(&self, image: usize) -> u64 {
        FIRST_NS + (self.images[image].number as f64 / self.rate_hz * 1e9) as u64
    }

    /// Pose of base in odom at an image.
    #[must_use]
    pub fn base(&self, image: usize) -> Pose2 {
        self.placed[image].base
    }

    /// Fills a depth frame from an image; `false` where no floor was found to place it by.
    ///
    /// # Errors
    /// [`ImportError`] for a file that is no depth image.
    pub fn depth(&self, image: usize, frame: &mut DepthFrame) -> Result<bool, ImportError> {
        files::read_pixels(&self.images[image].path, frame)?;
        let k = &self.intrinsics;
        frame.capture_ns = self.capture_ns(image);
        frame.metres_per_unit = self.metres_per_unit;
        (frame.fx_px, frame.fy_px) = (k.fx_px as f32, k.fy_px as f32);
        (frame.cx_px, frame.cy_px) = (k.cx_px as f32, k.cy_px as f32);
        frame.capture_latency_s = 0.0;
        frame.camera = self.placed[image].camera;
        let Some(seed) = self.fit_seed else { return Ok(true) };
        let fitted = camera_over_floor(frame, k, seed);
        frame.camera = fitted.unwrap_or_default();
        Ok(fitted.is_some())
    }

    /// The odometry of the whole folder: 100 Hz, from the first image to shortly after the last.
    #[must_use]
    pub fn odometry(&self) -> Vec<Odometry> {
        let stamps: Vec<u64> = (0..self.len()).map(|image| self.capture_ns(image)).collect();
        let (Some(&first_ns), Some(&last_ns)) = (stamps.first(), stamps.last()) else { return Vec::new() };
        let mut after = 0;
        let mut made = Vec::new();
        for stamp_ns in
            (first_ns - first_ns % ODOMETRY_NS..=last_ns + 10 * ODOMETRY_NS).step_by(ODOMETRY_NS as usize)
        {
            while after + 1 < stamps.len() && stamps[after + 1] <= stamp_ns {
                after += 1;
            }
            made.push(self.odometry_at(stamp_ns, after, &stamps));
        }
        made
    }

    /// Between image `before` and the next.
    fn odometry_at(&self, stamp_ns: u64, before: usize, stamps: &[u64]) -> Odometry {
        let next = (before + 1).min(stamps.len() - 1);
        let (from, to) = (self.base(before), self.base(next));
        let span_ns = stamps[next].saturating_sub(stamps[before]);
        if span_ns == 0 {
            return Odometry {
                stamp_ns,
                pose: from,
                pose_epoch: self.epoch(stamps.len() - 1),
                ..Odometry::default()
            };
        }
        let part = stamp_ns.saturating_sub(stamps[before]) as f64 / span_ns as f64;
        let span_s = span_ns as f64 * 1e-9;
        let pose = from.interpolate(&to, part);
        let ahead_m = pose.relative(&to).x_m - pose.relative(&from).x_m;
        let turn_rad = wrap_angle(to.yaw_rad - from.yaw_rad);
        Odometry {
            stamp_ns,
            pose,
            twist: Twist::new((ahead_m / span_s) as f32, (turn_rad / span_s) as f32),
            // An epoch begins half way between its image and the one before.
            pose_epoch: self.epoch(if part < 0.5 { before } else { next }),
            ..Odometry::default()
        }
    }

    /// Pose epoch of an image: images without a pose have nothing to do with each other.
    fn epoch(&self, image: usize) -> u32 {
        if self.fit_seed.is_some() { image as u32 + 1 } else { 0 }
    }

    /// The way that the camera took, as a path to follow.
    pub fn path(&self, path: &mut Path) {
        way(self.placed.iter().map(|placed| placed.base), self.epoch(0), path);
    }
}

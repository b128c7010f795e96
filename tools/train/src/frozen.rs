//! The held-out data that every published figure is measured on: made anew anywhere, and checked by hash.

use crate::drives::DriveProfile;
use crate::error::TrainError;
use crate::generate::{DatasetOptions, Frames, dataset};
use crate::record::Header;
use sidestep_msgs::Robot;
use std::path::{Path, PathBuf};

/// One set of held-out data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrozenSet {
    /// Name of its file.
    pub name: &'static str,
    /// Seed, used by no training data.
    pub seed: u64,
    /// Records.
    pub samples: u64,
    /// `None` for made-up maps, else whether drives have bursts of random commands.
    pub bursts: Option<bool>,
    /// [`Header::content_hash`] for the built-in robot.
    pub content_hash: u64,
}

/// The sets, of worlds that no training sees. They change with whatever changes a map, a drive or a label; figures are
/// then measured again.
pub const FROZEN_SETS: [FrozenSet; 3] = [
    FrozenSet {
        name: "artificial.data",
        seed: 990_001,
        samples: 20_000,
        bursts: None,
        content_hash: 0x5d38_2167_46ea_8cd7,
    },
    FrozenSet {
        name: "robust.data",
        seed: 990_002,
        samples: 10_000,
        bursts: Some(true),
        content_hash: 0x7d11_cc7a_7efc_665f,
    },
    FrozenSet {
        name: "paper.data",
        seed: 990_003,
        samples: 10_000,
        bursts: Some(false),
        content_hash: 0x1011_c527_6eb5_522c,
    },
];

impl FrozenSet {
    /// Makes the first `samples` records of the set.
    ///
    /// # Errors
    /// [`TrainError`] where the file cannot be written.
    pub fn make(
        &self,
        folder: &Path,
        samples: u64,
        threads: usize,
        robot: &Robot,
        progress: &mut dyn FnMut(&str),
    ) -> Result<Header, TrainError> {
        let drives = |bursts| Frames::Drives(DriveProfile { bursts, ..DriveProfile::default() });
        let options = DatasetOptions {
            out: folder.join(self.name),
            frames: self.bursts.map_or(Frames::Artificial, drives),
            samples,
            seed: self.seed,
            threads,
            robot: robot.clone(),
        };
        dataset(&options, progress)
    }
}

/// Makes all sets in a folder and checks their hashes; returns their files.
///
/// # Errors
/// [`TrainError::Frozen`] where a set is not the one that figures were measured on, [`TrainError::File`] where one
/// cannot be written.
pub fn frozen_sets(
    folder: &Path,
    threads: usize,
    robot: &Robot,
    progress: &mut dyn FnMut(&str),
) -> Result<Vec<PathBuf>, TrainError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| TrainError::File { path: folder.display().to_string(), source })?;
    let make = |set: &FrozenSet| {
        let header = set.make(folder, set.samples, threads, robot, progress)?;
        let path = folder.join(set.name);
        if header.content_hash == set.content_hash {
            return Ok(path);
        }
        Err(TrainError::Frozen {
            path: path.display().to_string(),
            found: header.content_hash,
            needed: set.content_hash,
        })
    };
    FROZEN_SETS.iter().map(make).collect()
}

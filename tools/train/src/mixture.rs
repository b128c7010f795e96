//! Several dataset files as one, with the records that training leaves out.

use crate::error::TrainError;
use crate::random::Random;
use crate::record::{Dataset, Record};
use sidestep_msgs::Robot;
use std::path::PathBuf;

/// One record in so many is left out of training, wherever it comes from: the random split of Table I.
const HELD_OUT: usize = 20;
const HELD_OUT_STREAM: u64 = 0x4845_4c44_0000_0000;

/// Dataset files, one after the other.
#[derive(Debug)]
pub struct Mixture {
    files: Vec<Dataset>,
    count: u64,
}

impl Mixture {
    /// Opens the files of a robot.
    ///
    /// # Errors
    /// [`TrainError`] where there is none, one is no dataset, or its labels are for another robot.
    pub fn open(paths: &[PathBuf], robot: &Robot) -> Result<Self, TrainError> {
        let files = paths.iter().map(|path| Dataset::open(path)).collect::<Result<Vec<_>, _>>()?;
        files.iter().try_for_each(|file| file.require(robot))?;
        let count = files.iter().map(|file| file.header().count).sum();
        if count == 0 || count > u64::from(u32::MAX) {
            return Err(TrainError::Option {
                option: "data",
                found: format!("{count} records"),
                needed: "1 to 4294967295",
            });
        }
        Ok(Self { files, count })
    }

    /// Records of all files.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Record `index` of all.
    ///
    /// # Errors
    /// [`TrainError::File`] beyond the end or where the disk fails.
    pub fn read(&self, index: u64) -> Result<Record, TrainError> {
        let (file, own) = self.place(index);
        file.read(own)
    }

    /// Whether training leaves record `index` out: a property of the place in its file, whatever else is mixed in.
    #[must_use]
    pub fn is_held_out(&self, index: u64) -> bool {
        let (file, own) = self.place(index);
        Random::new(file.header().seed, HELD_OUT_STREAM + own).below(HELD_OUT) == 0
    }

    /// The file of a record and its number there.
    fn place(&self, mut index: u64) -> (&Dataset, u64) {
        let mut current = &self.files[0];
        for file in &self.files {
            current = file;
            if index < file.header().count {
                break;
            }
            index -= file.header().count;
        }
        (current, index)
    }

    /// The files.
    #[must_use]
    pub fn files(&self) -> &[Dataset] {
        &self.files
    }

    /// Fingerprint of all records: that of the file where there is one.
    #[must_use]
    pub fn content_hash(&self) -> u64 {
        let hashes = self.files.iter().map(|file| file.header().content_hash);
        hashes.reduce(|all, own| (all.rotate_left(5) ^ own).wrapping_mul(0x9e37_79b9_7f4a_7c15)).unwrap_or(0)
    }
}

//! The dataset file: a header of one page, then records of one size, ready to be mapped into memory.
//!
//! | bytes | what |
//! |---|---|
//! | 0..64 | [`Header`], little-endian |
//! | 64..4096 | zero |
//! | 4096.. | `count` times [`Record`], little-endian, 848 bytes each |
//!
//! Nothing in the file depends on the number of threads that made it.

use crate::error::TrainError;
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE, Robot, Twist};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// First bytes of the file.
pub const MAGIC: [u8; 8] = *b"SIDEDATA";
/// Version of the layout.
pub const VERSION: u32 = 1;
/// Where the records begin: one page.
pub const RECORDS_AT: u64 = 4096;

/// Added to the kind of a record where parts of its map are unknown.
pub const PARTLY_UNKNOWN: u8 = 128;

/// What a dataset says of itself.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`VERSION`].
    pub version: u32,
    /// Bytes of a record.
    pub record_bytes: u32,
    /// Records.
    pub count: u64,
    /// Seed of the random numbers; of a drive, the number of its run.
    pub seed: u64,
    /// [`Robot::motion_hash`] of the robot that the labels are for.
    pub motion_hash: u64,
    /// Fingerprint of all records.
    pub content_hash: u64,
    /// Records by [`Source`]: artificial, demonstration.
    pub by_source: [u64; 2],
}

/// Where a record comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Source {
    /// A made-up map (paper section III-E).
    Artificial = 0,
    /// A frame of a drive.
    Demonstration = 1,
}

/// One sample: what the policy sees, and what the expert would do.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Record {
    /// `[1/255]` planning cost, row by row, as `LocalMap` has it.
    pub planning_cost: [u8; LOCAL_CELLS],
    /// Cell of the goal, projected to the border where it lies outside.
    pub goal_cell: u16,
    /// [`Source`].
    pub source: u8,
    /// Kind of world: 0 clusters, 1 corridor, 2 door, 3 close wall, drawn; 4 a recording; 8 an office, 9 a corridor, 10 a
    /// room, 11 a named world, driven through; plus [`PARTLY_UNKNOWN`].
    pub kind: u8,
    /// World that the record was taken in, for splits by world: its own number for an artificial map, that of the drive
    /// for a demonstration, the low half of the run's number for a recording.
    pub world: u32,
    /// `[m]` goal before projection, x in `base`.
    pub goal_x_m: f32,
    /// `[m]` goal before projection, y in `base`.
    pub goal_y_m: f32,
    /// u', v [m/s] and w [rad/s].
    pub velocity: [f32; 2],
    /// Best of 734 candidates: v [m/s] and w [rad/s], before any window.
    pub label_734: [f32; 2],
    /// `[1]` its J of eq. (6).
    pub cost_734: f32,
    /// Solved: v [m/s] and w [rad/s], before any window.
    pub label_solved: [f32; 2],
    /// `[1]` its J of eq. (6).
    pub cost_solved: f32,
    /// Seed of this sample within the dataset's seed; of a drive, its source frame.
    pub stream: u64,
    /// Zero.
    pub reserved: [u8; 8],
}

const _: () = assert!(size_of::<Header>() == 64 && size_of::<Record>() == 848);

impl Record {
    /// u' as a twist.
    #[must_use]
    pub fn twist(&self) -> Twist {
        Twist::new(self.velocity[0], self.velocity[1])
    }

    /// Left and right exchanged; the expert's answer is exactly symmetric.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let mut mirror = *self;
        for row in mirror.planning_cost.chunks_exact_mut(LOCAL_SIDE) {
            row.reverse();
        }
        let (row, col) = (self.goal_cell as usize / LOCAL_SIDE, self.goal_cell as usize % LOCAL_SIDE);
        mirror.goal_cell = (row * LOCAL_SIDE + LOCAL_SIDE - 1 - col) as u16;
        mirror.goal_y_m = -mirror.goal_y_m;
        for pair in [&mut mirror.velocity, &mut mirror.label_734, &mut mirror.label_solved] {
            pair[1] = -pair[1];
        }
        mirror
    }
}

/// A dataset opened for reading.
#[derive(Debug)]
pub struct Dataset {
    file: File,
    header: Header,
    path: String,
}

impl Dataset {
    /// Opens a file and checks header and length.
    ///
    /// # Errors
    /// [`TrainError`] with path and remedy.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|source| TrainError::File { path: name.clone(), source })?;
        let mut bytes = [0; size_of::<Header>()];
        file.read_exact_at(&mut bytes, 0)
            .map_err(|source| TrainError::File { path: name.clone(), source })?;
        let header: Header = bytemuck::pod_read_unaligned(&bytes);
        let unfit = |found: String, needed: String| TrainError::Dataset { path: name.clone(), found, needed };
        if header.magic != MAGIC || header.version != VERSION {
            let needed = format!("{VERSION} of {}", String::from_utf8_lossy(&MAGIC));
            return Err(unfit(format!("version {} of {:?}", header.version, header.magic), needed));
        }
        if header.record_bytes as usize != size_of::<Record>() {
            return Err(unfit(
                format!("records of {} bytes", header.record_bytes),
                format!("{} bytes", size_of::<Record>()),
            ));
        }
        let length = file.metadata().map_err(|source| TrainError::File { path: name.clone(), source })?.len();
        let needed = header.count.saturating_mul(size_of::<Record>() as u64).saturating_add(RECORDS_AT);
        if length != needed || header.count == 0 {
            return Err(unfit(
                format!("{length} bytes"),
                format!("{needed} bytes for {} records", header.count),
            ));
        }
        Ok(Self { file, header, path: name })
    }

    /// What the file says of itself.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Refuses labels for a robot of other limits or footprint.
    ///
    /// # Errors
    /// [`TrainError::Dataset`] with both hashes.
    pub fn require(&self, robot: &Robot) -> Result<(), TrainError> {
        if self.header.motion_hash == robot.motion_hash() {
            return Ok(());
        }
        Err(TrainError::Dataset {
            path: self.path.clone(),
            found: format!("labels for a robot of motion hash {:016x}", self.header.motion_hash),
            needed: format!("{:016x} ({})", robot.motion_hash(), robot.name),
        })
    }

    /// Record `index`.
    ///
    /// # Errors
    /// [`TrainError::File`] beyond the end or where the disk fails.
    pub fn read(&self, index: u64) -> Result<Record, TrainError> {
        let mut bytes = [0; size_of::<Record>()];
        self.file
            .read_exact_at(&mut bytes, RECORDS_AT + index * size_of::<Record>() as u64)
            .map_err(|source| TrainError::File { path: self.path.clone(), source })?;
        let mut record: Record = bytemuck::pod_read_unaligned(&bytes);
        record.goal_cell = record.goal_cell.min(LOCAL_CELLS as u16 - 1);
        Ok(record)
    }
}

/// A dataset being written; the header comes last, so that an unfinished file is refused.
#[derive(Debug)]
pub(crate) struct DatasetWriter {
    out: BufWriter<File>,
    header: Header,
    path: String,
}

impl DatasetWriter {
    pub(crate) fn create(path: &Path, seed: u64, motion_hash: u64) -> Result<Self, TrainError> {
        let file = File::create(path)
            .map_err(|source| TrainError::File { path: path.display().to_string(), source })?;
        Self::begin(file, path, seed, motion_hash)
    }

    /// As [`DatasetWriter::create`], where no file of this name exists yet.
    pub(crate) fn create_fresh(path: &Path, seed: u64, motion_hash: u64) -> Result<Self, TrainError> {
        let name = path.display().to_string();
        let file = File::create_new(path).map_err(|source| match source.kind() {
            std::io::ErrorKind::AlreadyExists => TrainError::Exists { path: name.clone() },
            _ => TrainError::File { path: name.clone(), source },
        })?;
        Self::begin(file, path, seed, motion_hash)
    }

    fn begin(file: File, path: &Path, seed: u64, motion_hash: u64) -> Result<Self, TrainError> {
        let name = path.display().to_string();
        let mut out = BufWriter::with_capacity(1 << 20, file);
        out.write_all(&[0; RECORDS_AT as usize])
            .map_err(|source| TrainError::File { path: name.clone(), source })?;
        let record_bytes = size_of::<Record>() as u32;
        let content_hash = sidestep_policy::fingerprint(&[]);
        let header = Header {
            magic: MAGIC,
            version: VERSION,
            record_bytes,
            seed,
            motion_hash,
            content_hash,
            ..Header::zeroed()
        };
        Ok(Self { out, header, path: name })
    }

    pub(crate) fn append(&mut self, records: &[Record]) -> Result<(), TrainError> {
        let failed = |source| TrainError::File { path: self.path.clone(), source };
        for record in records {
            let own = sidestep_policy::fingerprint(bytemuck::bytes_of(record));
            self.header.content_hash =
                (self.header.content_hash.rotate_left(5) ^ own).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            self.header.by_source[usize::from(record.source.min(1))] += 1;
            self.header.count += 1;
        }
        self.out.write_all(bytemuck::cast_slice(records)).map_err(failed)
    }

    pub(crate) fn finish(self) -> Result<Header, TrainError> {
        let failed = |source| TrainError::File { path: self.path.clone(), source };
        let file = self.out.into_inner().map_err(|error| failed(error.into_error()))?;
        file.write_all_at(bytemuck::bytes_of(&self.header), 0).map_err(failed)?;
        file.sync_all().map_err(failed)?;
        Ok(self.header)
    }
}

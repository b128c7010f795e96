//! A folder of depth images into a recording that the player plays as if a driver had been there.

use crate::error::ImportError;
use crate::source::{Options, Source};
use sidestep_msgs::{DEPTH, DepthFrame, Header, Message, ODOMETRY, PATH, Path, SCAN, TOPICS, Topic};
use sidestep_recorder::{DiskFile, Origin, RecordError, Writer};
use std::path::PathBuf;

/// `[ns]` from exposure to the arrival of an image: later odometry is there when the image is mapped.
pub const DEPTH_DELAY_NS: u64 = 20_000_000;

/// What an import made.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The recording.
    pub path: PathBuf,
    /// Images in it.
    pub images: usize,
    /// Images left out because no floor was found to place them by.
    pub unplaced: usize,
    /// `[s]` from the first image to the last.
    pub duration_s: f64,
    /// `[m]` way of the camera.
    pub distance_m: f64,
}

/// Writes messages as the driver that they came from would have sent them: numbered per topic.
#[derive(Debug)]
pub struct Sender {
    writer: Writer<DiskFile>,
    sequences: Vec<u64>,
}

impl Sender {
    /// Begins a recording that says what it was imported from.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made.
    pub fn create(
        path: &std::path::Path,
        imported: String,
        mono_to_wall_ns: i64,
    ) -> Result<Self, RecordError> {
        let origin = Origin {
            mono_to_wall_ns,
            metadata: vec![
                ("version".into(), env!("CARGO_PKG_VERSION").into()),
                ("imported".into(), imported),
            ],
            flush_period_ns: 1_000_000_000,
            ..Origin::default()
        };
        Ok(Self { writer: Writer::create(path, &origin)?, sequences: vec![0; TOPICS.len()] })
    }

    /// Writes a message that arrived at graph time `now_ns`; depth and scan number the frames.
    ///
    /// # Errors
    /// [`RecordError`] where the file does not take it.
    pub fn send<M: Message>(&mut self, topic: Topic<M>, now_ns: u64, message: &M) -> Result<(), RecordError> {
        self.sequences[topic.index] += 1;
        let sequence = self.sequences[topic.index];
        let is_frame = topic.index == DEPTH.index || topic.index == SCAN.index;
        let source_frame = if is_frame { sequence } else { 0 };
        let header = Header { sequence, source_frame, now_ns, ..Header::default() };
        self.writer.write(topic.row(), &header, bytemuck::bytes_of(message), now_ns)
    }

    /// Ends the recording and returns its name.
    ///
    /// # Errors
    /// [`RecordError`]; what was written stays in the file whose name ends in `.active`.
    pub fn complete(self) -> Result<PathBuf, RecordError> {
        self.writer.complete(&[])
    }
}

/// Imports a folder into a recording at `path`.
///
/// # Errors
/// [`ImportError`] with path, found, needed and remedy.
pub fn import_folder(options: &Options, path: &std::path::Path) -> Result<Summary, ImportError> {
    let source = Source::open(options)?;
    let mut sender = Sender::create(path, options.folder.display().to_string(), 0)?;
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let mut way = Box::new(Path::default());
    source.path(&mut way);
    let (mut image, mut unplaced) = (0, 0);
    for (place, odometry) in source.odometry().iter().enumerate() {
        if place == 0 {
            sender.send(PATH, odometry.stamp_ns, &*way)?;
        }
        sender.send(ODOMETRY, odometry.stamp_ns, odometry)?;
        while image < source.len() && source.capture_ns(image) + DEPTH_DELAY_NS <= odometry.stamp_ns {
            if source.depth(image, &mut frame)? {
                sender.send(DEPTH, frame.capture_ns + DEPTH_DELAY_NS, &*frame)?;
            } else {
                unplaced += 1;
            }
            image += 1;
        }
    }
    let path = sender.complete()?;
    let last = source.len() - 1;
    let steps = (0..last).map(|image| source.base(image).distance_m(&source.base(image + 1)));
    Ok(Summary {
        path,
        images: source.len() - unplaced,
        unplaced,
        duration_s: source.capture_ns(last).saturating_sub(source.capture_ns(0)) as f64 * 1e-9,
        distance_m: steps.sum(),
    })
}

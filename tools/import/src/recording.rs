//! A folder of depth images into a recording that the player plays as if a driver had been there.

use crate::error::ImportError;
use crate::source::{Options, Source};
use sidestep_msgs::{DEPTH, DepthFrame, Header, Message, ODOMETRY, PATH, Path, Topic};
use sidestep_recorder::{DiskFile, Origin, Writer};
use std::path::PathBuf;

/// `[ns]` from exposure to the arrival of an image: later odometry is there when the image is mapped.
const DEPTH_DELAY_NS: u64 = 20_000_000;

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

struct Sender {
    writer: Writer<DiskFile>,
    sequences: [u64; 3],
}

impl Sender {
    fn send<M: Message>(
        &mut self,
        (place, topic): (usize, Topic<M>),
        now_ns: u64,
        message: &M,
    ) -> Result<(), ImportError> {
        self.sequences[place] += 1;
        let sequence = self.sequences[place];
        let source_frame = if topic.index == DEPTH.index { sequence } else { 0 };
        let header = Header { sequence, source_frame, now_ns, ..Header::default() };
        Ok(self.writer.write(topic.row(), &header, bytemuck::bytes_of(message), now_ns)?)
    }
}

/// Imports a folder into a recording at `path`.
///
/// # Errors
/// [`ImportError`] with path, found, needed and remedy.
pub fn import_folder(options: &Options, path: &std::path::Path) -> Result<Summary, ImportError> {
    let source = Source::open(options)?;
    let origin = Origin {
        metadata: vec![
            ("version".into(), env!("CARGO_PKG_VERSION").into()),
            ("imported".into(), options.folder.display().to_string()),
        ],
        flush_period_ns: 1_000_000_000,
        ..Origin::default()
    };
    let mut sender = Sender { writer: Writer::create(path, &origin)?, sequences: [0; 3] };
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    let mut way = Box::new(Path::default());
    source.path(&mut way);
    let (mut image, mut unplaced) = (0, 0);
    for (place, odometry) in source.odometry().iter().enumerate() {
        if place == 0 {
            sender.send((0, PATH), odometry.stamp_ns, &*way)?;
        }
        sender.send((1, ODOMETRY), odometry.stamp_ns, odometry)?;
        while image < source.len() && source.capture_ns(image) + DEPTH_DELAY_NS <= odometry.stamp_ns {
            if source.depth(image, &mut frame)? {
                sender.send((2, DEPTH), frame.capture_ns + DEPTH_DELAY_NS, &*frame)?;
            } else {
                unplaced += 1;
            }
            image += 1;
        }
    }
    let path = sender.writer.complete(&[])?;
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

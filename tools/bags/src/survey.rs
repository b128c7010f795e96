//! The first look through a bag: which topics there are, what their first messages say, which frames hang together.

use crate::cdr::{CdrError, decode};
use crate::error::BagError;
use crate::listing;
use crate::messages::{CameraInfo, CompressedImage, Header, Image, LaserScan, Odometry, TransformMessage};
use crate::tree::{Tree, frame};
use serde::Deserialize;
use sidestep_player::{ForeignChannel, ForeignMessage, read_foreign};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The messages that an import can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Image,
    CompressedImage,
    CameraInfo,
    Odometry,
    Transforms,
    LaserScan,
    Other,
}

impl Kind {
    /// From the name of a schema, with or without its middle part.
    fn of(schema: &str) -> Self {
        match schema.replace("/msg/", "/").as_str() {
            "sensor_msgs/Image" => Self::Image,
            "sensor_msgs/CompressedImage" => Self::CompressedImage,
            "sensor_msgs/CameraInfo" => Self::CameraInfo,
            "nav_msgs/Odometry" => Self::Odometry,
            "tf2_msgs/TFMessage" => Self::Transforms,
            "sensor_msgs/LaserScan" => Self::LaserScan,
            _ => Self::Other,
        }
    }
}

/// A topic, and what its first message says.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    pub(crate) kind: Kind,
    pub(crate) schema: String,
    /// Encoding of the messages.
    pub(crate) encoding: String,
    pub(crate) count: u64,
    /// Frame of the header, without a leading slash.
    pub(crate) frame: String,
    /// Encoding of an image, format of a compressed one, child frame of an odometry.
    pub(crate) detail: String,
    /// Columns and rows, where the message says them.
    pub(crate) size: (u32, u32),
    pub(crate) camera: Option<CameraInfo>,
    /// Why the first message cannot be read.
    pub(crate) fault: Option<CdrError>,
}

/// What a bag holds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Survey {
    pub(crate) path: PathBuf,
    pub(crate) files: Vec<PathBuf>,
    pub(crate) topics: BTreeMap<String, Seen>,
    pub(crate) tree: Tree,
    /// Where and why files end early.
    pub(crate) damage: Vec<String>,
}

/// The first part of every stamped message.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Stamped {
    pub(crate) header: Header,
}

impl Survey {
    /// Reads all messages once.
    pub(crate) fn of(source: &Path) -> Result<Self, BagError> {
        let files = listing::files(source)?;
        let mut survey = Self { path: source.to_path_buf(), files, ..Self::default() };
        for file in survey.files.clone() {
            let end = read_foreign(&file, |channel, message| {
                survey.message(channel, message);
                Ok::<(), BagError>(())
            })?;
            survey.damage.extend(end.damage.map(|damage| format!("{}: {damage}", file.display())));
            for channel in &end.channels {
                survey.topic(channel);
            }
        }
        Ok(survey)
    }

    fn topic(&mut self, channel: &ForeignChannel) -> &mut Seen {
        self.topics.entry(channel.topic.clone()).or_insert_with(|| Seen {
            kind: Kind::of(&channel.schema),
            schema: channel.schema.clone(),
            encoding: channel.encoding.clone(),
            count: 0,
            frame: String::new(),
            detail: String::new(),
            size: (0, 0),
            camera: None,
            fault: None,
        })
    }

    fn message(&mut self, channel: &ForeignChannel, message: ForeignMessage) {
        let seen = self.topic(channel);
        seen.count += 1;
        if seen.encoding != "cdr" {
            return;
        }
        if seen.kind == Kind::Transforms {
            match decode::<TransformMessage>(message.data) {
                Ok(transforms) => self.tree.learn(&transforms),
                Err(fault) => seen.fault = seen.fault.take().or(Some(fault)),
            }
        } else if seen.count == 1 {
            seen.fault = seen.first(message.data).err();
        }
    }

    /// Topics of a kind that hold messages.
    pub(crate) fn of_kind(&self, kind: Kind) -> impl Iterator<Item = (&str, &Seen)> {
        let fits = move |(_, seen): &(&String, &Seen)| seen.kind == kind && seen.count > 0;
        self.topics.iter().filter(fits).map(|(name, seen)| (name.as_str(), seen))
    }

    /// All topics with their types, for a person.
    pub(crate) fn text(&self) -> String {
        let describe = |(name, seen): (&String, &Seen)| {
            let encoding =
                if seen.encoding == "cdr" { String::new() } else { format!(" [{}]", seen.encoding) };
            let detail = if seen.detail.is_empty() { String::new() } else { format!(" {}", seen.detail) };
            format!("{name} ({}{detail}{encoding}, {} messages)", seen.schema, seen.count)
        };
        let topics: Vec<String> = self.topics.iter().map(describe).collect();
        if topics.is_empty() { "no topic at all".into() } else { topics.join(", ") }
    }

    /// Refuses a topic whose messages cannot be read.
    pub(crate) fn check(&self, name: &str, seen: &Seen) -> Result<(), BagError> {
        if seen.encoding != "cdr" {
            let found = format!("{name} with message encoding {:?}", seen.encoding);
            let remedy = "record or convert it with rosbag2, which writes cdr (`ros2 bag convert`)";
            return Err(BagError::content(&self.path, found, "message encoding \"cdr\"", remedy));
        }
        let Some(fault) = &seen.fault else { return Ok(()) };
        let remedy = match fault {
            CdrError::Xcdr2(_) => {
                "record it again with a middleware that writes plain CDR (XCDR1): Fast DDS or Cyclone DDS as shipped \
                 with ROS 2, without an XCDR2 data representation in the QoS"
            }
            _ => "look at the topic with `ros2 bag info`; its type and its bytes do not agree",
        };
        let found = format!("{name} ({}) with {fault}", seen.schema);
        Err(BagError::content(&self.path, found, "plain CDR of this type", remedy))
    }
}

impl Seen {
    /// Keeps what the first message says.
    fn first(&mut self, data: &[u8]) -> Result<(), CdrError> {
        let header = match self.kind {
            Kind::Image => {
                let image: Image = decode(data)?;
                self.detail = image.encoding;
                self.size = (image.width, image.height);
                image.header
            }
            Kind::CompressedImage => {
                let image: CompressedImage = decode(data)?;
                self.detail = image.format;
                image.header
            }
            Kind::CameraInfo => {
                let info: CameraInfo = decode(data)?;
                self.size = (info.width, info.height);
                let header = info.header.clone();
                self.camera = Some(info);
                header
            }
            Kind::Odometry => {
                let odometry: Odometry = decode(data)?;
                self.detail = frame(&odometry.child_frame_id).to_owned();
                odometry.header
            }
            Kind::LaserScan => decode::<LaserScan>(data)?.header,
            Kind::Transforms | Kind::Other => return Ok(()),
        };
        self.frame = frame(&header.frame_id).to_owned();
        Ok(())
    }
}

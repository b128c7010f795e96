//! Channels of a recording back into topics, records back into messages.

use crate::error::PlayerError;
use crate::selection::Renamed;
use foxglove::messages::RawImage;
use mcap::records::{Channel, MessageHeader};
use prost::Message as _;
use sidestep_msgs::{
    DEPTH, DEPTH_REST_BYTES, Header, LAYOUT_HASH_KEY, Message, RAW_ENCODING, Topic, TopicRow, topic_named,
};
use std::collections::BTreeMap;
use std::path::Path;

/// What the channel of the rest of a depth frame has after the name of its image's channel.
const REST_SUFFIX: &str = "/raw";
const HEADER_BYTES: usize = size_of::<Header>();

/// One message of a recording, byte for byte as it was in shared memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Its topic.
    pub topic: usize,
    /// Its header.
    pub header: Header,
    /// Its bytes.
    pub message: Vec<u8>,
    /// `[ns]` wall time at which the recorder received it.
    pub logged_ns: u64,
}

impl Entry {
    /// The row of its topic.
    #[must_use]
    pub fn row(&self) -> &'static TopicRow {
        &sidestep_msgs::TOPICS[self.topic]
    }

    /// The message, if it is of this topic.
    #[must_use]
    pub fn read<M: Message>(&self, topic: Topic<M>) -> Option<M> {
        (topic.index == self.topic).then(|| bytemuck::pod_read_unaligned(&self.message))
    }

    /// Copies the message into `place`, if it is of this topic; for messages too large for the stack.
    pub fn read_into<M: Message>(&self, topic: Topic<M>, place: &mut M) -> bool {
        let same = topic.index == self.topic;
        if same {
            bytemuck::bytes_of_mut(place).copy_from_slice(&self.message);
        }
        same
    }
}

/// What a channel carries.
#[derive(Clone, Copy)]
enum Carries {
    Topic(&'static TopicRow),
    DepthImage,
    DepthRest,
    Other,
}

/// Joins records to messages.
#[derive(Default)]
pub(crate) struct Decoder {
    renamed: Renamed,
    channels: BTreeMap<u16, Carries>,
    /// Sequence and pixels of the newest image whose rest has not come yet.
    image: Option<(u32, Vec<u8>)>,
}

impl Decoder {
    /// A decoder for which some channels have other names.
    pub(crate) fn renaming(renamed: Renamed) -> Self {
        Self { renamed, ..Self::default() }
    }

    /// The topic that a channel carries, and whether it carries only the rest of a depth frame; `None` where another
    /// channel took that topic's name.
    fn topic<'a>(&self, channel: &'a str) -> Option<(&'a str, bool)> {
        if let Some(base) = channel.strip_suffix(REST_SUFFIX)
            && self.renamed.name(base).is_none_or(|name| name == DEPTH.row().name)
        {
            return self.renamed.name(base).map(|name| (name, true));
        }
        self.renamed.name(channel).map(|name| (name, false))
    }

    /// Learns a channel.
    pub(crate) fn channel(&mut self, channel: &Channel, path: &Path) -> Result<(), PlayerError> {
        let Some((name, is_depth)) = self.topic(&channel.topic) else {
            self.channels.insert(channel.id, Carries::Other);
            return Ok(());
        };
        let carries = if channel.message_encoding == RAW_ENCODING {
            let row = topic_named(name);
            let needed = row.map_or("no such topic".into(), |row| format!("{:016x}", row.layout_hash));
            let found = channel.metadata.get(LAYOUT_HASH_KEY).cloned().unwrap_or_default();
            match row {
                Some(_) if is_depth && found == needed => Carries::DepthRest,
                Some(row) if found == needed => Carries::Topic(row),
                _ => {
                    let (path, topic) = (path.to_path_buf(), channel.topic.clone());
                    return Err(PlayerError::Layout { path, topic, found, needed });
                }
            }
        } else if name == DEPTH.row().name && channel.message_encoding == "protobuf" {
            Carries::DepthImage
        } else {
            Carries::Other
        };
        self.channels.insert(channel.id, carries);
        Ok(())
    }

    /// Whether any channel so far is a topic of the table.
    pub(crate) fn knows_a_topic(&self) -> bool {
        self.channels.values().any(|carries| matches!(carries, Carries::Topic(_) | Carries::DepthRest))
    }

    /// The message that this record completes, if it completes one.
    pub(crate) fn message(
        &mut self,
        stamps: &MessageHeader,
        data: &[u8],
        path: &Path,
    ) -> Result<Option<Entry>, PlayerError> {
        match self.channels.get(&stamps.channel_id) {
            Some(Carries::Topic(row)) => {
                let [header, message] = parts(row, data, row.size, path)?;
                Ok(Some(entry(row, header, message.to_vec(), stamps)))
            }
            Some(Carries::DepthImage) => {
                self.image = Some((stamps.sequence, pixels(data, path)?));
                Ok(None)
            }
            Some(Carries::DepthRest) => {
                let row = DEPTH.row();
                let [header, rest] = parts(row, data, DEPTH_REST_BYTES, path)?;
                // Without its image, as where a file was cut between the two, the frame is not whole.
                let image = self.image.take().filter(|(sequence, _)| *sequence == stamps.sequence);
                let Some((_, pixels)) = image else { return Ok(None) };
                let mut message = vec![0; row.size];
                message[..DEPTH_REST_BYTES].copy_from_slice(rest);
                message[DEPTH_REST_BYTES..][..pixels.len()].copy_from_slice(&pixels);
                Ok(Some(entry(row, header, message, stamps)))
            }
            Some(Carries::Other) | None => Ok(None),
        }
    }
}

/// Header and message of a record.
fn parts<'a>(
    row: &TopicRow,
    data: &'a [u8],
    message_bytes: usize,
    path: &Path,
) -> Result<[&'a [u8]; 2], PlayerError> {
    let needed = HEADER_BYTES + message_bytes;
    if data.len() != needed {
        let detail = format!("a record of {} has {} bytes, needed {needed}", row.name, data.len());
        return Err(PlayerError::damaged(path, detail));
    }
    let (header, message) = data.split_at(HEADER_BYTES);
    Ok([header, message])
}

fn entry(row: &TopicRow, header: &[u8], message: Vec<u8>, stamps: &MessageHeader) -> Entry {
    let header = bytemuck::pod_read_unaligned(header);
    Entry { topic: row.index, header, message, logged_ns: stamps.log_time }
}

fn pixels(data: &[u8], path: &Path) -> Result<Vec<u8>, PlayerError> {
    let image = RawImage::decode(data).map_err(|error| {
        PlayerError::damaged(path, format!("an image of depth cannot be decoded: {error}"))
    })?;
    let room = DEPTH.row().size - DEPTH_REST_BYTES;
    let needed = 2 * u128::from(image.width) * u128::from(image.height);
    if image.encoding != "16UC1" || image.data.len() as u128 != needed || image.data.len() > room {
        let (width, height, bytes) = (image.width, image.height, image.data.len());
        let detail = format!(
            "an image of depth is {width} x {height} {} in {bytes} bytes, needed 16UC1 of at most 640 x 480",
            image.encoding
        );
        return Err(PlayerError::damaged(path, detail));
    }
    Ok(image.data.to_vec())
}

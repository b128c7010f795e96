//! Messages into MCAP: the one place that knows the writing half of the file format.

use crate::error::RecordError;
use crate::layout::layout_text;
use crate::view::{VIEW_CHANNELS, View, ViewChannel, ViewSettings, depth_image_schema};
use mcap::records::MessageHeader;
use mcap::write::{Metadata, NoSeek};
use sidestep_msgs::{
    DEPTH, DEPTH_REST_BYTES, DEPTH_REST_CHANNEL, Header, LAYOUT_ENCODING, LAYOUT_HASH_KEY, LOST_RECORD,
    MONO_TO_WALL_KEY, Message, ORIGIN_RECORD, RAW_ENCODING, TOPICS, Topic, TopicRow, TopicVisitor,
    visit_topics,
};
use std::collections::BTreeMap;
use std::io::Write;

/// `[byte]` a chunk is closed when it is larger than this.
const CHUNK_BYTES: u64 = 1 << 20;
const LIBRARY: &str = concat!("sidestep/", env!("CARGO_PKG_VERSION"));

/// Chunks are compressed, and complete in memory before they reach the stream.
pub(crate) fn whole_chunks() -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Lz4))
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
}

/// What a recording says of where it comes from.
#[derive(Debug, Clone, Default)]
pub struct Origin {
    /// `[ns]` to add to host time (CLOCK_MONOTONIC) for wall time; times in the file are wall time.
    pub mono_to_wall_ns: i64,
    /// Names and values: version, run, kernel class, model hash and the like.
    pub metadata: Vec<(String, String)>,
    /// Names and bytes: robot file, graph file, resolved parameters, a model that is not the embedded one.
    pub attachments: Vec<(String, Vec<u8>)>,
    /// `[ns]` a chunk is closed and handed to the system at least this often: what a kill can lose.
    pub flush_period_ns: u64,
    /// What the recording shows to viewers beside the raw messages.
    pub view: ViewSettings,
}

/// Writes messages into an MCAP stream.
///
/// Chunks are complete in memory before they reach the stream, so that a stream cut anywhere is readable up to its
/// last whole chunk.
pub struct Writer<W: Write> {
    mcap: mcap::Writer<NoSeek<W>>,
    name: String,
    channels: Vec<u16>,
    image_channel: u16,
    view: View,
    view_channels: Vec<u16>,
    mono_to_wall_ns: i64,
    flush_period_ns: u64,
    flushed_ns: Option<u64>,
    scratch: Vec<u8>,
    written: u64,
}

impl<W: Write> std::fmt::Debug for Writer<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("name", &self.name).field("written", &self.written).finish()
    }
}

/// Adds one channel per topic.
struct Channels<'a, W: Write> {
    mcap: &'a mut mcap::Writer<NoSeek<W>>,
    ids: Vec<u16>,
}

impl<W: Write> TopicVisitor for Channels<'_, W> {
    type Error = mcap::McapError;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), mcap::McapError> {
        let row = topic.row();
        let is_depth = row.index == DEPTH.index;
        let (channel, bytes) =
            if is_depth { (DEPTH_REST_CHANNEL, DEPTH_REST_BYTES) } else { (row.name, row.size) };
        let schema = self.mcap.add_schema(M::NAME, LAYOUT_ENCODING, layout_text::<M>(bytes).as_bytes())?;
        let metadata = BTreeMap::from([
            (LAYOUT_HASH_KEY.into(), format!("{:016x}", M::LAYOUT_HASH)),
            ("header_hash".into(), format!("{:016x}", Header::LAYOUT_HASH)),
            ("writer".into(), row.writer.into()),
        ]);
        self.ids.push(self.mcap.add_channel(schema, channel, RAW_ENCODING, &metadata)?);
        Ok(())
    }
}

impl<W: Write> Writer<W> {
    /// Begins a recording: channels, origin and attachments are in the stream when this returns.
    ///
    /// `name` is what messages about this recording call it.
    ///
    /// # Errors
    /// [`RecordError::Write`] when the stream does not take the bytes.
    pub fn new(stream: W, name: &str, origin: &Origin) -> Result<Self, RecordError> {
        Self::begin(stream, name, origin).map_err(|error| RecordError::write(name, &error))
    }

    fn begin(stream: W, name: &str, origin: &Origin) -> Result<Self, mcap::McapError> {
        let mut mcap = whole_chunks().library(LIBRARY).create(NoSeek::new(stream))?;
        mcap.write_metadata(&origin_record(origin))?;
        for (name, bytes) in &origin.attachments {
            mcap.attach(&mcap::Attachment {
                log_time: 0,
                create_time: 0,
                name: name.clone(),
                media_type: "application/octet-stream".into(),
                data: bytes.into(),
            })?;
        }
        let mut channels = Channels { mcap: &mut mcap, ids: Vec::with_capacity(TOPICS.len()) };
        visit_topics(&mut channels)?;
        let channels = channels.ids;
        let image_channel = add_image_channel(&mut mcap)?;
        let view_channels = if origin.view.shown { add_view_channels(&mut mcap)? } else { Vec::new() };
        mcap.flush()?;
        Ok(Self {
            mcap,
            name: name.into(),
            channels,
            image_channel,
            view: View::new(&origin.view, origin.mono_to_wall_ns),
            view_channels,
            mono_to_wall_ns: origin.mono_to_wall_ns,
            flush_period_ns: origin.flush_period_ns,
            flushed_ns: None,
            scratch: Vec::new(),
            written: 0,
        })
    }

    /// Appends one message, received at host time `received_ns`.
    ///
    /// # Errors
    /// [`RecordError::Write`]; nothing can be written after it.
    pub fn write(
        &mut self,
        row: &TopicRow,
        header: &Header,
        message: &[u8],
        received_ns: u64,
    ) -> Result<(), RecordError> {
        let mut record = std::mem::take(&mut self.scratch);
        record.clear();
        record.extend_from_slice(bytemuck::bytes_of(header));
        record.extend_from_slice(message);
        let outcome = self.write_record(row, &record, received_ns);
        self.scratch = record;
        outcome
    }

    /// As [`Writer::write`], with header and message already one after the other.
    ///
    /// # Errors
    /// [`RecordError::Write`]; nothing can be written after it.
    pub fn write_record(
        &mut self,
        row: &TopicRow,
        record: &[u8],
        received_ns: u64,
    ) -> Result<(), RecordError> {
        let header_bytes = size_of::<Header>();
        assert_eq!(record.len(), header_bytes + row.size, "a record of {} has another size", row.name);
        let header: Header = bytemuck::pod_read_unaligned(&record[..header_bytes]);
        let stamps = MessageHeader {
            channel_id: self.channels[row.index],
            sequence: header.sequence as u32,
            log_time: received_ns.saturating_add_signed(self.mono_to_wall_ns),
            publish_time: header.now_ns,
        };
        self.append(row, record, stamps)
            .and_then(|()| self.show(row, record, stamps, received_ns))
            .map_err(|error| RecordError::write(&self.name, &error))?;
        self.written += 1;
        let since_ns = received_ns.saturating_sub(*self.flushed_ns.get_or_insert(received_ns));
        if since_ns >= self.flush_period_ns {
            self.flushed_ns = Some(received_ns);
            self.flush()?;
        }
        Ok(())
    }

    fn append(
        &mut self,
        row: &TopicRow,
        record: &[u8],
        stamps: MessageHeader,
    ) -> Result<(), mcap::McapError> {
        if row.index != DEPTH.index {
            return self.mcap.write_to_known_channel(&stamps, record);
        }
        let (rest, frame) = (size_of::<Header>() + DEPTH_REST_BYTES, &record[size_of::<Header>()..]);
        let image = self.view.image(frame);
        self.mcap
            .write_to_known_channel(&MessageHeader { channel_id: self.image_channel, ..stamps }, &image)?;
        self.mcap.write_to_known_channel(&stamps, &record[..rest])
    }

    /// Appends what the record shows on the view channels.
    fn show(
        &mut self,
        row: &TopicRow,
        record: &[u8],
        stamps: MessageHeader,
        received_ns: u64,
    ) -> Result<(), mcap::McapError> {
        for (channel, message) in self.view.show(row, record, received_ns) {
            // Without view channels a view shows nothing.
            let Some(&channel_id) = self.view_channels.get(channel.index) else { continue };
            self.mcap.write_to_known_channel(&MessageHeader { channel_id, ..stamps }, message)?;
        }
        Ok(())
    }

    /// Closes the chunk in work and hands everything to the stream.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.mcap.flush().map_err(|error| RecordError::write(&self.name, &error))
    }

    /// The name that messages about this recording use.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Messages written so far.
    #[must_use]
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Ends the recording with what was lost on the way, its index and its end mark, and gives the stream back.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn finish(mut self, lost: &[u64]) -> Result<W, RecordError> {
        let metadata: BTreeMap<String, String> = TOPICS
            .iter()
            .zip(lost)
            .filter(|(_, count)| **count > 0)
            .map(|(row, count)| (row.name.into(), count.to_string()))
            .collect();
        let end = |mcap: &mut mcap::Writer<NoSeek<W>>| -> Result<(), mcap::McapError> {
            if !metadata.is_empty() {
                mcap.write_metadata(&Metadata { name: LOST_RECORD.into(), metadata })?;
            }
            mcap.finish().map(|_| ())
        };
        end(&mut self.mcap).map_err(|error| RecordError::write(&self.name, &error))?;
        let mut stream = self.mcap.into_inner().into_inner();
        stream.flush().map_err(|error| RecordError::write(&self.name, &error.into()))?;
        Ok(stream)
    }
}

fn origin_record(origin: &Origin) -> Metadata {
    let mut metadata: BTreeMap<String, String> = origin.metadata.iter().cloned().collect();
    metadata.insert(MONO_TO_WALL_KEY.into(), origin.mono_to_wall_ns.to_string());
    Metadata { name: ORIGIN_RECORD.into(), metadata }
}

fn add_image_channel<W: Write>(mcap: &mut mcap::Writer<NoSeek<W>>) -> Result<u16, mcap::McapError> {
    let schema = depth_image_schema();
    let schema = mcap.add_schema(&schema.name, &schema.encoding, &schema.data)?;
    mcap.add_channel(schema, DEPTH.row().name, "protobuf", &BTreeMap::new())
}

fn add_view_channels<W: Write>(mcap: &mut mcap::Writer<NoSeek<W>>) -> Result<Vec<u16>, mcap::McapError> {
    let add = |channel: &ViewChannel| {
        let schema = channel.schema();
        let schema = mcap.add_schema(&schema.name, &schema.encoding, &schema.data)?;
        mcap.add_channel(schema, channel.name, channel.encoding(), &BTreeMap::new())
    };
    VIEW_CHANNELS.iter().map(add).collect()
}

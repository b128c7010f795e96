//! What a recording holds, at a glance.

use crate::error::PlayerError;
use crate::scan::{MAGIC, Scan};
use mcap::records::Record;
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use serde::Serialize;
use sidestep_msgs::LOST_RECORD;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// One channel of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ChannelInfo {
    /// Its name.
    pub topic: String,
    /// Messages.
    pub count: u64,
    /// `[Hz]` messages by duration of the recording.
    pub rate_hz: f64,
    /// Name of its schema.
    pub schema: String,
    /// Encoding of its messages.
    pub encoding: String,
}

/// What a recording holds.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Info {
    /// The file.
    pub path: PathBuf,
    /// `[byte]` its size.
    pub size_bytes: u64,
    /// The program that wrote it.
    pub library: String,
    /// Whether it was ended in order.
    pub complete: bool,
    /// Where and why it ends early.
    pub damage: Option<String>,
    /// All messages.
    pub messages: u64,
    /// `[ns]` wall time of the first message received.
    pub start_ns: u64,
    /// `[ns]` wall time of the last message received.
    pub end_ns: u64,
    /// `[s]` from the first to the last.
    pub duration_s: f64,
    /// Its channels by name.
    pub channels: Vec<ChannelInfo>,
    /// Names and sizes in bytes of the files within.
    pub attachments: BTreeMap<String, u64>,
    /// What it says of itself.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
}

/// Channels and schemas by number while a file is read.
#[derive(Default)]
struct Tally {
    info: Info,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (u16, ChannelInfo)>,
    bounds: Option<(u64, u64)>,
}

impl Tally {
    fn record(&mut self, record: &Record) {
        match record {
            Record::Header(header) => self.info.library.clone_from(&header.library),
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name.clone());
            }
            Record::Channel(channel) => {
                let (topic, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
                let fresh = ChannelInfo { topic, encoding, ..ChannelInfo::default() };
                self.channels.entry(channel.id).or_insert((channel.schema_id, fresh));
            }
            Record::Message { header, .. } => {
                if let Some((_, channel)) = self.channels.get_mut(&header.channel_id) {
                    channel.count += 1;
                }
                let (start, end) = self.bounds.unwrap_or((header.log_time, header.log_time));
                self.bounds = Some((start.min(header.log_time), end.max(header.log_time)));
            }
            Record::Attachment { header, data, .. } => {
                self.info.attachments.insert(header.name.clone(), data.len() as u64);
            }
            Record::Metadata(metadata) => {
                self.info.metadata.insert(metadata.name.clone(), metadata.metadata.clone());
            }
            _ => {}
        }
    }

    fn finish(mut self) -> Info {
        let (start_ns, end_ns) = self.bounds.unwrap_or_default();
        let duration_s = end_ns.saturating_sub(start_ns) as f64 * 1e-9;
        for (schema, mut channel) in std::mem::take(&mut self.channels).into_values() {
            channel.schema = self.schemas.get(&schema).cloned().unwrap_or_default();
            channel.rate_hz = if duration_s > 0.0 { channel.count as f64 / duration_s } else { 0.0 };
            self.info.messages += channel.count;
            self.info.channels.push(channel);
        }
        self.info.channels.sort_by(|a, b| a.topic.cmp(&b.topic));
        Info { start_ns, end_ns, duration_s, ..self.info }
    }
}

impl Info {
    /// Reads a recording's own summary or, for one that was cut, the whole file.
    ///
    /// # Errors
    /// [`PlayerError::Read`] or [`PlayerError::NotMcap`]; damage within is told by [`Info::damage`].
    pub fn read(path: &Path) -> Result<Self, PlayerError> {
        // Opening the scan checks that this is an MCAP file.
        let mut scan = Scan::open(path)?;
        let mut tally = Tally::default();
        let fault = |source| PlayerError::read(path, source);
        let mut file = File::open(path).map_err(fault)?;
        let size_bytes = file.metadata().map_err(fault)?.len();
        let complete = summary(&mut file, size_bytes, &mut tally).is_some();
        if !complete {
            tally = Tally::default();
            while let Some(outcome) = scan.next(|record| tally.record(record)) {
                outcome?;
            }
        }
        let missing = "the end mark is missing, as after a kill or a full disk";
        let damage = (!complete).then(|| scan.damage().unwrap_or(missing).to_string());
        Ok(Self { path: path.to_path_buf(), size_bytes, complete, damage, ..tally.finish() })
    }

    /// Messages lost by the recorder, by topic.
    #[must_use]
    pub fn lost(&self) -> BTreeMap<String, u64> {
        let lost = self.metadata.get(LOST_RECORD).into_iter().flatten();
        lost.filter_map(|(topic, count)| Some((topic.clone(), count.parse().ok()?))).collect()
    }

    /// As text for a person.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        // A text in memory cannot fail to take more text.
        let mut line = |label: &str, value: String| {
            let _ = writeln!(text, "{label:<12} {value}");
        };
        line("file:", self.path.display().to_string());
        line("size:", format!("{:.1} MB", self.size_bytes as f64 * 1e-6));
        line("written by:", self.library.clone());
        line("state:", self.damage.as_ref().map_or("complete".into(), |damage| format!("cut: {damage}")));
        line("duration:", format!("{:.3} s", self.duration_s));
        line("start:", format!("{:.9} s since 1970", self.start_ns as f64 * 1e-9));
        line("messages:", self.messages.to_string());
        for (topic, count) in self.lost() {
            line("lost:", format!("{count} of {topic}"));
        }
        line("topics:", String::new());
        for channel in self.channels.iter().filter(|channel| channel.count > 0) {
            let ChannelInfo { topic, count, rate_hz, schema, encoding } = channel;
            let _ = writeln!(text, "  {topic:<18} {count:>8} msgs {rate_hz:>8.2} Hz  {schema} [{encoding}]");
        }
        for (name, bytes) in &self.attachments {
            let _ = writeln!(text, "attachment   {name} ({bytes} bytes)");
        }
        for (record, values) in &self.metadata {
            for (key, value) in values {
                let _ = writeln!(text, "metadata     {record}.{key} = {value}");
            }
        }
        text
    }
}

/// Reads the summary of a complete file; `None` where there is none or it cannot be trusted.
fn summary(file: &mut File, size_bytes: u64, tally: &mut Tally) -> Option<()> {
    let options =
        SummaryReaderOptions::default().with_file_size(size_bytes).with_record_length_limit(16 << 20);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(count) => {
                let count = file.read(reader.insert(count)).ok()?;
                reader.notify_read(count);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to).ok()?),
        }
    }
    let summary = reader.finish()?;
    let stats = summary.stats.as_ref()?;
    if let Some(library) = read_record(file, MAGIC.len() as u64, size_bytes) {
        tally.record(&mcap::parse_record(library.0, &library.1).ok()?);
    }
    for (id, schema) in &summary.schemas {
        tally.schemas.insert(*id, schema.name.clone());
    }
    for (id, channel) in &summary.channels {
        let count = stats.channel_message_counts.get(id).copied().unwrap_or(0);
        let (topic, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
        let schema = channel.schema.as_ref().map_or(0, |schema| schema.id);
        let info = ChannelInfo { topic, encoding, count, ..ChannelInfo::default() };
        tally.channels.insert(*id, (schema, info));
    }
    for index in &summary.attachment_indexes {
        tally.info.attachments.insert(index.name.clone(), index.data_size);
    }
    for index in &summary.metadata_indexes {
        let (opcode, body) = read_record(file, index.offset, size_bytes)?;
        tally.record(&mcap::parse_record(opcode, &body).ok()?);
    }
    tally.bounds = (stats.message_count > 0).then_some((stats.message_start_time, stats.message_end_time));
    Some(())
}

/// Opcode and body of the record that begins at `offset`.
fn read_record(file: &mut File, offset: u64, size_bytes: u64) -> Option<(u8, Vec<u8>)> {
    let mut head = [0; 9];
    file.seek(SeekFrom::Start(offset)).ok()?;
    file.read_exact(&mut head).ok()?;
    let mut length = [0; 8];
    length.copy_from_slice(&head[1..]);
    let length = u64::from_le_bytes(length);
    if length > size_bytes.saturating_sub(offset) || length > 16 << 20 {
        return None;
    }
    let mut body = vec![0; length as usize];
    file.read_exact(&mut body).ok()?;
    Some((head[0], body))
}

/// The file of this name within a recording.
///
/// # Errors
/// [`PlayerError::Read`], [`PlayerError::NotMcap`], or [`PlayerError::Damaged`] where there is no such file within.
pub fn attachment(path: &Path, name: &str) -> Result<Vec<u8>, PlayerError> {
    let mut scan = Scan::open(path)?;
    loop {
        let found = scan.next(|record| match record {
            Record::Attachment { header, data, .. } if header.name == name => Some(data.to_vec()),
            _ => None,
        });
        match found {
            Some(Ok(Some(bytes))) => return Ok(bytes),
            Some(Ok(None)) => {}
            Some(Err(error)) => return Err(error),
            None => return Err(PlayerError::damaged(path, format!("no file {name} within"))),
        }
    }
}

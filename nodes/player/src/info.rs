//! What a recording holds, at a glance.

use crate::error::PlayerError;
use crate::scan::{Extent, MAGIC, Scan, parse};
use mcap::records::{Record, Statistics, op};
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
                match self.channels.get_mut(&header.channel_id) {
                    Some((_, channel)) => channel.count += 1,
                    // Of a channel that the file does not declare.
                    None => self.info.messages += 1,
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
        let mut scan = Scan::through(path, Extent::Whole)?;
        let fault = |source| PlayerError::read(path, source);
        let mut file = File::open(path).map_err(fault)?;
        let size_bytes = file.metadata().map_err(fault)?.len();
        let mut tally = Tally::default();
        let mut complete = summary(path, &mut file, size_bytes, &mut tally).is_some();
        if !complete {
            tally = Tally::default();
            while let Some(outcome) = scan.next(|record| tally.record(record)) {
                outcome?;
            }
            complete = scan.is_complete();
        }
        let damage = scan.damage().filter(|_| !complete).map(str::to_owned);
        Ok(Self { path: path.to_path_buf(), size_bytes, complete, damage, ..tally.finish() })
    }

    /// Messages that the summary of a file counts; `None` where there is none.
    pub(crate) fn counted(path: &Path) -> Option<u64> {
        let mut file = File::open(path).ok()?;
        let size_bytes = file.metadata().ok()?.len();
        let mut tally = Tally::default();
        summary(path, &mut file, size_bytes, &mut tally)?;
        Some(tally.finish().messages)
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

/// `[byte]` the last record and the end mark of a complete file.
const FOOTER_BYTES: u64 = 9 + 20 + MAGIC.len() as u64;
/// `[byte]` a metadata record of a summary that is larger is not looked up.
const LOOK_UP_BYTES_MAX: u64 = 16 << 20;

/// Where the summary of a complete file begins.
fn summary_start(file: &mut File, size_bytes: u64) -> Option<u64> {
    let footer_start = size_bytes.checked_sub(FOOTER_BYTES)?;
    let (opcode, body) = read_record(file, footer_start, size_bytes)?;
    let mut last = [0; MAGIC.len()];
    file.read_exact(&mut last).ok()?;
    let Ok(Record::Footer(footer)) = parse(opcode, &body) else { return None };
    let start = footer.summary_start;
    (last == MAGIC && start > 0 && start < footer_start).then_some(start)
}

/// Reads the summary of a complete file; `None` where there is none or it does not tell enough.
fn summary(path: &Path, file: &mut File, size_bytes: u64, tally: &mut Tally) -> Option<()> {
    let mut scan = Scan::through(path, Extent::Whole).ok()?;
    scan.seek(summary_start(file, size_bytes)?).ok()?;
    let mut statistics: Option<Statistics> = None;
    let mut places = Vec::new();
    while let Some(outcome) = scan.next(|record| match record {
        Record::Schema { .. } | Record::Channel(_) => tally.record(record),
        Record::Statistics(found) => statistics = Some(found.clone()),
        Record::MetadataIndex(index) => places.push(index.offset),
        Record::AttachmentIndex(index) => {
            tally.info.attachments.insert(index.name.clone(), index.data_size);
        }
        _ => {}
    }) {
        outcome.ok()?;
    }
    let statistics = statistics.filter(|_| scan.is_complete())?;
    let counted: u64 =
        statistics.channel_message_counts.values().fold(0, |sum, count| sum.saturating_add(*count));
    let told = counted == statistics.message_count
        && tally.channels.len() >= statistics.channel_count as usize
        && tally.info.attachments.len() <= statistics.attachment_count as usize
        && places.len() == statistics.metadata_count as usize
        && (statistics.attachment_count == 0 || !tally.info.attachments.is_empty());
    if !told {
        return None;
    }
    for (id, count) in &statistics.channel_message_counts {
        tally.channels.get_mut(id)?.1.count = *count;
    }
    for offset in [MAGIC.len() as u64].into_iter().chain(places) {
        let (opcode, body) = read_record(file, offset, size_bytes)?;
        let wanted = matches!(opcode, op::HEADER | op::METADATA);
        wanted.then(|| parse(opcode, &body).map(|record| tally.record(&record)))?.ok()?;
    }
    let any = statistics.message_count > 0;
    tally.bounds = any.then_some((statistics.message_start_time, statistics.message_end_time));
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
    if length > size_bytes.saturating_sub(offset) || length > LOOK_UP_BYTES_MAX {
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
    let mut scan = Scan::through(path, Extent::Whole)?;
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

//! The file of a bag and the `metadata.yaml` beside it, as `ros2 bag info` and `ros2 bag play` want them.

use crate::cdr::encode;
use crate::error::BagError;
use crate::schemas::schema;
use serde::Serialize;
use sidestep_import::ImportError;
use sidestep_recorder::BagWriter;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// A topic that is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Output {
    topic: &'static str,
    message: &'static str,
    latched: bool,
}

impl Output {
    pub(crate) const fn new(topic: &'static str, message: &'static str) -> Self {
        Self { topic, message, latched: false }
    }

    /// A topic whose last message a late subscriber gets.
    pub(crate) const fn latched(topic: &'static str, message: &'static str) -> Self {
        Self { topic, message, latched: true }
    }

    /// What publishers offer, as rosbag2 writes it: reliable, the last ten, latched or not.
    fn offered_qos(&self) -> String {
        let durability = if self.latched { 1 } else { 2 };
        let forever = "\n    sec: 9223372036\n    nsec: 854775807";
        format!(
            "- history: 1\n  depth: 10\n  reliability: 1\n  durability: {durability}\n  deadline:{forever}\n  \
             lifespan:{forever}\n  liveliness: 1\n  liveliness_lease_duration:{forever}\n  \
             avoid_ros_namespace_conventions: false"
        )
    }
}

/// What was written.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BagTotals {
    /// The file, or the folder with its `metadata.yaml`.
    pub path: PathBuf,
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
    /// `[ns]` wall time of the first message received.
    pub first_ns: u64,
    /// `[ns]` wall time of the last message received.
    pub last_ns: u64,
}

struct Topic {
    id: u16,
    schema: String,
    qos: String,
    count: u64,
}

/// A bag that grows.
pub(crate) struct BagFile {
    writer: BagWriter<BufWriter<File>>,
    /// The folder, where one was asked for, and the name of the file in it.
    folder: Option<(PathBuf, String)>,
    path: PathBuf,
    topics: BTreeMap<&'static str, Topic>,
    span_ns: Option<(u64, u64)>,
    bytes: Vec<u8>,
}

impl BagFile {
    /// Begins a bag; nothing is overwritten.
    pub(crate) fn create(out: &Path) -> Result<Self, BagError> {
        let is_file = out.extension().is_some_and(|end| end == "mcap");
        let folder = if is_file {
            None
        } else {
            std::fs::create_dir(out).map_err(|source| {
                let remedy = "name a folder that does not exist yet, in one that does";
                BagError::Import(ImportError::Read { path: out.to_path_buf(), source, remedy })
            })?;
            let name = out.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Some((out.to_path_buf(), format!("{name}_0.mcap")))
        };
        let path = folder.as_ref().map_or_else(|| out.to_path_buf(), |(folder, name)| folder.join(name));
        Ok(Self {
            writer: BagWriter::create(&path)?,
            folder,
            path,
            topics: BTreeMap::new(),
            span_ns: None,
            bytes: Vec::new(),
        })
    }

    /// Appends a message that was received at a wall time.
    pub(crate) fn send<T: Serialize>(
        &mut self,
        output: &Output,
        logged_ns: u64,
        message: &T,
    ) -> Result<(), BagError> {
        if !self.topics.contains_key(output.topic) {
            let ((schema, text), qos) = (schema(output.message), output.offered_qos());
            let id = self.writer.topic(output.topic, (&schema, &text), &qos)?;
            self.topics.insert(output.topic, Topic { id, schema, qos, count: 0 });
        }
        let Some(topic) = self.topics.get_mut(output.topic) else { return Ok(()) };
        encode(message, &mut self.bytes).map_err(|fault| {
            let remedy = "export the recording without this topic";
            BagError::content(&self.path, fault.to_string(), "a message that CDR can hold", remedy)
        })?;
        self.writer.write(topic.id, [logged_ns, logged_ns], &self.bytes)?;
        topic.count += 1;
        let (first_ns, last_ns) = self.span_ns.unwrap_or((logged_ns, logged_ns));
        self.span_ns = Some((first_ns.min(logged_ns), last_ns.max(logged_ns)));
        Ok(())
    }

    /// Ends the bag.
    pub(crate) fn finish(self) -> Result<BagTotals, BagError> {
        self.writer.finish()?;
        let (first_ns, last_ns) = self.span_ns.unwrap_or_default();
        let counts = self.topics.iter().map(|(name, topic)| ((*name).to_owned(), topic.count));
        let totals = BagTotals { path: self.path, messages: counts.collect(), first_ns, last_ns };
        let Some((folder, name)) = self.folder else { return Ok(totals) };
        let listing = folder.join("metadata.yaml");
        std::fs::write(&listing, metadata(&self.topics, &totals, &name)).map_err(|source| {
            let remedy = "free space; the .mcap file beside it is complete";
            BagError::Import(ImportError::Read { path: listing, source, remedy })
        })?;
        Ok(BagTotals { path: folder, ..totals })
    }
}

/// The listing in version 5, which every release since Humble reads.
fn metadata(topics: &BTreeMap<&str, Topic>, totals: &BagTotals, name: &str) -> String {
    let (start, duration) = (totals.first_ns, totals.last_ns - totals.first_ns);
    let all: u64 = totals.messages.values().sum();
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    \
         nanoseconds: {duration}\n  starting_time:\n    nanoseconds_since_epoch: {start}\n  \
         message_count: {all}\n  topics_with_message_count:\n"
    );
    for (topic, Topic { schema, qos, count, .. }) in topics {
        // A text in memory cannot fail to take more text.
        let _ = write!(
            text,
            "    - topic_metadata:\n        name: {topic}\n        type: {schema}\n        \
             serialization_format: cdr\n        offered_qos_profiles: \"{}\"\n      message_count: {count}\n",
            qos.replace('\n', "\\n")
        );
    }
    let _ = write!(
        text,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {name}\n  files:\n    \
         - path: {name}\n      starting_time:\n        nanoseconds_since_epoch: {start}\n      duration:\n        \
         nanoseconds: {duration}\n      message_count: {all}\n"
    );
    text
}

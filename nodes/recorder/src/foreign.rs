//! MCAP files for other programs: ROS 2 bags, written as rosbag2 writes them.

use crate::error::RecordError;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

const LIBRARY: &str = concat!("sidestep/", env!("CARGO_PKG_VERSION"));

/// Writes a ROS 2 bag: profile `ros2`, schemas `ros2msg`, messages `cdr`, chunks compressed as by rosbag2's preset
/// for speed.
pub struct BagWriter<W: Write + Seek> {
    mcap: mcap::Writer<W>,
    name: String,
    sequences: BTreeMap<u16, u32>,
}

impl<W: Write + Seek> std::fmt::Debug for BagWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BagWriter").field("name", &self.name).finish_non_exhaustive()
    }
}

impl BagWriter<BufWriter<File>> {
    /// Begins a bag in a file that does not exist yet.
    ///
    /// # Errors
    /// [`RecordError::Create`] where the file cannot be made or is there already, [`RecordError::Write`].
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let fault = |source| RecordError::Create { path: path.to_path_buf(), source };
        let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(fault)?;
        Self::begin(BufWriter::new(file), &path.display().to_string())
    }
}

impl<W: Write + Seek> BagWriter<W> {
    /// Begins a bag in a stream; `name` is what messages about it call it.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn begin(stream: W, name: &str) -> Result<Self, RecordError> {
        let mcap = mcap::WriteOptions::new()
            .profile("ros2")
            .library(LIBRARY)
            .compression(Some(mcap::Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .create(stream)
            .map_err(|error| RecordError::write(name, &error))?;
        Ok(Self { mcap, name: name.into(), sequences: BTreeMap::new() })
    }

    /// Adds a topic with the name and text of its schema, and what publishers offered, and returns its number.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn topic(
        &mut self,
        topic: &str,
        (schema, text): (&str, &str),
        offered_qos: &str,
    ) -> Result<u16, RecordError> {
        let metadata = BTreeMap::from([("offered_qos_profiles".into(), offered_qos.into())]);
        self.mcap
            .add_schema(schema, "ros2msg", text.as_bytes())
            .and_then(|schema| self.mcap.add_channel(schema, topic, "cdr", &metadata))
            .map_err(|error| RecordError::write(&self.name, &error))
    }

    /// Appends a message, encapsulation included, at wall times in nanoseconds.
    ///
    /// # Errors
    /// [`RecordError::Write`]; nothing can be written after it.
    pub fn write(
        &mut self,
        topic: u16,
        [logged_ns, published_ns]: [u64; 2],
        data: &[u8],
    ) -> Result<(), RecordError> {
        let sequence = self.sequences.entry(topic).or_default();
        *sequence = sequence.wrapping_add(1);
        let stamps = MessageHeader {
            channel_id: topic,
            sequence: *sequence,
            log_time: logged_ns,
            publish_time: published_ns,
        };
        let written = self.mcap.write_to_known_channel(&stamps, data);
        written.map_err(|error| RecordError::write(&self.name, &error))
    }

    /// Ends the bag with its index and gives the stream back.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn finish(mut self) -> Result<W, RecordError> {
        self.mcap.finish().map_err(|error| RecordError::write(&self.name, &error))?;
        let mut stream = self.mcap.into_inner();
        stream.flush().map_err(|error| RecordError::write(&self.name, &error.into()))?;
        Ok(stream)
    }
}

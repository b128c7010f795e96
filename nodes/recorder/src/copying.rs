//! Records of another MCAP file written again as they are, into a file that is complete: any MCAP, not only ours.

use crate::error::RecordError;
use crate::file::DiskFile;
use crate::writer::whole_chunks;
use mcap::McapError;
use mcap::records::Record;
use mcap::write::{Metadata, NoSeek};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes records again: schemas, channels, messages, attachments and metadata; indices and sums are made anew.
pub struct Copying<W: Write> {
    /// Taken by the first record, whose profile the file keeps.
    stream: Option<W>,
    mcap: Option<mcap::Writer<NoSeek<W>>>,
    name: String,
}

impl<W: Write> std::fmt::Debug for Copying<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Copying").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Whether a record is refused for what it says, not for want of a disk.
fn is_refusal(error: &McapError) -> bool {
    matches!(
        error,
        McapError::UnknownChannel(..)
            | McapError::UnknownSchema(..)
            | McapError::ConflictingChannels(_)
            | McapError::ConflictingSchemas(_)
            | McapError::InvalidSchemaId
    )
}

impl<W: Write> Copying<W> {
    /// A file that begins with its first record. `name` is what messages about it call it.
    pub fn new(stream: W, name: &str) -> Self {
        Self { stream: Some(stream), mcap: None, name: name.into() }
    }

    /// Writes a record again; `false` where it cannot stand in a file, such as a message of a channel that nobody declared.
    ///
    /// # Errors
    /// [`RecordError::Write`]; nothing can be written after it.
    pub fn write(&mut self, record: &Record) -> Result<bool, RecordError> {
        match self.copy(record) {
            Ok(()) => Ok(true),
            Err(error) if is_refusal(&error) => Ok(false),
            Err(error) => Err(RecordError::write(&self.name, &error)),
        }
    }

    fn writer(&mut self, profile: &str, library: &str) -> Result<&mut mcap::Writer<NoSeek<W>>, McapError> {
        if let Some(stream) = self.stream.take() {
            let options = whole_chunks().profile(profile).library(library);
            self.mcap = Some(options.create(NoSeek::new(stream))?);
        }
        self.mcap.as_mut().ok_or(McapError::AttemptedWriteAfterFailure)
    }

    fn copy(&mut self, record: &Record) -> Result<(), McapError> {
        if let Record::Header(header) = record {
            return self.writer(&header.profile, &header.library).map(|_| ());
        }
        let mcap = self.writer("", "")?;
        match record {
            Record::Schema { header, data } => {
                mcap.add_schema_with_id(header.id, &header.name, &header.encoding, data).map(|_| ())
            }
            Record::Channel(channel) => {
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                mcap.add_channel_with_id(channel.id, channel.schema_id, topic, encoding, &channel.metadata)
                    .map(|_| ())
            }
            Record::Message { header, data } => mcap.write_to_known_channel(header, data),
            Record::Attachment { header, data, .. } => mcap.attach(&mcap::Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name.clone(),
                media_type: header.media_type.clone(),
                data: data.as_ref().into(),
            }),
            Record::Metadata(found) => {
                let (name, metadata) = (found.name.clone(), found.metadata.clone());
                mcap.write_metadata(&Metadata { name, metadata })
            }
            Record::Unknown { opcode, data } if *opcode >= 0x80 => {
                mcap.write_private_record(*opcode, data, Default::default())
            }
            // What follows from the others is made anew.
            _ => Ok(()),
        }
    }

    /// Ends the file with its index and its end mark, and gives the stream back.
    ///
    /// # Errors
    /// [`RecordError::Write`].
    pub fn finish(mut self) -> Result<W, RecordError> {
        let ended = self.writer("", "").and_then(|mcap| mcap.finish().map(|_| ()));
        let ended = ended.and_then(|()| self.mcap.take().ok_or(McapError::AttemptedWriteAfterFailure));
        let mcap = ended.map_err(|error| RecordError::write(&self.name, &error))?;
        let mut stream = mcap.into_inner().into_inner();
        stream.flush().map_err(|error| RecordError::write(&self.name, &error.into()))?;
        Ok(stream)
    }
}

impl Copying<DiskFile> {
    /// Begins a file; see [`DiskFile::create`] for its name.
    ///
    /// # Errors
    /// [`RecordError::Create`].
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let file = DiskFile::create(path)?;
        Ok(Self::new(file, &path.display().to_string()))
    }

    /// Ends the file and gives it its name, which is returned.
    ///
    /// # Errors
    /// [`RecordError`]; what was written stays in the file whose name ends in `.active`.
    pub fn complete(self) -> Result<PathBuf, RecordError> {
        self.finish()?.complete()
    }
}

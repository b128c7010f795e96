//! MCAP records one after the other, from a file that may be cut, damaged or hostile.

use crate::error::PlayerError;
use mcap::McapError;
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// `[byte]` no record or chunk of a recording is larger: a file that claims more is damaged, and memory stays bounded.
const RECORD_BYTES_MAX: usize = 64 << 20;
/// First and last bytes of a complete file.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Reads records in the order of the file.
pub(crate) struct Scan {
    file: File,
    reader: LinearReader,
    path: PathBuf,
    ended: bool,
    damage: Option<String>,
}

impl Scan {
    pub(crate) fn open(path: &Path) -> Result<Self, PlayerError> {
        let mut file = File::open(path).map_err(|source| PlayerError::read(path, source))?;
        let mut first = Vec::new();
        let read = file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut first);
        read.map_err(|source| PlayerError::read(path, source))?;
        if first != MAGIC {
            let found = first.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
            return Err(PlayerError::NotMcap { path: path.to_path_buf(), found });
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX);
        let reader = LinearReader::new_with_options(options);
        Ok(Self { file, reader, path: path.to_path_buf(), ended: false, damage: None })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Where the file ends early, after everything before it was read.
    pub(crate) fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// Shows the next record to `look`; `None` at the end of the data or at the first damage.
    pub(crate) fn next<T>(&mut self, look: impl FnOnce(&Record) -> T) -> Option<Result<T, PlayerError>> {
        while !self.ended {
            match self.reader.next_event() {
                None => self.ended = true,
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    match read_some(&mut self.file, &mut self.reader, wanted) {
                        Ok(()) => {}
                        Err(source) => {
                            self.ended = true;
                            return Some(Err(PlayerError::read(&self.path, source)));
                        }
                    }
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    match mcap::parse_record(opcode, data) {
                        Ok(Record::DataEnd(_)) => self.ended = true,
                        Ok(record) => return Some(Ok(look(&record))),
                        Err(error) => self.stop(&error),
                    }
                }
                Some(Err(error)) => self.stop(&error),
            }
        }
        None
    }

    fn stop(&mut self, error: &McapError) {
        self.ended = true;
        self.damage = Some(match error {
            McapError::UnexpectedEof => "the file ends in the middle, as after a kill or a full disk".into(),
            other => other.to_string(),
        });
    }
}

/// Hands the reader at most `wanted` further bytes.
fn read_some(file: &mut File, reader: &mut LinearReader, wanted: usize) -> std::io::Result<()> {
    loop {
        match file.read(reader.insert(wanted.min(RECORD_BYTES_MAX))) {
            Ok(count) => {
                reader.notify_read(count);
                return Ok(());
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

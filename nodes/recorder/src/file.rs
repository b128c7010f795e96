//! The file of a recording: `NAME.mcap.active` while it grows, `NAME.mcap` when it is complete.

use crate::error::RecordError;
use crate::writer::{Origin, Writer};
use crossbeam::channel::{Sender, bounded};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Names tried before giving up: `NAME.mcap`, `NAME-2.mcap`, ...
const NAMES_TRIED: u32 = 1000;
/// Flushes between two wishes that the disk really has the bytes, which guards against a loss of power.
const FLUSHES_PER_SYNC: u32 = 5;

/// Sees to it that the disk has what the system has, in a thread of its own: a busy disk may take seconds, and what waits
/// for the writer meanwhile would be lost with a kill.
#[derive(Debug)]
struct Syncer {
    ask: Sender<()>,
    failed: Arc<OnceLock<std::io::Error>>,
}

impl Syncer {
    fn start(file: File) -> std::io::Result<Self> {
        let (ask, asked) = bounded(1);
        let failed = Arc::new(OnceLock::new());
        let said = Arc::clone(&failed);
        let sync = move || {
            while asked.recv().is_ok() {
                if let Err(error) = file.sync_data() {
                    let _ = said.set(error);
                }
            }
        };
        std::thread::Builder::new().name("recorder-sync".into()).spawn(sync)?;
        Ok(Self { ask, failed })
    }

    /// Asks once more; where the disk is still busy with an earlier wish, that one comes first.
    fn ask(&self) -> std::io::Result<()> {
        let _ = self.ask.try_send(());
        self.failed.get().map_or(Ok(()), |error| Err(std::io::Error::new(error.kind(), error.to_string())))
    }
}

/// A file that reaches the system at each flush and the disk at about every fifth.
#[derive(Debug)]
pub struct DiskFile {
    file: BufWriter<File>,
    syncer: Syncer,
    active: PathBuf,
    path: PathBuf,
    flushes: u32,
}

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()?;
        self.flushes += 1;
        if self.flushes.is_multiple_of(FLUSHES_PER_SYNC) { self.syncer.ask() } else { Ok(()) }
    }
}

/// `NAME.mcap` and, where that is taken, `NAME-2.mcap` and so on.
fn numbered(path: &Path, number: u32) -> PathBuf {
    if number == 1 {
        return path.to_path_buf();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number}.mcap"))
}

impl DiskFile {
    /// Makes the folder where needed and a file whose name is not taken; a recording is never overwritten.
    ///
    /// # Errors
    /// [`RecordError::Create`].
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        let fault = |path: &Path, source| RecordError::Create { path: path.to_path_buf(), source };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|source| fault(path, source))?;
        }
        for number in 1..=NAMES_TRIED {
            let path = numbered(path, number);
            let active = path.with_added_extension("active");
            if path.exists() {
                continue;
            }
            match OpenOptions::new().write(true).create_new(true).open(&active) {
                Ok(file) => {
                    let syncer = file.try_clone().and_then(Syncer::start);
                    let syncer = syncer.map_err(|source| fault(&active, source))?;
                    return Ok(Self { file: BufWriter::new(file), syncer, active, path, flushes: 0 });
                }
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(source) => return Err(fault(&path, source)),
            }
        }
        Err(fault(path, std::io::ErrorKind::AlreadyExists.into()))
    }

    /// The name that the file has while it grows.
    pub(crate) fn active(&self) -> &Path {
        &self.active
    }

    /// The name that the file will have when it is complete.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the complete file its name.
    pub(crate) fn complete(mut self) -> Result<PathBuf, RecordError> {
        let name = self.path.display().to_string();
        let failed = |error: std::io::Error| RecordError::write(&name, &error.into());
        self.file.flush().map_err(failed)?;
        // Named before the disk has it all, which may take seconds: whoever is killed meanwhile leaves a complete file.
        std::fs::rename(&self.active, &self.path).map_err(|source| RecordError::Rename {
            path: self.path.clone(),
            active: self.active.clone(),
            source,
        })?;
        self.file.get_ref().sync_all().map_err(failed)?;
        Ok(self.path)
    }
}

impl Writer<DiskFile> {
    /// Begins a recording in a file; see [`DiskFile::create`] for its name.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn create(path: &Path, origin: &Origin) -> Result<Self, RecordError> {
        let file = DiskFile::create(path)?;
        let name = file.active.display().to_string();
        Self::new(file, &name, origin)
    }

    /// The name that the file will have when it is complete.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        PathBuf::from(self.name()).with_extension("")
    }

    /// Ends the recording and gives the file its name, which is returned.
    ///
    /// # Errors
    /// [`RecordError`]; what was written stays in the file whose name ends in `.active`.
    pub fn complete(self, lost: &[u64]) -> Result<PathBuf, RecordError> {
        self.finish(lost)?.complete()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("sidestep-recorder-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        folder
    }

    #[test]
    fn a_recording_has_its_name_only_when_it_is_complete_and_overwrites_nothing() {
        let folder = folder("names");
        let wanted = folder.join("deep/drive.mcap");
        let first = Writer::create(&wanted, &Origin::default()).unwrap();
        assert!(folder.join("deep/drive.mcap.active").exists() && !wanted.exists());
        assert_eq!(first.path(), wanted);
        assert_eq!(first.complete(&[]).unwrap(), wanted);
        let second = Writer::create(&wanted, &Origin::default()).unwrap();
        assert_eq!(second.complete(&[]).unwrap(), folder.join("deep/drive-2.mcap"));
        assert!(!folder.join("deep/drive.mcap.active").exists());
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let folder = folder("file");
        std::fs::write(&folder, b"a file").unwrap();
        let error = Writer::create(&folder.join("drive.mcap"), &Origin::default()).unwrap_err();
        assert!(error.to_string().contains("drive.mcap"), "{error}");
        std::fs::remove_file(folder).unwrap();
    }
}

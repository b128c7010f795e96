//! Where a recording goes: a file or nowhere, with a copy of its chunks for the black box.

use crate::file::DiskFile;
use crate::frames::{Chunk, take_chunks};
use std::io::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[derive(Debug, Default)]
struct Passed {
    bytes: u64,
    copy: Option<Vec<u8>>,
}

/// What has passed through a stream, seen from beside it; writer and onlooker are the same thread.
#[derive(Debug, Clone, Default)]
pub(crate) struct Onlooker(Arc<Mutex<Passed>>);

impl Onlooker {
    fn passed(&self) -> MutexGuard<'_, Passed> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Copies what is written from now on.
    pub(crate) fn copy(&self) {
        self.passed().copy = Some(Vec::new());
    }

    /// `[byte]` written so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.passed().bytes
    }

    /// The chunks that were closed since the last call.
    pub(crate) fn take_chunks(&self) -> Vec<Chunk> {
        match &mut self.passed().copy {
            Some(copy) if !copy.is_empty() => take_chunks(copy),
            _ => Vec::new(),
        }
    }
}

/// The stream of one file, or of none where only the black box is kept.
#[derive(Debug)]
pub(crate) struct Stream {
    pub(crate) file: Option<DiskFile>,
    pub(crate) onlooker: Onlooker,
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let taken = self.file.as_mut().map_or(Ok(bytes.len()), |file| file.write(bytes))?;
        let mut passed = self.onlooker.passed();
        passed.bytes += taken as u64;
        if let Some(copy) = &mut passed.copy {
            copy.extend_from_slice(&bytes[..taken]);
        }
        Ok(taken)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.as_mut().map_or(Ok(()), DiskFile::flush)
    }
}

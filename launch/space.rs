//! Free room: on disks, and in the shared memory that messages lie in.

use crate::failure::Failure;
use std::path::Path;

/// Where shared memory lies.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// `[MB]` four times what the shipped graph takes: it drives in 8 MB, not in 5. Messages take their room when they are written
/// first; who finds none then is ended by the system (SIGBUS).
const LEAST_MB: u64 = 32;
/// What to do where there is none.
pub(crate) const REMEDY: &str =
    "end other runs, or mount /dev/shm with a larger size (containers: --shm-size)";

/// `[MB]` free and whole size of the file system of a path.
pub(crate) fn space_mb(path: &Path) -> Option<(u64, u64)> {
    let room = rustix::fs::statvfs(path).ok()?;
    let megabytes = |blocks: u64| blocks.saturating_mul(room.f_frsize) >> 20;
    Some((megabytes(room.f_bavail), megabytes(room.f_blocks)))
}

/// `[MB]` free shared memory, and in words; `None` where it has no size: without a limit, or not to be asked.
pub(crate) fn shared_memory() -> Option<(u64, String)> {
    let (free, whole) = space_mb(Path::new(SHARED_MEMORY)).filter(|(_, whole)| *whole > 0)?;
    Some((free, format!("{free} of {whole} MB free in {SHARED_MEMORY}")))
}

/// Whether the messages of a graph find room.
///
/// # Errors
/// Too little shared memory is free.
pub(crate) fn check_shared_memory() -> Result<(), Failure> {
    match shared_memory() {
        Some((free, found)) if free < LEAST_MB => {
            Err(Failure::io(format!("{found}, {LEAST_MB} MB needed: {REMEDY}")))
        }
        _ => Ok(()),
    }
}

/// What a signal says of why a process ended, where it says anything.
pub(crate) fn cause_of(signal: Option<i32>) -> Option<String> {
    let (_, found) = shared_memory().filter(|_| signal == Some(libc::SIGBUS))?;
    Some(format!("perhaps it found no room for a message; now {found}: {REMEDY}"))
}

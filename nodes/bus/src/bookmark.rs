//! How far a reader of everything has come, for a lockstep driver that must not run away from it.
//!
//! Rings overwrite what is not read in time. In real time nobody can wait; where the driver moves time, it can: the recorder
//! writes the number of the newest word of the clock that it saw before it emptied its inboxes, and the driver reads it.

use crate::boot::Boot;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

/// A number in the run's shared memory, written by one node and read by its driver; gone with the run.
#[derive(Debug)]
pub struct Bookmark(Option<File>);

impl Bookmark {
    fn path(boot: &Boot, node: &str) -> PathBuf {
        PathBuf::from("/dev/shm").join(format!("{}{node}.bookmark", boot.domain.prefix))
    }

    /// The bookmark that this node writes; a memory that is full costs the bookmark, never the node.
    #[must_use]
    pub fn write(boot: &Boot) -> Self {
        let mark = Self(File::create(Self::path(boot, &boot.node)).ok());
        mark.tell(0);
        mark
    }

    /// The bookmark that another node writes; until that node has begun, it tells nothing.
    #[must_use]
    pub fn read(boot: &Boot, node: &str) -> Self {
        Self(File::open(Self::path(boot, node)).ok())
    }

    /// Says that everything from before this word of the clock was taken.
    pub fn tell(&self, clock_sequence: u64) {
        let _ = self.0.as_ref().map(|file| file.write_all_at(&clock_sequence.to_le_bytes(), 0));
    }

    /// The newest word of the clock up to which everything was taken.
    #[must_use]
    pub fn told(&self) -> Option<u64> {
        let mut bytes = [0; 8];
        self.0.as_ref()?.read_exact_at(&mut bytes, 0).ok()?;
        Some(u64::from_le_bytes(bytes))
    }
}

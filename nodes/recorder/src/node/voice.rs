//! What the recorder says of itself: of its files on `recording`, of its progress to a lockstep driver.

use crate::{Progress, Queue};
use sidestep_bus::{Bookmark, NodeError, Outbox, Step, pause};
use sidestep_msgs::Recording;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// `[s]` the black box speaks of its growth in steps of this size: each word makes other nodes say their state.
const HELD_STEP_S: f32 = 10.0;

/// Says on `recording` what has changed.
pub(super) struct Voice {
    pub(super) outbox: Outbox<Recording>,
    pub(super) progress: Arc<Progress>,
    pub(super) said: Recording,
    /// The file in the run's folder that names the newest snapshot.
    pub(super) word: PathBuf,
}

impl Voice {
    pub(super) fn tell(&mut self, step: &mut Step) -> Result<(), NodeError> {
        let (snapshots, snapshot_token, path) = self.progress.snapshots();
        let held_s = self.progress.held_s();
        let now = Recording { files: self.progress.files(), snapshots, snapshot_token, held_s, _pad: 0 };
        let grown = !step.is_lockstep() && (held_s - self.said.held_s).abs() >= HELD_STEP_S;
        if !grown && now == (Recording { held_s, ..self.said }) {
            return Ok(());
        }
        if let Some(path) = path.filter(|_| snapshots != self.said.snapshots) {
            let _ = std::fs::write(&self.word, path.display().to_string());
            eprintln!("snapshot: {}", path.display());
        }
        self.said = now;
        self.outbox.send(step, |recording| *recording = now)
    }
}

/// Tells a lockstep driver how far the recording has come, once the queue has room for what may follow; looks for that room
/// for a while, but not so long that the heart would stand still.
pub(super) fn mark(bookmark: &Bookmark, step: &Step, queue: &Queue) {
    let room = (0..20).any(|_| {
        queue.has_room() || {
            pause(Duration::from_millis(1));
            false
        }
    });
    if room {
        bookmark.tell(step.clock_sequence());
    }
}

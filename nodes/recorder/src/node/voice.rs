//! What the recorder says of its files and of its black box.

use crate::Progress;
use sidestep_bus::{NodeError, Outbox, Step};
use sidestep_msgs::Recording;
use std::path::PathBuf;
use std::sync::Arc;

/// `[s]` the black box speaks of its growth in steps of this size.
const HELD_STEP_S: f32 = 1.0;

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
        let grown = (held_s - self.said.held_s).abs() >= HELD_STEP_S;
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

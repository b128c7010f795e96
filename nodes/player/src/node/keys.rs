//! Keys of the launcher's terminal, one byte each, through a socket in the folder of the run.
//!
//! The terminal is the launcher's, the playback is this process. A datagram socket keeps nothing when either dies, needs no
//! handshake, and whoever may write into the folder of the run can press keys too.

use crate::Key;
use sidestep_bus::{Boot, NodeError};
use std::os::unix::net::UnixDatagram;

/// The player's end.
pub(super) struct Keys(UnixDatagram);

impl Keys {
    pub(super) fn listen(boot: &Boot) -> Result<Self, NodeError> {
        let path = boot.domain.root.join(crate::KEYS_SOCKET);
        let failed = |source| NodeError::File {
            path: path.display().to_string(),
            source,
            remedy: "the folder of the run must be writable",
        };
        // Left by an earlier life of this node.
        let _ = std::fs::remove_file(&path);
        let socket = UnixDatagram::bind(&path).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self(socket))
    }

    /// What was pressed since the last look.
    pub(super) fn pressed(&self) -> Vec<Key> {
        let mut keys = Vec::new();
        let mut bytes = [0; 64];
        while let Ok(count) = self.0.recv(&mut bytes) {
            keys.extend(bytes[..count].iter().filter_map(|byte| Key::from_byte(*byte)));
        }
        keys
    }
}

//! A run written down between two steps, so that going on gives the same bytes as never having stopped.

use crate::error::TrainError;
use crate::optimiser::Adam;
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// First bytes of the file.
const MAGIC: [u8; 8] = *b"SIDECHK2";

/// What identifies a run; a checkpoint of another one is refused.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Identity {
    pub(crate) magic: [u8; 8],
    /// Fingerprint of the dataset.
    pub(crate) dataset: u64,
    /// Robot that the labels are for.
    pub(crate) robot: u64,
    pub(crate) seed: u64,
    /// Samples of the whole schedule.
    pub(crate) samples: u64,
    /// Channels, rounds, hidden sizes, batch.
    pub(crate) shape: [u32; 5],
    /// Planes and stride of each convolution; zeros where there is none.
    pub(crate) convolutions: [[u32; 2]; Identity::CONVOLUTIONS],
    /// Learning rate, doubt weight, label kind.
    pub(crate) options: [f32; 3],
}

impl Identity {
    pub(crate) const MAGIC: [u8; 8] = MAGIC;
    /// Most convolutions of a run.
    pub(crate) const CONVOLUTIONS: usize = 4;
}

/// Everything that a run keeps between steps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Checkpoint {
    pub(crate) identity: Identity,
    pub(crate) seen: u64,
    pub(crate) parameters: Vec<f32>,
    pub(crate) adam: Adam,
}

impl Checkpoint {
    /// Writes beside the old file and then takes its place, so that a crash leaves one of the two whole.
    pub(crate) fn write(&self, path: &Path) -> Result<(), TrainError> {
        let mut bytes = bytemuck::bytes_of(&self.identity).to_vec();
        bytes.extend_from_slice(&self.seen.to_le_bytes());
        bytes.extend_from_slice(&self.adam.steps.to_le_bytes());
        for part in [&self.parameters, &self.adam.first, &self.adam.second] {
            bytes.extend_from_slice(bytemuck::cast_slice(part));
        }
        let fresh = path.with_extension("part");
        let failed = |source| TrainError::File { path: path.display().to_string(), source };
        std::fs::write(&fresh, &bytes).and_then(|()| std::fs::rename(&fresh, path)).map_err(failed)
    }

    /// Reads the checkpoint of the run `identity`; `None` where there is no file.
    pub(crate) fn read(path: &Path, identity: Identity, count: usize) -> Result<Option<Self>, TrainError> {
        let name = path.display().to_string();
        let bytes = match std::fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(TrainError::File { path: name, source }),
        };
        let head = size_of::<Identity>();
        let needed = head + 16 + 12 * count;
        if bytes.len() != needed || bytes[..head] != *bytemuck::bytes_of(&identity) {
            let found = format!("{} bytes of another run or other options", bytes.len());
            return Err(TrainError::Checkpoint {
                path: name,
                found,
                needed: format!("{needed} bytes of this run"),
            });
        }
        let number = |at: usize| bytes[at..at + 8].try_into().map(u64::from_le_bytes).unwrap_or_default();
        let part = |index: usize| -> Vec<f32> {
            let from = head + 16 + 4 * count * index;
            bytes[from..from + 4 * count].chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
        };
        let adam = Adam { first: part(1), second: part(2), steps: number(head + 8) };
        Ok(Some(Self { identity, seen: number(head), parameters: part(0), adam }))
    }
}

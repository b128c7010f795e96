//! All that a step keeps, as plain bytes, so that a recording can be replayed from its middle.

use crate::arbiter::{Arbiter, Memory};
use crate::clearance::{FreeSpace, Rows};
use bytemuck::Zeroable;

const MEMORY: usize = size_of::<Memory>();
const ROWS: usize = size_of::<Rows>();
/// Bytes of a state.
const SIZE: usize = MEMORY + 5 * ROWS;

const _: () = assert!(SIZE <= sidestep_msgs::ARBITER_STATE_BYTES);

impl Arbiter {
    /// Writes the state; returns the bytes used, 0 where there is no room.
    pub fn state(&self, out: &mut [u8]) -> usize {
        let Some(out) = out.get_mut(..SIZE) else { return 0 };
        let (memory, rows) = out.split_at_mut(MEMORY);
        memory.copy_from_slice(bytemuck::bytes_of(&self.memory));
        let FreeSpace { blocked, old, unknown, movers, .. } = &self.space;
        let parts = [blocked, old, unknown, &movers.sources, &movers.fixed];
        for (part, bytes) in parts.into_iter().zip(rows.chunks_exact_mut(ROWS)) {
            bytes.copy_from_slice(bytemuck::bytes_of(part));
        }
        SIZE
    }

    /// Takes a state written by [`Arbiter::state`] of the same version; returns false for bytes of another size.
    pub fn restore(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() != SIZE {
            return false;
        }
        let (memory, rows) = bytes.split_at(MEMORY);
        let mut kept = Memory::zeroed();
        bytemuck::bytes_of_mut(&mut kept).copy_from_slice(memory);
        self.memory = kept;
        let FreeSpace { blocked, old, unknown, movers, .. } = &mut self.space;
        let parts = [blocked, old, unknown, &mut movers.sources, &mut movers.fixed];
        for (part, bytes) in parts.into_iter().zip(rows.chunks_exact(ROWS)) {
            bytemuck::bytes_of_mut(part).copy_from_slice(bytes);
        }
        self.space.dilate();
        self.space.movers.grow();
        true
    }
}

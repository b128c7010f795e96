//! The mapper's state as plain bytes: what a recording keeps, so that a replay can begin in its middle.

use crate::grid::{CELLS, Grid};
use crate::history::History;
use crate::mapper::{Mapper, Memory};
use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};
use sidestep_msgs::MAPPER_STATE_BYTES;

/// Version of the layout below.
const VERSION: u64 = 0x6d61_7070_6572_0004;

/// Everything but the cells.
#[derive(Debug, Clone, Copy, Zeroable, Pod)]
#[repr(C)]
struct Head {
    version: u64,
    origin: [i32; 2],
    memory: Memory,
    history: History,
}

const HEAD: usize = size_of::<Head>();
const SIZE: usize = HEAD + CELLS * (4 + 4 + 4 + 1 + 4 + 4);
const _: () = assert!(SIZE <= MAPPER_STATE_BYTES);

impl Mapper {
    /// Writes all that the step keeps; returns the bytes used, 0 when there is no room.
    pub fn state(&self, out: &mut [u8]) -> usize {
        let Some(out) = out.get_mut(..SIZE) else { return 0 };
        let head =
            Head { version: VERSION, origin: self.grid.origin(), memory: self.memory, history: self.history };
        let grid = &self.grid;
        let parts: [&[u8]; 7] = [
            bytes_of(&head),
            cast_slice(&grid.log_odds),
            cast_slice(&grid.seen_tick),
            cast_slice(&grid.drift_m),
            &grid.bands,
            cast_slice(&grid.changed_tick),
            cast_slice(&grid.sonar_tick),
        ];
        let mut rest = out;
        for part in parts {
            let (here, after) = rest.split_at_mut(part.len());
            here.copy_from_slice(part);
            rest = after;
        }
        SIZE
    }

    /// Continues from bytes that [`Mapper::state`] wrote; on anything else returns false and changes nothing.
    pub fn restore(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() < SIZE {
            return false;
        }
        let (head, cells) = bytes[..SIZE].split_at(HEAD);
        let head: Head = bytemuck::pod_read_unaligned(head);
        let (log_odds, rest) = cells.split_at(4 * CELLS);
        let (seen_tick, rest) = rest.split_at(4 * CELLS);
        let (drift_m, rest) = rest.split_at(4 * CELLS);
        let (bands, rest) = rest.split_at(CELLS);
        let (changed_tick, sonar_tick) = rest.split_at(4 * CELLS);
        let within = |cell: &[u8]| f32::from_ne_bytes([cell[0], cell[1], cell[2], cell[3]]).abs() < 1e6;
        let finite = log_odds.chunks_exact(4).chain(drift_m.chunks_exact(4)).all(within);
        let placed = head.origin.iter().all(|part| part.abs_diff(0) < 1 << 28);
        let sound = head.history.is_sound()
            && head.memory.pose.is_finite()
            && head.memory.drift_m.is_finite()
            && head.memory.turned_m.is_finite();
        if head.version != VERSION || !(finite && placed && sound) {
            return false;
        }
        let grid: &mut Grid = &mut self.grid;
        bytemuck::cast_slice_mut(&mut grid.log_odds).copy_from_slice(log_odds);
        bytemuck::cast_slice_mut(&mut grid.seen_tick).copy_from_slice(seen_tick);
        bytemuck::cast_slice_mut(&mut grid.drift_m).copy_from_slice(drift_m);
        grid.bands.copy_from_slice(bands);
        bytemuck::cast_slice_mut(&mut grid.changed_tick).copy_from_slice(changed_tick);
        bytemuck::cast_slice_mut(&mut grid.sonar_tick).copy_from_slice(sonar_tick);
        grid.place(head.origin);
        self.memory = head.memory;
        self.history = head.history;
        self.look_again();
        true
    }
}

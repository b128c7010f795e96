//! Our map as ROS has maps: the one place that says which cell is which and what its number means.

use crate::messages::{MapMetaData, Time, Transform};
use crate::rigid::Rigid;
use sidestep_msgs::{AGE_NEVER, Grid};

/// What a cell that was never seen is in ROS: -1 as a byte.
const UNKNOWN: u8 = 255;

/// Cells of a map in the order of ROS: row by row along y from the right, each row along x from the rear; 0 to 100,
/// and -1 where the cell was never seen.
pub(crate) fn cells(grid: &Grid, occupancy: &[u8], age: &[u8]) -> Vec<u8> {
    let side = grid.side;
    let cell = |place: usize| {
        let (left, forward) = (place / side, place % side);
        let ours = (side - 1 - forward) * side + (side - 1 - left);
        let percent = (u32::from(occupancy[ours]) * 100 + 127) / 255;
        if age[ours] == AGE_NEVER { UNKNOWN } else { percent as u8 }
    };
    (0..side * side).map(cell).collect()
}

/// Size and place of a map in `base_link`: its origin is the corner of the first cell, rear and right.
pub(crate) fn metadata(grid: &Grid, stamp: Time) -> MapMetaData {
    let corner = [f64::from(grid.rear_m), f64::from(grid.right_m), 0.0];
    MapMetaData {
        map_load_time: stamp,
        resolution: grid.cell_m,
        width: grid.side as u32,
        height: grid.side as u32,
        origin: Transform::from(Rigid { translation_m: corner, ..Rigid::IDENTITY }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, SAFETY_CELLS, SAFETY_GRID};

    /// Marks one point at a time; a reader of ROS must find it where it is.
    #[test]
    fn what_is_ahead_and_to_the_left_is_there_for_ros_too() {
        for (grid, count) in [(LOCAL_GRID, LOCAL_CELLS), (SAFETY_GRID, SAFETY_CELLS)] {
            for (x_m, y_m) in [(1.83, 0.47), (0.31, -1.12), (-0.22, 0.93)] {
                let (mut occupancy, mut age) = (vec![0; count], vec![0; count]);
                occupancy[grid.index(x_m, y_m).unwrap()] = 255;
                age[grid.index(0.07, 0.07).unwrap()] = AGE_NEVER;
                let info = metadata(&grid, Time::default());
                let at = |x_m: f32, y_m: f32| {
                    let column = (f64::from(x_m) - info.origin.translation.x) / f64::from(info.resolution);
                    let row = (f64::from(y_m) - info.origin.translation.y) / f64::from(info.resolution);
                    row as usize * info.width as usize + column as usize
                };
                let cells = cells(&grid, &occupancy, &age);
                let occupied: Vec<usize> = (0..count).filter(|&cell| cells[cell] == 100).collect();
                assert_eq!(occupied, [at(x_m, y_m)], "{x_m}, {y_m}");
                let unknown: Vec<usize> = (0..count).filter(|&cell| cells[cell] as i8 == -1).collect();
                assert_eq!(unknown, [at(0.07, 0.07)]);
            }
        }
    }
}

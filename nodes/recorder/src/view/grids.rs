//! Maps as grids.
//!
//! A map of the graph begins at its far left corner, row by row towards the robot. A grid begins at the corner of its
//! pose, here the rear right one in the map's frame; its columns run along x, its rows along y. So row and column change
//! places.

use super::Seen;
use super::channels::{LOCAL, SAFETY};
use super::file_time::FileTime;
use super::shapes::{BASE, ODOM, pose};
use super::sheet::Sheet;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{Grid, PackedElementField, Timestamp, Vector2};
use sidestep_msgs::{LOCAL_GRID, LOCAL_MAP, Pose2, SAFETY_GRID, SAFETY_MAP};

pub(crate) fn take(seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
    if let Some(map) = seen.read(LOCAL_MAP) {
        let layers: [(&str, &[u8]); 3] =
            [("occupancy", &map.occupancy), ("planning_cost", &map.planning_cost), ("age", &map.age)];
        sheet.put(LOCAL, &grid(&LOCAL_GRID, BASE, &Pose2::ORIGIN, &layers, time.stamp(map.capture_ns)));
    } else if let Some(map) = seen.read(SAFETY_MAP) {
        let layers: [(&str, &[u8]); 3] =
            [("occupancy", &map.occupancy), ("age", &map.age), ("still", &map.still)];
        sheet.put(SAFETY, &grid(&SAFETY_GRID, ODOM, &map.frame(), &layers, time.stamp(map.capture_ns)));
    }
}

/// Layers of one map, whose frame lies at a pose in `parent`, side by side in each cell.
fn grid(
    map: &sidestep_msgs::Grid,
    parent: &str,
    frame: &Pose2,
    layers: &[(&str, &[u8])],
    stamp: Option<Timestamp>,
) -> Grid {
    let (side, stride) = (map.side, layers.len());
    let mut data = vec![0; side * side * stride];
    for (layer, (_, cells)) in layers.iter().enumerate() {
        for (row, line) in cells.chunks_exact(side).enumerate() {
            let forward = side - 1 - row;
            for (col, &cell) in line.iter().enumerate() {
                let left = side - 1 - col;
                data[(left * side + forward) * stride + layer] = cell;
            }
        }
    }
    let cell_m = f64::from(map.cell_m);
    let field = |(offset, (name, _)): (usize, &(&str, &[u8]))| PackedElementField {
        name: (*name).into(),
        offset: offset as u32,
        r#type: NumericType::Uint8 as i32,
    };
    Grid {
        timestamp: stamp,
        frame_id: parent.into(),
        pose: Some(pose(&frame.compose(&Pose2::new(map.rear_m.into(), map.right_m.into(), 0.0)), 0.0)),
        column_count: side as u32,
        cell_size: Some(Vector2 { x: cell_m, y: cell_m }),
        row_stride: (side * stride) as u32,
        cell_stride: stride as u32,
        fields: layers.iter().enumerate().map(field).collect(),
        data: data.into(),
    }
}

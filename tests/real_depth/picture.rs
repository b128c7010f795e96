//! Pictures of maps, for looking at: written where `SIDESTEP_PICTURES` points, nowhere without it.

use super::batch::{Batch, Seen};
use sidestep_msgs::{AGE_NEVER, DepthFrame, SAFETY_GRID, SAFETY_SIDE, SafetyMap};

/// `[px]` side of a cell.
const SCALE: usize = 6;

fn write(name: &str, width: usize, height: usize, rgb: &[u8]) {
    let Some(folder) = std::env::var_os("SIDESTEP_PICTURES") else { return };
    let path = std::path::PathBuf::from(folder).join(format!("{name}.png"));
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(rgb).unwrap();
}

/// A safety map: white free, black occupied, blue unknown; beside it the batch in the same frame, if there is one.
pub(crate) fn safety(name: &str, map: &SafetyMap, batch: Option<&Batch>) {
    let side = SAFETY_SIDE * SCALE;
    let mut rgb = vec![90; 2 * side * side * 3];
    let mut paint = |left: usize, row: usize, col: usize, colour: [u8; 3]| {
        for place in 0..SCALE * SCALE {
            let (y, x) = (row * SCALE + place / SCALE, left + col * SCALE + place % SCALE);
            rgb[(y * 2 * side + x) * 3..][..3].copy_from_slice(&colour);
        }
    };
    for index in 0..SAFETY_SIDE * SAFETY_SIDE {
        let shade = 255 - map.occupancy[index];
        let unknown = map.age[index] == AGE_NEVER && map.occupancy[index] <= super::OCCUPIED;
        let colour = if unknown { [90, 90, 140] } else { [shade; 3] };
        paint(0, index / SAFETY_SIDE, index % SAFETY_SIDE, colour);
    }
    for (seen, x_m, y_m) in batch.iter().flat_map(|batch| batch.cells()) {
        let (x, y) = map.frame().inverse_transform(x_m, y_m);
        if let Some((row, col)) = SAFETY_GRID.row_col(x as f32, y as f32) {
            paint(side, row, col, if seen == Seen::Occupied { [200, 0, 0] } else { [230, 255, 230] });
        }
    }
    write(name, 2 * side, side, &rgb);
}

/// A depth frame: near bright, far dark, missing blue.
pub(crate) fn depth(name: &str, frame: &DepthFrame) {
    let colour = |&raw: &u16| {
        let m = f32::from(raw) * frame.metres_per_unit;
        let shade = (255.0 - 255.0 * (m / 4.0).min(1.0)) as u8;
        if raw == 0 || raw == u16::MAX { [0, 0, 120] } else { [shade; 3] }
    };
    let rgb: Vec<u8> = frame.used_pixels().iter().flat_map(colour).collect();
    write(name, frame.width as usize, frame.height as usize, &rgb);
}

//! Draws one moment of a recording: depth image, map, goal, both proposals and the command:
//! `cargo run --release -p sidestep-compare --example moment RECORDING.mcap FRAME > FILE.svg`.
#![allow(clippy::print_stdout, reason = "the picture is the output")]

use sidestep_compare::{Options, Rank, compare};
use sidestep_msgs::{DEPTH, DepthFrame, Robot};
use sidestep_player::{Messages, attachment};
use sidestep_report::{Figure, Picture};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Pixels of the depth image that become one of the picture.
const BIN: usize = 4;
/// `[m]` range of the colours.
const NEAR_M: f32 = 0.4;
const FAR_M: f32 = 4.5;
/// Steps of colour; few steps make a small file.
const STEPS: f32 = 24.0;
/// Colours from near to far, light to dark, told apart by lightness alone (after the palette cividis).
const PALETTE: [[f32; 3]; 5] = [
    [255.0, 234.0, 70.0],
    [203.0, 186.0, 105.0],
    [124.0, 123.0, 120.0],
    [62.0, 74.0, 106.0],
    [0.0, 32.0, 76.0],
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let needed = "needed: RECORDING.mcap FRAME, where FRAME is the number of a depth frame or `worst`";
    let file = PathBuf::from(arguments.next().ok_or(needed)?);
    let wanted = arguments.next().unwrap_or_else(|| "worst".to_owned());
    let options =
        Options { file: file.clone(), other: None, worst: 100, rank: Rank::Disagreement, mine: None };
    let comparison = compare(&options)?;
    let shown = match wanted.parse::<u64>() {
        Ok(number) => comparison.worst.iter().min_by_key(|shown| shown.frame.abs_diff(number)),
        Err(_) => comparison.worst.first(),
    }
    .ok_or("no frame to draw")?;
    let robot = String::from_utf8(attachment(&file, "robot.toml")?)?;
    let robot = Robot::from_toml("robot.toml", &robot)?;
    let map = shown.figure(&robot.footprint.polygon_m, ["policy", "expert"])?;
    let depth = depth_picture(&file, shown.frame)?;
    println!("{}", Figure::sheet("One moment of a recording", &[depth, map], 2).svg());
    Ok(())
}

/// The depth frame of this number.
fn depth_picture(file: &Path, number: u64) -> Result<Figure, Box<dyn Error>> {
    let mut frame: Box<DepthFrame> = Box::new(bytemuck::Zeroable::zeroed());
    for entry in Messages::open(file)? {
        let entry = entry?;
        if entry.header.sequence == number && entry.read_into(DEPTH, &mut frame) {
            break;
        }
    }
    let (width, height) = (frame.width as usize, frame.height as usize);
    let (columns, rows) = (width / BIN, height / BIN);
    let mut rgba = Vec::with_capacity(4 * columns * rows);
    for cell in 0..columns * rows {
        let (row, column) = (cell / columns * BIN, cell % columns * BIN);
        // The nearest of the pixels: what is thin stays visible.
        let pixels = (0..BIN * BIN).map(|k| frame.pixels[(row + k / BIN) * width + column + k % BIN]);
        let nearest = pixels.filter(|pixel| *pixel != 0 && *pixel != u16::MAX).min();
        let range_m = nearest.map(|pixel| f32::from(pixel) * frame.metres_per_unit);
        rgba.extend(range_m.map_or([128, 128, 128, 60], colour));
    }
    let title = format!("Depth, {width}x{height}, {NEAR_M} m (bright) to {FAR_M} m (dark)");
    Ok(Picture { title, width: columns as u32, height: rows as u32, rgba, shown_width: 480.0 }.figure()?)
}

fn colour(range_m: f32) -> [u8; 4] {
    let part = ((range_m - NEAR_M) / (FAR_M - NEAR_M)).clamp(0.0, 1.0);
    let place = (part * STEPS).round() / STEPS * (PALETTE.len() - 1) as f32;
    let below = (place as usize).min(PALETTE.len() - 2);
    let mix = |i: usize| {
        let (from, to) = (PALETTE[below][i], PALETTE[below + 1][i]);
        (from + (to - from) * (place - below as f32)).round() as u8
    };
    [mix(0), mix(1), mix(2), 255]
}

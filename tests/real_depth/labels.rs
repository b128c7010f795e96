//! Rectangles drawn by hand on depth images, and what a map says where they are.

use super::{CLEAR_BELOW, OCCUPIED};
use serde::Deserialize;
use sidestep_msgs::{AGE_NEVER, DepthFrame, SAFETY_GRID, SAFETY_SIDE, SafetyMap};
use std::collections::BTreeMap;

/// Pixels of a rectangle in one cell that make the cell part of it.
const PIXELS_MIN: u32 = 6;

/// What a rectangle shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Thing {
    Floor,
    Obstacle,
}

/// A rectangle of an image.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Label {
    pub(crate) image: usize,
    pub(crate) name: String,
    pub(crate) is: Thing,
    /// `[px]` left, top, right, bottom.
    rectangle: [usize; 4],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    label: Vec<Label>,
}

/// The labels of a file.
pub(crate) fn read(path: &std::path::Path) -> Vec<Label> {
    toml::from_str::<File>(&std::fs::read_to_string(path).unwrap()).unwrap().label
}

/// What the map says in the cells of a label.
#[derive(Debug, Default)]
pub(crate) struct Verdict {
    pub(crate) cells: u32,
    /// Cells with an occupied one within one cell.
    pub(crate) near_occupied: u32,
    pub(crate) occupied: u32,
    pub(crate) free: u32,
}

impl Label {
    /// Cells of the map that hold pixels of the rectangle.
    fn cells(&self, frame: &DepthFrame, map: &SafetyMap) -> Vec<usize> {
        let [left, top, right, bottom] = self.rectangle;
        let rotation = frame.camera.rotation();
        let mut counts = BTreeMap::<usize, u32>::new();
        for (v, u) in (top..bottom).flat_map(|v| (left..right).map(move |u| (v, u))) {
            let raw = frame.pixels[v * frame.width as usize + u];
            let z = f32::from(raw) * frame.metres_per_unit;
            if raw == u16::MAX || !(0.35..3.0).contains(&z) {
                continue;
            }
            let x = (u as f32 - frame.cx_px) / frame.fx_px * z;
            let y = (v as f32 - frame.cy_px) / frame.fy_px * z;
            let body = [0, 1].map(|i| rotation[i][0] * x + rotation[i][1] * y + rotation[i][2] * z);
            let (x, y) = map.base.transform(body[0].into(), body[1].into());
            let (x, y) = map.frame().inverse_transform(x, y);
            if x.abs().max(y.abs()) < 1.9
                && let Some(cell) = SAFETY_GRID.index(x as f32, y as f32)
            {
                *counts.entry(cell).or_default() += 1;
            }
        }
        counts.into_iter().filter(|(_, count)| *count >= PIXELS_MIN).map(|(cell, _)| cell).collect()
    }

    /// Asks the map, which must be of the same image.
    pub(crate) fn ask(&self, frame: &DepthFrame, map: &SafetyMap) -> Verdict {
        let is_occupied = |at: usize| map.occupancy[at] > OCCUPIED;
        let mut verdict = Verdict::default();
        for cell in self.cells(frame, map) {
            let (row, col) = (cell / SAFETY_SIDE, cell % SAFETY_SIDE);
            let mut near = (row - 1..=row + 1)
                .flat_map(|row| (col - 1..=col + 1).map(move |col| row * SAFETY_SIDE + col));
            verdict.cells += 1;
            verdict.near_occupied += u32::from(near.any(is_occupied));
            verdict.occupied += u32::from(is_occupied(cell));
            verdict.free += u32::from(map.age[cell] != AGE_NEVER && map.occupancy[cell] < CLEAR_BELOW);
        }
        verdict
    }
}

//! Products of matrices for layers that see many samples at once: forward, and backward to input and weights.
//!
//! Sixteen outputs share a register; four rows and up to four registers of outputs are summed at once. Every sum is a
//! chain of multiply-adds in one fixed order, so neither the width of a register nor the number of threads changes a bit.

use crate::layer::Layer;
use crate::line::{LANES, Line};
use bytemuck::{cast_slice, cast_slice_mut};
use sidestep_policy::on_lanes;

/// Registers of outputs that are summed at once.
pub(crate) const GROUPS: usize = 4;
/// Rows that are summed at once; the cells of a layer must be a multiple.
pub(crate) const ROWS: usize = 4;
/// Longest part of a row whose weights for all groups, 24 KB, stay in the first cache while all cells pass.
const PART: usize = 96;
/// Cells whose slopes stay there while all weights pass.
const CELLS: usize = 96;

/// The outputs that are summed at once.
pub(crate) type Set = [Line; GROUPS];
/// Their sums, by group and row.
type Tile = [[Line; ROWS]; GROUPS];

const EMPTY: Tile = [[Line::ZERO; ROWS]; GROUPS];

on_lanes! {
    /// The sums of the first `samples` samples from their input.
    pub(crate) fn forward(layer: &mut Layer, wide: bool, samples: usize) = forward_body
}

on_lanes! {
    /// From the slopes of those sums to those of the input.
    pub(crate) fn backward(layer: &mut Layer, wide: bool, samples: usize) = backward_body
}

on_lanes! {
    /// Adds the slopes of weights and biases, which all cells share.
    pub(crate) fn collect(layer: &Layer, wide: bool, samples: usize, weight: &mut [f32], bias: &mut [f32]) = collect_body
}

on_lanes! {
    /// Hands what `layer` makes to the next one, cut off below zero (ReLU).
    pub(crate) fn hand_on(layer: &Layer, next: &mut Layer, samples: usize) = hand_on_body
}

on_lanes! {
    /// Hands the slopes of the input of `next` back: none where it was cut off.
    pub(crate) fn hand_back(layer: &mut Layer, next: &Layer, samples: usize) = hand_back_body
}

#[inline(always)]
fn add(sums: &mut [f32], Line(lane): &Line) {
    if let Some(sums) = sums.first_chunk_mut::<LANES>() {
        *sums = std::array::from_fn(|index| sums[index] + lane[index]);
    } else {
        for (sum, value) in sums.iter_mut().zip(lane) {
            *sum += value;
        }
    }
}

/// Calls `$body` for as many groups at once as registers hold, and otherwise for one after the other.
macro_rules! by_groups {
    ($wide:expr, $groups:expr, $body:ident::<$fused:ident>($($argument:expr),*)) => {
        match ($wide, $groups) {
            (true, 3..) => $body::<$fused, 4>(0, $($argument),*),
            (true, 2) => $body::<$fused, 2>(0, $($argument),*),
            _ => {
                for group in 0..$groups {
                    $body::<$fused, 1>(group, $($argument),*);
                }
            }
        }
    };
}

/// The products of four rows with `N` groups of weights.
#[inline(always)]
fn multiply_rows<const FUSED: bool, const N: usize>(
    group: usize,
    rows: [&[f32]; ROWS],
    weights: &[Set],
    tile: &mut Tile,
) {
    let mut sums = [[Line::ZERO; ROWS]; N];
    let rows = rows.map(|row| &row[..weights.len()]);
    for (place, weights) in weights.iter().enumerate() {
        for n in 0..N {
            for row in 0..ROWS {
                let factor = Line([rows[row][place]; LANES]);
                sums[n][row] = sums[n][row].plus_product::<FUSED>(weights[group + n], factor);
            }
        }
    }
    tile[group..group + N].copy_from_slice(&sums);
}

#[inline(always)]
fn forward_body<const FUSED: bool>(layer: &mut Layer, wide: bool, samples: usize) {
    // The last quad may reach into samples that are not asked for: what they come to is never read.
    let cells = (samples * layer.made).next_multiple_of(ROWS);
    let Layer { window, groups, starts, input, weights, bias, sums, .. } = layer;
    let input: &[f32] = cast_slice(input);
    let sums = &mut sums[..cells * *groups];
    let (starts, _) = starts[..cells].as_chunks::<ROWS>();
    for cell in sums.chunks_exact_mut(*groups) {
        cell.copy_from_slice(bias);
    }
    for (weights, first) in weights.chunks_exact(window.places()).zip((0..*groups).step_by(GROUPS)) {
        let count = GROUPS.min(*groups - first);
        for (row, weights) in weights.chunks_exact(window.run).enumerate() {
            for (part, weights) in weights.chunks(PART).enumerate() {
                let shift = row * window.pitch + part * PART;
                for (quad, starts) in starts.iter().enumerate() {
                    let rows = starts.map(|start| &input[start + shift..][..weights.len()]);
                    let mut tile = EMPTY;
                    by_groups!(wide, count, multiply_rows::<FUSED>(rows, weights, &mut tile));
                    for cell in 0..ROWS {
                        let sums = &mut sums[(quad * ROWS + cell) * *groups + first..][..count];
                        for (sum, tile) in sums.iter_mut().zip(&tile) {
                            *sum = sum.plus(tile[cell]);
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn backward_body<const FUSED: bool>(layer: &mut Layer, wide: bool, samples: usize) {
    let cells = (samples * layer.made).next_multiple_of(ROWS);
    let Layer { window, outputs, groups, size, starts, slopes, transposed, sums, .. } = layer;
    let slopes: &mut [f32] = cast_slice_mut(slopes);
    slopes[..samples * *size].fill(0.0);
    let sums = &sums[..cells * *groups];
    let (starts, _) = starts[..cells].as_chunks::<ROWS>();
    let sets = window.sets();
    for (set, weights) in transposed.chunks_exact(*outputs).enumerate() {
        let (row, from) = (set / sets, set % sets * LANES * GROUPS);
        let count = GROUPS.min((window.run - from).div_ceil(LANES));
        for (starts, sums) in starts.iter().zip(sums.chunks_exact(ROWS * *groups)) {
            let rows = std::array::from_fn(|cell| cast_slice(&sums[cell * *groups..][..*groups]));
            let mut tile = EMPTY;
            by_groups!(wide, count, multiply_rows::<FUSED>(rows, weights, &mut tile));
            for (group, tile) in tile.iter().enumerate().take(count) {
                let shift = row * window.pitch + from + group * LANES;
                for (start, lane) in starts.iter().zip(tile) {
                    add(&mut slopes[start + shift..][..LANES], lane);
                }
            }
        }
    }
}

/// The products of four numbers of each cell's input with `N` groups of its slopes, over all cells.
#[inline(always)]
fn multiply_cells<const FUSED: bool, const N: usize>(
    group: usize,
    input: &[f32],
    starts: &[usize],
    slopes: &[Line],
    stride: usize,
    tile: &mut Tile,
) {
    let mut sums = [[Line::ZERO; ROWS]; N];
    for (start, slopes) in starts.iter().zip(slopes.chunks(stride)) {
        let (input, slopes) = (&input[*start..][..ROWS], &slopes[group..][..N]);
        for n in 0..N {
            for row in 0..ROWS {
                let factor = Line([input[row]; LANES]);
                sums[n][row] = sums[n][row].plus_product::<FUSED>(slopes[n], factor);
            }
        }
    }
    tile[group..group + N].copy_from_slice(&sums);
}

#[inline(always)]
fn collect_body<const FUSED: bool>(
    layer: &Layer,
    wide: bool,
    samples: usize,
    weight: &mut [f32],
    bias: &mut [f32],
) {
    let Layer { window, outputs, made, groups, starts, input, sums, .. } = layer;
    let input: &[f32] = cast_slice(input);
    let cells = samples * made;
    let sums = &sums[..cells * *groups];
    for (starts, slopes) in starts[..cells].chunks(CELLS).zip(sums.chunks(CELLS * *groups)) {
        for (group, bias) in bias.chunks_mut(LANES).enumerate() {
            let mut sum = Line::ZERO;
            for cell in slopes.chunks_exact(*groups) {
                add(&mut sum.0, &cell[group]);
            }
            add(bias, &sum);
        }
        for first in (0..*groups).step_by(GROUPS) {
            let (count, slopes) = (GROUPS.min(*groups - first), &slopes[first..]);
            for (row, weight) in weight.chunks_exact_mut(window.run * *outputs).enumerate() {
                for (quad, weight) in weight.chunks_mut(ROWS * *outputs).enumerate() {
                    let input = &input[row * window.pitch + quad * ROWS..];
                    let mut tile = EMPTY;
                    by_groups!(
                        wide,
                        count,
                        multiply_cells::<FUSED>(input, starts, slopes, *groups, &mut tile)
                    );
                    for (row, weight) in weight.chunks_exact_mut(*outputs).enumerate() {
                        let weight = weight[first * LANES..].chunks_mut(LANES);
                        for (weight, tile) in weight.zip(&tile) {
                            add(weight, &tile[row]);
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn hand_on_body<const FUSED: bool>(layer: &Layer, next: &mut Layer, samples: usize) {
    let input: &mut [f32] = cast_slice_mut(&mut next.input);
    let entries = &next.entries[..samples * layer.made];
    for (sums, entry) in layer.sums.chunks_exact(layer.groups).zip(entries) {
        let sums: &[f32] = cast_slice(sums);
        for (to, sum) in input[*entry..][..layer.outputs].iter_mut().zip(sums) {
            *to = if *sum > 0.0 { *sum } else { 0.0 };
        }
    }
}

#[inline(always)]
fn hand_back_body<const FUSED: bool>(layer: &mut Layer, next: &Layer, samples: usize) {
    let (input, slopes): (&[f32], &[f32]) = (cast_slice(&next.input), cast_slice(&next.slopes));
    let entries = &next.entries[..samples * layer.made];
    for (sums, entry) in layer.sums.chunks_exact_mut(layer.groups).zip(entries) {
        let sums: &mut [f32] = cast_slice_mut(sums);
        let span = *entry..entry + layer.outputs;
        for ((sum, value), slope) in sums.iter_mut().zip(&input[span.clone()]).zip(&slopes[span]) {
            *sum = if *value > 0.0 { *slope } else { 0.0 };
        }
    }
}

//! The convolutions of the head, fused with their ReLU and vectorised over the planes they make.
//!
//! Planes are channel-last with a border of zeros, so the neighbourhood of an output cell is three runs of numbers. Each
//! output is one chain, bias first, then the neighbourhood in order: neither the width of a vector nor the number of
//! cells computed at once changes a bit. Measured: `benches/step.rs`.

use crate::lanes::{Lanes, multiply_add};
use crate::network::{CROP_PLANES, ConvolutionLayer, convolved};

/// Output planes whose weights lie side by side.
const GROUP: usize = 16;

/// A convolution, its weights packed so that a group of planes reads memory in order.
#[derive(Debug, Clone, PartialEq)]
struct PackedConvolution {
    /// Numbers per cell of the input.
    inputs: usize,
    stride: usize,
    /// Rows and columns of the input, and of the output.
    from: [usize; 2],
    to: [usize; 2],
    /// Groups x 3 x 3 x inputs.
    weight: Vec<[f32; GROUP]>,
    /// Padded to whole groups.
    bias: Vec<[f32; GROUP]>,
}

impl PackedConvolution {
    /// Packs `layer` for an input of `inputs` numbers per cell, those beyond the layer's own being padding.
    fn new(layer: &ConvolutionLayer, inputs: usize, from: [usize; 2]) -> Self {
        let groups = layer.outputs.div_ceil(GROUP);
        let mut weight = vec![[0.0; GROUP]; groups * 9 * inputs];
        for (index, value) in layer.weight.iter().enumerate() {
            let (output, input, tap) = (index / (layer.inputs * 9), index / 9 % layer.inputs, index % 9);
            weight[(output / GROUP * 9 + tap) * inputs + input][output % GROUP] = *value;
        }
        let mut bias = vec![[0.0; GROUP]; groups];
        for (output, value) in layer.bias.iter().enumerate() {
            bias[output / GROUP][output % GROUP] = *value;
        }
        Self { inputs, stride: layer.stride, from, to: convolved(from, layer.stride), weight, bias }
    }

    /// Numbers per cell of the output.
    fn outputs(&self) -> usize {
        self.bias.len() * GROUP
    }

    /// Where the neighbourhood of an output cell begins in the input.
    #[inline(always)]
    fn neighbourhood(&self, cell: usize) -> usize {
        let (row, column) = (cell / self.to[1] * self.stride, cell % self.to[1] * self.stride);
        (row * (self.from[1] + 2) + column) * self.inputs
    }

    /// Where an output cell is in the output.
    #[inline(always)]
    fn place(&self, cell: usize) -> usize {
        bordered_place(self.to, cell) * self.outputs()
    }
}

/// Index of a cell among those of planes with a border.
#[inline(always)]
fn bordered_place(size: [usize; 2], cell: usize) -> usize {
    (cell / size[1] + 1) * (size[1] + 2) + cell % size[1] + 1
}

/// Numbers of planes with a border.
fn bordered(size: [usize; 2], numbers: usize) -> usize {
    (size[0] + 2) * (size[1] + 2) * numbers
}

/// A chain of convolutions, each with a ReLU behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvolutionChain {
    layers: Vec<PackedConvolution>,
    size: [usize; 2],
    /// Planes made, padding left out.
    outputs: usize,
}

/// The memory that a chain works in.
#[derive(Debug, Clone)]
pub struct ConvolutionScratch {
    /// The input and what each layer makes, with borders of zeros that nothing writes to.
    planes: Vec<Vec<f32>>,
}

impl ConvolutionChain {
    /// Packs layers for planes of `size`, rows and columns; the first reads [`CROP_PLANES`], each other one what is
    /// made before it.
    #[must_use]
    pub fn new(layers: &[ConvolutionLayer], size: [usize; 2]) -> Self {
        let (mut inputs, mut from) = (CROP_PLANES, size);
        let pack = |layer: &ConvolutionLayer| {
            let packed = PackedConvolution::new(layer, inputs, from);
            (inputs, from) = (packed.outputs(), packed.to);
            packed
        };
        let outputs = layers.last().map_or(CROP_PLANES, |layer| layer.outputs);
        Self { layers: layers.iter().map(pack).collect(), size, outputs }
    }

    /// Planes, rows and columns that it makes.
    #[must_use]
    pub fn shape(&self) -> [usize; 3] {
        let [rows, columns] = self.layers.last().map_or(self.size, |layer| layer.to);
        [self.outputs, rows, columns]
    }

    /// Memory for one run at a time.
    #[must_use]
    pub fn scratch(&self) -> ConvolutionScratch {
        let input = std::iter::once(vec![0.0; bordered(self.size, CROP_PLANES)]);
        let made = self.layers.iter().map(|layer| vec![0.0; bordered(layer.to, layer.outputs())]);
        ConvolutionScratch { planes: input.chain(made).collect() }
    }

    /// Convolves `planes`; input and output are plane after plane, row by row, other lengths compute nothing.
    pub fn run(
        &self,
        lanes: Lanes,
        planes: [&[f32]; CROP_PLANES],
        scratch: &mut ConvolutionScratch,
        out: &mut [f32],
    ) {
        let cells = self.size[0] * self.size[1];
        if planes.iter().any(|plane| plane.len() != cells)
            || out.len() != self.shape().iter().product::<usize>()
        {
            return;
        }
        for (index, plane) in planes.iter().enumerate() {
            for (cell, value) in plane.iter().enumerate() {
                scratch.planes[0][bordered_place(self.size, cell) * CROP_PLANES + index] = *value;
            }
        }
        for (index, layer) in self.layers.iter().enumerate() {
            let [from, to] = &mut scratch.planes[index..index + 2] else { continue };
            convolution(lanes, layer, lanes.floats() >= GROUP, from, to);
        }
        let (Some(made), Some(layer)) = (scratch.planes.last(), self.layers.last()) else { return };
        let cells = layer.to[0] * layer.to[1];
        for cell in 0..cells {
            for (plane, value) in made[layer.place(cell)..][..self.outputs].iter().enumerate() {
                out[plane * cells + cell] = *value;
            }
        }
    }
}

on_lanes! {
    fn convolution(layer: &PackedConvolution, wide: bool, from: &[f32], to: &mut [f32]) = convolution_body
}

/// As many sums at once as fit the vector registers beside the weights: twenty of thirty-two where one holds a group, else
/// ten of sixteen.
#[inline(always)]
fn convolution_body<const FUSED: bool>(layer: &PackedConvolution, wide: bool, from: &[f32], to: &mut [f32]) {
    if wide {
        let pairs = layer.bias.len() / 2;
        for pair in 0..pairs {
            all_cells::<FUSED, 2, 10>(layer, 2 * pair, from, to);
        }
        if layer.bias.len() > 2 * pairs {
            all_cells::<FUSED, 1, 10>(layer, 2 * pairs, from, to);
        }
    } else {
        for group in 0..layer.bias.len() {
            all_cells::<FUSED, 1, 5>(layer, group, from, to);
        }
    }
}

/// `GROUPS` groups of planes, `CELLS` cells at once.
#[inline(always)]
fn all_cells<const FUSED: bool, const GROUPS: usize, const CELLS: usize>(
    layer: &PackedConvolution,
    group: usize,
    from: &[f32],
    to: &mut [f32],
) {
    let cells = layer.to[0] * layer.to[1];
    let whole = cells - cells % CELLS;
    for cell in (0..whole).step_by(CELLS) {
        some_cells::<FUSED, GROUPS, CELLS>(layer, group, cell, from, to);
    }
    for cell in whole..cells {
        some_cells::<FUSED, GROUPS, 1>(layer, group, cell, from, to);
    }
}

/// The cells from `cell` on share the loads of the weights.
#[inline(always)]
fn some_cells<const FUSED: bool, const GROUPS: usize, const CELLS: usize>(
    layer: &PackedConvolution,
    group: usize,
    cell: usize,
    from: &[f32],
    to: &mut [f32],
) {
    let run = 3 * layer.inputs;
    let starts: [usize; CELLS] = std::array::from_fn(|index| layer.neighbourhood(cell + index));
    let bias: [[f32; GROUP]; GROUPS] = std::array::from_fn(|index| layer.bias[group + index]);
    let mut sums = [bias; CELLS];
    for row in 0..3 {
        let weights: [&[[f32; GROUP]]; GROUPS] =
            std::array::from_fn(|index| &layer.weight[((group + index) * 3 + row) * run..][..run]);
        let cells: [&[f32]; CELLS] = std::array::from_fn(|index| {
            &from[starts[index] + row * (layer.from[1] + 2) * layer.inputs..][..run]
        });
        for place in 0..run {
            for (sums, cell) in sums.iter_mut().zip(cells) {
                for (sums, weights) in sums.iter_mut().zip(weights) {
                    *sums = add_scaled::<FUSED>(&weights[place], cell[place], sums);
                }
            }
        }
    }
    for (index, sums) in sums.iter().enumerate() {
        let out = &mut to[layer.place(cell + index) + group * GROUP..][..GROUPS * GROUP];
        for (out, sum) in out.iter_mut().zip(sums.as_flattened()) {
            *out = if *sum > 0.0 { *sum } else { 0.0 };
        }
    }
}

#[inline(always)]
fn add_scaled<const FUSED: bool>(weights: &[f32; GROUP], scale: f32, sums: &[f32; GROUP]) -> [f32; GROUP] {
    std::array::from_fn(|lane| multiply_add::<FUSED>(weights[lane], scale, sums[lane]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::numbers;

    /// Groups in pairs, alone and part of one; strides of one and two.
    fn layers() -> Vec<ConvolutionLayer> {
        let layer = |inputs, outputs, stride, seed| ConvolutionLayer {
            inputs,
            outputs,
            stride,
            weight: numbers(outputs * inputs * 9, seed),
            bias: numbers(outputs, seed + 1),
        };
        vec![layer(CROP_PLANES, 32, 1, 10), layer(32, 20, 2, 20), layer(20, 44, 2, 30)]
    }

    fn run(lanes: Lanes, size: [usize; 2]) -> Vec<f32> {
        let chain = ConvolutionChain::new(&layers(), size);
        let planes = numbers(2 * size[0] * size[1], 3);
        let (value, reward) = planes.split_at(size[0] * size[1]);
        let mut out = vec![0.0; chain.shape().iter().product()];
        let mut scratch = chain.scratch();
        // A second run finds what the first one left.
        for _ in 0..2 {
            chain.run(lanes, [value, reward], &mut scratch, &mut out);
        }
        out
    }

    /// The definition, in double precision and without any trick.
    fn plain(mut size: [usize; 2]) -> Vec<f64> {
        let mut planes: Vec<f64> = numbers(2 * size[0] * size[1], 3).into_iter().map(f64::from).collect();
        for layer in layers() {
            let [rows, columns] = size.map(|cells| cells as i64);
            let to = convolved(size, layer.stride);
            let term = |plane: usize, cell: usize, index: usize| {
                let (input, tap) = (index / 9, (index % 9) as i64);
                let row = (cell / to[1] * layer.stride) as i64 + tap / 3 - 1;
                let column = (cell % to[1] * layer.stride) as i64 + tap % 3 - 1;
                let inside = (0..rows).contains(&row) && (0..columns).contains(&column);
                let place = (input as i64 * rows + row) * columns + column;
                let value = if inside { planes[place as usize] } else { 0.0 };
                f64::from(layer.weight[plane * layer.inputs * 9 + index]) * value
            };
            let sum = |plane: usize, cell: usize| {
                let sum = (0..layer.inputs * 9).map(|index| term(plane, cell, index)).sum::<f64>();
                (sum + f64::from(layer.bias[plane])).max(0.0)
            };
            let cells = to[0] * to[1];
            planes = (0..layer.outputs * cells).map(|place| sum(place / cells, place % cells)).collect();
            size = to;
        }
        planes
    }

    #[test]
    fn convolutions_follow_their_definition() {
        for size in [[16, 20], [7, 9], [1, 1]] {
            for lanes in Lanes::available() {
                let (found, needed) = (run(lanes, size), plain(size));
                assert_eq!(found.len(), needed.len());
                for (a, b) in found.iter().zip(needed) {
                    assert!((f64::from(*a) - b).abs() < 1e-3 * (1.0 + b.abs()), "{size:?} {lanes}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn every_fused_variant_gives_the_same_bits() {
        let fused: Vec<_> = Lanes::available().into_iter().filter(|l| l.class() == "fused").collect();
        let bits = |lanes| run(lanes, [16, 20]).into_iter().map(f32::to_bits).collect::<Vec<_>>();
        for pair in fused.windows(2) {
            assert_eq!(bits(pair[0]), bits(pair[1]), "{pair:?}");
        }
    }

    #[test]
    fn wrong_lengths_compute_nothing() {
        let chain = ConvolutionChain::new(&layers(), [16, 20]);
        let (right, wrong) = (vec![1.0; 320], vec![1.0; 319]);
        let size = chain.shape().iter().product();
        for (planes, count) in [([&right, &wrong], size), ([&wrong, &right], size), ([&right, &right], 7)] {
            let mut out = vec![7.0; count];
            chain.run(Lanes::detect(), planes.map(Vec::as_slice), &mut chain.scratch(), &mut out);
            assert!(out.iter().all(|x| (x - 7.0).abs() < 1e-9));
        }
    }
}

//! The two computations that cost time: value iteration and the dense layers, fused and vectorised.
//!
//! Vectors run over cells or over outputs, never over a sum, so each element is one fixed chain of multiply-adds
//! whatever the instruction set. Measured: `benches/step.rs`.

use crate::convolution::{ROW_CELLS as WIDTH, convolve};
use crate::lanes::{Lanes, multiply_add};
use crate::network::DenseLayer;
use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE};

/// Floats between rows of a padded plane: one zero left, at least five right.
const STRIDE: usize = 48;
/// Rows of a padded plane: one row of zeros above and below.
const PADDED: usize = (LOCAL_SIDE + 2) * STRIDE;
/// Outputs of a dense layer computed at once.
const BLOCK: usize = 64;
/// Outputs computed at once in a layer with few of them.
const SMALL_BLOCK: usize = 16;

/// The value iteration of one network.
#[derive(Debug, Clone, PartialEq)]
pub struct ValueIteration {
    /// `[1]` 3x3 reward kernel per channel.
    pub reward: Vec<[f32; 9]>,
    /// `[1]` bias per channel.
    pub bias: Vec<f32>,
    /// `[1]` 3x3 value kernel per channel.
    pub value: Vec<[f32; 9]>,
    /// Value iterations K.
    pub rounds: usize,
}

/// The memory that a value iteration works in.
#[derive(Debug, Clone)]
pub struct ValueScratch {
    planes: [Vec<f32>; 2],
    reward: Vec<f32>,
}

impl ValueScratch {
    /// Memory for `channels` channels.
    #[must_use]
    pub fn new(channels: usize) -> Self {
        let plane = vec![0.0; PADDED];
        Self { planes: [plane.clone(), plane], reward: vec![0.0; channels * LOCAL_SIDE * WIDTH] }
    }
}

impl ValueIteration {
    /// V after all rounds for the reward map m_r; both are 28 x 28, row by row, other lengths compute nothing.
    pub fn run(&self, lanes: Lanes, reward_map: &[f32], scratch: &mut ValueScratch, out: &mut [f32]) {
        if reward_map.len() == LOCAL_CELLS && out.len() == LOCAL_CELLS {
            value_iteration(lanes, self, reward_map, scratch, out);
        }
    }
}

on_lanes! {
    fn value_iteration(
        weights: &ValueIteration,
        reward_map: &[f32],
        scratch: &mut ValueScratch,
        out: &mut [f32],
    ) = value_iteration_body
}

#[inline(always)]
fn value_iteration_body<const FUSED: bool>(
    weights: &ValueIteration,
    reward_map: &[f32],
    scratch: &mut ValueScratch,
    out: &mut [f32],
) {
    let [from, to] = &mut scratch.planes;
    for (row, cells) in reward_map.chunks_exact(LOCAL_SIDE).enumerate() {
        from[(row + 1) * STRIDE + 1..][..LOCAL_SIDE].copy_from_slice(cells);
    }
    for (channel, (kernel, bias)) in weights.reward.iter().zip(&weights.bias).enumerate() {
        for row in 0..LOCAL_SIDE {
            let sums = convolve::<FUSED, 1, STRIDE>(&[*kernel], [[*bias; WIDTH]], from, row);
            scratch.reward[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH].copy_from_slice(&sums[0]);
        }
    }
    from.fill(0.0);
    to.fill(0.0);
    let (mut from, mut to) = (from, to);
    for _ in 0..weights.rounds {
        for row in 0..LOCAL_SIDE {
            let mut best = [f32::NEG_INFINITY; WIDTH];
            let mut pairs = weights.value.chunks_exact(2);
            let mut channel = 0;
            for pair in &mut pairs {
                best_of::<FUSED, 2>(pair, &scratch.reward, channel, from, row, &mut best);
                channel += 2;
            }
            for single in pairs.remainder() {
                best_of::<FUSED, 1>(&[*single], &scratch.reward, channel, from, row, &mut best);
            }
            to[(row + 1) * STRIDE + 1..][..WIDTH].copy_from_slice(&best);
            // Lanes beyond the last column are padding.
            to[(row + 1) * STRIDE + 1 + LOCAL_SIDE..][..WIDTH - LOCAL_SIDE].fill(0.0);
        }
        std::mem::swap(&mut from, &mut to);
    }
    for (row, cells) in out.chunks_exact_mut(LOCAL_SIDE).enumerate() {
        cells.copy_from_slice(&from[(row + 1) * STRIDE + 1..][..LOCAL_SIDE]);
    }
}

/// Raises `best` to the values of `N` channels in one row.
#[inline(always)]
fn best_of<const FUSED: bool, const N: usize>(
    kernels: &[[f32; 9]],
    reward: &[f32],
    channel: usize,
    plane: &[f32],
    row: usize,
    best: &mut [f32; WIDTH],
) {
    let mut start = [[0.0; WIDTH]; N];
    for (n, lane) in start.iter_mut().enumerate() {
        lane.copy_from_slice(&reward[((channel + n) * LOCAL_SIDE + row) * WIDTH..][..WIDTH]);
    }
    let sums = convolve::<FUSED, N, STRIDE>(kernels, start, plane, row);
    for sum in &sums {
        for lane in 0..WIDTH {
            best[lane] = if sum[lane] > best[lane] { sum[lane] } else { best[lane] };
        }
    }
}

/// A dense layer, its weights packed so that a block of outputs reads memory in order.
#[derive(Debug, Clone, PartialEq)]
struct PackedLayer {
    inputs: usize,
    outputs: usize,
    block: usize,
    /// Blocks x inputs x `block`.
    weight: Vec<f32>,
    /// Padded to whole blocks.
    bias: Vec<f32>,
}

impl PackedLayer {
    fn new(layer: &DenseLayer) -> Self {
        let block = if layer.outputs.is_multiple_of(BLOCK) { BLOCK } else { SMALL_BLOCK };
        let blocks = layer.outputs.div_ceil(block);
        let mut weight = vec![0.0; blocks * layer.inputs * block];
        for (index, value) in layer.weight.iter().enumerate() {
            let (input, output) = (index / layer.outputs, index % layer.outputs);
            weight[(output / block * layer.inputs + input) * block + output % block] = *value;
        }
        let mut bias = layer.bias.clone();
        bias.resize(blocks * block, 0.0);
        Self { inputs: layer.inputs, outputs: layer.outputs, block, weight, bias }
    }
}

/// A chain of dense layers with ReLU between them.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseChain {
    layers: Vec<PackedLayer>,
}

/// The memory that a chain works in.
#[derive(Debug, Clone)]
pub struct DenseScratch {
    planes: [Vec<f32>; 2],
}

impl DenseChain {
    /// Packs layers; the outputs of each must be the inputs of the next.
    #[must_use]
    pub fn new(layers: &[DenseLayer]) -> Self {
        Self { layers: layers.iter().map(PackedLayer::new).collect() }
    }

    /// Memory for one run at a time.
    #[must_use]
    pub fn scratch(&self) -> DenseScratch {
        let most = self.layers.iter().map(|layer| layer.inputs.max(layer.bias.len())).max().unwrap_or(0);
        DenseScratch { planes: [vec![0.0; most], vec![0.0; most]] }
    }

    /// The outputs of the last layer; an input of another length than the first layer's gives nothing.
    pub fn run<'a>(&self, lanes: Lanes, input: &[f32], scratch: &'a mut DenseScratch) -> &'a [f32] {
        let [mut from, mut to] = scratch.planes.each_mut();
        if self.layers.first().is_none_or(|layer| layer.inputs != input.len()) {
            return &[];
        }
        from[..input.len()].copy_from_slice(input);
        let mut outputs = 0;
        for (index, layer) in self.layers.iter().enumerate() {
            let bend = index + 1 < self.layers.len();
            dense(lanes, layer, bend, &from[..layer.inputs], &mut to[..layer.bias.len()]);
            std::mem::swap(&mut from, &mut to);
            outputs = layer.outputs;
        }
        &from[..outputs]
    }
}

on_lanes! {
    fn dense(layer: &PackedLayer, bend: bool, input: &[f32], out: &mut [f32]) = dense_body
}

#[inline(always)]
fn dense_body<const FUSED: bool>(layer: &PackedLayer, bend: bool, input: &[f32], out: &mut [f32]) {
    if layer.block == BLOCK {
        dense_blocks::<FUSED, BLOCK>(layer, bend, input, out);
    } else {
        dense_blocks::<FUSED, SMALL_BLOCK>(layer, bend, input, out);
    }
}

#[inline(always)]
fn dense_blocks<const FUSED: bool, const N: usize>(
    layer: &PackedLayer,
    bend: bool,
    input: &[f32],
    out: &mut [f32],
) {
    let weights = layer.weight.chunks_exact(layer.inputs * N);
    for ((weight, bias), out) in weights.zip(layer.bias.chunks_exact(N)).zip(out.chunks_exact_mut(N)) {
        let mut sums = [0.0; N];
        sums.copy_from_slice(bias);
        for (row, x) in weight.chunks_exact(N).zip(input) {
            for lane in 0..N {
                sums[lane] = multiply_add::<FUSED>(*x, row[lane], sums[lane]);
            }
        }
        if bend {
            for sum in &mut sums {
                *sum = if *sum > 0.0 { *sum } else { 0.0 };
            }
        }
        out.copy_from_slice(&sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::numbers;

    fn kernels(count: usize, seed: u32, scale: f32) -> Vec<[f32; 9]> {
        numbers(count * 9, seed).chunks_exact(9).map(|k| std::array::from_fn(|i| k[i] * scale)).collect()
    }

    fn iteration(channels: usize) -> ValueIteration {
        ValueIteration {
            reward: kernels(channels, 1, 1.0),
            bias: numbers(channels, 2),
            value: kernels(channels, 3, 0.3),
            rounds: 36,
        }
    }

    fn run(lanes: Lanes, weights: &ValueIteration, map: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; LOCAL_CELLS];
        weights.run(lanes, map, &mut ValueScratch::new(weights.reward.len()), &mut out);
        out
    }

    /// The definition, in double precision and without any trick.
    fn plain(weights: &ValueIteration, map: &[f32]) -> Vec<f64> {
        let side = LOCAL_SIDE as i64;
        let conv = |plane: &[f64], kernel: &[f32; 9], cell: i64| -> f64 {
            (0..9_i64)
                .map(|tap| {
                    let (row, col) = (cell / side + tap / 3 - 1, cell % side + tap % 3 - 1);
                    let inside = (0..side).contains(&row) && (0..side).contains(&col);
                    let value = if inside { plane[(row * side + col) as usize] } else { 0.0 };
                    f64::from(kernel[tap as usize]) * value
                })
                .sum()
        };
        let map: Vec<f64> = map.iter().map(|x| f64::from(*x)).collect();
        let channels = weights.reward.len();
        let reward: Vec<Vec<f64>> = (0..channels)
            .map(|q| {
                let bias = f64::from(weights.bias[q]);
                (0..side * side).map(|cell| bias + conv(&map, &weights.reward[q], cell)).collect()
            })
            .collect();
        let mut value = vec![0.0; LOCAL_CELLS];
        for _ in 0..weights.rounds {
            value = (0..side * side)
                .map(|cell| {
                    let of = |q: usize| reward[q][cell as usize] + conv(&value, &weights.value[q], cell);
                    (0..channels).map(of).fold(f64::NEG_INFINITY, f64::max)
                })
                .collect();
        }
        value
    }

    #[test]
    fn value_iteration_follows_its_definition() {
        for channels in [10, 7, 1] {
            let weights = iteration(channels);
            let map = numbers(LOCAL_CELLS, 4);
            let (found, needed) = (run(Lanes::detect(), &weights, &map), plain(&weights, &map));
            for (a, b) in found.iter().zip(needed) {
                assert!((f64::from(*a) - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
            }
        }
    }

    #[test]
    fn every_fused_variant_gives_the_same_bits() {
        let (weights, map) = (iteration(10), numbers(LOCAL_CELLS, 5));
        let chain = chain();
        let input = numbers(70, 9);
        let bits = |lanes| {
            let value = run(lanes, &weights, &map);
            let head = chain.run(lanes, &input, &mut chain.scratch()).to_vec();
            value.into_iter().chain(head).map(f32::to_bits).collect::<Vec<_>>()
        };
        let fused: Vec<_> = Lanes::available().into_iter().filter(|l| l.class() == "fused").collect();
        for pair in fused.windows(2) {
            assert_eq!(bits(pair[0]), bits(pair[1]), "{pair:?}");
        }
    }

    #[test]
    fn the_unfused_class_differs_by_rounding_only() {
        let (weights, map) = (iteration(10), numbers(LOCAL_CELLS, 6));
        let variants = Lanes::available();
        let (first, last) =
            (run(variants[0], &weights, &map), run(variants[variants.len() - 1], &weights, &map));
        for (a, b) in first.iter().zip(last) {
            assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
        }
    }

    fn chain() -> DenseChain {
        let layer = |inputs, outputs, seed| DenseLayer {
            inputs,
            outputs,
            weight: numbers(inputs * outputs, seed),
            bias: numbers(outputs, seed + 1),
        };
        DenseChain::new(&[layer(70, 128, 10), layer(128, 24, 20), layer(24, 4, 30)])
    }

    #[test]
    fn dense_layers_follow_their_definition() {
        let mut x: Vec<f64> = numbers(70, 7).iter().map(|x| f64::from(*x)).collect();
        let found = chain().run(Lanes::detect(), &numbers(70, 7), &mut chain().scratch()).to_vec();
        for (inputs, outputs, seed) in [(70, 128, 10), (128, 24, 20), (24, 4, 30)] {
            let (weight, bias) = (numbers(inputs * outputs, seed), numbers(outputs, seed + 1));
            x = (0..outputs)
                .map(|o| {
                    let products = (0..inputs).map(|i| x[i] * f64::from(weight[i * outputs + o]));
                    let sum = f64::from(bias[o]) + products.sum::<f64>();
                    if outputs == 4 { sum } else { sum.max(0.0) }
                })
                .collect();
        }
        assert_eq!(found.len(), 4);
        for (a, b) in found.iter().zip(x) {
            assert!((f64::from(*a) - b).abs() < 1e-3 * (1.0 + b.abs()), "{a} {b}");
        }
    }

    #[test]
    fn wrong_lengths_compute_nothing() {
        assert!(chain().run(Lanes::detect(), &[0.0; 3], &mut chain().scratch()).is_empty());
        let mut out = vec![7.0; LOCAL_CELLS];
        iteration(2).run(Lanes::detect(), &[0.0; 3], &mut ValueScratch::new(2), &mut out);
        assert!(out.iter().all(|x| (x - 7.0).abs() < 1e-9));
    }
}

//! All parameters of the network as one vector, as the optimiser sees them, and their way into a model file.

use crate::head::CROP;
use crate::layer::Layout;
use crate::random::Random;
use sidestep_msgs::Limits;
use sidestep_policy::{
    CROP_COLS, CROP_PLANES, CROP_ROWS, ConvolutionLayer, DIRECT_FEATURES, DenseLayer, HEAD_OUTPUTS, Network,
    convolved,
};
use std::ops::Range;

/// Weight of the goal in m_r (paper eq. 3).
pub(crate) const LAMBDA: f32 = 1.0;
/// Scale of V among the features; folded into the first layer of the model file.
pub(crate) const VALUE_SCALE: f32 = 0.2;
/// Discount that the value kernels start from.
const DISCOUNT: f32 = 0.95;

/// Sizes of a 3x3 convolution with a border of zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvolutionSize {
    /// Planes it makes.
    pub outputs: usize,
    /// Cells from one output to the next.
    pub stride: usize,
}

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Channels of the value iteration.
    pub channels: usize,
    /// Value iterations K.
    pub rounds: usize,
    /// Convolutions between the crop and the dense layers.
    pub convolutions: &'static [ConvolutionSize],
    /// Outputs of the hidden dense layers.
    pub hidden: [usize; 2],
}

impl Shape {
    /// What is trained unless told otherwise; measured: `ablation/README.md`.
    pub(crate) const STANDARD: Self = Self {
        channels: 10,
        rounds: 36,
        convolutions: &[
            ConvolutionSize { outputs: 32, stride: 1 },
            ConvolutionSize { outputs: 64, stride: 2 },
            ConvolutionSize { outputs: 64, stride: 2 },
        ],
        hidden: [256, 128],
    };

    /// Sizes of the convolutions, what each reads included.
    pub(crate) fn layouts(&self) -> Vec<Layout> {
        let (mut inputs, mut from) = (CROP_PLANES, [CROP_ROWS, CROP_COLS]);
        let next = |size: &ConvolutionSize| {
            let (outputs, stride) = (size.outputs, size.stride);
            let layout = Layout { inputs, outputs, stride, from, to: convolved(from, stride) };
            (inputs, from) = (outputs, layout.to);
            layout
        };
        self.convolutions.iter().map(next).collect()
    }

    /// Planes that the dense layers see, and cells of each.
    fn seen(&self) -> (usize, usize) {
        let last = self.layouts().pop();
        last.map_or((CROP_PLANES, CROP_ROWS * CROP_COLS), |layout| {
            (layout.outputs, layout.to[0] * layout.to[1])
        })
    }

    /// Inputs of the first dense layer: the planes, cell by cell, then u' and goal.
    pub(crate) fn features(&self) -> usize {
        let (planes, cells) = self.seen();
        planes * cells + DIRECT_FEATURES
    }

    /// Inputs and outputs of the three dense layers.
    pub(crate) fn dense(&self) -> [(usize, usize); 3] {
        let [first, second] = self.hidden;
        [(self.features(), first), (first, second), (second, HEAD_OUTPUTS)]
    }

    pub(crate) fn reward(&self) -> Range<usize> {
        0..self.channels * 9
    }

    pub(crate) fn reward_bias(&self) -> Range<usize> {
        let from = self.reward().end;
        from..from + self.channels
    }

    pub(crate) fn value(&self) -> Range<usize> {
        let from = self.reward_bias().end;
        from..from + self.channels * 9
    }

    /// Weight and bias of convolution `index`; weights are 3 x 3 x inputs x outputs.
    pub(crate) fn convolution(&self, index: usize) -> (Range<usize>, Range<usize>) {
        let layouts = self.layouts();
        let count = |layout: &Layout| (layout.neighbourhood() + 1) * layout.outputs;
        let from = self.value().end + layouts[..index].iter().map(count).sum::<usize>();
        let bias = from + layouts[index].neighbourhood() * layouts[index].outputs;
        (from..bias, bias..bias + layouts[index].outputs)
    }

    /// Weight and bias of dense layer `index`; weights are inputs x outputs.
    pub(crate) fn layer(&self, index: usize) -> (Range<usize>, Range<usize>) {
        let last = self.convolutions.len().checked_sub(1);
        let mut from = last.map_or(self.value().end, |last| self.convolution(last).1.end);
        for (inputs, outputs) in &self.dense()[..index] {
            from += inputs * outputs + outputs;
        }
        let (inputs, outputs) = self.dense()[index];
        let bias = from + inputs * outputs;
        (from..bias, bias..bias + outputs)
    }

    /// Weight and bias of layer `index` of the head: convolutions, then dense layers.
    pub(crate) fn head_layer(&self, index: usize) -> (Range<usize>, Range<usize>) {
        match index.checked_sub(self.convolutions.len()) {
            Some(dense) => self.layer(dense),
            None => self.convolution(index),
        }
    }

    /// Number of parameters.
    #[must_use]
    pub fn count(&self) -> usize {
        self.layer(2).1.end
    }

    /// Kernels of nine from a slice of the vector.
    pub(crate) fn kernels(values: &[f32]) -> Vec<[f32; 9]> {
        values.chunks_exact(9).map(|chunk| std::array::from_fn(|tap| chunk[tap])).collect()
    }

    /// Where training starts: value kernels that plan (notes: 5 % better than random), He-scaled convolutions and dense layers.
    pub(crate) fn initial(&self, seed: u64) -> Vec<f32> {
        let mut random = Random::new(seed, 0x494e_4954);
        let mut parameters = vec![0.0; self.count()];
        for (index, weight) in parameters[self.reward()].iter_mut().enumerate() {
            *weight = 0.02 * random.normal() + if index % 9 == 4 { 1.0 } else { 0.0 };
        }
        for (index, weight) in parameters[self.value()].iter_mut().enumerate() {
            // Channel q moves to neighbour q; further channels to one of them again.
            *weight = 0.02 * random.normal() + if index % 9 == index / 9 % 9 { DISCOUNT } else { 0.0 };
        }
        for (index, layout) in self.layouts().iter().enumerate() {
            for weight in &mut parameters[self.convolution(index).0] {
                *weight = (2.0 / layout.neighbourhood() as f32).sqrt() * random.normal();
            }
        }
        for index in 0..3 {
            let inputs = self.dense()[index].0 as f32;
            let gain = if index == 2 { 0.1 } else { 1.0 };
            for weight in &mut parameters[self.layer(index).0] {
                *weight = gain * (2.0 / inputs).sqrt() * random.normal();
            }
        }
        // Doubt starts at about 0.1 m/s and 0.2 rad/s.
        let bias = self.layer(2).1.start;
        parameters[bias + 2..bias + 4].copy_from_slice(&[-2.3, -1.6]);
        parameters
    }

    /// The network in SI units, scales folded in, in the order of the model file.
    pub(crate) fn network(&self, parameters: &[f32], limits: &Limits) -> Network {
        let parameters = self.folded(parameters, limits);
        let part = |range: Range<usize>| parameters[range].to_vec();
        let convolutions = self.layouts().into_iter().enumerate().map(|(index, layout)| {
            let Layout { inputs, outputs, stride, .. } = layout;
            let (weight, bias) = self.convolution(index);
            let from = &parameters[weight];
            let place = |output, input, tap| (tap * inputs + input) * outputs + output;
            let weight = (0..outputs * inputs * 9)
                .map(|to| from[place(to / (inputs * 9), to / 9 % inputs, to % 9)])
                .collect();
            ConvolutionLayer { inputs, outputs, stride, weight, bias: part(bias) }
        });
        let mut dense = Vec::new();
        for (index, (inputs, outputs)) in self.dense().into_iter().enumerate() {
            let (weight, bias) = self.layer(index);
            dense.push(DenseLayer { inputs, outputs, weight: part(weight), bias: part(bias) });
        }
        dense[0].weight = self.plane_by_plane(&dense[0].weight);
        Network {
            lambda: LAMBDA,
            rounds: self.rounds,
            reward: Self::kernels(&parameters[self.reward()]),
            reward_bias: part(self.reward_bias()),
            value: Self::kernels(&parameters[self.value()]),
            convolutions: convolutions.collect(),
            dense,
        }
    }

    /// The parameters for inputs and outputs in SI units.
    fn folded(&self, parameters: &[f32], limits: &Limits) -> Vec<f32> {
        let mut parameters = parameters.to_vec();
        let (start, rows, outputs) = match self.layouts().first() {
            Some(layout) => (self.convolution(0).0.start, layout.neighbourhood(), layout.outputs),
            None => (self.layer(0).0.start, CROP, self.hidden[0]),
        };
        for planes in parameters[start..][..rows * outputs].chunks_exact_mut(CROP_PLANES * outputs) {
            planes[..outputs].iter_mut().for_each(|weight| *weight *= VALUE_SCALE);
        }
        let (weight, bias) = self.layer(2);
        for row in parameters[weight.start..bias.end].chunks_exact_mut(HEAD_OUTPUTS) {
            row.iter_mut().zip(output_scale(limits)).for_each(|(weight, scale)| *weight *= scale);
        }
        parameters
    }

    /// The rows of the first dense layer, one plane after the other instead of one cell after the other.
    fn plane_by_plane(&self, weight: &[f32]) -> Vec<f32> {
        let (planes, cells) = self.seen();
        let row = |index: usize| {
            if index < planes * cells { index % cells * planes + index / cells } else { index }
        };
        let outputs = self.hidden[0];
        (0..self.features()).flat_map(|to| &weight[row(to) * outputs..][..outputs]).copied().collect()
    }
}

/// SI units per unit of output: the label's window for v and w, one for the logarithms of the doubt.
pub(crate) fn output_scale(limits: &Limits) -> [f32; HEAD_OUTPUTS] {
    let window = sidestep_msgs::WINDOW_S;
    [limits.accelerate_m_s2 * window, limits.turn_accelerate_rad_s2 * window, 1.0, 1.0]
}

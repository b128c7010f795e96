//! All parameters of the network as one vector, as the optimiser sees them, and their way into a model file.

use crate::random::Random;
use sidestep_msgs::Limits;
use sidestep_policy::{CROP_CELLS, DenseLayer, FEATURES, HEAD_OUTPUTS, Network};
use std::ops::Range;

/// Weight of the goal in m_r (paper eq. 3).
pub(crate) const LAMBDA: f32 = 1.0;
/// Scale of V among the features; folded into the first dense layer of the model file.
pub(crate) const VALUE_SCALE: f32 = 0.2;
/// Discount that the value kernels start from.
const DISCOUNT: f32 = 0.95;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Channels of the value iteration.
    pub channels: usize,
    /// Value iterations K.
    pub rounds: usize,
    /// Outputs of the hidden dense layers.
    pub hidden: [usize; 2],
}

impl Shape {
    /// Inputs and outputs of the three dense layers.
    pub(crate) fn dense(&self) -> [(usize, usize); 3] {
        [(FEATURES, self.hidden[0]), (self.hidden[0], self.hidden[1]), (self.hidden[1], HEAD_OUTPUTS)]
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

    /// Weight and bias of dense layer `index`.
    pub(crate) fn layer(&self, index: usize) -> (Range<usize>, Range<usize>) {
        let mut from = self.value().end;
        for (inputs, outputs) in &self.dense()[..index] {
            from += inputs * outputs + outputs;
        }
        let (inputs, outputs) = self.dense()[index];
        let bias = from + inputs * outputs;
        (from..bias, bias..bias + outputs)
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

    /// Where training starts: value kernels that plan (notes: 5 % better than random), He-scaled dense layers.
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

    /// The network in SI units, scales folded in.
    pub(crate) fn network(&self, parameters: &[f32], limits: &Limits) -> Network {
        let scale = output_scale(limits);
        let dense = (0..3)
            .map(|index| {
                let (inputs, outputs) = self.dense()[index];
                let (weight, bias) = self.layer(index);
                let mut layer = DenseLayer {
                    inputs,
                    outputs,
                    weight: parameters[weight].to_vec(),
                    bias: parameters[bias].to_vec(),
                };
                if index == 0 {
                    layer.weight[..CROP_CELLS * outputs].iter_mut().for_each(|weight| *weight *= VALUE_SCALE);
                }
                if index == 2 {
                    let columns =
                        layer.weight.chunks_exact_mut(outputs).chain(std::iter::once(&mut layer.bias[..]));
                    columns.for_each(|row| {
                        row.iter_mut().zip(scale).for_each(|(weight, scale)| *weight *= scale)
                    });
                }
                layer
            })
            .collect();
        Network {
            lambda: LAMBDA,
            rounds: self.rounds,
            reward: Self::kernels(&parameters[self.reward()]),
            reward_bias: parameters[self.reward_bias()].to_vec(),
            value: Self::kernels(&parameters[self.value()]),
            dense,
        }
    }
}

/// SI units per unit of output: the label's window for v and w, one for the logarithms of the doubt.
pub(crate) fn output_scale(limits: &Limits) -> [f32; HEAD_OUTPUTS] {
    let window = sidestep_msgs::WINDOW_S;
    [limits.accelerate_m_s2 * window, limits.turn_accelerate_rad_s2 * window, 1.0, 1.0]
}

//! The head of many samples forward and backward: convolutions on the crop, dense layers on what they leave.

use crate::layer::Layer;
use crate::parameters::Shape;
use crate::products::{backward, collect, forward, hand_back, hand_on};
use bytemuck::{cast_slice, cast_slice_mut};
use sidestep_policy::{CROP_CELLS, CROP_PLANES, DIRECT_FEATURES, HEAD_OUTPUTS, Lanes};

/// Numbers of a sample's crop: V and m_r, cell by cell.
pub(crate) const CROP: usize = CROP_CELLS * CROP_PLANES;

/// Command and doubt of one sample, or their slopes.
pub(crate) type Outputs = [f32; HEAD_OUTPUTS];

/// The head and its memory.
#[derive(Debug, Clone)]
pub(crate) struct Head {
    shape: Shape,
    lanes: Lanes,
    layers: Vec<Layer>,
}

impl Head {
    /// Memory for up to `samples` samples, a multiple of four.
    pub(crate) fn new(shape: Shape, lanes: Lanes, samples: usize) -> Self {
        let layouts = shape.layouts();
        let mut before = layouts
            .last()
            .map_or([CROP_CELLS, CROP_PLANES], |layout| [layout.to[0] * layout.to[1], layout.outputs]);
        let mut layers: Vec<Layer> =
            layouts.iter().map(|layout| Layer::convolution(layout, samples)).collect();
        for (inputs, outputs) in shape.dense() {
            layers.push(Layer::dense(inputs, outputs, before, samples));
            before = [1, outputs];
        }
        Self { shape, lanes, layers }
    }

    /// Takes the parameters that forward and backward work with.
    pub(crate) fn load(&mut self, parameters: &[f32]) {
        for (index, layer) in self.layers.iter_mut().enumerate() {
            let (weight, bias) = self.shape.head_layer(index);
            layer.load(&parameters[weight], &parameters[bias]);
        }
    }

    /// Puts sample `index` before [`Head::forward`]: the crop cell by cell, and the features that come from no plane.
    pub(crate) fn see(
        &mut self,
        index: usize,
        cells: impl Iterator<Item = [f32; CROP_PLANES]>,
        direct: impl Iterator<Item = f32>,
    ) {
        let first = &mut self.layers[0];
        let input: &mut [f32] = cast_slice_mut(&mut first.input);
        for (entry, planes) in first.entries[index * CROP_CELLS..].iter().zip(cells) {
            input[*entry..][..CROP_PLANES].copy_from_slice(&planes);
        }
        let dense = &mut self.layers[self.shape.convolutions.len()];
        let place = dense.starts[index] + dense.window.run - DIRECT_FEATURES;
        let input: &mut [f32] = cast_slice_mut(&mut dense.input);
        input[place..].iter_mut().zip(direct).for_each(|(to, value)| *to = value);
    }

    /// The outputs of sample `index`, whose place is that of their slopes before [`Head::backward`].
    pub(crate) fn output(&mut self, index: usize) -> &mut Outputs {
        let last = self.layers.len() - 1;
        let [outputs @ .., _, _, _, _, _, _, _, _, _, _, _, _] = &mut self.layers[last].sums[index].0;
        outputs
    }

    /// The slopes of V in the crop of sample `index`, cell by cell.
    pub(crate) fn crop_slopes(&self, index: usize) -> impl Iterator<Item = f32> {
        let Layer { entries, slopes, .. } = &self.layers[0];
        let slopes: &[f32] = cast_slice(slopes);
        entries[index * CROP_CELLS..][..CROP_CELLS].iter().map(|entry| slopes[*entry])
    }

    /// From crops to the outputs of `count` samples.
    pub(crate) fn forward(&mut self, count: usize) {
        let (lanes, wide) = (self.lanes, self.wide());
        let mut layers = self.layers.as_mut_slice();
        while let Some((layer, above)) = layers.split_first_mut() {
            forward(lanes, layer, wide, count);
            if let Some(next) = above.first_mut() {
                hand_on(lanes, layer, next, count);
            }
            layers = above;
        }
    }

    /// From the slopes of the outputs of `count` samples to those of the crops; adds those of the parameters to `gradient`.
    pub(crate) fn backward(&mut self, count: usize, gradient: &mut [f32]) {
        let (lanes, wide) = (self.lanes, self.wide());
        for index in (0..self.layers.len()).rev() {
            let (below, layer) = self.layers.split_at_mut(index);
            let layer = &mut layer[0];
            let (weight, bias) = self.shape.head_layer(index);
            let (before, from_bias) = gradient.split_at_mut(bias.start);
            collect(lanes, layer, wide, count, &mut before[weight], &mut from_bias[..bias.len()]);
            backward(lanes, layer, wide, count);
            if let Some(below) = below.last_mut() {
                hand_back(lanes, below, layer, count);
            }
        }
    }

    /// Whether one register holds sixteen numbers.
    fn wide(&self) -> bool {
        self.lanes.floats() >= crate::line::LANES
    }
}

//! The head of many samples forward and backward: convolutions on the crop, dense layers on what they leave.

use crate::convolution::{Convolution, Layout};
use crate::matrix::{Matrix, add_column_sums, add_product, product, rectify};
use crate::parameters::Shape;
use sidestep_policy::{CROP_CELLS, CROP_PLANES, DIRECT_FEATURES, HEAD_OUTPUTS};

/// Numbers of a sample's crop: V and m_r, cell by cell.
pub(crate) const CROP: usize = CROP_CELLS * CROP_PLANES;

/// The head and its memory.
#[derive(Debug, Clone)]
pub(crate) struct Head {
    shape: Shape,
    convolutions: Vec<Convolution>,
    /// Activations per sample: the crop, then each convolution.
    planes: Vec<Vec<f32>>,
    /// Activations per sample: features, two hidden layers, outputs.
    layers: [Vec<f32>; 4],
    /// Slopes of `planes`.
    plane_slopes: Vec<Vec<f32>>,
    /// Slopes of `layers` but for the features.
    slopes: [Vec<f32>; 3],
}

impl Head {
    /// Memory for up to `samples` samples.
    pub(crate) fn new(shape: Shape, samples: usize) -> Self {
        let layouts = shape.layouts();
        let sizes = std::iter::once(CROP).chain(layouts.iter().map(Layout::output));
        let planes: Vec<Vec<f32>> = sizes.map(|size| vec![0.0; samples * size]).collect();
        let [first, second] = shape.hidden;
        let memory = |size: usize| vec![0.0; samples * size];
        Self {
            shape,
            convolutions: layouts.into_iter().map(|layout| Convolution::new(layout, samples)).collect(),
            plane_slopes: planes.clone(),
            planes,
            layers: [shape.features(), first, second, HEAD_OUTPUTS].map(memory),
            slopes: [first, second, HEAD_OUTPUTS].map(memory),
        }
    }

    /// Where sample `index` is put before [`Head::forward`]: the crop, and the features that come from no plane.
    pub(crate) fn input(&mut self, index: usize) -> [&mut [f32]; 2] {
        let features = self.shape.features();
        let direct = (index + 1) * features - DIRECT_FEATURES;
        [&mut self.planes[0][index * CROP..][..CROP], &mut self.layers[0][direct..direct + DIRECT_FEATURES]]
    }

    /// The outputs of sample `index`, and where their slopes are put before [`Head::backward`].
    pub(crate) fn output(&mut self, index: usize) -> (&[f32], &mut [f32]) {
        let span = index * HEAD_OUTPUTS..(index + 1) * HEAD_OUTPUTS;
        (&self.layers[3][span.clone()], &mut self.slopes[2][span])
    }

    /// The slopes of the crop of sample `index`.
    pub(crate) fn crop_slopes(&self, index: usize) -> &[f32] {
        &self.plane_slopes[0][index * CROP..][..CROP]
    }

    /// From crops to the outputs of `count` samples.
    pub(crate) fn forward(&mut self, parameters: &[f32], count: usize) {
        for (index, convolution) in self.convolutions.iter_mut().enumerate() {
            let [from, to] = &mut self.planes[index..index + 2] else { continue };
            let (weight, bias) = self.shape.convolution(index);
            convolution.forward([&parameters[weight], &parameters[bias]], count, from, to);
        }
        let features = self.shape.features();
        let flat = features - DIRECT_FEATURES;
        let planes = self.planes.last().map_or(&[][..], Vec::as_slice);
        for (row, planes) in self.layers[0].chunks_exact_mut(features).zip(planes.chunks_exact(flat)) {
            row[..flat].copy_from_slice(planes);
        }
        for layer in 0..3 {
            let (inputs, outputs) = self.shape.dense()[layer];
            let (weight, bias) = self.shape.layer(layer);
            let [from, to] = &mut self.layers[layer..layer + 2] else { continue };
            for row in to.chunks_exact_mut(outputs) {
                row.copy_from_slice(&parameters[bias.clone()]);
            }
            let (rows, columns) = ((count, inputs), (inputs, outputs));
            add_product(Matrix::rows(from, rows), Matrix::rows(&parameters[weight], columns), to);
            if layer < 2 {
                rectify(to);
            }
        }
    }

    /// From the slopes of the outputs of `count` samples to those of the crops; adds those of the parameters to `gradient`.
    pub(crate) fn backward(&mut self, parameters: &[f32], count: usize, gradient: &mut [f32]) {
        for layer in (0..3).rev() {
            let (inputs, outputs) = self.shape.dense()[layer];
            let (weight, bias) = self.shape.layer(layer);
            let (lower, above) = self.slopes.split_at_mut(layer);
            let above = Matrix::rows(&above[0], (count, outputs));
            add_column_sums(above, &mut gradient[bias]);
            let active = Matrix::rows(&self.layers[layer], (count, inputs));
            add_product(active.transposed(), above, &mut gradient[weight.clone()]);
            // Nothing asks for the slopes of the features that come from no plane.
            let (below, asked) = match (lower.last_mut(), self.plane_slopes.last_mut()) {
                (Some(below), _) => (below, inputs),
                (None, Some(below)) => (below, inputs - DIRECT_FEATURES),
                (None, None) => return,
            };
            let weight = Matrix::rows(&parameters[weight], (asked, outputs));
            product(above, weight.transposed(), below);
            if layer > 0 {
                cut_off(below, &self.layers[layer]);
            }
        }
        for (index, convolution) in self.convolutions.iter_mut().enumerate().rev() {
            let [below, above] = &mut self.plane_slopes[index..index + 2] else { continue };
            cut_off(above, &self.planes[index + 1]);
            let (weight, bias) = self.shape.convolution(index);
            let (before, from_bias) = gradient.split_at_mut(bias.start);
            let slopes = [&mut before[weight.clone()], &mut from_bias[..bias.len()]];
            convolution.backward(&parameters[weight], slopes, count, above, below);
        }
    }
}

/// The slopes below a ReLU: none where it cut off.
fn cut_off(slopes: &mut [f32], values: &[f32]) {
    for (slope, value) in slopes.iter_mut().zip(values) {
        *slope = if *value > 0.0 { *slope } else { 0.0 };
    }
}

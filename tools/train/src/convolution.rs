//! A 3x3 convolution of many samples forward and backward, as products of matrices.
//!
//! Planes are channel-last. With a border of zeros round them the neighbourhood of an output is three runs of numbers, one
//! per row of the kernel; side by side they are a row of one matrix, and the weights are the other.

use crate::matrix::{Matrix, add_column_sums, add_product, product, rectify};

/// Sizes of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Planes it reads.
    pub(crate) inputs: usize,
    /// Planes it makes.
    pub(crate) outputs: usize,
    /// Cells from one output to the next.
    pub(crate) stride: usize,
    /// Rows and columns that it reads.
    pub(crate) from: [usize; 2],
    /// Rows and columns that it makes.
    pub(crate) to: [usize; 2],
}

impl Layout {
    /// Numbers that one sample's output has.
    pub(crate) fn output(&self) -> usize {
        self.outputs * self.to[0] * self.to[1]
    }

    /// Numbers in the neighbourhood of an output cell.
    pub(crate) fn neighbourhood(&self) -> usize {
        9 * self.inputs
    }

    /// Numbers of a sample's input with its border.
    fn bordered(&self) -> usize {
        self.inputs * (self.from[0] + 2) * (self.from[1] + 2)
    }

    /// Where the runs of all neighbourhoods begin among `count` bordered samples.
    fn runs(self, count: usize) -> impl Iterator<Item = usize> {
        let (rows, columns, width) = (self.from[0] + 2, self.to[1], self.from[1] + 2);
        (0..count * self.to[0]).flat_map(move |line| {
            let top = line / self.to[0] * rows + line % self.to[0] * self.stride;
            let place = move |tap, column| ((top + tap) * width + column * self.stride) * self.inputs;
            (0..columns).flat_map(move |column| (0..3).map(move |tap| place(tap, column)))
        })
    }

    /// Where the rows of the input begin among `count` bordered samples.
    fn lines(self, count: usize) -> impl Iterator<Item = usize> {
        let (rows, width) = (self.from[0], self.from[1] + 2);
        let place = move |line| (line / rows * (rows + 2) + line % rows + 1) * width + 1;
        (0..count * rows).map(move |line| place(line) * self.inputs)
    }
}

/// One convolution and its memory.
#[derive(Debug, Clone)]
pub(crate) struct Convolution {
    layout: Layout,
    /// Input with its border, per sample.
    bordered: Vec<f32>,
    /// The same for the slopes.
    bordered_slopes: Vec<f32>,
    /// Neighbourhoods, one row per output cell of each sample.
    unfolded: Vec<f32>,
    /// Slopes of those.
    unfolded_slopes: Vec<f32>,
}

impl Convolution {
    /// Memory for up to `samples` samples.
    pub(crate) fn new(layout: Layout, samples: usize) -> Self {
        let bordered = vec![0.0; samples * layout.bordered()];
        let unfolded = vec![0.0; samples * layout.to[0] * layout.to[1] * layout.neighbourhood()];
        Self {
            layout,
            bordered_slopes: bordered.clone(),
            bordered,
            unfolded_slopes: unfolded.clone(),
            unfolded,
        }
    }

    /// Convolves the planes of `count` samples and cuts off what is negative.
    pub(crate) fn forward(
        &mut self,
        [weight, bias]: [&[f32]; 2],
        count: usize,
        from: &[f32],
        to: &mut [f32],
    ) {
        let layout = self.layout;
        let line = layout.from[1] * layout.inputs;
        for (cells, at) in from.chunks_exact(line).zip(layout.lines(count)) {
            self.bordered[at..at + line].copy_from_slice(cells);
        }
        let run = 3 * layout.inputs;
        layout.runs(count).enumerate().for_each(|(index, at)| {
            self.unfolded[index * run..][..run].copy_from_slice(&self.bordered[at..][..run]);
        });
        let to = &mut to[..count * layout.output()];
        to.chunks_exact_mut(layout.outputs).for_each(|cell| cell.copy_from_slice(bias));
        let rows = (to.len() / layout.outputs, layout.neighbourhood());
        let weight = Matrix::rows(weight, (layout.neighbourhood(), layout.outputs));
        add_product(Matrix::rows(&self.unfolded, rows), weight, to);
        rectify(to);
    }

    /// From the slopes of the sums of `count` samples to those of weights and biases, which are added to, and to those of
    /// the input.
    pub(crate) fn backward(
        &mut self,
        weight: &[f32],
        [weight_slopes, bias_slopes]: [&mut [f32]; 2],
        count: usize,
        above: &[f32],
        below: &mut [f32],
    ) {
        let layout = self.layout;
        let above = &above[..count * layout.output()];
        let rows = (above.len() / layout.outputs, layout.neighbourhood());
        let above = Matrix::rows(above, (rows.0, layout.outputs));
        add_column_sums(above, bias_slopes);
        add_product(Matrix::rows(&self.unfolded, rows).transposed(), above, weight_slopes);
        let weight = Matrix::rows(weight, (layout.neighbourhood(), layout.outputs));
        product(above, weight.transposed(), &mut self.unfolded_slopes);
        self.bordered_slopes.fill(0.0);
        let run = 3 * layout.inputs;
        layout.runs(count).enumerate().for_each(|(index, at)| {
            let part = &self.unfolded_slopes[index * run..][..run];
            self.bordered_slopes[at..][..run].iter_mut().zip(part).for_each(|(sum, slope)| *sum += slope);
        });
        let line = layout.from[1] * layout.inputs;
        for (cells, at) in below.chunks_exact_mut(line).zip(layout.lines(count)) {
            cells.copy_from_slice(&self.bordered_slopes[at..at + line]);
        }
    }
}

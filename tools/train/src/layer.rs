//! A layer of the head and its memory: each cell that it makes sees a window of what the layer before made.
//!
//! A convolution sees three runs of numbers, one per row of its kernel: planes are channel-last, with a border of zeros.
//! A dense layer makes one cell, which sees all of a sample as one run. So both are the same products
//! (`products.rs`), and no window is ever copied out.

use crate::line::{LANES, Line, lines};
use crate::products::{GROUPS, Set};

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
    /// Numbers in the neighbourhood of an output cell.
    pub(crate) fn neighbourhood(&self) -> usize {
        9 * self.inputs
    }
}

/// What a cell sees: runs of numbers, `pitch` from one to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    pub(crate) rows: usize,
    pub(crate) pitch: usize,
    pub(crate) run: usize,
}

impl Window {
    /// Numbers in it.
    pub(crate) fn places(&self) -> usize {
        self.rows * self.run
    }

    /// Sets of outputs that a run fills, when it is what is summed.
    pub(crate) fn sets(&self) -> usize {
        self.run.div_ceil(LANES * GROUPS)
    }
}

/// One layer and its memory.
#[derive(Debug, Clone)]
pub(crate) struct Layer {
    pub(crate) window: Window,
    pub(crate) outputs: usize,
    /// Cells that it makes of a sample.
    pub(crate) made: usize,
    /// Numbers that it reads of a sample, with the border.
    pub(crate) size: usize,
    /// Registers that the outputs of a cell fill.
    pub(crate) groups: usize,
    /// Where the numbers of each cell of the layer before are put.
    pub(crate) entries: Vec<usize>,
    /// Where the window of each cell begins.
    pub(crate) starts: Vec<usize>,
    /// All samples, with their borders.
    pub(crate) input: Vec<Line>,
    /// Slopes of those.
    pub(crate) slopes: Vec<Line>,
    /// By set of outputs and place in the window.
    pub(crate) weights: Vec<Set>,
    /// By row, set of places in its run and output.
    pub(crate) transposed: Vec<Set>,
    pub(crate) bias: Vec<Line>,
    /// By cell and group: first what the layer makes, before any cut, then the slopes of that.
    pub(crate) sums: Vec<Line>,
}

impl Layer {
    /// A convolution of up to `samples` samples.
    pub(crate) fn convolution(layout: &Layout, samples: usize) -> Self {
        let &Layout { inputs, outputs, stride, from, to } = layout;
        let width = from[1] + 2;
        let size = (from[0] + 2) * width * inputs;
        let places = |[rows, columns]: [usize; 2], step: usize, border: usize| {
            let place = move |cell: usize| {
                let (row, column) = (cell / columns % rows * step, cell % columns * step);
                cell / (rows * columns) * size + ((row + border) * width + column + border) * inputs
            };
            (0..samples * rows * columns).map(place).collect()
        };
        let window = Window { rows: 3, pitch: width * inputs, run: 3 * inputs };
        Self::new(window, outputs, [places(from, 1, 1), places(to, stride, 0)], [samples, size])
    }

    /// A dense layer of up to `samples` samples; what is before it makes `cells` cells of `numbers` numbers.
    pub(crate) fn dense(inputs: usize, outputs: usize, [cells, numbers]: [usize; 2], samples: usize) -> Self {
        let size = inputs.next_multiple_of(LANES);
        let entries = (0..samples * cells).map(|cell| cell / cells * size + cell % cells * numbers).collect();
        let starts = (0..samples).map(|sample| sample * size).collect();
        let window = Window { rows: 1, pitch: 0, run: inputs };
        Self::new(window, outputs, [entries, starts], [samples, size])
    }

    fn new(
        window: Window,
        outputs: usize,
        [entries, starts]: [Vec<usize>; 2],
        [samples, size]: [usize; 2],
    ) -> Self {
        let groups = outputs.div_ceil(LANES);
        let empty = [Line::ZERO; GROUPS];
        let input = lines(samples * size);
        Self {
            window,
            outputs,
            made: starts.len() / samples,
            size,
            groups,
            slopes: input.clone(),
            input,
            weights: vec![empty; groups.div_ceil(GROUPS) * window.places()],
            transposed: vec![empty; window.rows * window.sets() * outputs],
            bias: vec![Line::ZERO; groups],
            sums: vec![Line::ZERO; starts.len() * groups],
            entries,
            starts,
        }
    }

    /// Takes weights, places x outputs, and biases.
    pub(crate) fn load(&mut self, weight: &[f32], bias: &[f32]) {
        let Window { run, .. } = self.window;
        let (places, sets) = (self.window.places(), self.window.sets());
        for (to, from) in self.bias.iter_mut().zip(bias.chunks(LANES)) {
            to.0[..from.len()].copy_from_slice(from);
        }
        for (place, row) in weight.chunks_exact(self.outputs).enumerate() {
            for (group, from) in row.chunks(LANES).enumerate() {
                let to = &mut self.weights[group / GROUPS * places + place][group % GROUPS];
                to.0[..from.len()].copy_from_slice(from);
            }
        }
        for (row, weight) in weight.chunks_exact(run * self.outputs).enumerate() {
            for (group, from) in weight.chunks(LANES * self.outputs).enumerate() {
                let to = &mut self.transposed[(row * sets + group / GROUPS) * self.outputs..][..self.outputs];
                for (output, to) in to.iter_mut().enumerate() {
                    let column = from[output..].iter().step_by(self.outputs);
                    to[group % GROUPS].0.iter_mut().zip(column).for_each(|(to, from)| *to = *from);
                }
            }
        }
    }
}

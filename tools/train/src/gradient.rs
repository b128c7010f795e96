//! Loss and gradient of a group of samples, in one fixed order of sums.

use crate::parameters::{LAMBDA, Shape, VALUE_SCALE, output_scale};
use crate::planes::{Kernels, PlaneScratch, Trace, backward, forward, place};
use crate::record::Record;
use sidestep_msgs::{LOCAL_SIDE, Limits, Twist, clamp_to_window};
use sidestep_policy::{
    CROP_CELLS, CROP_COL, CROP_COLS, CROP_ROW, FEATURES, HEAD_OUTPUTS, LOG_DOUBT_RANGE, Lanes, ROBOT_COL,
    ROBOT_ROW, goal_features,
};

/// Samples whose planes are kept at once: enough for the products of the dense layers (8 cost a tenth more, 32 no less).
const CHUNK: usize = 16;
/// `[m/s, rad/s]` error at which the loss turns from quadratic to linear.
const HUBER: f32 = 0.05;
/// Largest pull of the doubt, so that one surprise cannot shake the trunk.
const DOUBT_PULL_MAX: f32 = 10.0;

/// What the loss is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Goal {
    /// Limits of the robot.
    pub(crate) limits: Limits,
    /// Weight of the doubt beside the command.
    pub(crate) doubt_weight: f32,
    /// Whether the 734-candidate label is learned instead of the solved one.
    pub(crate) plain_labels: bool,
}

/// Sums over samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    /// Loss of the command.
    pub(crate) loss: f64,
    /// Loss of the doubt.
    pub(crate) doubt_loss: f64,
    /// `[m/s, rad/s]` absolute error within the window.
    pub(crate) error: [f64; 2],
}

impl Sums {
    pub(crate) fn add(&mut self, other: &Self) {
        self.loss += other.loss;
        self.doubt_loss += other.doubt_loss;
        self.error[0] += other.error[0];
        self.error[1] += other.error[1];
    }
}

/// The memory of one thread.
#[derive(Debug, Clone)]
pub(crate) struct Worker {
    shape: Shape,
    lanes: Lanes,
    traces: Vec<Trace>,
    planes: PlaneScratch,
    /// Activations: features, two hidden layers, outputs.
    layers: [Vec<f32>; 4],
    /// Their gradients.
    slopes: [Vec<f32>; 4],
}

impl Worker {
    pub(crate) fn new(shape: Shape) -> Self {
        let sizes = [FEATURES, shape.hidden[0], shape.hidden[1], HEAD_OUTPUTS];
        let layers = sizes.map(|size| vec![0.0; size * CHUNK]);
        Self {
            shape,
            lanes: crate::planes::lanes(),
            traces: vec![Trace::new(shape.rounds); CHUNK],
            planes: PlaneScratch::new(shape.channels),
            slopes: layers.clone(),
            layers,
        }
    }

    /// Adds the gradient of the summed loss of `records` to `gradient`.
    pub(crate) fn group(
        &mut self,
        parameters: &[f32],
        goal: &Goal,
        records: &[Record],
        gradient: &mut [f32],
    ) -> Sums {
        let kernels = self.kernels(parameters);
        let mut sums = Sums::default();
        for chunk in records.chunks(CHUNK) {
            self.activate(parameters, &kernels, chunk);
            for (index, record) in chunk.iter().enumerate() {
                let span = index * HEAD_OUTPUTS..(index + 1) * HEAD_OUTPUTS;
                sums.add(&loss(goal, record, &self.layers[3][span.clone()], &mut self.slopes[3][span]));
            }
            self.head_backward(parameters, chunk.len(), gradient);
            for index in 0..chunk.len() {
                let slope = &self.slopes[0][index * FEATURES..][..FEATURES];
                spread(slope, self.planes.gradient());
                backward(self.lanes, &kernels, &self.traces[index], &mut self.planes, gradient);
            }
        }
        sums
    }

    fn kernels(&self, parameters: &[f32]) -> Kernels {
        Kernels {
            reward: Shape::kernels(&parameters[self.shape.reward()]),
            bias: parameters[self.shape.reward_bias()].to_vec(),
            value: Shape::kernels(&parameters[self.shape.value()]),
            rounds: self.shape.rounds,
        }
    }

    /// From records to outputs.
    fn activate(&mut self, parameters: &[f32], kernels: &Kernels, chunk: &[Record]) {
        for (index, record) in chunk.iter().enumerate() {
            let trace = &mut self.traces[index];
            for (cell, cost) in record.planning_cost.iter().enumerate() {
                trace.reward_map[place(cell / LOCAL_SIDE, cell % LOCAL_SIDE)] = -f32::from(*cost) / 255.0;
            }
            let goal = usize::from(record.goal_cell);
            trace.reward_map[place(goal / LOCAL_SIDE, goal % LOCAL_SIDE)] += LAMBDA;
            forward(self.lanes, kernels, trace, &mut self.planes);
            features(trace, record, &mut self.layers[0][index * FEATURES..][..FEATURES]);
        }
        for layer in 0..3 {
            let (inputs, outputs) = self.shape.dense()[layer];
            let (weight, bias) = self.shape.layer(layer);
            let [from, to] = &mut self.layers[layer..layer + 2] else { continue };
            for row in to.chunks_exact_mut(outputs) {
                row.copy_from_slice(&parameters[bias.clone()]);
            }
            let (rows, columns) = ((chunk.len(), inputs), (inputs, outputs));
            product(Matrix::rows(from, rows), Matrix::rows(&parameters[weight], columns), to);
            if layer < 2 {
                to.iter_mut().for_each(|value| *value = if *value > 0.0 { *value } else { 0.0 });
            }
        }
    }

    /// From the slopes of the outputs to those of the features and of the dense parameters.
    fn head_backward(&mut self, parameters: &[f32], count: usize, gradient: &mut [f32]) {
        for layer in (0..3).rev() {
            let (inputs, outputs) = self.shape.dense()[layer];
            let (weight, bias) = self.shape.layer(layer);
            let [below, above] = &mut self.slopes[layer..layer + 2] else { continue };
            let above = Matrix::rows(above, (count, outputs));
            for row in above.data[..count * outputs].chunks_exact(outputs) {
                gradient[bias.clone()].iter_mut().zip(row).for_each(|(sum, slope)| *sum += slope);
            }
            let active = Matrix::rows(&self.layers[layer], (count, inputs));
            product(active.transposed(), above, &mut gradient[weight.clone()]);
            below.fill(0.0);
            product(above, Matrix::rows(&parameters[weight], (inputs, outputs)).transposed(), below);
            if layer > 0 {
                for (slope, value) in below.iter_mut().zip(&self.layers[layer]) {
                    *slope = if *value > 0.0 { *slope } else { 0.0 };
                }
            }
        }
    }
}

/// What the dense layers see of a sample.
fn features(trace: &Trace, record: &Record, out: &mut [f32]) {
    let value = trace.value();
    let robot = robot_places().iter().map(|index| value[*index]).sum::<f32>() * 0.25;
    for cell in 0..CROP_CELLS {
        let from = crop_place(cell);
        out[cell] = VALUE_SCALE * (value[from] - robot);
        out[CROP_CELLS + cell] = trace.reward_map[from];
    }
    out[2 * CROP_CELLS..2 * CROP_CELLS + 2].copy_from_slice(&record.velocity);
    out[2 * CROP_CELLS + 2..].copy_from_slice(&goal_features(usize::from(record.goal_cell)));
}

/// From the slopes of the features to the gradient of V.
fn spread(slope: &[f32], gradient: &mut [f32]) {
    gradient.fill(0.0);
    let mut total = 0.0;
    for cell in 0..CROP_CELLS {
        let part = VALUE_SCALE * slope[cell];
        gradient[crop_place(cell)] += part;
        total += part;
    }
    for index in robot_places() {
        gradient[index] -= 0.25 * total;
    }
}

fn crop_place(cell: usize) -> usize {
    place(CROP_ROW + cell / CROP_COLS, CROP_COL + cell % CROP_COLS)
}

fn robot_places() -> [usize; 4] {
    std::array::from_fn(|index| place(ROBOT_ROW + index / 2, ROBOT_COL + index % 2))
}

/// Loss of one sample, and its slope for each output.
///
/// The command is compared within the window of the label: beyond the same edge of it there is nothing to gain. The
/// doubt learns the error as the scale of a Laplace distribution; the error itself is a constant to it.
fn loss(goal: &Goal, record: &Record, output: &[f32], slope: &mut [f32]) -> Sums {
    let scale = output_scale(&goal.limits);
    let from = record.twist();
    let label = if goal.plain_labels { record.label_734 } else { record.label_solved };
    let within = |v, w| {
        let twist = clamp_to_window(Twist::new(v, w), from, &goal.limits);
        [twist.v_m_s, twist.w_rad_s]
    };
    let (least, most) = (within(-100.0, -100.0), within(100.0, 100.0));
    let target = within(label[0], label[1]);
    let wish: [f32; 2] = std::array::from_fn(|axis| record.velocity[axis] + scale[axis] * output[axis]);
    let command = within(wish[0], wish[1]);
    let mut sums = Sums::default();
    for axis in 0..2 {
        let idle = (target[axis] >= most[axis] && wish[axis] >= most[axis])
            || (target[axis] <= least[axis] && wish[axis] <= least[axis]);
        let error = if idle { 0.0 } else { wish[axis] - target[axis] };
        slope[axis] = scale[axis] * (error / HUBER).clamp(-1.0, 1.0);
        let size = error.abs();
        let value = if size < HUBER { 0.5 * size * size / HUBER } else { size - 0.5 * HUBER };
        sums.loss += f64::from(value);
        sums.error[axis] = f64::from((command[axis] - target[axis]).abs());

        let log = output[2 + axis].clamp(LOG_DOUBT_RANGE.0, LOG_DOUBT_RANGE.1);
        let ratio = (command[axis] - target[axis]).abs() * libm::expf(-log);
        let pull = (1.0 - ratio).max(-DOUBT_PULL_MAX);
        // Beyond the range only the way back counts.
        let outside = (output[2 + axis] > log && pull < 0.0) || (output[2 + axis] < log && pull > 0.0);
        slope[2 + axis] = if outside { 0.0 } else { goal.doubt_weight * pull };
        sums.doubt_loss += f64::from(log + ratio);
    }
    sums
}

/// A view of numbers as rows and columns.
#[derive(Clone, Copy)]
struct Matrix<'a> {
    data: &'a [f32],
    size: (usize, usize),
    strides: (usize, usize),
}

impl<'a> Matrix<'a> {
    fn rows(data: &'a [f32], size: (usize, usize)) -> Self {
        assert!(data.len() >= size.0 * size.1, "a matrix of {size:?} needs more than {} numbers", data.len());
        Self { data, size, strides: (size.1, 1) }
    }

    fn transposed(self) -> Self {
        Self { size: (self.size.1, self.size.0), strides: (self.strides.1, self.strides.0), ..self }
    }
}

/// out += left * right, out row by row.
#[allow(unsafe_code, reason = "matrixmultiply takes pointers; the sizes are checked here")]
fn product(left: Matrix<'_>, right: Matrix<'_>, out: &mut [f32]) {
    let ((rows, inner), columns) = (left.size, right.size.1);
    assert!(inner == right.size.0 && out.len() >= rows * columns, "{:?} {:?}", left.size, right.size);
    let strides = |matrix: Matrix<'_>| (matrix.strides.0 as isize, matrix.strides.1 as isize);
    let ((row_left, column_left), (row_right, column_right)) = (strides(left), strides(right));
    // SAFETY: both views hold their size (checked when made), and out holds rows x columns.
    unsafe {
        matrixmultiply::sgemm(
            rows,
            inner,
            columns,
            1.0,
            left.data.as_ptr(),
            row_left,
            column_left,
            right.data.as_ptr(),
            row_right,
            column_right,
            1.0,
            out.as_mut_ptr(),
            columns as isize,
            1,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use bytemuck::Zeroable;
    use sidestep_msgs::{LOCAL_CELLS, Robot};

    fn goal() -> Goal {
        let robot =
            Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap();
        Goal { limits: robot.limits, doubt_weight: 0.0, plain_labels: false }
    }

    fn records(count: usize) -> Vec<Record> {
        (0..count as u64)
            .map(|stream| {
                let mut random = Random::new(3, stream);
                let mut record = Record::zeroed();
                record.planning_cost.iter_mut().for_each(|cost| *cost = (random.unit() * 200.0) as u8);
                record.goal_cell = random.below(LOCAL_CELLS) as u16;
                record.velocity = [random.between(0.2, 0.8), random.between(-1.0, 1.0)];
                record.label_solved = [random.between(0.0, 1.0), random.between(-1.5, 1.5)];
                record
            })
            .collect()
    }

    const SHAPE: Shape = Shape { channels: 5, rounds: 6, hidden: [24, 16] };

    fn evaluate(parameters: &[f32], records: &[Record]) -> (f64, Vec<f32>) {
        let mut gradient = vec![0.0; SHAPE.count()];
        let sums = Worker::new(SHAPE).group(parameters, &goal(), records, &mut gradient);
        (sums.loss, gradient)
    }

    /// Compares slopes along random directions, one block of parameters at a time, with finite differences.
    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let mut parameters = SHAPE.initial(5);
        let mut random = Random::new(11, 0);
        parameters.iter_mut().for_each(|value| *value += 0.03 * random.normal());
        let records = records(3);
        let (_, gradient) = evaluate(&parameters, &records);
        let blocks = [
            SHAPE.reward(),
            SHAPE.reward_bias(),
            SHAPE.value(),
            SHAPE.layer(0).0,
            SHAPE.layer(1).0,
            SHAPE.layer(2).0,
            SHAPE.layer(0).1,
            SHAPE.layer(2).1,
        ];
        for block in blocks {
            let direction: Vec<f32> =
                block.clone().map(|index| gradient[index].signum() * random.unit()).collect();
            let along = |step: f32| {
                let mut moved = parameters.clone();
                moved[block.clone()].iter_mut().zip(&direction).for_each(|(value, d)| *value += step * d);
                evaluate(&moved, &records).0
            };
            // Small enough that few of the kinks of max and ReLU lie within it.
            let step = 6e-5;
            let measured = (along(step) - along(-step)) / f64::from(2.0 * step);
            let claimed: f64 =
                direction.iter().zip(&gradient[block.clone()]).map(|(d, g)| f64::from(d * g)).sum();
            assert!(
                (measured - claimed).abs() < 0.01 * claimed.abs() + 2e-4,
                "{block:?}: {measured} {claimed}"
            );
        }
    }

    #[test]
    fn nothing_pulls_when_both_are_beyond_the_same_edge_of_the_window() {
        let mut record = records(1)[0];
        record.velocity = [0.2, 0.0];
        record.label_solved = [1.0, 1.5];
        let mut slope = [1.0; 4];
        let sums = loss(&goal(), &record, &[1.2, 1.5, 0.0, 0.0], &mut slope);
        assert_eq!((slope, sums.loss, sums.error), ([0.0; 4], 0.0, [0.0; 2]));
        loss(&goal(), &record, &[-1.2, 0.9, 0.0, 0.0], &mut slope);
        assert!(slope[0] < 0.0 && slope[1] < 0.0);
    }

    #[test]
    fn the_doubt_is_pulled_to_the_size_of_the_error() {
        let mut record = records(1)[0];
        record.velocity = [0.2, 0.0];
        record.label_solved = [0.4, 0.0];
        let goal = Goal { doubt_weight: 1.0, ..goal() };
        // The wish is 0.2 + 0.3 * 0.333 = 0.3 m/s: an error of 0.1 m/s.
        let pull = |log: f32| {
            let mut slope = [0.0; 4];
            loss(&goal, &record, &[1.0 / 3.0, 0.0, log, -3.0], &mut slope);
            slope[2]
        };
        assert!(pull(-1.0) > 0.5 && pull(-4.0) < -0.5 && pull(libm::logf(0.1)).abs() < 1e-4);
    }
}

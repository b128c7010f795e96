//! Loss and gradient of a group of samples, in one fixed order of sums.

use crate::head::{Head, Outputs};
use crate::parameters::{LAMBDA, Shape, VALUE_SCALE, output_scale};
use crate::planes::{Kernels, PlaneScratch, Trace, backward, forward, place};
use crate::record::Record;
use sidestep_msgs::{LOCAL_SIDE, Limits, Twist, clamp_to_window};
use sidestep_policy::{
    CROP_CELLS, CROP_COL, CROP_COLS, CROP_PLANES, CROP_ROW, LOG_DOUBT_RANGE, Lanes, ROBOT_COL, ROBOT_ROW,
    goal_features,
};

/// Samples whose planes are kept at once: enough for the products of the dense layers (8 and 32 cost a little more).
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
    kernels: Kernels,
    traces: Vec<Trace>,
    planes: PlaneScratch,
    head: Head,
}

impl Worker {
    pub(crate) fn new(shape: Shape, lanes: Lanes) -> Self {
        Self {
            shape,
            lanes,
            kernels: Kernels::default(),
            traces: vec![Trace::new(shape.rounds); CHUNK],
            planes: PlaneScratch::new(shape.channels),
            head: Head::new(shape, lanes, CHUNK),
        }
    }

    /// Takes the parameters that the gradients are asked at.
    pub(crate) fn load(&mut self, parameters: &[f32]) {
        self.kernels = Kernels {
            reward: Shape::kernels(&parameters[self.shape.reward()]),
            bias: parameters[self.shape.reward_bias()].to_vec(),
            value: Shape::kernels(&parameters[self.shape.value()]),
            rounds: self.shape.rounds,
        };
        self.head.load(parameters);
    }

    /// Adds the gradient of the summed loss of `records` to `gradient`.
    pub(crate) fn group(&mut self, goal: &Goal, records: &[Record], gradient: &mut [f32]) -> Sums {
        let mut sums = Sums::default();
        for chunk in records.chunks(CHUNK) {
            self.answer(chunk);
            for (index, record) in chunk.iter().enumerate() {
                let place = self.head.output(index);
                let output = *place;
                sums.add(&loss(goal, record, &output, place));
            }
            self.head.backward(chunk.len(), gradient);
            for (index, trace) in self.traces.iter().enumerate().take(chunk.len()) {
                spread(self.head.crop_slopes(index), self.planes.gradient());
                backward(self.lanes, &self.kernels, trace, &mut self.planes, gradient);
            }
        }
        sums
    }

    /// From records to the outputs of the head.
    fn answer(&mut self, records: &[Record]) {
        for (index, record) in records.iter().enumerate() {
            self.plan(index, record);
        }
        self.head.forward(records.len());
    }

    /// From a record to what the head sees of it.
    fn plan(&mut self, index: usize, record: &Record) {
        let trace = &mut self.traces[index];
        let reward_map = trace.reward_map_mut();
        for (cell, cost) in record.planning_cost.iter().enumerate() {
            reward_map[place(cell / LOCAL_SIDE, cell % LOCAL_SIDE)] = -f32::from(*cost) / 255.0;
        }
        let goal = usize::from(record.goal_cell);
        reward_map[place(goal / LOCAL_SIDE, goal % LOCAL_SIDE)] += LAMBDA;
        forward(self.lanes, &self.kernels, trace, &mut self.planes);
        let direct = record.velocity.into_iter().chain(goal_features(goal));
        self.head.see(index, crop(trace), direct);
    }
}

/// The crop: V relative to the robot, and m_r, cell by cell.
fn crop(trace: &Trace) -> impl Iterator<Item = [f32; CROP_PLANES]> {
    let (value, reward_map) = (trace.value(), trace.reward_map());
    let robot = robot_places().iter().map(|index| value[*index]).sum::<f32>() * 0.25;
    let seen = move |from: usize| [VALUE_SCALE * (value[from] - robot), reward_map[from]];
    (0..CROP_CELLS).map(crop_place).map(seen)
}

/// From the slopes of V in the crop to the gradient of V.
fn spread(crop: impl Iterator<Item = f32>, gradient: &mut [f32]) {
    gradient.fill(0.0);
    let mut total = 0.0;
    for (cell, slope) in crop.enumerate() {
        let part = VALUE_SCALE * slope;
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
fn loss(goal: &Goal, record: &Record, output: &Outputs, slope: &mut Outputs) -> Sums {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::ConvolutionSize;
    use crate::random::Random;
    use bytemuck::Zeroable;
    use sidestep_msgs::{LOCAL_CELLS, Robot};
    use sidestep_policy::{Contract, Golden, record_golden, to_onnx};

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

    const CONVOLUTIONS: &[ConvolutionSize] =
        &[ConvolutionSize { outputs: 5, stride: 1 }, ConvolutionSize { outputs: 6, stride: 3 }];
    const DENSE: Shape = Shape { channels: 5, rounds: 6, convolutions: &[], hidden: [24, 16] };

    fn evaluate_on(lanes: Lanes, shape: Shape, parameters: &[f32], records: &[Record]) -> (f64, Vec<f32>) {
        let mut gradient = vec![0.0; shape.count()];
        let mut worker = Worker::new(shape, lanes);
        worker.load(parameters);
        let sums = worker.group(&goal(), records, &mut gradient);
        (sums.loss, gradient)
    }

    fn evaluate(shape: Shape, parameters: &[f32], records: &[Record]) -> (f64, Vec<f32>) {
        evaluate_on(Lanes::detect(), shape, parameters, records)
    }

    /// Compares slopes along random directions, one block of parameters at a time, with finite differences.
    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        for shape in [DENSE, Shape { convolutions: CONVOLUTIONS, ..DENSE }] {
            let mut parameters = shape.initial(5);
            let mut random = Random::new(11, 0);
            parameters.iter_mut().for_each(|value| *value += 0.03 * random.normal());
            let records = records(3);
            let (_, gradient) = evaluate(shape, &parameters, &records);
            let layers = (0..shape.convolutions.len()).map(|index| shape.convolution(index));
            let layers = layers.chain((0..3).map(|index| shape.layer(index)));
            let blocks = [shape.reward(), shape.reward_bias(), shape.value()]
                .into_iter()
                .chain(layers.flat_map(|(weight, bias)| [weight, bias]));
            for block in blocks {
                let direction: Vec<f32> =
                    block.clone().map(|index| gradient[index].signum() * random.unit()).collect();
                let along = |step: f32| {
                    let mut moved = parameters.clone();
                    moved[block.clone()].iter_mut().zip(&direction).for_each(|(value, d)| *value += step * d);
                    evaluate(shape, &moved, &records).0
                };
                // Small enough that few of the kinks of max and ReLU lie within it; more parameters move further.
                let step = 6e-5 / (1.0 + block.len() as f32 / 2000.0);
                let measured = (along(step) - along(-step)) / f64::from(2.0 * step);
                let claimed: f64 =
                    direction.iter().zip(&gradient[block.clone()]).map(|(d, g)| f64::from(d * g)).sum();
                assert!(
                    (measured - claimed).abs() < 0.01 * claimed.abs() + 2e-4,
                    "{block:?}: {measured} {claimed}"
                );
            }
        }
    }

    /// Seven samples of the network that ships: whole registers, parts of one, and a last quad that is not full.
    #[test]
    fn every_fused_variant_gives_the_same_bits() {
        let fused: Vec<_> = Lanes::available().into_iter().filter(|lanes| lanes.class() == "fused").collect();
        let shape = Shape { rounds: 6, ..Shape::STANDARD };
        for shape in [shape, Shape { convolutions: CONVOLUTIONS, ..DENSE }] {
            let (parameters, records) = (shape.initial(5), records(7));
            let bits = |lanes| {
                let (_, gradient) = evaluate_on(lanes, shape, &parameters, &records);
                gradient.into_iter().map(f32::to_bits).collect::<Vec<_>>()
            };
            for pair in fused.windows(2) {
                assert!(bits(pair[0]) == bits(pair[1]), "{pair:?} {shape:?}");
            }
        }
    }

    /// Asks the exported model, run by an engine of its own, what the head answers here.
    #[test]
    fn the_exported_model_answers_what_was_trained() {
        let (records, limits) = (records(2), goal().limits);
        for shape in [DENSE, Shape { convolutions: CONVOLUTIONS, ..DENSE }] {
            let mut parameters = shape.initial(5);
            let mut random = Random::new(12, 0);
            parameters.iter_mut().for_each(|value| *value += 0.03 * random.normal());
            let mut worker = Worker::new(shape, Lanes::detect());
            worker.load(&parameters);
            worker.answer(&records);
            for (index, record) in records.iter().enumerate() {
                let contract = contract(shape.rounds, record);
                let onnx = to_onnx(&shape.network(&parameters, &limits), &contract);
                let answer = record_golden(&onnx, contract.golden).unwrap();
                let output = worker.head.output(index);
                for axis in 0..2 {
                    let command = record.velocity[axis] + output_scale(&limits)[axis] * output[axis];
                    assert!((answer.command[axis] - command).abs() < 1e-4, "{:?} {output:?}", answer.command);
                    let log = output[2 + axis].clamp(LOG_DOUBT_RANGE.0, LOG_DOUBT_RANGE.1);
                    assert!((answer.doubt[axis] - libm::expf(log)).abs() < 1e-4, "{:?}", answer.doubt);
                }
            }
        }
    }

    fn contract(rounds: usize, record: &Record) -> Contract {
        let golden = Golden {
            planning_cost: record.planning_cost,
            goal_cell: record.goal_cell.into(),
            velocity: record.twist(),
            command: [0.0; 2],
            doubt: [0.0; 2],
        };
        Contract {
            rounds,
            robot: "loomo".into(),
            robot_hash: 0,
            motion_hash: 0,
            window_s: 0.3,
            dataset_hash: 0,
            samples_seen: 0,
            golden,
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

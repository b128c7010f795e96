//! Time of one inference, fused and in plain tract, and of the kernels alone.

use sidestep_msgs::{LOCAL_CELLS, Robot, Twist};
use sidestep_policy::*;

fn main() {
    divan::main();
}

fn robot() -> Option<Robot> {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).ok()
}

fn question() -> ([u8; LOCAL_CELLS], usize, Twist) {
    let mut map = [0; LOCAL_CELLS];
    for (index, cell) in map.iter_mut().enumerate() {
        *cell = if index % 28 > 18 && index / 28 < 12 { 200 } else { (index % 7) as u8 };
    }
    (map, 130, Twist::new(0.5, 0.1))
}

#[divan::bench(sample_count = 2000)]
fn policy(bencher: divan::Bencher<'_, '_>) {
    let Some(mut policy) = robot().and_then(|robot| Policy::load(embedded(), "embedded", &robot).ok()) else {
        return;
    };
    let (map, goal, twist) = question();
    bencher.bench_local(|| policy.infer(divan::black_box(&map), goal, twist));
}

/// Convolutions of the size that `sidestep train` makes; only the numbers are made up.
fn head() -> Vec<ConvolutionLayer> {
    let numbers = |count: usize| -> Vec<f32> {
        (0..count).map(|index| 0.1 * ((index * 7919 % 1000) as f32 / 500.0 - 1.0)).collect()
    };
    let convolution = |inputs: usize, outputs: usize, stride| {
        let (weight, bias) = (numbers(9 * inputs * outputs), numbers(outputs));
        ConvolutionLayer { inputs, outputs, stride, weight, bias }
    };
    vec![convolution(CROP_PLANES, 32, 1), convolution(32, 64, 2), convolution(64, 64, 2)]
}

#[divan::bench(sample_count = 100)]
fn policy_in_plain_tract(bencher: divan::Bencher<'_, '_>) {
    let plain = robot().and_then(|robot| Policy::load_plain(embedded(), "embedded", &robot).ok());
    let Some(mut policy) = plain else { return };
    let (map, goal, twist) = question();
    bencher.bench_local(|| policy.infer(divan::black_box(&map), goal, twist));
}

/// Kernels of rewards and of values that plan.
fn kernels() -> (Vec<[f32; 9]>, Vec<[f32; 9]>) {
    let kernel = |q: usize| std::array::from_fn(|tap| if tap == q % 9 { 0.95 } else { 0.01 });
    let kernels: Vec<[f32; 9]> = (0..10).map(kernel).collect();
    (kernels.clone(), kernels)
}

#[divan::bench(args = Lanes::available(), sample_count = 1000)]
fn value_iteration(bencher: divan::Bencher<'_, '_>, lanes: Lanes) {
    let (reward, value) = kernels();
    let weights = ValueIteration { reward, bias: vec![0.0; 10], value, rounds: 36 };
    let (mut scratch, mut out) = (ValueScratch::new(10), [0.0; LOCAL_CELLS]);
    let map = question().0.map(|byte| -f32::from(byte) / 255.0);
    bencher.bench_local(|| {
        weights.run(lanes, divan::black_box(&map), &mut scratch, &mut out);
        out[0]
    });
}

#[divan::bench(args = Lanes::available(), sample_count = 1000)]
fn convolutions(bencher: divan::Bencher<'_, '_>, lanes: Lanes) {
    let chain = ConvolutionChain::new(&head(), [CROP_ROWS, CROP_COLS]);
    let (mut scratch, mut out) = (chain.scratch(), vec![0.0; chain.shape().iter().product()]);
    let planes = [vec![0.3; CROP_CELLS], vec![-0.2; CROP_CELLS]];
    bencher.bench_local(|| {
        chain.run(lanes, [divan::black_box(&planes[0]), &planes[1]], &mut scratch, &mut out);
        out[0]
    });
}

#[divan::bench(sample_count = 5)]
fn load() -> bool {
    robot().is_some_and(|robot| Policy::load(embedded(), "embedded", &robot).is_ok())
}

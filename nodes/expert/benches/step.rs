//! Time of one plan, by mode and number of candidates; problems are taken in turn.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../src/samples.rs"]
mod samples;

use samples::{LOOMO, Sample};
use sidestep_expert::{Mode, Planner, Weights};
use sidestep_msgs::Twist;

fn main() {
    divan::main();
}

fn time(bencher: divan::Bencher<'_, '_>, candidates: usize, mode: Mode) {
    let samples: Vec<Sample> = (0..32).map(Sample::artificial).collect();
    let mut planner = Planner::new(&LOOMO, &Weights::STANDARD, candidates);
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % samples.len();
        let sample = &samples[next];
        planner.plan(divan::black_box(&sample.cost), sample.goal, sample.from, mode)
    });
}

#[divan::bench(args = [50, 125, 270, 734, 2000, 10000], sample_count = 500)]
fn plain(bencher: divan::Bencher<'_, '_>, candidates: usize) {
    time(bencher, candidates, Mode::Plain);
}

#[divan::bench(sample_count = 500)]
fn solved(bencher: divan::Bencher<'_, '_>) {
    time(bencher, 734, Mode::Solved);
}

#[divan::bench(sample_count = 500)]
fn refined(bencher: divan::Bencher<'_, '_>) {
    time(bencher, 734, Mode::Refined(Twist::new(0.5, 0.3)));
}

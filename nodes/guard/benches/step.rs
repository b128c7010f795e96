//! Time of one step: the first frame of the office, 640 x 480 with noise, every second row and column, and every pixel.

use sidestep_guard::{Config, Guard};
use sidestep_msgs::{DepthFrame, NearField, Robot};
use sidestep_sim::{Simulator, World};

fn main() {
    divan::main();
}

#[divan::bench(args = [2, 1], sample_count = 500)]
fn depth_640x480(bencher: divan::Bencher<'_, '_>, stride_px: u32) {
    let text = include_str!("../../../launch/robots/loomo.toml");
    let Ok(robot) = Robot::from_toml("loomo.toml", text) else { return };
    let Ok(mut guard) = Guard::new(&Config { stride_px, ..Config::STANDARD }, &robot) else { return };
    let world = World::office(1);
    let start = world.start;
    let mut simulator = Simulator::new(&sidestep_sim::Config::default(), &robot, world, start, 1);
    simulator.advance(100_000_000);
    let (mut frame, mut field) = (Box::<DepthFrame>::default(), NearField::default());
    simulator.render(&mut frame);
    bencher.bench_local(|| guard.step(divan::black_box(&frame), &mut field));
}

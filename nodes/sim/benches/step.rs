//! Time of one depth frame, one scan and one step of the world.

use sidestep_msgs::{DepthFrame, Robot, Scan};
use sidestep_sim::{Config, Simulator, World};

fn main() {
    divan::main();
}

fn robot(name: &str) -> Robot {
    let path = format!("{}/../../launch/robots/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    match Robot::from_toml(&path, &text) {
        Ok(robot) => robot,
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(2)
        }
    }
}

fn office(config: &Config, name: &str) -> Simulator {
    let world = World::office(1);
    let start = world.start;
    let mut simulator = Simulator::new(config, &robot(name), world, start, 1);
    simulator.advance(1);
    simulator
}

#[divan::bench(args = [640, 320, 160])]
fn depth(bencher: divan::Bencher, width_px: u32) {
    let config = Config { width_px, height_px: width_px * 3 / 4, ..Config::default() };
    let mut simulator = office(&config, "loomo");
    let mut frame = Box::new(DepthFrame::default());
    bencher.bench_local(move || simulator.render(&mut frame));
}

#[divan::bench]
fn depth_without_noise(bencher: divan::Bencher) {
    let mut simulator = office(&Config { noise: false, ..Config::default() }, "loomo");
    let mut frame = Box::new(DepthFrame::default());
    bencher.bench_local(move || simulator.render(&mut frame));
}

#[divan::bench]
fn scan(bencher: divan::Bencher) {
    let mut simulator = office(&Config::default(), "jackal");
    let mut scan = Scan::default();
    bencher.bench_local(move || simulator.scan(&mut scan));
}

#[divan::bench]
fn ten_milliseconds_of_world(bencher: divan::Bencher) {
    let mut simulator = office(&Config::default(), "loomo");
    let mut now_ns = 1;
    bencher.bench_local(move || {
        now_ns += 10_000_000;
        simulator.advance(now_ns);
    });
}

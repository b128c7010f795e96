//! Time of one step: an office-like frame of 640 x 480 into the memory and out as both maps.

#[path = "../tests/scene/mod.rs"]
mod scene;

use divan::Bencher;
use scene::{Scene, View, frame, loomo};
use sidestep_mapper::{Config, Mapper, Widening, planning_cost};
use sidestep_msgs::{DepthFrame, LocalMap, Pose2, SafetyMap, Scan};

fn main() {
    divan::main();
}

/// Walls on three sides, a desk on four legs, a cupboard and two boxes.
fn office() -> Scene {
    let mut scene = Scene::default()
        .stand([3.2, 3.4], [-3.0, 3.0], 2.5)
        .stand([-2.0, 3.4], [1.9, 2.1], 2.5)
        .stand([1.5, 1.8], [-0.5, -0.2], 0.3)
        .stand([2.2, 2.6], [0.1, 0.5], 0.5)
        .hang([1.8, 2.8], [-1.6, -0.8], [0.7, 0.74]);
    for (x, y) in [(1.82, -1.58), (2.75, -1.58), (1.82, -0.83), (2.75, -0.83)] {
        scene = scene.stand([x, x + 0.03], [y, y + 0.03], 0.7);
    }
    scene
}

/// Ten frames on a slow curve, with some pixels lost and all a little noisy.
fn drive() -> (Mapper, Vec<(View, Box<DepthFrame>)>) {
    let robot = loomo();
    let mapper = Mapper::new(&Config::shipped(), &robot).unwrap_or_else(|error| unreachable!("{error}"));
    let mut seed = 1u64;
    let frames = (0..10).map(|step| {
        let view = View::level(Pose2::new(0.02 * f64::from(step), 0.0, 0.02 * f64::from(step)));
        let mut frame = frame(1);
        office().render(&view, 0, &mut frame);
        for pixel in frame.pixels.iter_mut() {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let (noise, lost) = ((seed >> 60) as i32 - 8, seed >> 40 & 31 == 0);
            *pixel = if lost { 0 } else { (i32::from(*pixel) + noise).max(0) as u16 };
        }
        (view, frame)
    });
    let frames = frames.collect();
    (mapper, frames)
}

fn step(bencher: Bencher, write: bool) {
    let (mut mapper, mut frames) = drive();
    let (mut local, mut safety) = (LocalMap::default(), SafetyMap::default());
    let mut count = 0u64;
    bencher.bench_local(|| {
        count += 1;
        let (view, frame) = &mut frames[count as usize % 10];
        let stamp_ns = 33_333_333 * count;
        frame.capture_ns = stamp_ns;
        mapper.odometry(&view.odometry(stamp_ns));
        let status = mapper.depth(frame);
        if write {
            mapper.write_local(&mut local);
            mapper.write_safety(&mut safety);
        }
        status
    });
}

#[divan::bench]
fn depth_640x480(bencher: Bencher) {
    step(bencher, false);
}

#[divan::bench]
fn depth_640x480_and_both_maps(bencher: Bencher) {
    step(bencher, true);
}

#[divan::bench]
fn scan_720_beams_and_both_maps(bencher: Bencher) {
    let mut mapper =
        Mapper::new(&Config::shipped(), &scene::jackal()).unwrap_or_else(|error| unreachable!("{error}"));
    let mut scan =
        Scan { first_rad: -2.356, step_rad: 4.712 / 720.0, near_m: 0.1, far_m: 10.0, ..Scan::default() };
    scan.count = 720;
    for (beam, range_m) in scan.range_m.iter_mut().enumerate() {
        *range_m = 1.5 + 2.0 * (beam / 40 % 3) as f32;
    }
    let (mut local, mut safety) = (LocalMap::default(), SafetyMap::default());
    let view = View::level(Pose2::ORIGIN);
    bencher.bench_local(|| {
        scan.capture_ns += 33_333_333;
        mapper.odometry(&view.odometry(scan.capture_ns));
        let status = mapper.scan(&scan);
        mapper.write_local(&mut local);
        mapper.write_safety(&mut safety);
        status
    });
}

#[divan::bench]
fn local_map(bencher: Bencher) {
    let (mapper, _) = drive();
    let mut map = LocalMap::default();
    bencher.bench_local(|| mapper.write_local(&mut map));
}

#[divan::bench]
fn safety_map(bencher: Bencher) {
    let (mapper, _) = drive();
    let mut map = SafetyMap::default();
    bencher.bench_local(|| mapper.write_safety(&mut map));
}

#[divan::bench]
fn planning(bencher: Bencher) {
    let (mut mapper, mut frames) = drive();
    let mut map = LocalMap::default();
    for (count, (view, frame)) in frames.iter_mut().enumerate() {
        frame.capture_ns = 33_333_333 * (count as u64 + 1);
        mapper.odometry(&view.odometry(frame.capture_ns));
        mapper.depth(frame);
    }
    mapper.write_local(&mut map);
    let (mut out, widening) = (map.planning_cost, Widening::of(&scene::loomo()));
    bencher.bench_local(|| planning_cost(&map.occupancy, &map.age, widening, &mut out));
}

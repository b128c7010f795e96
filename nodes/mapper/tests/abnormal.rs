//! Anything at all as input: no panic, a status for every frame, and maps whose bytes keep their meaning.

#![allow(clippy::unwrap_used, reason = "a test may unwrap")]

mod scene;

use proptest::prelude::*;
use scene::loomo;
use sidestep_mapper::{Config, Mapper};
use sidestep_msgs::{AGE_NEVER, DepthFrame, LocalMap, Odometry, Ranges, SafetyMap, Scan, Status};

/// A generator of bytes that are random, or one of those that break arithmetic.
struct Bytes(u64);

impl Bytes {
    fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 ^ self.0 >> 29
    }

    fn number(&mut self) -> f32 {
        let odd =
            [0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE, 1e-30, -1e9];
        match self.word() % 4 {
            0 => odd[self.word() as usize % odd.len()],
            1 => f32::from_bits(self.word() as u32),
            _ => (self.word() as i32) as f32 / 1e9,
        }
    }
}

fn spoil<M: bytemuck::Pod>(message: &mut M, bytes: &mut Bytes, least: usize) {
    let words: &mut [u32] = bytemuck::cast_slice_mut(bytemuck::bytes_of_mut(message));
    let changes = bytes.word() as usize % 6;
    for _ in 0..changes {
        let place = least + bytes.word() as usize % (words.len() - least).min(64);
        words[place] = bytes.number().to_bits();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Spoils good messages in up to six places each, in any order, and asks for both maps after each.
    #[test]
    fn no_input_panics_and_every_byte_keeps_its_meaning(seed in any::<u64>()) {
        let mut bytes = Bytes(seed);
        let mut mapper = Mapper::new(&Config::shipped(), &loomo()).unwrap();
        let (mut local, mut safety) = (Box::<LocalMap>::default(), Box::<SafetyMap>::default());
        for step in 1..=25u64 {
            let stamp_ns = step * 33_000_000;
            let pose = sidestep_msgs::Pose2::new(0.1 * step as f64, 0.0, 0.1);
            let mut odometry = Odometry { stamp_ns, pose, ..Odometry::default() };
            spoil(&mut odometry, &mut bytes, 2);
            mapper.odometry(&odometry);
            let mut ranges = Ranges { stamp_ns, count: 8, ..Ranges::default() };
            ranges.sensors.iter_mut().for_each(|sensor| sensor.field_of_view_rad = 0.6);
            spoil(&mut ranges, &mut bytes, 0);
            mapper.ranges(&ranges);
            let status = if step % 2 == 0 {
                let mut frame = scene::frame(8);
                frame.camera = sidestep_msgs::Isometry::camera(0.1, 0.0, 0.5, 0.2);
                frame.capture_ns = stamp_ns;
                frame.pixels[..4800].iter_mut().for_each(|pixel| *pixel = bytes.word() as u16 >> 4);
                spoil::<DepthFrame>(&mut frame, &mut bytes, 0);
                mapper.depth(&frame)
            } else {
                let mut scan = Box::new(Scan { capture_ns: stamp_ns, count: 720, far_m: 10.0, ..Scan::default() });
                (scan.step_rad, scan.near_m) = (0.006, 0.1);
                scan.range_m.iter_mut().for_each(|range_m| *range_m = bytes.number().abs());
                spoil::<Scan>(&mut scan, &mut bytes, 0);
                mapper.scan(&scan)
            };
            mapper.write_local(&mut local);
            mapper.write_safety(&mut safety);
            prop_assert!(status == Status::Ok || local.refused > 0);
            prop_assert!(local.pose.is_finite() && local.capture_ns == safety.capture_ns);
            let unknown = |(occupancy, age): (&u8, &u8)| *age != AGE_NEVER || *occupancy >= 128;
            prop_assert!(local.occupancy.iter().zip(&local.age).all(unknown));
            prop_assert!(safety.occupancy.iter().zip(&safety.age).all(unknown));
        }
    }
}

//! Anything at all as input: a status for every frame, never a panic, never a clear field that was not seen.

#![allow(clippy::unwrap_used, reason = "a test may unwrap")]

use proptest::prelude::*;
use sidestep_guard::{Config, Guard};
use sidestep_msgs::{DepthFrame, Isometry, NearField, Robot, Status};

fn guard() -> Guard {
    let text = include_str!("../../../launch/robots/loomo.toml");
    Guard::new(&Config::STANDARD, &Robot::from_toml("loomo.toml", text).unwrap()).unwrap()
}

/// A frame of 80 x 60 that looks at a wall 2 m ahead.
fn frame() -> Box<DepthFrame> {
    let mut frame: Box<DepthFrame> = Box::default();
    (frame.width, frame.height, frame.metres_per_unit) = (80, 60, 0.001);
    (frame.fx_px, frame.fy_px, frame.cx_px, frame.cy_px) = (76.0, 76.0, 39.5, 29.5);
    frame.camera = Isometry::camera(0.1, 0.0, 0.55, 0.0);
    frame.capture_ns = 1;
    frame.pixels[..4800].fill(1900);
    frame
}

type Spoil = fn(&mut DepthFrame);

/// Every way a frame can be unusable, with its status.
#[test]
fn a_refused_frame_is_a_field_that_nobody_can_take_for_a_look() {
    let cases: &[(Spoil, Status)] = &[
        (|frame| frame.width = 0, Status::RefusedShape),
        (|frame| frame.height = u32::MAX, Status::RefusedShape),
        (|frame| frame.metres_per_unit = f32::NAN, Status::RefusedShape),
        (|frame| frame.fx_px = 0.0, Status::RefusedShape),
        (|frame| frame.cy_px = f32::INFINITY, Status::RefusedShape),
        (|frame| frame.camera.translation_m[2] = f32::NAN, Status::RefusedPose),
        (|frame| frame.camera.rotation_xyzw = [0.0; 4], Status::RefusedPose),
        (|frame| frame.capture_ns = 0, Status::RefusedStamp),
        (|frame| frame.pixels.fill(0), Status::RefusedEmpty),
        (|frame| frame.pixels.fill(u16::MAX), Status::RefusedSaturated),
    ];
    let (mut guard, mut field) = (guard(), NearField::default());
    for (number, (spoil, status)) in cases.iter().enumerate() {
        let mut spoilt = frame();
        assert_eq!(guard.step(&spoilt, &mut field), Status::Ok);
        assert!(field.range_m.iter().all(|range_m| range_m.is_finite()), "{:?}", field.range_m);
        spoil(&mut spoilt);
        assert_eq!(guard.step(&spoilt, &mut field), *status, "case {number}");
        // An empty one is a look at what is too near, perhaps: it says of nothing that it was seen.
        let stamp_ns = if *status == Status::RefusedEmpty { spoilt.capture_ns } else { 0 };
        let is_unseen = field.range_m.iter().all(|range_m| range_m.is_nan());
        assert!(field.capture_ns == stamp_ns && is_unseen, "case {number}");
    }
}

/// A wall without returns on its left half: there the field says that it saw nothing.
#[test]
fn the_step_keeps_nothing_of_the_frame_before() {
    let (mut one, mut other) = (NearField::default(), NearField::default());
    let mut guard = guard();
    guard.step(&frame(), &mut one);
    let mut empty = frame();
    empty.pixels[..2400].fill(0);
    guard.step(&empty, &mut other);
    guard.step(&frame(), &mut other);
    assert_eq!(bytemuck::bytes_of(&one), bytemuck::bytes_of(&other));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Good frames with random pixels and up to six random words anywhere in their head.
    #[test]
    fn no_input_panics(
        pixels in prop::collection::vec(any::<u16>(), 4800),
        spoilt in prop::collection::vec((0..18usize, any::<u32>()), 0..6),
    ) {
        let (mut guard, mut field, mut frame) = (guard(), NearField::default(), frame());
        frame.pixels[..4800].copy_from_slice(&pixels);
        let words: &mut [u32] = bytemuck::cast_slice_mut(bytemuck::bytes_of_mut(&mut *frame));
        spoilt.into_iter().for_each(|(place, word)| words[place] = word);
        let status = guard.step(&frame, &mut field);
        prop_assert!(status == Status::Ok || field.capture_ns == 0);
        prop_assert!(field.left_rad.is_finite() && field.sector_rad.is_finite());
        prop_assert!(field.range_m.iter().all(|range_m| range_m.is_nan() || *range_m >= 0.0));
    }
}

//! The 64 sectors of a frame, as wide together as all that its camera can see, and the sector of a point.
//!
//! A point is placed by a table over the "diamond angle", y / (|x| + |y|), which grows with the angle and costs one
//! division. The table is made anew for each frame, since a camera in a head may turn.

use crate::frame::Lens;
use sidestep_msgs::NEAR_SECTORS;
use std::f32::consts::{PI, TAU};
use wide::{f32x4, i32x4};

/// Points that are placed side by side.
pub(crate) const LANES: usize = 4;
/// Entries of the table over the full circle; one is a fortieth of a sector for a camera of 60 degrees.
const ENTRIES: usize = 1 << 14;
/// Entries per unit of the diamond angle, which runs from -2 to 2.
const PER_UNIT: f32 = ENTRIES as f32 / 4.0;

/// The sectors of one frame.
#[derive(Debug)]
pub(crate) struct Fan {
    /// `[rad]` bearing of the left edge of sector 0.
    pub(crate) left_rad: f32,
    /// `[rad]` width of a sector.
    pub(crate) sector_rad: f32,
    /// Cosine and sine of the bearing of the optical axis.
    axis: [f32; 2],
    sectors: Box<[u8; ENTRIES]>,
}

/// In (-2, 2], growing with the angle; NaN at the origin.
#[inline]
fn diamond(x: f32x4, y: f32x4) -> f32x4 {
    let part = y / (x.abs() + y.abs());
    let two = f32x4::splat(2.0) | (y & f32x4::splat(-0.0));
    x.simd_ge(f32x4::ZERO).bitselect(part, two - part)
}

#[inline]
fn entries(diamond: f32x4) -> [i32; LANES] {
    let entry = ((diamond + f32x4::splat(2.0)) * f32x4::splat(PER_UNIT)).fast_trunc_int();
    // NaN is at most zero, and lands inside with whatever rounding does at the ends.
    entry.max(i32x4::ZERO).min(i32x4::splat(ENTRIES as i32 - 1)).to_array()
}

impl Fan {
    pub(crate) fn new() -> Self {
        Self { left_rad: 0.0, sector_rad: 0.0, axis: [1.0, 0.0], sectors: Box::new([0; ENTRIES]) }
    }

    /// Spans the sectors over all that a camera of so many pixels sees between two depths.
    pub(crate) fn span(&mut self, lens: &Lens, size_px: [f32; 2], depths_m: [f32; 2]) {
        let axis_rad = lens.axis_rad();
        let (sin, cos) = libm::sincosf(axis_rad);
        self.axis = [cos, sin];
        // The widest bearings of a convex body seen from outside are those of its corners.
        let (mut right, mut left) = (f32::INFINITY, f32::NEG_INFINITY);
        for column_px in [-0.5, size_px[0] - 0.5] {
            for row_px in [-0.5, size_px[1] - 0.5] {
                let ray = lens.ray(column_px, row_px);
                for depth_m in depths_m {
                    let (x, y) = (lens.eye_m[0] + depth_m * ray[0], lens.eye_m[1] + depth_m * ray[1]);
                    let bearing = libm::atan2f(cos * y - sin * x, cos * x + sin * y);
                    (right, left) = (right.min(bearing), left.max(bearing));
                }
            }
        }
        // Seen from inside, it is all round.
        if left - right > PI || !(left - right).is_finite() {
            (right, left) = (-PI, PI);
        }
        let sector = ((left - right).max(1e-3) / NEAR_SECTORS as f32).min(TAU);
        self.left_rad = axis_rad + left;
        self.sector_rad = sector;
        let mut from = ENTRIES;
        for index in 0..NEAR_SECTORS {
            let edge = left - (index + 1) as f32 * sector;
            let (sin, cos) = libm::sincosf(edge);
            let last = index + 1 == NEAR_SECTORS;
            let [to, ..] = entries(diamond(f32x4::splat(cos), f32x4::splat(sin)));
            let to = if last { 0 } else { (to as usize).min(from) };
            self.sectors[to..from].fill(index as u8);
            from = to;
        }
    }

    /// The sectors of points of `base`; a point beside the fan belongs to its outermost sector.
    #[inline]
    pub(crate) fn sectors(&self, x_m: f32x4, y_m: f32x4) -> [usize; LANES] {
        let [cos, sin] = self.axis.map(f32x4::splat);
        let entries = entries(diamond(cos * x_m + sin * y_m, cos * y_m - sin * x_m));
        entries.map(|entry| usize::from(self.sectors[entry as usize % ENTRIES]) % NEAR_SECTORS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{DepthFrame, Isometry};

    fn sector(fan: &Fan, x_m: f32, y_m: f32) -> usize {
        fan.sectors(f32x4::splat(x_m), f32x4::splat(y_m))[LANES - 1]
    }

    fn fan(camera: Isometry) -> Fan {
        let frame = DepthFrame {
            fx_px: 300.0,
            fy_px: 300.0,
            cx_px: 159.5,
            cy_px: 119.5,
            camera,
            ..Default::default()
        };
        let mut fan = Fan::new();
        fan.span(&Lens::new(&frame), [320.0, 240.0], [0.35, 3.5]);
        fan
    }

    /// Points all over the fan of cameras that look ahead, and one that is turned to the left and mounted aside.
    #[test]
    fn a_point_lies_in_the_sector_of_its_bearing() {
        let mut turned = Isometry::camera(0.1, 0.3, 0.5, 0.0);
        // A quarter turn to the left: the optical axis (z) is y of the body.
        turned.rotation_xyzw = [-std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];
        for (camera, axis_rad) in [(Isometry::camera(0.1, 0.0, 0.55, 0.17), 0.0), (turned, 0.5 * PI)] {
            let fan = fan(camera);
            assert!((fan.left_rad - 32.0 * fan.sector_rad - axis_rad).abs() < 0.2, "{}", fan.left_rad);
            for step in 0..640 {
                let bearing = fan.left_rad - (step as f32 + 0.5) / 10.0 * fan.sector_rad;
                let (sin, cos) = libm::sincosf(bearing);
                // Within a tenth of a sector of an edge either side will do.
                let sector = sector(&fan, 1.7 * cos, 1.7 * sin);
                let (low, high) = ((step.max(1) - 1) / 10, ((step + 1) / 10).min(63));
                assert!(sector >= low && sector <= high, "{step}: {sector}");
            }
        }
    }

    #[test]
    fn the_fan_is_as_wide_as_the_view_of_a_camera_that_looks_down() {
        let fan = fan(Isometry::camera(0.1, 0.0, 0.55, 0.1745));
        // The lower corners of the image look farthest aside.
        let down = 120.0 / 300.0;
        let widest = libm::atan2f(160.0 / 300.0, libm::cosf(0.1745) - down * libm::sinf(0.1745));
        assert!((fan.left_rad - widest).abs() < 0.03 && fan.left_rad < widest, "{} {widest}", fan.left_rad);
        assert!((fan.left_rad - 32.0 * fan.sector_rad).abs() < 1e-4);
    }

    #[test]
    fn whatever_lies_outside_or_nowhere_belongs_to_some_sector() {
        let fan = fan(Isometry::camera(0.1, 0.0, 0.55, 0.17));
        assert_eq!((sector(&fan, 0.1, 2.0), sector(&fan, 0.1, -2.0)), (0, 63));
        for (x, y) in [(0.0, 0.0), (f32::NAN, 1.0), (f32::INFINITY, f32::INFINITY), (-1.0, 0.0)] {
            assert!(sector(&fan, x, y) < 64);
        }
    }
}

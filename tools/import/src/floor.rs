//! Where a camera without a pose is above the floor: a plane fit to one depth image.
//!
//! The inverse depth of a plane is affine in the pixel: 1/z = a x + b y + c along the ray (x, y, 1), and the noise of a
//! stereo camera is even in 1/z. Three pixels give a plane; the one that most pixels agree with, and few lie below, is
//! the floor; least squares over those pixels refine it.

use crate::files::Intrinsics;
use crate::placing::quaternion;
use sidestep_msgs::{DepthFrame, Isometry};

/// Pixels drawn from an image.
const POINTS: usize = 4000;
/// Planes tried.
const TRIES: usize = 400;
/// `[1/m]` a pixel this close to the plane belongs to it.
const CLOSE_PER_M: f64 = 0.02;
/// `[m]` nearer and farther pixels are not used: noise of a stereo camera grows with the square of the distance.
const RANGE_M: std::ops::RangeInclusive<f64> = 0.3..=4.0;
/// `[m]` heights above the floor that a camera on a robot or a head can have.
const HEIGHT_M: std::ops::RangeInclusive<f64> = 0.2..=2.0;
/// Largest part of the floor's normal to the side of the camera: a roll of 20 degrees.
const SIDE_MAX: f64 = 0.342;
/// Largest part of the floor's normal along the view: a pitch of 50 degrees down.
const AHEAD_MAX: f64 = 0.766;
/// Fewest pixels, of those drawn, that make a floor.
const SUPPORT_MIN: usize = POINTS / 20;

/// A ray and its inverse depth.
#[derive(Clone, Copy)]
struct Point {
    x: f64,
    y: f64,
    inverse_m: f64,
}

/// A plane a x + b y + c = 1/z: the direction down to the floor, divided by the camera's height.
type Plane = [f64; 3];

/// SplitMix64.
fn draw(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Solves the equations whose rows are m and whose right sides are r; `None` where they do not determine a plane.
fn solve(m: &[[f64; 3]; 3], r: [f64; 3]) -> Option<Plane> {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let (c0, c1, c2) = (cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]));
    let determinant = m[0][0] * c0[0] + m[0][1] * c0[1] + m[0][2] * c0[2];
    let part = |i: usize| (c0[i] * r[0] + c1[i] * r[1] + c2[i] * r[2]) / determinant;
    (determinant.abs() > 1e-9).then(|| [part(0), part(1), part(2)])
}

/// How much more a plane says than the point: positive where the point lies beyond, that is below the floor.
fn excess(plane: &Plane, point: &Point) -> f64 {
    plane[0] * point.x + plane[1] * point.y + plane[2] - point.inverse_m
}

/// Whether a camera can stand like this above a floor.
fn is_floor(plane: &Plane) -> bool {
    let norm = plane.iter().map(|part| part * part).sum::<f64>().sqrt();
    let [side, down, ahead] = plane.map(|part| part / norm);
    HEIGHT_M.contains(&(1.0 / norm))
        && down > 0.0
        && side.abs() <= SIDE_MAX
        && (-0.2..=AHEAD_MAX).contains(&ahead)
}

fn points(frame: &DepthFrame, k: &Intrinsics, seed: &mut u64) -> Vec<Point> {
    let (width, used) = (frame.width as usize, frame.used_pixels());
    let mut points = Vec::with_capacity(POINTS);
    for _ in 0..8 * POINTS {
        if points.len() == POINTS || used.is_empty() {
            break;
        }
        let place = draw(seed) as usize % used.len();
        let z_m = f64::from(used[place]) * f64::from(frame.metres_per_unit);
        if used[place] == u16::MAX || !RANGE_M.contains(&z_m) {
            continue;
        }
        let (u, v) = ((place % width) as f64, (place / width) as f64);
        points.push(Point { x: (u - k.cx_px) / k.fx_px, y: (v - k.cy_px) / k.fy_px, inverse_m: 1.0 / z_m });
    }
    points
}

/// Least squares over the points close to a plane; `None` where too few are.
fn refine(plane: &Plane, points: &[Point]) -> Option<Plane> {
    let (mut m, mut r, mut support) = ([[0.0; 3]; 3], [0.0; 3], 0);
    for point in points.iter().filter(|point| excess(plane, point).abs() < CLOSE_PER_M) {
        let row = [point.x, point.y, 1.0];
        for i in 0..3 {
            for j in 0..3 {
                m[i][j] += row[i] * row[j];
            }
            r[i] += row[i] * point.inverse_m;
        }
        support += 1;
    }
    (support >= SUPPORT_MIN).then(|| solve(&m, r)).flatten()
}

/// The pose of the camera in `body`, base being on the floor below and facing where the camera looks; `None` where no
/// floor is found.
#[must_use]
pub fn camera_over_floor(frame: &DepthFrame, k: &Intrinsics, seed: u64) -> Option<Isometry> {
    let mut seed = seed;
    let points = points(frame, k, &mut seed);
    if points.len() < SUPPORT_MIN {
        return None;
    }
    let mut best: Option<(i64, Plane)> = None;
    for _ in 0..TRIES {
        let [a, b, c] = [(); 3].map(|()| points[draw(&mut seed) as usize % points.len()]);
        let rows = [[a.x, a.y, 1.0], [b.x, b.y, 1.0], [c.x, c.y, 1.0]];
        let Some(plane) = solve(&rows, [a.inverse_m, b.inverse_m, c.inverse_m]) else { continue };
        if !is_floor(&plane) {
            continue;
        }
        let score: i64 = points
            .iter()
            .map(|point| match excess(&plane, point) {
                close if close.abs() < CLOSE_PER_M => 1,
                below if below > 2.0 * CLOSE_PER_M => -1,
                _ => 0,
            })
            .sum();
        if best.is_none_or(|(most, _)| score > most) {
            best = Some((score, plane));
        }
    }
    let mut plane = best?.1;
    for _ in 0..3 {
        plane = refine(&plane, &points)?;
    }
    is_floor(&plane).then(|| pose(&plane))
}

/// The camera's pose over a plane: up is against the plane's normal, forward the view without its part along up.
fn pose(plane: &Plane) -> Isometry {
    let norm = plane.iter().map(|part| part * part).sum::<f64>().sqrt();
    let up = plane.map(|part| -part / norm);
    // The view is (0, 0, 1) in the camera.
    let ahead = [-up[2] * up[0], -up[2] * up[1], 1.0 - up[2] * up[2]];
    let length = ahead.iter().map(|part| part * part).sum::<f64>().sqrt();
    let x = ahead.map(|part| part / length);
    let y = [up[1] * x[2] - up[2] * x[1], up[2] * x[0] - up[0] * x[2], up[0] * x[1] - up[1] * x[0]];
    // The axes of body, seen in the camera, are the rows of the rotation from camera to body.
    let rotation = [x, y, up];
    Isometry { translation_m: [0.0, 0.0, (1.0 / norm) as f32], rotation_xyzw: quaternion(&rotation), _pad: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: Intrinsics = Intrinsics { fx_px: 384.0, fy_px: 384.0, cx_px: 320.0, cy_px: 240.0 };

    /// A floor seen from `height_m`, with a wall 2.5 m ahead and a box; every seventh pixel is missing.
    fn room(camera: &Isometry) -> Box<DepthFrame> {
        let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
        (frame.width, frame.height, frame.metres_per_unit) = (640, 480, 0.001);
        let r = camera.rotation();
        for place in 0..640 * 480_usize {
            let ray = [((place % 640) as f32 - 320.0) / 384.0, ((place / 640) as f32 - 240.0) / 384.0, 1.0];
            let d = [0, 1, 2].map(|i| r[i][0] * ray[0] + r[i][1] * ray[1] + r[i][2] * ray[2]);
            let floor = if d[2] < -1e-3 { -camera.translation_m[2] / d[2] } else { f32::INFINITY };
            let wall = if d[0] > 1e-3 { 2.5 / d[0] } else { f32::INFINITY };
            let mut depth = floor.min(wall);
            let side = d[1] * depth;
            if (0.2..0.6).contains(&side) && d[0] * depth > 1.2 {
                depth = 1.2 / d[0];
            }
            let noise_m = 0.002 * depth * depth * ((place * 7919 % 13) as f32 / 6.0 - 1.0);
            frame.pixels[place] =
                if place % 7 == 0 || depth > 10.0 { 0 } else { ((depth + noise_m) * 1000.0) as u16 };
        }
        frame
    }

    #[test]
    fn height_pitch_and_roll_come_back_with_wall_and_box_in_view() {
        for (height_m, pitch_rad) in [(0.63, 0.35), (0.79, 0.3), (1.6, 0.45)] {
            let level = Isometry::camera(0.0, 0.0, height_m, pitch_rad);
            let frame = room(&level);
            let found = camera_over_floor(&frame, &K, 7).unwrap();
            assert!((found.translation_m[2] - height_m).abs() < 0.01, "{height_m}: {found:?}");
            let (a, b) = (found.rotation(), level.rotation());
            let most = (0..9).map(|i| (a[i / 3][i % 3] - b[i / 3][i % 3]).abs()).fold(0.0, f32::max);
            assert!(most < 0.01, "{height_m} m, {pitch_rad} rad: off by {most}");
        }
    }

    #[test]
    fn an_image_without_a_floor_has_none() {
        let mut frame = room(&Isometry::camera(0.0, 0.0, 0.6, 0.3));
        frame.pixels.fill(0);
        assert_eq!(camera_over_floor(&frame, &K, 7), None);
        frame.pixels.fill(u16::MAX);
        assert_eq!(camera_over_floor(&frame, &K, 7), None);
        // A wall straight ahead.
        frame.pixels[..640 * 480].fill(1500);
        assert_eq!(camera_over_floor(&frame, &K, 7), None);
    }
}

//! From the pose of a camera in some world to what the graph wants: `base` in `odom`, the camera in `body`.
//!
//! A head-worn or hand-held camera has no axle below it. Base is put on the floor under the camera, facing where the
//! camera looks; body is level; what is left of the pose, height included, is the camera's pose in body.

use crate::files::Rigid;
use sidestep_msgs::{Isometry, Pose2};

/// Which axis of the world of the poses points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Up {
    /// +Y, as HoloLens and most headsets have it.
    Y,
    /// +Z, as robots have it.
    Z,
}

/// A camera placed for the graph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    /// Pose of base in odom.
    pub(crate) base: Pose2,
    /// Pose of the camera in body.
    pub(crate) camera: Isometry,
}

/// A vector of the world of the poses in axes with z up.
fn upright(up: Up, v: [f64; 3]) -> [f64; 3] {
    match up {
        Up::Y => [v[0], -v[2], v[1]],
        Up::Z => v,
    }
}

/// A camera pose in axes with z up; the optical axes of the camera stay as they are.
pub(crate) fn turn_upright(up: Up, pose: &Rigid) -> Rigid {
    let column = |j: usize| upright(up, [pose.rotation[0][j], pose.rotation[1][j], pose.rotation[2][j]]);
    let (x, y, z) = (column(0), column(1), column(2));
    let rotation = [[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]];
    Rigid { rotation, translation_m: upright(up, pose.translation_m) }
}

/// Places a camera whose pose is upright, over a floor at `floor_m`.
pub(crate) fn place(pose: &Rigid, floor_m: f64) -> Placed {
    let [x_m, y_m, z_m] = pose.translation_m;
    let r = &pose.rotation;
    let yaw_rad = libm::atan2(r[1][2], r[0][2]);
    let (sin, cos) = libm::sincos(yaw_rad);
    // Turned back by the yaw: the camera as seen from base.
    let turned = |j: usize| [cos * r[0][j] + sin * r[1][j], cos * r[1][j] - sin * r[0][j], r[2][j]];
    let (a, b, c) = (turned(0), turned(1), turned(2));
    let rotation = [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
    let camera = Isometry {
        translation_m: [0.0, 0.0, (z_m - floor_m) as f32],
        rotation_xyzw: quaternion(&rotation),
        _pad: 0,
    };
    Placed { base: Pose2::new(x_m, y_m, yaw_rad), camera }
}

/// Unit quaternion (x, y, z, w) of a rotation given as rows.
pub(crate) fn quaternion(r: &[[f64; 3]; 3]) -> [f32; 4] {
    // Twice each component, squared; the largest is far from zero and settles the signs of the others.
    let squares = [
        1.0 + r[0][0] - r[1][1] - r[2][2],
        1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
        1.0 + r[0][0] + r[1][1] + r[2][2],
    ];
    let products = [
        [squares[0], r[0][1] + r[1][0], r[0][2] + r[2][0], r[2][1] - r[1][2]],
        [r[0][1] + r[1][0], squares[1], r[1][2] + r[2][1], r[0][2] - r[2][0]],
        [r[0][2] + r[2][0], r[1][2] + r[2][1], squares[2], r[1][0] - r[0][1]],
        [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], squares[3]],
    ];
    let largest = (1..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let q = products[largest];
    let norm = q.iter().map(|part| part * part).sum::<f64>().sqrt();
    q.map(|part| (part / norm) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placed_camera_sees_each_point_where_the_world_has_it() {
        // A HoloLens-like pose: tilted, rolled, +Y up.
        let (s, c) = libm::sincos(0.4);
        let (sr, cr) = libm::sincos(-0.2);
        // Camera x right, y down, z forward in a world with +Y up: a level camera looking along -Z is diag(1, -1, -1).
        let pitched = [[1.0, 0.0, 0.0], [0.0, -c, -s], [0.0, s, -c]];
        let roll = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]];
        let product = |i: usize, j: usize| (0..3).map(|k| pitched[i][k] * roll[k][j]).sum::<f64>();
        let rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| product(i, j)));
        let pose = Rigid { rotation, translation_m: [3.0, 0.1, -2.0] };
        let upright = turn_upright(Up::Y, &pose);
        let placed = place(&upright, -1.5);
        let camera = placed.camera.rotation();
        for p in [[0.0, 0.0, 1.0], [0.3, -0.2, 2.5], [-1.0, 0.7, 1.7]] {
            let world: Vec<f64> = (0..3)
                .map(|i| (0..3).map(|j| rotation[i][j] * p[j]).sum::<f64>() + pose.translation_m[i])
                .collect();
            let body: Vec<f64> = (0..3)
                .map(|i| {
                    let turned: f64 = (0..3).map(|j| f64::from(camera[i][j]) * p[j]).sum();
                    turned + f64::from(placed.camera.translation_m[i])
                })
                .collect();
            let (x, y) = placed.base.transform(body[0], body[1]);
            let error = (x - world[0]).abs() + (y + world[2]).abs() + (body[2] - (world[1] + 1.5)).abs();
            assert!(error < 1e-5, "{p:?}: off by {error}");
        }
        assert!(placed.camera.is_valid());
    }

    #[test]
    fn quaternions_of_half_turns_are_unit_and_give_the_rotation_back() {
        for rotation in [
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
        ] {
            let isometry =
                Isometry { translation_m: [0.0; 3], rotation_xyzw: quaternion(&rotation), _pad: 0 };
            let back = isometry.rotation();
            let same = (0..3).all(|i| (0..3).all(|j| (f64::from(back[i][j]) - rotation[i][j]).abs() < 1e-6));
            assert!(same, "{rotation:?} gives {back:?}");
        }
    }
}

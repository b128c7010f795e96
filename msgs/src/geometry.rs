//! Poses, twists and the unicycle: the meaning of the numbers in the messages.
//!
//! All trigonometry comes from `libm`, so that every machine computes the same bytes.

use crate::layout::{ZeroCopySend, record};
use std::f64::consts::PI;

record! {
    /// A pose in the plane.
    pub struct Pose2 {
        /// `[m]` along x of the parent frame.
        pub x_m: f64,
        /// `[m]` along y of the parent frame.
        pub y_m: f64,
        /// `[rad]` (-pi, pi] counter-clockwise from the parent's x axis.
        pub yaw_rad: f64,
    }
}

record! {
    /// A velocity of a differential drive, in `base`.
    pub struct Twist {
        /// `[m/s]` forward speed.
        pub v_m_s: f32,
        /// `[rad/s]` turn rate, counter-clockwise.
        pub w_rad_s: f32,
    }
}

record! {
    /// A rigid transform in space: a point p of the child frame lies at R p + t in the parent frame.
    pub struct Isometry {
        /// `[m]` t, the child's origin in the parent frame.
        pub translation_m: [f32; 3],
        /// `[1]` unit quaternion (x, y, z, w) of R.
        pub rotation_xyzw: [f32; 4],
        /// Zero.
        pub _pad: u32,
    }
}

/// Brings an angle to (-pi, pi].
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turns = libm::floor((PI - angle_rad) / (2.0 * PI));
    angle_rad + 2.0 * PI * turns
}

impl Pose2 {
    /// The pose (0, 0, 0).
    pub const ORIGIN: Self = Self { x_m: 0.0, y_m: 0.0, yaw_rad: 0.0 };

    /// A pose from its three numbers.
    #[must_use]
    pub const fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// A point of this pose's frame, seen in the parent frame.
    #[must_use]
    pub fn transform(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        (self.x_m + cos * x_m - sin * y_m, self.y_m + sin * x_m + cos * y_m)
    }

    /// A point of the parent frame, seen in this pose's frame.
    #[must_use]
    pub fn inverse_transform(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        (cos * dx + sin * dy, cos * dy - sin * dx)
    }

    /// `child`, given in this pose's frame, seen in the parent frame.
    #[must_use]
    pub fn compose(&self, child: &Self) -> Self {
        let (x_m, y_m) = self.transform(child.x_m, child.y_m);
        Self { x_m, y_m, yaw_rad: wrap_angle(self.yaw_rad + child.yaw_rad) }
    }

    /// `other`, given in the parent frame, seen in this pose's frame.
    #[must_use]
    pub fn relative(&self, other: &Self) -> Self {
        let (x_m, y_m) = self.inverse_transform(other.x_m, other.y_m);
        Self { x_m, y_m, yaw_rad: wrap_angle(other.yaw_rad - self.yaw_rad) }
    }

    /// The unicycle h(x, u) of paper eq. (6b): constant twist for `dt_s`, exact along the arc.
    #[must_use]
    pub fn advance(&self, twist: &Twist, dt_s: f64) -> Self {
        let (v, w) = (f64::from(twist.v_m_s), f64::from(twist.w_rad_s));
        let half_turn = 0.5 * w * dt_s;
        // sin(a)/a, by its series where the quotient would lose digits.
        let chord = if half_turn.abs() < 1e-4 {
            1.0 - half_turn * half_turn / 6.0
        } else {
            libm::sin(half_turn) / half_turn
        };
        let (sin, cos) = libm::sincos(self.yaw_rad + half_turn);
        let step_m = v * dt_s * chord;
        Self {
            x_m: self.x_m + step_m * cos,
            y_m: self.y_m + step_m * sin,
            yaw_rad: wrap_angle(self.yaw_rad + w * dt_s),
        }
    }

    /// Between this pose (`part` = 0) and `other` (1), the short way round; beyond 1 it extrapolates.
    #[must_use]
    pub fn interpolate(&self, other: &Self, part: f64) -> Self {
        Self {
            x_m: self.x_m + (other.x_m - self.x_m) * part,
            y_m: self.y_m + (other.y_m - self.y_m) * part,
            yaw_rad: wrap_angle(self.yaw_rad + wrap_angle(other.yaw_rad - self.yaw_rad) * part),
        }
    }

    /// Straight distance to `other`.
    #[must_use]
    pub fn distance_m(&self, other: &Self) -> f64 {
        libm::hypot(other.x_m - self.x_m, other.y_m - self.y_m)
    }

    /// Whether all three numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite()
    }
}

impl Twist {
    /// Standing still.
    pub const STOP: Self = Self { v_m_s: 0.0, w_rad_s: 0.0 };

    /// A twist from its two numbers.
    #[must_use]
    pub const fn new(v_m_s: f32, w_rad_s: f32) -> Self {
        Self { v_m_s, w_rad_s }
    }

    /// Whether both numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.v_m_s.is_finite() && self.w_rad_s.is_finite()
    }

    /// This twist mirrored at the x axis.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self { v_m_s: self.v_m_s, w_rad_s: -self.w_rad_s }
    }
}

impl Isometry {
    /// The camera pose of a level robot: at `(forward, left, up)` in `body`, pitched down by `pitch_down_rad`,
    /// with optical axes (x right, y down, z forward).
    #[must_use]
    pub fn camera(forward_m: f32, left_m: f32, up_m: f32, pitch_down_rad: f32) -> Self {
        // Optical to body for a level camera: quaternion (-1/2, 1/2, -1/2, 1/2) maps z->x, x->-y, y->-z.
        let (s, c) = libm::sincosf(0.5 * pitch_down_rad);
        let (ax, ay, az, aw) = (0.0, s, 0.0, c);
        let (bx, by, bz, bw) = (-0.5, 0.5, -0.5, 0.5);
        let rotation_xyzw = [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ];
        Self { translation_m: [forward_m, left_m, up_m], rotation_xyzw, _pad: 0 }
    }

    /// R as rows, for loops that turn many points.
    #[must_use]
    pub fn rotation(&self) -> [[f32; 3]; 3] {
        let [x, y, z, w] = self.rotation_xyzw;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }

    /// Whether every number is finite and the quaternion is of unit length to 1 %.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let norm2: f32 = self.rotation_xyzw.iter().map(|q| q * q).sum();
        self.translation_m.iter().all(|t| t.is_finite()) && (norm2 - 1.0).abs() < 0.02
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn angles_wrap_to_the_half_open_turn() {
        for (angle, wrapped) in
            [(0.0, 0.0), (PI, PI), (-PI, PI), (3.0 * PI, PI), (-0.5, -0.5), (7.0, 7.0 - 2.0 * PI)]
        {
            assert!(close(wrap_angle(angle), wrapped), "{angle} gives {}", wrap_angle(angle));
        }
    }

    #[test]
    fn a_quarter_turn_ends_where_the_circle_says() {
        // Radius v/w = 1 m: from the origin along x, a quarter circle to the left ends at (1, 1) facing +y.
        let end = Pose2::ORIGIN.advance(&Twist::new(0.5, 0.5), PI);
        assert!(close(end.x_m, 1.0) && close(end.y_m, 1.0) && close(end.yaw_rad, PI / 2.0), "{end:?}");
    }

    #[test]
    fn advance_is_continuous_where_the_series_takes_over() {
        let near = |w: f32| Pose2::ORIGIN.advance(&Twist::new(1.0, w), 1.0);
        let (below, above) = (near(1.99e-4), near(2.01e-4));
        assert!((below.y_m - above.y_m).abs() < 2e-6 && close(below.x_m, above.x_m), "{below:?} {above:?}");
    }

    #[test]
    fn relative_undoes_compose() {
        let (a, b) = (Pose2::new(1.0, -2.0, 2.5), Pose2::new(-0.3, 0.7, 1.9));
        let back = a.relative(&a.compose(&b));
        assert!(back.distance_m(&b) < 1e-12 && close(back.yaw_rad, b.yaw_rad), "{back:?}");
    }

    #[test]
    fn a_level_camera_looks_forward_and_a_pitched_one_at_the_floor() {
        let turn =
            |pose: &Isometry, p: [f32; 3]| pose.rotation().map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2]);
        let level = Isometry::camera(0.0, 0.0, 0.5, 0.0);
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near(turn(&level, [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]));
        assert!(near(turn(&level, [1.0, 0.0, 0.0]), [0.0, -1.0, 0.0]));
        assert!(near(turn(&level, [0.0, 1.0, 0.0]), [0.0, 0.0, -1.0]));
        let down = turn(&Isometry::camera(0.0, 0.0, 0.5, 0.1), [0.0, 0.0, 1.0]);
        assert!(
            (down[0] - libm::cosf(0.1)).abs() < 1e-6 && (down[2] + libm::sinf(0.1)).abs() < 1e-6,
            "{down:?}"
        );
    }
}

//! Rigid transforms in space, as tf chains them.

use sidestep_msgs::{Isometry, Pose2};

/// A point p of the child frame lies at R p + t in the parent frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rigid {
    /// t.
    pub(crate) translation_m: [f64; 3],
    /// Unit quaternion (x, y, z, w) of R.
    pub(crate) rotation_xyzw: [f64; 4],
}

impl Rigid {
    pub(crate) const IDENTITY: Self = Self { translation_m: [0.0; 3], rotation_xyzw: [0.0, 0.0, 0.0, 1.0] };

    /// Normalises the rotation; `None` where a number is not finite or the rotation is none.
    pub(crate) fn checked(translation_m: [f64; 3], rotation: [f64; 4]) -> Option<Self> {
        let norm = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
        let sound = translation_m.iter().all(|part| part.is_finite()) && (0.5..2.0).contains(&norm);
        sound.then(|| Self { translation_m, rotation_xyzw: rotation.map(|part| part / norm) })
    }

    /// A pose in the plane.
    pub(crate) fn planar(pose: &Pose2, roll_rad: f64, pitch_rad: f64) -> Self {
        let half = |axis: usize, angle_rad: f64| {
            let (sin, cos) = libm::sincos(0.5 * angle_rad);
            let mut rotation = [0.0, 0.0, 0.0, cos];
            rotation[axis] = sin;
            rotation
        };
        let (roll, pitch, yaw) = (half(0, roll_rad), half(1, pitch_rad), half(2, pose.yaw_rad));
        let rotation_xyzw = product(yaw, product(pitch, roll));
        Self { translation_m: [pose.x_m, pose.y_m, 0.0], rotation_xyzw }
    }

    /// A vector turned by R.
    fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        let [x, y, z, w] = self.rotation_xyzw;
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let once = cross([x, y, z], v).map(|part| 2.0 * part);
        let twice = cross([x, y, z], once);
        [0, 1, 2].map(|i| v[i] + w * once[i] + twice[i])
    }

    /// `child`, given in this frame, seen in the parent frame.
    pub(crate) fn compose(&self, child: &Self) -> Self {
        let turned = self.turn(child.translation_m);
        Self {
            translation_m: [0, 1, 2].map(|i| self.translation_m[i] + turned[i]),
            rotation_xyzw: product(self.rotation_xyzw, child.rotation_xyzw),
        }
    }

    /// The parent frame seen in this frame.
    pub(crate) fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation_xyzw;
        let back = Self { translation_m: [0.0; 3], rotation_xyzw: [-x, -y, -z, w] };
        Self { translation_m: back.turn(self.translation_m).map(|part| -part), ..back }
    }

    /// Between this (`part` = 0) and `other` (1), the short way round.
    pub(crate) fn interpolate(&self, other: &Self, part: f64) -> Self {
        let (a, b) = (self.rotation_xyzw, other.rotation_xyzw);
        let sign = if (0..4).map(|i| a[i] * b[i]).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        let mix = |a: f64, b: f64| a + (b - a) * part;
        let rotation = [0, 1, 2, 3].map(|i| mix(a[i], sign * b[i]));
        let translation = [0, 1, 2].map(|i| mix(self.translation_m[i], other.translation_m[i]));
        Self::checked(translation, rotation).unwrap_or(*self)
    }

    /// Pose in the plane, roll and pitch: first roll, then pitch, then yaw.
    pub(crate) fn angles(&self) -> (Pose2, f64, f64) {
        let [x, y, z, w] = self.rotation_xyzw;
        let roll_rad = libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        let pitch_rad = libm::asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0));
        let yaw_rad = libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        (Pose2::new(self.translation_m[0], self.translation_m[1], yaw_rad), roll_rad, pitch_rad)
    }

    pub(crate) fn isometry(&self) -> Isometry {
        Isometry {
            translation_m: self.translation_m.map(|part| part as f32),
            rotation_xyzw: self.rotation_xyzw.map(|part| part as f32),
            _pad: 0,
        }
    }
}

impl From<&Isometry> for Rigid {
    fn from(isometry: &Isometry) -> Self {
        Self {
            translation_m: isometry.translation_m.map(f64::from),
            rotation_xyzw: isometry.rotation_xyzw.map(f64::from),
        }
    }
}

/// Hamilton product: first `b`, then `a`.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_come_back_and_inverse_undoes_compose() {
        let pose = Pose2::new(1.0, -2.0, 2.1);
        let rigid = Rigid::planar(&pose, 0.1, -0.2);
        let (back, roll, pitch) = rigid.angles();
        assert!(back.distance_m(&pose) < 1e-12 && (back.yaw_rad - 2.1).abs() < 1e-12, "{back:?}");
        assert!((roll - 0.1).abs() < 1e-12 && (pitch + 0.2).abs() < 1e-12);
        let child = Rigid::checked([0.3, 0.1, 0.9], [0.5, -0.5, 0.5, 0.5]).unwrap();
        let same = rigid.inverse().compose(&rigid.compose(&child));
        assert!((0..3).all(|i| (same.translation_m[i] - child.translation_m[i]).abs() < 1e-12), "{same:?}");
    }

    #[test]
    fn a_level_camera_is_the_one_of_the_messages() {
        // tf says it as roll -90, yaw -90 degrees.
        let quarter = std::f64::consts::FRAC_PI_2;
        let optical = Rigid::planar(&Pose2::new(0.0, 0.0, -quarter), -quarter, 0.0);
        let (ours, theirs) = (Isometry::camera(0.0, 0.0, 0.0, 0.0).rotation(), optical.isometry().rotation());
        assert!((0..9).all(|i| (ours[i / 3][i % 3] - theirs[i / 3][i % 3]).abs() < 1e-6), "{theirs:?}");
    }
}

//! Points, poses, lines and arrows as the well-known schemas have them.

use foxglove::messages::{
    ArrowPrimitive, Color, LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneUpdate, Timestamp,
    Vector3, line_primitive,
};
use sidestep_msgs::{Pose2, Twist};

/// Frame ids.
pub(crate) const WORLD: &str = "world";
pub(crate) const ODOM: &str = "odom";
pub(crate) const BASE: &str = "base";
pub(crate) const BODY: &str = "body";
pub(crate) const CAMERA_FRAME: &str = "camera";

/// Colours by who speaks.
pub(crate) const COMMANDED: Color = Color { r: 0.1, g: 0.8, b: 0.2, a: 1.0 };
pub(crate) const WISHED: Color = Color { r: 0.6, g: 0.6, b: 0.6, a: 0.8 };
pub(crate) const POLICY: Color = Color { r: 0.2, g: 0.5, b: 1.0, a: 1.0 };
pub(crate) const EXPERT: Color = Color { r: 1.0, g: 0.55, b: 0.1, a: 1.0 };
pub(crate) const FAINT: Color = Color { r: 1.0, g: 0.55, b: 0.1, a: 0.15 };
pub(crate) const OUTLINE: Color = Color { r: 0.9, g: 0.9, b: 0.9, a: 1.0 };
pub(crate) const ALARM: Color = Color { r: 1.0, g: 0.1, b: 0.1, a: 1.0 };
pub(crate) const PERSON: Color = Color { r: 0.8, g: 0.3, b: 0.8, a: 0.8 };

/// `[m]` velocities below this length of arrow are not drawn.
const ARROW_LEAST_M: f64 = 0.01;
/// `[m]` arm at which the turn rate is drawn.
const ARM_M: f64 = 0.3;
/// `[m]` width of trajectories.
pub(crate) const LINE_M: f64 = 0.02;

pub(crate) fn vector(x: f64, y: f64, z: f64) -> Option<Vector3> {
    Some(Vector3 { x, y, z })
}

/// Cosine and sine, the same on every machine.
pub(crate) fn cos_sin(angle_rad: f64) -> (f64, f64) {
    Pose2::new(0.0, 0.0, angle_rad).transform(1.0, 0.0)
}

/// The turn about z.
pub(crate) fn yaw(angle_rad: f64) -> Quaternion {
    let (w, z) = cos_sin(0.5 * angle_rad);
    Quaternion { x: 0.0, y: 0.0, z, w }
}

/// The tilt of `body` in `base`: roll about x, then pitch about y.
pub(crate) fn tilt(roll_rad: f64, pitch_rad: f64) -> Quaternion {
    let ((cr, sr), (cp, sp)) = (cos_sin(0.5 * roll_rad), cos_sin(0.5 * pitch_rad));
    Quaternion { x: cp * sr, y: sp * cr, z: -sp * sr, w: cp * cr }
}

/// A pose on the plane at a height.
pub(crate) fn pose(pose: &Pose2, z_m: f64) -> Pose {
    Pose { position: vector(pose.x_m, pose.y_m, z_m), orientation: Some(yaw(pose.yaw_rad)) }
}

pub(crate) fn point(x_m: f64, y_m: f64, z_m: f64) -> Point3 {
    Point3 { x: x_m, y: y_m, z: z_m }
}

/// A line of a width in metres.
pub(crate) fn line(
    kind: line_primitive::Type,
    points: Vec<Point3>,
    width_m: f64,
    color: Color,
) -> LinePrimitive {
    LinePrimitive {
        r#type: kind as i32,
        pose: Some(pose(&Pose2::ORIGIN, 0.0)),
        thickness: width_m,
        points,
        color: Some(color),
        ..LinePrimitive::default()
    }
}

fn arrow(from: &Pose2, length_m: f64, z_m: f64, color: Color) -> Option<ArrowPrimitive> {
    // NaN is not drawn either.
    (length_m > ARROW_LEAST_M).then(|| ArrowPrimitive {
        pose: Some(pose(from, z_m)),
        shaft_length: 0.75 * length_m,
        shaft_diameter: 0.03,
        head_length: 0.25 * length_m,
        head_diameter: 0.07,
        color: Some(color),
    })
}

/// A velocity as two arrows: the way of one second ahead, and across its tip the way of a point [`ARM_M`] before the axle.
pub(crate) fn arrows(twist: &Twist, z_m: f64, color: Color) -> Vec<ArrowPrimitive> {
    let (v_m_s, w_rad_s) = (f64::from(twist.v_m_s), f64::from(twist.w_rad_s));
    let half_turn = std::f64::consts::PI;
    let ahead = Pose2::new(0.0, 0.0, if v_m_s < 0.0 { half_turn } else { 0.0 });
    let across = Pose2::new(v_m_s, 0.0, 0.5 * half_turn * w_rad_s.signum());
    let ahead = arrow(&ahead, v_m_s.abs(), z_m, color);
    let across = if v_m_s.is_finite() { arrow(&across, ARM_M * w_rad_s.abs(), z_m, color) } else { None };
    ahead.into_iter().chain(across).collect()
}

/// Something with an id in a frame, which replaces what had this id before.
pub(crate) fn entity(id: &str, frame: &str, stamp: Option<Timestamp>) -> SceneEntity {
    SceneEntity { timestamp: stamp, frame_id: frame.into(), id: id.into(), ..SceneEntity::default() }
}

pub(crate) fn scene(entities: Vec<SceneEntity>) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities }
}

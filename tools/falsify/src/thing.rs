//! What stands or moves in the world, and what of it the map says.

use serde::Serialize;
use sidestep_msgs::{Pose2, Robot};
use sidestep_sim::{Outline, Solid};

/// `[m]` nothing stands nearer to the robot at the start: its cells, wherever the grid lies, leave the full margin.
const START_M: f64 = 0.11;

/// An obstacle.
#[derive(Debug, Clone, Copy)]
pub struct Thing {
    /// Where it stands at the start.
    pub solid: Solid,
    /// Whether the map says that something is there; otherwise it says that nobody looked there.
    pub seen: bool,
    /// Whether it is there; otherwise only its mark in the map is.
    pub exists: bool,
    /// `[m]` it is not in the map while the robot is farther away.
    pub seen_within_m: f64,
    /// `[m/s]` its motion in the world.
    pub velocity_m_s: [f64; 2],
    /// Whether it stands in what was granted free, and is never in the map.
    pub granted: bool,
}

impl Thing {
    /// Something that does not move and is known.
    pub(crate) fn standing(solid: Solid, seen: bool) -> Self {
        Self {
            solid,
            seen,
            exists: true,
            seen_within_m: f64::INFINITY,
            velocity_m_s: [0.0; 2],
            granted: false,
        }
    }

    /// The solid at a time.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Solid {
        let [vx, vy] = self.velocity_m_s;
        Solid { x_m: self.solid.x_m + vx * time_s, y_m: self.solid.y_m + vy * time_s, ..self.solid }
    }

    /// `[m/s]` its speed.
    #[must_use]
    pub fn speed_m_s(&self) -> f64 {
        libm::hypot(self.velocity_m_s[0], self.velocity_m_s[1])
    }
}

/// All obstacles.
#[derive(Debug, Clone, Default)]
pub struct Things(pub Vec<Thing>);

/// As a report names it.
#[derive(Serialize)]
struct Told {
    x_m: f64,
    y_m: f64,
    radius_m: Option<f64>,
    size_m: Option<[f64; 2]>,
    yaw_rad: Option<f64>,
    seen: bool,
    exists: bool,
    velocity_m_s: [f64; 2],
}

impl Serialize for Things {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|thing| {
            let (radius_m, size_m, yaw_rad) = match thing.solid.outline {
                Outline::Disc { radius_m } => (Some(radius_m), None, None),
                Outline::Rectangle { half_length_m, half_width_m, cos, sin } => {
                    (None, Some([2.0 * half_length_m, 2.0 * half_width_m]), Some(libm::atan2(sin, cos)))
                }
            };
            Told {
                x_m: thing.solid.x_m,
                y_m: thing.solid.y_m,
                radius_m,
                size_m,
                yaw_rad,
                seen: thing.seen,
                exists: thing.exists,
                velocity_m_s: thing.velocity_m_s,
            }
        }))
    }
}

/// The footprint at a pose.
pub(crate) fn footprint(robot: &Robot, pose: &Pose2, out: &mut Vec<[f64; 2]>) {
    out.clear();
    out.extend(robot.footprint.polygon_m.iter().map(|corner| {
        let (x, y) = pose.transform(f64::from(corner[0]), f64::from(corner[1]));
        [x, y]
    }));
}

/// Whether all of a solid lies where the camera of a robot at a pose looks.
pub(crate) fn in_sector(robot: &Robot, pose: &Pose2, solid: &Solid) -> bool {
    solid.corners().into_iter().all(|[x_m, y_m]| {
        let (ahead_m, left_m) = pose.inverse_transform(x_m, y_m);
        robot.looks_at(ahead_m as f32, left_m as f32)
    })
}

/// Whether the robot may start beside a solid; beside one that was wrongly granted free, as near as it likes.
pub(crate) fn clear_of_start(solid: &Solid, yaw_rad: f64, robot: &Robot, granted: bool) -> bool {
    let mut polygon = Vec::with_capacity(8);
    footprint(robot, &Pose2::new(0.0, 0.0, yaw_rad), &mut polygon);
    solid.gap_m(&polygon) > if granted { 0.0 } else { START_M }
}

//! The robot: one file that simulator, mapper, expert, policy contract, arbiter and training all read.
//!
//! In the file every number is a table `{ value = .., source = ".." }`, where the source begins with `measured`,
//! `datasheet`, `paper` or `guess`: a number without an origin is refused. Here only the values remain.

use serde::{Deserialize, Deserializer};

/// Why a robot file was refused.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// Not TOML, an unknown key, a wrong type or a missing key; the text names line and column.
    #[error("robot file {path}: {detail}")]
    Parse {
        /// The file.
        path: String,
        /// Line, column, what was found and what is allowed.
        detail: String,
    },
    /// A value outside its range.
    #[error("robot file {path}: {key} is {found}, needed: {needed}")]
    Range {
        /// The file.
        path: String,
        /// The key.
        key: &'static str,
        /// The value.
        found: f32,
        /// The range.
        needed: &'static str,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sourced<T> {
    value: T,
    source: String,
}

/// Reads `{ value, source }` and checks that the source is of a known kind.
fn sourced<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let Sourced { value, source } = Sourced::deserialize(deserializer)?;
    let known = ["measured", "datasheet", "paper", "guess"];
    if known.iter().any(|kind| source.starts_with(kind)) {
        return Ok(value);
    }
    Err(serde::de::Error::custom(format!(
        "source is \"{source}\", needed: a text that begins with one of {}",
        known.join(", ")
    )))
}

/// Limits of motion that hold for any command.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// `[m/s]` fastest forward.
    #[serde(deserialize_with = "sourced")]
    pub forward_m_s: f32,
    /// `[m/s]` fastest in reverse, positive.
    #[serde(deserialize_with = "sourced")]
    pub reverse_m_s: f32,
    /// `[rad/s]` fastest turn.
    #[serde(deserialize_with = "sourced")]
    pub turn_rad_s: f32,
    /// `[m/s^2]` strongest acceleration commanded.
    #[serde(deserialize_with = "sourced")]
    pub accelerate_m_s2: f32,
    /// `[m/s^2]` braking that can be relied on.
    #[serde(deserialize_with = "sourced")]
    pub brake_m_s2: f32,
    /// `[rad/s^2]` strongest change of the turn rate, both ways.
    #[serde(deserialize_with = "sourced")]
    pub turn_accelerate_rad_s2: f32,
    /// `[m/s^3]` strongest change of acceleration in comfort; emergencies ignore it.
    #[serde(deserialize_with = "sourced")]
    pub comfort_jerk_m_s3: f32,
}

/// The outline of the robot on the floor.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Footprint {
    /// `[m]` corners (x, y) in `base`, counter-clockwise, convex, 3 to 8 of them.
    #[serde(deserialize_with = "sourced")]
    pub polygon_m: Vec<[f32; 2]>,
}

/// The depth camera: geometry and what its stereo can do.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// `[m]` mounting ahead of the axle.
    #[serde(deserialize_with = "sourced")]
    pub forward_m: f32,
    /// `[m]` mounting above the floor.
    #[serde(deserialize_with = "sourced")]
    pub height_m: f32,
    /// `[rad]` pitch down.
    #[serde(deserialize_with = "sourced")]
    pub pitch_down_rad: f32,
    /// `[px]` columns.
    #[serde(deserialize_with = "sourced")]
    pub width_px: u32,
    /// `[px]` rows.
    #[serde(deserialize_with = "sourced")]
    pub height_px: u32,
    /// `[px]` focal length, both axes.
    #[serde(deserialize_with = "sourced")]
    pub focal_px: f32,
    /// `[m]` nearest depth.
    #[serde(deserialize_with = "sourced")]
    pub near_m: f32,
    /// `[m]` farthest depth used.
    #[serde(deserialize_with = "sourced")]
    pub far_m: f32,
    /// `[m]` stereo baseline.
    #[serde(deserialize_with = "sourced")]
    pub baseline_m: f32,
    /// `[px]` standard deviation of the disparity.
    #[serde(deserialize_with = "sourced")]
    pub disparity_sigma_px: f32,
    /// `[Hz]` frames per second.
    #[serde(deserialize_with = "sourced")]
    pub rate_hz: f32,
}

/// A planar lidar.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lidar {
    /// `[m]` mounting ahead of the axle.
    #[serde(deserialize_with = "sourced")]
    pub forward_m: f32,
    /// `[m]` height of the scan plane.
    #[serde(deserialize_with = "sourced")]
    pub height_m: f32,
    /// `[rad]` full field of view, centred ahead.
    #[serde(deserialize_with = "sourced")]
    pub field_of_view_rad: f32,
    /// Beams of a sweep.
    #[serde(deserialize_with = "sourced")]
    pub beams: u32,
    /// `[m]` nearest range.
    #[serde(deserialize_with = "sourced")]
    pub near_m: f32,
    /// `[m]` farthest range.
    #[serde(deserialize_with = "sourced")]
    pub far_m: f32,
    /// `[m]` standard deviation of a range.
    #[serde(deserialize_with = "sourced")]
    pub sigma_m: f32,
    /// `[Hz]` sweeps per second.
    #[serde(deserialize_with = "sourced")]
    pub rate_hz: f32,
}

/// One ultrasonic sensor.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ultrasonic {
    /// `[m]` mounting along x of `base`.
    pub x_m: f32,
    /// `[m]` mounting along y of `base`.
    pub y_m: f32,
    /// `[m]` mounting above the floor.
    pub height_m: f32,
    /// `[rad]` bearing of the cone's axis.
    pub yaw_rad: f32,
    /// `[rad]` full opening of the cone.
    pub field_of_view_rad: f32,
    /// `[m]` nearest distance.
    pub near_m: f32,
    /// `[m]` farthest distance.
    pub far_m: f32,
}

/// How the base follows a command: the identified set that the arbiter must be safe for.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator {
    /// `[s]` shortest time from command to first effect.
    #[serde(deserialize_with = "sourced")]
    pub dead_time_min_s: f32,
    /// `[s]` longest time from command to first effect.
    #[serde(deserialize_with = "sourced")]
    pub dead_time_max_s: f32,
    /// `[s]` time constant of the first-order response.
    #[serde(deserialize_with = "sourced")]
    pub lag_s: f32,
    /// `[m/s^2]` weakest braking the base shows.
    #[serde(deserialize_with = "sourced")]
    pub brake_min_m_s2: f32,
    /// `[m/s^2]` strongest braking the base shows.
    #[serde(deserialize_with = "sourced")]
    pub brake_max_m_s2: f32,
    /// `[m/s]` error of the speed followed: faster or slower than told, never the other way.
    #[serde(deserialize_with = "sourced")]
    pub tracking_m_s: f32,
    /// `[rad/s]` error of the turn rate followed.
    #[serde(deserialize_with = "sourced")]
    pub tracking_rad_s: f32,
    /// `[s]` silence after which the base brakes by itself.
    #[serde(deserialize_with = "sourced")]
    pub watchdog_s: f32,
    /// `[rad]` pitch per forward acceleration: a self-balancing base leans; radians per m/s^2.
    #[serde(deserialize_with = "sourced")]
    pub pitch_rad_per_m_s2: f32,
}

/// What may be assumed where nothing was seen yet, and of what moves.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// `[m]` radius of the disc round the start that the operator grants to be free.
    #[serde(deserialize_with = "sourced")]
    pub disc_m: f32,
    /// `[m/m]` growth of the pose error with distance.
    #[serde(deserialize_with = "sourced")]
    pub drift_per_m: f32,
    /// `[rad/rad]` growth of the heading error with turning.
    #[serde(deserialize_with = "sourced")]
    pub drift_per_rad: f32,
    /// `[m/s]` fastest mover assumed in the visible sector; 0 = a static world.
    #[serde(deserialize_with = "sourced")]
    pub mover_m_s: f32,
}

/// A robot.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Name, for reports.
    pub name: String,
    /// Limits of motion.
    pub limits: Limits,
    /// Outline.
    pub footprint: Footprint,
    /// Depth camera, if there is one.
    pub camera: Option<Camera>,
    /// Lidar, if there is one.
    pub lidar: Option<Lidar>,
    /// Ultrasonic sensors, at most 8.
    #[serde(default)]
    pub ultrasonic: Vec<Ultrasonic>,
    /// Response of the base.
    pub actuator: Actuator,
    /// Assumptions.
    pub start: Start,
}

impl Robot {
    /// Reads and checks a robot file.
    ///
    /// # Errors
    /// [`RobotError::Parse`] with line and column, or [`RobotError::Range`] with key, value and range.
    pub fn from_toml(path: &str, text: &str) -> Result<Self, RobotError> {
        let robot: Self = toml::from_str(text)
            .map_err(|error| RobotError::Parse { path: path.into(), detail: error.to_string() })?;
        robot.check(path)?;
        Ok(robot)
    }

    fn check(&self, path: &str) -> Result<(), RobotError> {
        let l = &self.limits;
        let a = &self.actuator;
        let refused = |key, found, needed| Err(RobotError::Range { path: path.into(), key, found, needed });
        let positive = [
            ("limits.forward_m_s", l.forward_m_s, 3.0),
            ("limits.turn_rad_s", l.turn_rad_s, 6.0),
            ("limits.accelerate_m_s2", l.accelerate_m_s2, 10.0),
            ("limits.brake_m_s2", l.brake_m_s2, 10.0),
            ("limits.turn_accelerate_rad_s2", l.turn_accelerate_rad_s2, 30.0),
            ("limits.comfort_jerk_m_s3", l.comfort_jerk_m_s3, 100.0),
            ("actuator.brake_min_m_s2", a.brake_min_m_s2, 10.0),
            ("actuator.watchdog_s", a.watchdog_s, 1.0),
        ];
        if let Some((key, found, _)) =
            positive.into_iter().find(|(_, found, most)| !(*found > 0.0 && found <= most))
        {
            return refused(key, found, "more than 0 and physically sane");
        }
        let not_negative = [
            ("actuator.lag_s", a.lag_s, 1.0),
            ("actuator.brake_max_m_s2", a.brake_max_m_s2, 20.0),
            ("actuator.tracking_m_s", a.tracking_m_s, 1.0),
            ("actuator.tracking_rad_s", a.tracking_rad_s, 1.0),
        ];
        if let Some((key, found, _)) =
            not_negative.into_iter().find(|(_, found, most)| !(0.0..=*most).contains(found))
        {
            return refused(key, found, "0 or more and physically sane");
        }
        let mover_m_s = self.start.mover_m_s;
        if !(0.0..=3.0).contains(&mover_m_s) {
            return refused("start.mover_m_s", mover_m_s, "0 (a static world) to 3 m/s");
        }
        if !(a.dead_time_min_s >= 0.0 && a.dead_time_min_s <= a.dead_time_max_s && a.dead_time_max_s <= 0.5) {
            let needed = "dead_time_min_s <= dead_time_max_s <= 0.5 s";
            return refused("actuator.dead_time_max_s", a.dead_time_max_s, needed);
        }
        let corners = self.footprint.polygon_m.len();
        if !(3..=8).contains(&corners) || self.half_width_m() <= 0.0 {
            let needed = "3 to 8 corners, counter-clockwise, round the axle";
            return refused("footprint.polygon_m", corners as f32, needed);
        }
        if self.ultrasonic.len() > crate::RANGES_MAX {
            return refused("ultrasonic", self.ultrasonic.len() as f32, "at most 8 sensors");
        }
        Ok(())
    }

    /// `[m]` half of the footprint's width.
    #[must_use]
    pub fn half_width_m(&self) -> f32 {
        self.footprint.polygon_m.iter().fold(0.0, |most, corner| most.max(corner[1].abs()))
    }

    /// Whether camera or scanner look towards a point of `base`, however near or far.
    #[must_use]
    pub fn looks_at(&self, x_m: f32, y_m: f32) -> bool {
        let from_m = self.camera.map_or(0.0, |camera| camera.forward_m);
        libm::atan2f(y_m, x_m - from_m).abs() <= self.half_view_rad()
    }

    /// `[rad]` bearing of the edge of what camera or scanner see, from straight ahead.
    #[must_use]
    pub fn half_view_rad(&self) -> f32 {
        let camera = self.camera.map(|camera| libm::atan2f(0.5 * camera.width_px as f32, camera.focal_px));
        let scanner = self.lidar.map(|lidar| 0.5 * lidar.field_of_view_rad);
        camera.or(scanner).unwrap_or(core::f32::consts::PI)
    }

    /// `[m]` distance from the axle at which a camera first sees the floor straight ahead: nearer cells show themselves only
    /// from farther off. 0 for a scanner, which sees them from where it stands.
    #[must_use]
    pub fn blind_m(&self) -> f32 {
        self.camera.map_or(0.0, |camera| {
            let half_rad = libm::atan2f(0.5 * camera.height_px as f32, camera.focal_px);
            let lowest = libm::tanf((camera.pitch_down_rad + half_rad).max(0.0));
            (camera.forward_m + camera.height_m / lowest.max(1e-3)).max(0.0)
        })
    }

    /// `[m]` radius of the circle round the axle that holds the footprint.
    #[must_use]
    pub fn radius_m(&self) -> f32 {
        self.footprint.polygon_m.iter().fold(0.0, |most, corner| most.max(libm::hypotf(corner[0], corner[1])))
    }

    /// Hash of what a driving policy learns from: limits of its motion and the footprint. Identifying the base or
    /// moving the camera leaves it, so that a model outlives both.
    #[must_use]
    pub fn motion_hash(&self) -> u64 {
        let l = &self.limits;
        let numbers =
            [l.forward_m_s, l.reverse_m_s, l.turn_rad_s, l.accelerate_m_s2, l.turn_accelerate_rad_s2];
        crate::layout_hash(&format!("{numbers:?} {:?}", self.footprint.polygon_m), &[])
    }

    /// Hash of every number: what a model and a recording name, so that they meet only the robot they were made for.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let text = format!("{self:?}");
        crate::layout_hash(&text, &[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOMO: &str = include_str!("../../launch/robots/loomo.toml");

    /// The shipped file with one value changed.
    fn refusal(key: &str, value: &str) -> String {
        let line = LOOMO.lines().find(|line| line.starts_with(&format!("{key} = "))).unwrap();
        let changed = format!("{key} = {{ value = {value}, source = \"guess: a test\" }}");
        Robot::from_toml("robot.toml", &LOOMO.replace(line, &changed)).unwrap_err().to_string()
    }

    #[test]
    fn a_value_out_of_its_range_is_refused_with_key_value_and_range() {
        for (key, value, named, needed) in [
            ("mover_m_s", "-0.1", "start.mover_m_s", "0 (a static world) to 3 m/s"),
            ("mover_m_s", "3.1", "start.mover_m_s", "0 (a static world) to 3 m/s"),
            ("mover_m_s", "nan", "start.mover_m_s", "0 (a static world) to 3 m/s"),
            ("tracking_rad_s", "nan", "actuator.tracking_rad_s", "0 or more and physically sane"),
            ("tracking_m_s", "-0.1", "actuator.tracking_m_s", "0 or more and physically sane"),
            ("brake_max_m_s2", "inf", "actuator.brake_max_m_s2", "0 or more and physically sane"),
            ("lag_s", "1.1", "actuator.lag_s", "0 or more and physically sane"),
            ("forward_m_s", "0.0", "limits.forward_m_s", "more than 0 and physically sane"),
            (
                "dead_time_max_s",
                "0.6",
                "actuator.dead_time_max_s",
                "dead_time_min_s <= dead_time_max_s <= 0.5 s",
            ),
        ] {
            let text = refusal(key, value);
            assert!(text.contains("robot.toml") && text.contains(named) && text.contains(needed), "{text}");
        }
    }

    /// The shipped camera: a point beside its axis within its 28 degrees, one just outside, one behind.
    #[test]
    fn a_camera_looks_ahead_of_where_it_is() {
        let robot = Robot::from_toml("robot.toml", LOOMO).unwrap();
        assert!(robot.looks_at(1.1, 0.5) && robot.looks_at(1.1, -0.5));
        assert!(!robot.looks_at(1.1, 0.55) && !robot.looks_at(0.05, 0.0));
    }
}

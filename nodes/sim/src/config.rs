//! What the simulation is asked for.

use crate::world::WorldError;
use serde::Deserialize;

/// Configuration of the simulator, as the graph file has it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// `office`, `corridor`, `room`, or the path of a world file: `.toml`, ROS map `.yaml`, BARN `.world`, or
    /// `ARCHIVE.tar.xz#N`.
    pub world: String,
    /// Seed of everything that looks random.
    pub seed: u64,
    /// `[0, 16]` people, at most as many as the world has ways for.
    pub people: u32,
    /// Noise of the sensors and drift of the odometry.
    pub noise: bool,
    /// `[px]` `[16, 640]` columns rendered; 0 = as the robot's camera; the field of view stays.
    pub width_px: u32,
    /// `[px]` `[16, 480]` rows rendered; 0 = as the robot's camera.
    pub height_px: u32,
    /// `[1]` `[0, 1]` where the base lies between the shortest and the longest dead time of the robot file.
    pub dead_time_part: f64,
    /// `[1]` `[0, 1]` where the base lies between the weakest and the strongest brake of the robot file.
    pub brake_part: f64,
    /// `[1/min]` `[0, 60]` slips of the wheels, 0.3 s each.
    pub slips_per_min: f64,
    /// `[1]` `[0.1, 1000]` most graph seconds per host second in lockstep, to watch it; the recorder is waited for.
    pub lockstep_rate_most: f64,
    /// `[m, m, rad]` start in the world; without it, the world's own.
    pub start: Option<[f64; 3]>,
}

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// A value that cannot be.
    #[error("sim: {key} is {found}, needed: {needed}")]
    Range {
        /// The key.
        key: &'static str,
        /// The value.
        found: String,
        /// The range.
        needed: &'static str,
    },
    /// A world that cannot be had.
    #[error("sim: {0}")]
    World(#[from] WorldError),
}

impl Default for Config {
    fn default() -> Self {
        Self {
            world: "office".into(),
            seed: 1,
            people: 2,
            noise: true,
            width_px: 0,
            height_px: 0,
            dead_time_part: 0.5,
            brake_part: 0.1,
            slips_per_min: 0.0,
            lockstep_rate_most: 1000.0,
            start: None,
        }
    }
}

impl Config {
    /// Checks every range.
    ///
    /// # Errors
    /// [`ConfigError`] with key, value and range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let refuse = |key, found: String, needed| Err(ConfigError::Range { key, found, needed });
        if self.people > 16 {
            return refuse("people", self.people.to_string(), "0 to 16");
        }
        if self.width_px != 0 && !(16..=640).contains(&self.width_px) {
            return refuse("width_px", self.width_px.to_string(), "0 or 16 to 640");
        }
        if self.height_px != 0 && !(16..=480).contains(&self.height_px) {
            return refuse("height_px", self.height_px.to_string(), "0 or 16 to 480");
        }
        for (key, part) in [("dead_time_part", self.dead_time_part), ("brake_part", self.brake_part)] {
            if !(0.0..=1.0).contains(&part) {
                return refuse(key, part.to_string(), "0 to 1");
            }
        }
        if !(0.0..=60.0).contains(&self.slips_per_min) {
            return refuse("slips_per_min", self.slips_per_min.to_string(), "0 to 60");
        }
        if !(0.1..=1000.0).contains(&self.lockstep_rate_most) {
            // Slower, and the simulator would miss its heartbeat between two ticks.
            return refuse("lockstep_rate_most", self.lockstep_rate_most.to_string(), "0.1 to 1000");
        }
        if self.start.is_some_and(|start| !start.iter().all(|x| x.is_finite())) {
            return refuse("start", format!("{:?}", self.start), "three finite numbers");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_named() {
        let cases = [
            Config { people: 17, ..Config::default() },
            Config { width_px: 5, ..Config::default() },
            Config { height_px: 481, ..Config::default() },
            Config { brake_part: f64::NAN, ..Config::default() },
            Config { slips_per_min: -1.0, ..Config::default() },
            Config { lockstep_rate_most: 0.0, ..Config::default() },
            Config { start: Some([0.0, f64::NAN, 0.0]), ..Config::default() },
        ];
        for case in cases {
            let error = case.check().unwrap_err().to_string();
            assert!(error.starts_with("sim: ") && error.contains("needed"), "{error}");
        }
        assert!(Config::default().check().is_ok());
    }
}

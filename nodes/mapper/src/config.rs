//! What the mapper may be told: limits of the sensor, height classes, trust and memory.

use serde::Deserialize;

/// Parameters of the mapper; every one is required.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// `[m]` nearest depth used.
    pub near_m: f32,
    /// `[m]` farthest depth used.
    pub far_m: f32,
    /// `[m]` what stands higher than this above the floor is an obstacle, at range 0.
    pub floor_cut_m: f32,
    /// `[m/m]` growth of the floor cut with range: the tangent of the pitch error that must not turn floor into obstacle.
    pub floor_cut_per_m: f32,
    /// `[m]` what lies deeper than this below the floor is a hole, at range 0; grows with range as the floor cut does.
    pub hole_cut_m: f32,
    /// `[m]` what is higher than this passes overhead.
    pub band_top_m: f32,
    /// `[m]` side of the square, facing the camera, whose pixels are enough support for a cell.
    pub support_side_m: f32,
    /// `[px]` least support of a cell at any range.
    pub support_min_px: u32,
    /// `[1]` least part of a frame's pixels that must carry a measurement.
    pub valid_part_min: f32,
    /// `[1]` log-odds added by a supported sighting of an obstacle.
    pub hit_log_odds: f32,
    /// `[1]` log-odds added by a sighting of four times the needed support, and by a lidar beam.
    pub strong_hit_log_odds: f32,
    /// `[1]` log-odds taken by a sighting of free space.
    pub miss_log_odds: f32,
    /// `[1]` log-odds at which an occupied cell saturates.
    pub log_odds_max: f32,
    /// `[1]` log-odds at which a free cell saturates, positive.
    pub log_odds_free_max: f32,
    /// `[s]` time without sight after which a free cell is unknown again.
    pub forget_free_s: f32,
    /// `[s]` time without sight after which an occupied cell is unknown again.
    pub forget_occupied_s: f32,
    /// `[m]` expected pose drift since the last sight after which any cell is unknown again.
    pub forget_drift_m: f32,
    /// `[m]` farthest distance at which a heading error counts towards the drift; what is nearer to a turn moves less.
    pub drift_lever_m: f32,
    /// `[s]` widest gap between two odometry samples that is still interpolated.
    pub odometry_gap_s: f32,
    /// `[m]` ultrasonic readings nearer than this are marked.
    pub sonar_below_m: f32,
    /// `[s]` time for which a cell marked by an ultrasonic sensor stays marked out of that sensor's sight.
    pub sonar_hold_s: f32,
    /// Whether what stands in the band always crosses the lidar's plane, so that a beam clears the cells it passes.
    pub scan_sees_band: bool,
    /// Whether the start disc of the robot file is granted free at the first frame.
    pub grant_start_disc: bool,
}

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("mapper: {key} is {found}, needed: {needed}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// The value found.
    pub found: f32,
    /// The range needed.
    pub needed: &'static str,
}

impl Config {
    /// The values shipped for a robot with a depth camera, or with a lidar in whose plane every obstacle stands.
    #[must_use]
    pub const fn shipped() -> Self {
        Self {
            near_m: 0.35,
            far_m: 3.5,
            floor_cut_m: 0.05,
            floor_cut_per_m: 0.0175,
            hole_cut_m: 0.08,
            band_top_m: 0.9,
            support_side_m: 0.009,
            support_min_px: 3,
            valid_part_min: 0.005,
            hit_log_odds: 0.85,
            strong_hit_log_odds: 2.2,
            miss_log_odds: 0.85,
            log_odds_max: 3.5,
            log_odds_free_max: 2.2,
            forget_free_s: 1800.0,
            forget_occupied_s: 600.0,
            forget_drift_m: 0.15,
            drift_lever_m: 1.0,
            odometry_gap_s: 0.15,
            sonar_below_m: 0.5,
            sonar_hold_s: 10.0,
            scan_sees_band: true,
            grant_start_disc: true,
        }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first key out of its range, with what was found and what is needed.
    pub fn check(&self) -> Result<(), ConfigError> {
        let ranges = [
            ("near_m", self.near_m, 0.05, 2.0, "0.05 to 2 m"),
            ("far_m", self.far_m, 0.5, 8.0, "0.5 to 8 m"),
            ("floor_cut_m", self.floor_cut_m, 0.005, 0.5, "0.005 to 0.5 m"),
            ("floor_cut_per_m", self.floor_cut_per_m, 0.0, 0.2, "0 to 0.2"),
            ("hole_cut_m", self.hole_cut_m, 0.005, 1.0, "0.005 to 1 m"),
            ("band_top_m", self.band_top_m, 0.2, 3.0, "0.2 to 3 m"),
            ("support_side_m", self.support_side_m, 0.0, 0.05, "0 to 0.05 m"),
            ("support_min_px", self.support_min_px as f32, 1.0, 1000.0, "1 to 1000"),
            ("valid_part_min", self.valid_part_min, 0.0, 0.5, "0 to 0.5"),
            ("hit_log_odds", self.hit_log_odds, 0.1, 5.0, "0.1 to 5"),
            ("strong_hit_log_odds", self.strong_hit_log_odds, 0.1, 5.0, "0.1 to 5"),
            ("miss_log_odds", self.miss_log_odds, 0.05, 3.0, "0.05 to 3"),
            ("log_odds_max", self.log_odds_max, 1.0, 3.5, "1 to 3.5"),
            ("log_odds_free_max", self.log_odds_free_max, 1.0, 3.5, "1 to 3.5"),
            ("forget_free_s", self.forget_free_s, 1.0, 1e6, "1 s to 1e6 s"),
            ("forget_occupied_s", self.forget_occupied_s, 1.0, 1e6, "1 s to 1e6 s"),
            ("forget_drift_m", self.forget_drift_m, 0.01, 100.0, "0.01 to 100 m"),
            ("drift_lever_m", self.drift_lever_m, 0.0, 5.0, "0 to 5 m"),
            ("odometry_gap_s", self.odometry_gap_s, 0.02, 1.0, "0.02 to 1 s"),
            ("sonar_below_m", self.sonar_below_m, 0.0, 3.0, "0 to 3 m"),
            ("sonar_hold_s", self.sonar_hold_s, 0.0, 600.0, "0 to 600 s"),
        ];
        for (key, found, least, most, needed) in ranges {
            // NaN fails both comparisons.
            if !(found >= least && found <= most) {
                return Err(ConfigError { key, found, needed });
            }
        }
        if self.far_m <= self.near_m {
            return Err(ConfigError { key: "far_m", found: self.far_m, needed: "more than near_m" });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_values_pass_and_every_nan_is_refused_by_its_key() {
        assert_eq!(Config::shipped().check(), Ok(()));
        let broken = Config { miss_log_odds: f32::NAN, ..Config::shipped() };
        assert_eq!(broken.check().unwrap_err().key, "miss_log_odds");
        let swapped = Config { near_m: 1.0, far_m: 0.6, ..Config::shipped() };
        assert_eq!(swapped.check().unwrap_err().key, "far_m");
    }
}

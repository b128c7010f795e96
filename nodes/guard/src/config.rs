//! What the guard may be told: limits of the sensor, what counts as floor, and how much it takes to believe a pixel.

use crate::tally::RANGE_MAX_M;
use serde::Deserialize;

/// Parameters of the guard; every one is required.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// `[m]` nearest depth used.
    pub near_m: f32,
    /// `[m]` farthest depth used.
    pub far_m: f32,
    /// `[m]` what stands higher than this above the floor is in the way, at range 0.
    pub floor_cut_m: f32,
    /// `[m/m]` growth of the floor cut with range, beside that for the lean of the base: error of the camera's mounting.
    pub floor_cut_per_m: f32,
    /// `[m]` what is higher than this passes overhead.
    pub band_top_m: f32,
    /// `[px]` of so many columns, and of so many rows, one is looked at; fewer are left out of frames below 512 columns.
    pub stride_px: u32,
    /// `[m]` side of the square, facing the camera, whose pixels are enough to believe a range.
    pub support_side_m: f32,
    /// `[px]` least support at any range, of the pixels looked at.
    pub support_min_px: u32,
    /// `[m]` depth within which these pixels must lie; two sigma of the stereo noise where that is more.
    pub support_depth_m: f32,
    /// `[1]` least part of a frame's pixels that must carry a measurement.
    pub valid_part_min: f32,
    /// `[1]` least part of a sector's mean share of pixels that must be measured in it for the sector to count as seen.
    pub seen_part_min: f32,
}

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("guard: {key} is {found}, needed: {needed}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// The value found.
    pub found: f32,
    /// The range needed.
    pub needed: &'static str,
}

impl Config {
    /// The values shipped for a depth camera.
    pub const STANDARD: Self = Self {
        near_m: 0.35,
        far_m: 3.5,
        floor_cut_m: 0.05,
        floor_cut_per_m: 0.01,
        band_top_m: 0.9,
        stride_px: 2,
        support_side_m: 0.015,
        support_min_px: 4,
        support_depth_m: 0.06,
        valid_part_min: 0.005,
        seen_part_min: 0.1,
    };

    /// Checks every range.
    ///
    /// # Errors
    /// The first key out of its range, with what was found and what is needed.
    pub fn check(&self) -> Result<(), ConfigError> {
        let ranges = [
            ("near_m", self.near_m, 0.05, 2.0, "0.05 to 2 m"),
            ("far_m", self.far_m, self.near_m, 0.7 * RANGE_MAX_M, "near_m to 7 m"),
            ("floor_cut_m", self.floor_cut_m, 0.005, 0.5, "0.005 to 0.5 m"),
            ("floor_cut_per_m", self.floor_cut_per_m, 0.0, 0.2, "0 to 0.2"),
            ("band_top_m", self.band_top_m, 0.2, 3.0, "0.2 to 3 m"),
            ("stride_px", self.stride_px as f32, 1.0, 8.0, "1 to 8"),
            ("support_side_m", self.support_side_m, 0.0, 0.05, "0 to 0.05 m"),
            ("support_min_px", self.support_min_px as f32, 1.0, 1000.0, "1 to 1000"),
            ("support_depth_m", self.support_depth_m, 0.02, 0.5, "0.02 to 0.5 m"),
            ("valid_part_min", self.valid_part_min, 0.0, 0.5, "0 to 0.5"),
            ("seen_part_min", self.seen_part_min, 0.0, 1.0, "0 to 1"),
        ];
        for (key, found, least, most, needed) in ranges {
            // NaN fails both comparisons.
            if !(found >= least && found <= most) {
                return Err(ConfigError { key, found, needed });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_values_pass_and_every_range_is_watched() {
        assert_eq!(Config::STANDARD.check(), Ok(()));
        let error = Config { stride_px: 0, ..Config::STANDARD }.check().unwrap_err();
        assert_eq!(error.to_string(), "guard: stride_px is 0, needed: 1 to 8");
        assert_eq!(Config { near_m: f32::NAN, ..Config::STANDARD }.check().unwrap_err().key, "near_m");
        assert_eq!(Config { far_m: 0.2, ..Config::STANDARD }.check().unwrap_err().key, "far_m");
    }
}

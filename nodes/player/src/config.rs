//! Settings of the player.

use serde::Deserialize;
use std::path::PathBuf;

/// Settings of the player.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The recording.
    pub file: PathBuf,
    /// `[1]` (0, 100] graph seconds per host second.
    pub rate: f64,
    /// Whether to begin again at the end, in a new epoch.
    pub repeat: bool,
    /// `[s]` `[0, 1e6]` how far into the recording to begin.
    pub start_offset_s: f64,
}

impl Config {
    /// Checks the ranges.
    ///
    /// # Errors
    /// A text with key, value and range.
    pub fn check(&self) -> Result<(), String> {
        let wrong =
            |key: &str, found: f64, needed: &str| Err(format!("player.{key} is {found}, needed: {needed}"));
        if !(self.rate > 0.0 && self.rate <= 100.0) {
            return wrong("rate", self.rate, "more than 0, at most 100");
        }
        if !(self.start_offset_s >= 0.0 && self.start_offset_s <= 1e6) {
            return wrong("start_offset_s", self.start_offset_s, "0 to 1e6");
        }
        Ok(())
    }

    /// `[ns]` [`Config::start_offset_s`].
    #[must_use]
    pub fn start_offset_ns(&self) -> u64 {
        (self.start_offset_s * 1e9) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_out_of_range_is_named_with_its_range() {
        let good = Config { file: "drive.mcap".into(), rate: 1.0, repeat: false, start_offset_s: 0.0 };
        assert_eq!(good.check(), Ok(()));
        for bad in [
            Config { rate: 0.0, ..good.clone() },
            Config { start_offset_s: f64::NAN, ..good.clone() },
            Config { rate: f64::INFINITY, ..good },
        ] {
            let text = bad.check().unwrap_err();
            assert!(text.starts_with("player.") && text.contains("needed"), "{text}");
        }
    }
}

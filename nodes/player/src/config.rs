//! Settings of the player.

use crate::selection::Selection;
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
    /// `[s]` more than 0: how much of it to play; inf = to its end.
    pub duration_s: f64,
    /// The driver's topics to play; none = all of them.
    pub topics: Vec<String>,
    /// Topics of the driver that are not played.
    pub exclude: Vec<String>,
    /// `CHANNEL:=TOPIC`: a channel of the recording that is played on a topic of the driver, in place of that topic's own.
    pub remap: Vec<String>,
    /// Whether to stand before the first message until the keyboard says go on.
    pub paused: bool,
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
        if self.duration_s.is_nan() || self.duration_s <= 0.0 {
            return wrong("duration_s", self.duration_s, "more than 0, inf for all");
        }
        Selection::of(self).map(|_| ())
    }

    /// `[ns]` [`Config::duration_s`].
    #[must_use]
    pub fn duration_ns(&self) -> u64 {
        (self.duration_s * 1e9) as u64
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
        let good = Config {
            file: "drive.mcap".into(),
            rate: 1.0,
            repeat: false,
            start_offset_s: 0.0,
            duration_s: f64::INFINITY,
            topics: Vec::new(),
            exclude: Vec::new(),
            remap: Vec::new(),
            paused: false,
        };
        assert_eq!(good.check(), Ok(()));
        for bad in [
            Config { rate: 0.0, ..good.clone() },
            Config { start_offset_s: f64::NAN, ..good.clone() },
            Config { rate: f64::INFINITY, ..good.clone() },
            Config { duration_s: 0.0, ..good.clone() },
            Config { duration_s: f64::NAN, ..good.clone() },
            Config { remap: vec!["odometry".into()], ..good },
        ] {
            let text = bad.check().unwrap_err();
            assert!(text.starts_with("player.") && text.contains("needed"), "{text}");
        }
    }
}

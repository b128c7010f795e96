//! Settings of the recorder.

use serde::Deserialize;
use std::path::PathBuf;

/// Settings of the recorder.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Folder of the recordings; made where it is missing.
    pub folder: PathBuf,
    /// `[s]` (0, 10] a chunk reaches the system at least this often: what a kill can lose.
    pub flush_period_s: f64,
    /// `[64, 65536]` small messages that may wait for the disk, 16 KiB each.
    pub queue_small: usize,
    /// `[2, 1024]` depth frames and states that may wait for the disk, 0.6 MiB each.
    pub queue_large: usize,
    /// Further files that each recording takes within, such as a model that is not the embedded one.
    pub attach: Vec<PathBuf>,
    /// Whether recordings carry channels for Foxglove and Lichtblick beside the raw messages.
    pub view: bool,
}

impl Config {
    /// Checks the ranges.
    ///
    /// # Errors
    /// A text with key, value and range.
    pub fn check(&self) -> Result<(), String> {
        let wrong = |key: &str, found: &dyn std::fmt::Display, needed: &str| {
            Err(format!("recorder.{key} is {found}, needed: {needed}"))
        };
        if self.folder.as_os_str().is_empty() {
            return wrong("folder", &"empty", "a folder for recordings");
        }
        if !(self.flush_period_s > 0.0 && self.flush_period_s <= 10.0) {
            return wrong("flush_period_s", &self.flush_period_s, "more than 0, at most 10");
        }
        if !(64..=65_536).contains(&self.queue_small) {
            return wrong("queue_small", &self.queue_small, "64 to 65536");
        }
        if !(2..=1024).contains(&self.queue_large) {
            return wrong("queue_large", &self.queue_large, "2 to 1024");
        }
        Ok(())
    }

    /// `[ns]` [`Config::flush_period_s`].
    #[must_use]
    pub fn flush_period_ns(&self) -> u64 {
        (self.flush_period_s * 1e9) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_out_of_range_is_named_with_its_range() {
        let good = Config {
            folder: "recordings".into(),
            flush_period_s: 1.0,
            queue_small: 1024,
            queue_large: 24,
            attach: Vec::new(),
            view: true,
        };
        assert_eq!(good.check(), Ok(()));
        for bad in [
            Config { flush_period_s: f64::NAN, ..good.clone() },
            Config { queue_small: 1, ..good.clone() },
            Config { queue_large: 5000, ..good.clone() },
            Config { folder: PathBuf::new(), ..good },
        ] {
            let text = bad.check().unwrap_err();
            assert!(text.starts_with("recorder.") && text.contains("needed"), "{text}");
        }
    }
}

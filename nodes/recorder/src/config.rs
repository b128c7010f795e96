//! Settings of the recorder.

use crate::filter::Filter;
use serde::Deserialize;
use std::path::PathBuf;

/// Settings of the recorder.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Folder of the recordings; made where it is missing.
    pub folder: PathBuf,
    /// Whether the whole drive is written; without it only what the black box keeps.
    pub whole_drive: bool,
    /// Names or patterns (`*`, `?`) of the topics to record; empty = all.
    pub topics: Vec<String>,
    /// Names or patterns of topics not to record.
    pub exclude: Vec<String>,
    /// `[MB]` 0 or [1, 1000000] a file of this size is followed by the next; 0 = never.
    pub split_mb: u64,
    /// `[s]` 0 or [1, 86400] a file of this age is followed by the next; 0 = never.
    pub split_s: f64,
    /// `[MB]` [0, 1000000] the recording ends in order when the disk has less left; 0 = when the disk refuses.
    pub free_mb_least: u64,
    /// `[MB]` [0, 256] memory of the black box; 0 = none.
    pub black_box_mb: u64,
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
    /// The whole drive with all topics into one file, without a black box.
    #[must_use]
    pub fn plain(folder: PathBuf) -> Self {
        Self {
            folder,
            whole_drive: true,
            topics: Vec::new(),
            exclude: Vec::new(),
            split_mb: 0,
            split_s: 0.0,
            free_mb_least: 0,
            black_box_mb: 0,
            flush_period_s: 0.5,
            queue_small: 1024,
            queue_large: 48,
            attach: Vec::new(),
            view: true,
        }
    }

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
        if self.split_mb > 1_000_000 {
            return wrong("split_mb", &self.split_mb, "0 to 1000000");
        }
        if !((0.0..=0.0).contains(&self.split_s) || (1.0..=86_400.0).contains(&self.split_s)) {
            return wrong("split_s", &self.split_s, "0, or 1 to 86400");
        }
        if self.free_mb_least > 1_000_000 {
            return wrong("free_mb_least", &self.free_mb_least, "0 to 1000000");
        }
        if self.black_box_mb > 256 {
            return wrong("black_box_mb", &self.black_box_mb, "0 to 256");
        }
        if !self.whole_drive && self.black_box_mb == 0 {
            return wrong("whole_drive", &false, "true where black_box_mb is 0, else nothing is recorded");
        }
        self.filter()?;
        if !(64..=65_536).contains(&self.queue_small) {
            return wrong("queue_small", &self.queue_small, "64 to 65536");
        }
        if !(2..=1024).contains(&self.queue_large) {
            return wrong("queue_large", &self.queue_large, "2 to 1024");
        }
        Ok(())
    }

    /// The topics that are recorded.
    ///
    /// # Errors
    /// As [`Filter::of`], with the key.
    pub fn filter(&self) -> Result<Filter, String> {
        Filter::of(&self.topics, &self.exclude).map_err(|why| format!("recorder.topics or exclude: {why}"))
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
        let good = Config::plain("recordings".into());
        assert_eq!(good.check(), Ok(()));
        for bad in [
            Config { flush_period_s: f64::NAN, ..good.clone() },
            Config { queue_small: 1, ..good.clone() },
            Config { split_mb: 2_000_000, ..good.clone() },
            Config { split_s: 0.5, ..good.clone() },
            Config { split_s: f64::NAN, ..good.clone() },
            Config { free_mb_least: 1 << 40, ..good.clone() },
            Config { black_box_mb: 257, ..good.clone() },
            Config { whole_drive: false, ..good.clone() },
            Config { topics: vec!["dept".into()], ..good.clone() },
            Config { queue_large: 5000, ..good.clone() },
            Config { folder: PathBuf::new(), ..good },
        ] {
            let text = bad.check().unwrap_err();
            assert!(text.starts_with("recorder.") && text.contains("needed"), "{text}");
        }
    }
}

//! Parameters of the arbiter.

use serde::Deserialize;
use sidestep_msgs::{FREE_BELOW, Winner};

/// Why the arbiter cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("arbiter: {key} is {found}, needed: {needed}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// The value.
    pub found: f64,
    /// The range.
    pub needed: &'static str,
}

/// Whose proposals drive while they are fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lead {
    /// The network's.
    #[default]
    Policy,
    /// The expert's, however hard it thinks (plain, solved or refined).
    Expert,
}

/// What follows a stop that an operator or a crash caused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Resume {
    /// Drive on.
    #[default]
    Auto,
    /// Wait for an operator (ISO 3691-4: no automatic restart).
    Operator,
}

/// Configuration of the node.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Key `lead` at the top of the graph file.
    #[serde(skip)]
    pub lead: Lead,
    /// Key `resume` at the top of the graph file.
    #[serde(skip)]
    pub resume: Resume,
    /// `[s]` oldest map, from its capture stamp: three frame periods.
    pub map_age_s: f32,
    /// `[s]` oldest local goal, from the capture stamp of its map.
    pub goal_age_s: f32,
    /// `[s]` oldest proposal, from the capture stamp of its map.
    pub proposal_age_s: f32,
    /// `[s]` oldest odometry.
    pub odometry_age_s: f32,
    /// `[s]` oldest wish of the operator.
    pub teleop_age_s: f32,
    /// `[s]` oldest ultrasonic reading; older ones are ignored, since the map holds them too.
    pub ranges_age_s: f32,
    /// `[s]` oldest near field, once one came.
    pub near_field_age_s: f32,
    /// `[1]` a cell is free below this probability of being occupied.
    pub free_below: f32,
    /// `[m]` widening of the footprint for pose drift and range error; the map is conservative by itself.
    pub margin_m: f32,
    /// `[m]` longest motion of a point of the footprint between two poses that are checked.
    pub gap_m: f32,
    /// `[s]` a command is assumed to hold this long before the brake: until the base brakes if the arbiter dies.
    pub hold_s: f32,
    /// `[m]` deepest overlap with cells that are not free, from which the robot may still move away.
    pub overlap_m: f32,
    /// `[m/s]` fastest while something is inside the margin.
    pub squeeze_m_s: f32,
    /// `[m/s]` slower than this is no progress: turn or back up instead.
    pub crawl_m_s: f32,
    /// `[rad/s]` turn rate of an escape or a scan.
    pub escape_turn_rad_s: f32,
    /// `[m/s]` speed of a back-up.
    pub back_up_m_s: f32,
    /// `[m]` longest back-up.
    pub back_up_m: f32,
    /// `[s]` `[0, 25]` an escape backward crosses only cells seen within this time; a recovery any free cell.
    pub back_up_age_s: f32,
    /// `[s]` standing for this long although there is a goal: recovery.
    pub boxed_in_s: f32,
    /// `[s]` the same where what is in the way is a cell that the camera does not see (`seen_s`), or nothing: a lead that
    /// crawls without a reason.
    pub unseen_s: f32,
    /// `[s]` wanting at most 0.15 m/s for this long before a gap that the footprint fits through: led on.
    pub hesitate_s: f32,
    /// `[s]` no progress for this long: recovery.
    pub no_progress_s: f32,
    /// `[m]` what counts as progress.
    pub progress_m: f32,
    /// `[s]` rest after recovery failed, before it tries again (`resume = auto`).
    pub wait_s: f32,
    /// `[s]` what has stood for this long goes on standing; before, it may move. Only where the robot file names a speed of movers.
    pub still_s: f32,
    /// `[s]` a cell not seen for longer may hide a mover (as above), and waiting shows no more of it.
    pub seen_s: f32,
    /// `[m/s]` a policy in more doubt than this gives way to the expert; `inf` = never.
    pub doubt_limit_m_s: f32,
    /// `[rad/s]` a policy in more doubt than this gives way to the expert; `inf` = never.
    pub doubt_limit_rad_s: f32,
    /// Good frames in a row after which a lead that failed drives again.
    pub lead_frames: u32,
    /// `[s]` or good for this long.
    pub lead_good_s: f32,
    /// Path of the file that keeps an emergency stop and a hold; empty = in the folder of the run.
    pub latch_file: String,
}

impl Config {
    /// The shipped configuration.
    pub const STANDARD: Self = Self {
        lead: Lead::Policy,
        resume: Resume::Auto,
        map_age_s: 0.1,
        goal_age_s: 0.1,
        proposal_age_s: 0.1,
        odometry_age_s: 0.06,
        teleop_age_s: 0.1,
        ranges_age_s: 0.3,
        near_field_age_s: 0.15,
        free_below: FREE_BELOW,
        margin_m: 0.015,
        gap_m: 0.02,
        hold_s: 0.08,
        overlap_m: 0.06,
        squeeze_m_s: 0.3,
        crawl_m_s: 0.03,
        escape_turn_rad_s: 1.0,
        back_up_m_s: 0.2,
        back_up_m: 0.9,
        back_up_age_s: 20.0,
        boxed_in_s: 3.0,
        unseen_s: 1.0,
        hesitate_s: 0.15,
        no_progress_s: 5.0,
        progress_m: 0.1,
        wait_s: 2.0,
        still_s: 1.0,
        seen_s: 0.5,
        doubt_limit_m_s: f32::INFINITY,
        doubt_limit_rad_s: f32::INFINITY,
        lead_frames: 10,
        lead_good_s: 0.5,
        latch_file: String::new(),
    };

    /// This configuration under the graph file's `lead` and `resume`.
    #[must_use]
    pub fn under(self, lead: Winner, resume: Option<&str>) -> Self {
        let lead = if lead == Winner::Policy { Lead::Policy } else { Lead::Expert };
        let resume = if resume == Some("operator") { Resume::Operator } else { Resume::Auto };
        Self { lead, resume, ..self }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first key out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        const AGE: &str = "0.02 to 2 s";
        let ranges = [
            ("map_age_s", self.map_age_s, 0.02, 2.0, AGE),
            ("goal_age_s", self.goal_age_s, 0.02, 2.0, AGE),
            ("proposal_age_s", self.proposal_age_s, 0.02, 2.0, AGE),
            ("odometry_age_s", self.odometry_age_s, 0.02, 0.2, "0.02 to 0.2 s"),
            ("teleop_age_s", self.teleop_age_s, 0.02, 2.0, AGE),
            ("ranges_age_s", self.ranges_age_s, 0.02, 2.0, AGE),
            ("near_field_age_s", self.near_field_age_s, 0.02, 2.0, AGE),
            ("free_below", self.free_below, 0.05, 0.49, "0.05 to 0.49: unknown (0.5) is not free"),
            ("margin_m", self.margin_m, 0.0, 0.2, "0 to 0.2 m"),
            ("gap_m", self.gap_m, 0.005, 0.05, "0.005 to 0.05 m"),
            ("hold_s", self.hold_s, 0.02, 0.3, "0.02 to 0.3 s"),
            ("overlap_m", self.overlap_m, 0.0, 0.08, "0 to 0.08 m"),
            ("squeeze_m_s", self.squeeze_m_s, 0.0, 1.0, "0 to 1 m/s"),
            ("crawl_m_s", self.crawl_m_s, 0.0, 0.2, "0 to 0.2 m/s"),
            ("escape_turn_rad_s", self.escape_turn_rad_s, 0.1, 3.0, "0.1 to 3 rad/s"),
            ("back_up_m_s", self.back_up_m_s, 0.02, 0.5, "0.02 to 0.5 m/s"),
            ("back_up_m", self.back_up_m, 0.0, 1.0, "0 to 1 m"),
            ("back_up_age_s", self.back_up_age_s, 0.0, 25.0, "0 to 25 s"),
            ("boxed_in_s", self.boxed_in_s, 0.5, 60.0, "0.5 to 60 s"),
            ("unseen_s", self.unseen_s, 0.2, 60.0, "0.2 to 60 s"),
            ("hesitate_s", self.hesitate_s, 0.1, 60.0, "0.1 to 60 s"),
            ("no_progress_s", self.no_progress_s, 1.0, 600.0, "1 to 600 s"),
            ("progress_m", self.progress_m, 0.01, 1.0, "0.01 to 1 m"),
            ("wait_s", self.wait_s, 0.5, 600.0, "0.5 to 600 s"),
            ("still_s", self.still_s, 0.1, 25.0, "0.1 to 25 s"),
            ("seen_s", self.seen_s, 0.0, 25.0, "0 to 25 s"),
            ("doubt_limit_m_s", self.doubt_limit_m_s, 0.0, f32::INFINITY, "0 to inf"),
            ("doubt_limit_rad_s", self.doubt_limit_rad_s, 0.0, f32::INFINITY, "0 to inf"),
            ("lead_frames", self.lead_frames as f32, 1.0, 1000.0, "1 to 1000"),
            ("lead_good_s", self.lead_good_s, 0.0, 60.0, "0 to 60 s"),
        ];
        for (key, found, least, most, needed) in ranges {
            // NaN fails the comparison.
            if !(found >= least && found <= most) {
                return Err(ConfigError { key, found: f64::from(found), needed });
            }
        }
        Ok(())
    }
}

/// `[ns]` of a span in seconds, for comparisons that are exact to the nanosecond.
pub(crate) fn span_ns(span_s: f32) -> u64 {
    (f64::from(span_s) * 1e6 + 0.5) as u64 * 1000
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_configuration_passes_and_every_range_is_watched() {
        assert_eq!(Config::STANDARD.check(), Ok(()));
        assert_eq!(Config { free_below: 0.5, ..Config::STANDARD }.check().unwrap_err().key, "free_below");
        let error = Config { margin_m: f32::NAN, ..Config::STANDARD }.check().unwrap_err();
        assert_eq!(error.to_string(), "arbiter: margin_m is NaN, needed: 0 to 0.2 m");
    }

    #[test]
    fn spans_are_whole_microseconds() {
        assert_eq!(span_ns(0.1), 100_000_000);
        assert_eq!(span_ns(0.06), 60_000_000);
    }
}

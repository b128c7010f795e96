//! Parameters of the expert.

use serde::Deserialize;

/// Why a configuration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("expert: {key} is {found}, needed: {needed}")]
pub struct ConfigError {
    /// The key.
    pub key: &'static str,
    /// The value.
    pub found: f64,
    /// The range.
    pub needed: &'static str,
}

/// How hard the node thinks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lead {
    /// The best candidate.
    Plain,
    /// The best four distinct candidates, improved.
    Solved,
    /// The policy's proposal, improved; plain where there is none.
    Refined,
}

/// The weights of paper eq. (6); the values are not printed there, these were measured to drive well.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// `[1/m]` w1, on the distance between goal and last pose.
    pub distance_per_m: f32,
    /// `[1/rad]` w2, on the heading to the goal at the last pose.
    pub heading_per_rad: f32,
    /// `[1]` w3, on the change of (v, w) in SI units.
    pub change: f32,
    /// `[1]` m of eq. (6c): largest planning cost that is safe.
    pub limit: f32,
    /// `[1]` price of each 1.0 of planning cost above the limit, per step: eq. (6c) as an exact penalty.
    pub penalty: f32,
}

impl Weights {
    /// The shipped weights: those of the training labels.
    pub const STANDARD: Self =
        Self { distance_per_m: 4.0, heading_per_rad: 0.5, change: 0.3, limit: 0.4, penalty: 20.0 };
}

/// Configuration of the node.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// How hard to think.
    pub mode: Lead,
    /// `[50, 10000]` candidates of a plain plan; the paper's demonstrator has 734.
    pub candidates: usize,
    /// `[ns]` graph time after which a refining expert stops waiting for the policy's proposal.
    pub policy_wait_ns: u64,
    /// Eq. (6).
    pub weights: Weights,
}

impl Config {
    /// The shipped configuration.
    pub const STANDARD: Self =
        Self { mode: Lead::Plain, candidates: 734, policy_wait_ns: 10_000_000, weights: Weights::STANDARD };

    /// This configuration under the graph's `lead`: the leads `solved` and `refined` name the expert's mode.
    #[must_use]
    pub fn led_by(self, lead: &str) -> Self {
        let mode = match lead {
            "solved" => Lead::Solved,
            "refined" => Lead::Refined,
            _ => self.mode,
        };
        Self { mode, ..self }
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first key out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let w = &self.weights;
        let ranges = [
            ("candidates", self.candidates as f64, 50.0, 10_000.0, "50 to 10000"),
            ("policy_wait_ns", self.policy_wait_ns as f64, 0.0, 1e9, "0 to 1000000000"),
            ("weights.distance_per_m", f64::from(w.distance_per_m), 0.0, 1000.0, "0 to 1000"),
            ("weights.heading_per_rad", f64::from(w.heading_per_rad), 0.0, 1000.0, "0 to 1000"),
            ("weights.change", f64::from(w.change), 0.0, 1000.0, "0 to 1000"),
            ("weights.limit", f64::from(w.limit), 0.0, 1.0, "0 to 1"),
            ("weights.penalty", f64::from(w.penalty), 0.0, 1e4, "0 to 10000"),
        ];
        for (key, found, least, most, needed) in ranges {
            // NaN fails the comparison.
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
    fn the_shipped_configuration_passes_and_every_range_is_watched() {
        assert_eq!(Config::STANDARD.check(), Ok(()));
        assert_eq!(Config { candidates: 49, ..Config::STANDARD }.check().unwrap_err().key, "candidates");
        let weights = Weights { limit: f32::NAN, ..Weights::STANDARD };
        let error = Config { weights, ..Config::STANDARD }.check().unwrap_err();
        assert_eq!(error.to_string(), "expert: weights.limit is NaN, needed: 0 to 1");
    }
}

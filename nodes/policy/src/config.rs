//! Parameters of the policy node.

use crate::error::ModelError;
use crate::policy::{Policy, embedded};
use serde::Deserialize;
use sidestep_msgs::Robot;

/// Configuration of the node.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// An ONNX file; empty for the model in the binary.
    pub model: String,
}

impl Config {
    /// Reads, checks and tests the model for a robot.
    ///
    /// # Errors
    /// [`ModelError`], with the file's name.
    pub fn load(&self, robot: &Robot) -> Result<Policy, ModelError> {
        if self.model.is_empty() {
            return Policy::load(embedded(), "embedded", robot);
        }
        let unreadable =
            |error: std::io::Error| ModelError::Read { model: self.model.clone(), detail: error.to_string() };
        Policy::load(&std::fs::read(&self.model).map_err(unreadable)?, &self.model, robot)
    }
}

//! Parameters of the policy node.

use crate::error::ModelError;
use crate::policy::{Policy, embedded};
use serde::Deserialize;
use sidestep_msgs::Robot;
use std::borrow::Cow;

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
        let name = if self.model.is_empty() { "embedded" } else { &self.model };
        Policy::load(&self.bytes()?, name, robot)
    }

    /// The model file.
    ///
    /// # Errors
    /// [`ModelError::Read`], with the file's name.
    pub fn bytes(&self) -> Result<Cow<'static, [u8]>, ModelError> {
        if self.model.is_empty() {
            return Ok(embedded().into());
        }
        let unreadable =
            |error: std::io::Error| ModelError::Read { model: self.model.clone(), detail: error.to_string() };
        Ok(std::fs::read(&self.model).map_err(unreadable)?.into())
    }
}

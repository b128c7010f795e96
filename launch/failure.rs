//! Why a command failed, and the exit code that says so.

/// A message for the user and the exit code that goes with it.
#[derive(Debug)]
pub(crate) struct Failure {
    /// 1 = what was asked did not hold, 2 = usage or configuration, 3 = input or output failed or was lost.
    pub(crate) code: u8,
    /// Found, needed, remedy.
    pub(crate) message: String,
}

impl Failure {
    /// What was asked did not hold.
    pub(crate) fn unmet(message: impl Into<String>) -> Self {
        Self { code: 1, message: message.into() }
    }

    /// Usage or configuration.
    pub(crate) fn usage(message: impl Into<String>) -> Self {
        Self { code: 2, message: message.into() }
    }

    /// Input or output failed or was lost.
    pub(crate) fn io(message: impl Into<String>) -> Self {
        Self { code: 3, message: message.into() }
    }
}

impl From<sidestep_bus::NodeError> for Failure {
    fn from(error: sidestep_bus::NodeError) -> Self {
        Self { code: error.exit_code(), message: error.to_string() }
    }
}

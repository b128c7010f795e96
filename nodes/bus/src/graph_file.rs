//! What a node reads in the resolved graph file: in a run, and when a recording of it is run again.

use crate::error::NodeError;
use serde::de::DeserializeOwned;
use sidestep_msgs::Winner;

/// A resolved graph file.
#[derive(Debug, Clone)]
pub struct GraphFile(toml::Table);

impl GraphFile {
    /// Parses the text of the file called `name`.
    ///
    /// # Errors
    /// [`NodeError::Configuration`] with line and column.
    pub fn parse(name: &str, text: &str) -> Result<Self, NodeError> {
        let table = text.parse();
        table.map(Self).map_err(|error| NodeError::Configuration(format!("graph file {name}: {error}")))
    }

    /// The table `nodes.NAME.config`.
    ///
    /// # Errors
    /// [`NodeError::Configuration`] with the key and what is allowed.
    pub fn config<C: DeserializeOwned>(&self, node: &str) -> Result<C, NodeError> {
        let config =
            self.0.get("nodes").and_then(|nodes| nodes.get(node)).and_then(|node| node.get("config"));
        let config = config.cloned().unwrap_or_else(|| toml::Value::Table(toml::Table::new()));
        config
            .try_into()
            .map_err(|error| NodeError::Configuration(format!("graph file: nodes.{node}.config: {error}")))
    }

    /// The lead: policy, expert, solved or refined.
    #[must_use]
    pub fn lead(&self) -> &str {
        self.text("lead").unwrap_or("policy")
    }

    /// The proposer whose command drives under the lead: all leads but `policy` are the expert node's.
    #[must_use]
    pub fn lead_winner(&self) -> Winner {
        if self.lead() == "policy" { Winner::Policy } else { Winner::Expert }
    }

    /// A top-level text, such as `resume`.
    #[must_use]
    pub fn text(&self, key: &str) -> Option<&str> {
        self.0.get(key).and_then(toml::Value::as_str)
    }

    /// Whether the graph has a node of this name.
    #[must_use]
    pub fn has_node(&self, name: &str) -> bool {
        let has = |kind| self.0.get(kind).and_then(|nodes| nodes.get(name)).is_some();
        has("nodes") || has("external")
    }

    /// `[s]` a node's latency budget, if it has one.
    #[must_use]
    pub fn budget_s(&self, node: &str) -> Option<f64> {
        let budget = self.0.get("budgets_ms").and_then(|budgets| budgets.get(node));
        budget.and_then(toml::Value::as_float).map(|ms| ms * 1e-3)
    }
}

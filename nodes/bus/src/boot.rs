//! What the launcher tells a node at its start.

use crate::domain::DomainName;
use crate::error::NodeError;
use crate::graph_file::GraphFile;
use serde::de::DeserializeOwned;
use sidestep_msgs::{Robot, Winner};
use std::path::PathBuf;

/// Names of the environment variables through which the launcher speaks to a node, in any language.
pub mod environment {
    /// Prefix of every shared-memory object of the run.
    pub const DOMAIN: &str = "SIDESTEP_DOMAIN";
    /// Folder of the run.
    pub const ROOT: &str = "SIDESTEP_ROOT";
    /// Number of the run.
    pub const RUN: &str = "SIDESTEP_RUN";
    /// Name of the node.
    pub const NODE: &str = "SIDESTEP_NODE";
    /// Restarts of the node so far.
    pub const INCARNATION: &str = "SIDESTEP_INCARNATION";
    /// The resolved graph file.
    pub const GRAPH: &str = "SIDESTEP_GRAPH";
    /// The robot file.
    pub const ROBOT: &str = "SIDESTEP_ROBOT";
}

/// A node's place in the run.
#[derive(Debug, Clone)]
pub struct Boot {
    /// Name of the node.
    pub node: String,
    /// Domain of the run.
    pub domain: DomainName,
    /// Number of the run.
    pub run: u64,
    /// Restarts of this node so far.
    pub incarnation: u32,
    graph: PathBuf,
    robot: PathBuf,
}

fn variable(name: &'static str, needed: &'static str) -> Result<String, NodeError> {
    std::env::var(name).map_err(|_| NodeError::Environment {
        variable: name,
        found: "not set".into(),
        needed,
    })
}

fn number<T: std::str::FromStr>(name: &'static str) -> Result<T, NodeError> {
    let text = variable(name, "a number")?;
    text.parse().map_err(|_| NodeError::Environment { variable: name, found: text, needed: "a number" })
}

impl Boot {
    /// Reads the environment that the launcher gave.
    ///
    /// # Errors
    /// [`NodeError::Environment`] with the variable that is missing or wrong.
    pub fn from_environment(node: &str) -> Result<Self, NodeError> {
        let prefix = variable(environment::DOMAIN, "the prefix of the run")?;
        let root = PathBuf::from(variable(environment::ROOT, "the folder of the run")?);
        Ok(Self {
            node: node.into(),
            domain: DomainName { prefix, root },
            run: number(environment::RUN)?,
            incarnation: number(environment::INCARNATION)?,
            graph: variable(environment::GRAPH, "the graph file")?.into(),
            robot: variable(environment::ROBOT, "the robot file")?.into(),
        })
    }

    fn read(path: &PathBuf) -> Result<String, NodeError> {
        std::fs::read_to_string(path).map_err(|source| NodeError::File {
            path: path.display().to_string(),
            source,
            remedy: "the launcher writes it at the start of a run",
        })
    }

    fn graph(&self) -> Result<GraphFile, NodeError> {
        GraphFile::parse(&self.graph.display().to_string(), &Self::read(&self.graph)?)
    }

    /// The node's own table `nodes.NAME.config` of the graph file.
    ///
    /// # Errors
    /// [`NodeError::File`], or [`NodeError::Configuration`] with the key and what is allowed.
    pub fn config<C: DeserializeOwned>(&self) -> Result<C, NodeError> {
        self.graph()?.config(&self.node)
    }

    /// As [`GraphFile::lead`].
    ///
    /// # Errors
    /// [`NodeError::File`] or [`NodeError::Configuration`].
    pub fn lead(&self) -> Result<String, NodeError> {
        Ok(self.graph()?.lead().to_owned())
    }

    /// As [`GraphFile::lead_winner`].
    ///
    /// # Errors
    /// As [`Boot::lead`].
    pub fn lead_winner(&self) -> Result<Winner, NodeError> {
        Ok(self.graph()?.lead_winner())
    }

    /// As [`GraphFile::text`].
    ///
    /// # Errors
    /// [`NodeError::File`] or [`NodeError::Configuration`].
    pub fn graph_text(&self, key: &str) -> Result<Option<String>, NodeError> {
        Ok(self.graph()?.text(key).map(str::to_owned))
    }

    /// Whether graph time moves only when the driver says so: `time = "lockstep"` in the graph file.
    ///
    /// # Errors
    /// [`NodeError::File`] or [`NodeError::Configuration`].
    pub fn is_lockstep(&self) -> Result<bool, NodeError> {
        Ok(self.graph()?.text("time") == Some("lockstep"))
    }

    /// As [`GraphFile::has_node`].
    ///
    /// # Errors
    /// [`NodeError::File`] or [`NodeError::Configuration`].
    pub fn has_node(&self, name: &str) -> Result<bool, NodeError> {
        Ok(self.graph()?.has_node(name))
    }

    /// `[s]` the node's latency budget of the graph file, if it has one.
    ///
    /// # Errors
    /// [`NodeError::File`] or [`NodeError::Configuration`].
    pub fn budget_s(&self) -> Result<Option<f64>, NodeError> {
        Ok(self.graph()?.budget_s(&self.node))
    }

    /// The robot.
    ///
    /// # Errors
    /// [`NodeError::File`], or [`NodeError::Configuration`] with key, found and needed.
    pub fn robot(&self) -> Result<Robot, NodeError> {
        let text = Self::read(&self.robot)?;
        Robot::from_toml(&self.robot.display().to_string(), &text)
            .map_err(|error| NodeError::Configuration(error.to_string()))
    }
}

//! What the nodes of a replay are made of: the files within the recording, or others on purpose.

use crate::error::ReplayError;
use sidestep_bus::GraphFile;
use sidestep_msgs::Robot;
use sidestep_player::{Info, attachment};
use std::path::Path;

/// The files that a recording carries of its run.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The resolved graph file.
    pub graph: String,
    /// The robot file.
    pub robot: String,
    /// Name and hash of the model, where the graph had a policy.
    pub model: Option<(String, String)>,
    /// The model, where the binary did not hold it.
    pub onnx: Option<Vec<u8>>,
    /// Machines of one class compute the same bytes.
    pub kernel_class: String,
}

fn text(path: &Path, info: &Info, name: &'static str) -> Result<String, ReplayError> {
    if !info.attachments.contains_key(name) {
        let remedy = "replay a drive that `sidestep run` recorded; an import or a bag has sensors only: `sidestep play` it";
        return Err(ReplayError::Missing { path: path.to_path_buf(), what: name, remedy });
    }
    Ok(String::from_utf8_lossy(&attachment(path, name)?).into_owned())
}

/// The text after `key = "` up to the next quote.
fn quoted(text: &str, key: &str) -> String {
    let after = text.split_once(&format!("{key} = \"")).map_or("", |(_, after)| after);
    after.split_once('"').map_or("", |(value, _)| value).to_owned()
}

impl Origin {
    /// Reads them.
    ///
    /// # Errors
    /// [`ReplayError::Player`], or [`ReplayError::Missing`] for a file that no run recorded.
    pub fn read(path: &Path) -> Result<Self, ReplayError> {
        let info = Info::read(path)?;
        let model = text(path, &info, "model.toml").ok();
        let onnx = info.attachments.contains_key("model.onnx").then(|| attachment(path, "model.onnx"));
        let about = info.metadata.get(sidestep_msgs::ORIGIN_RECORD);
        Ok(Self {
            graph: text(path, &info, "graph.toml")?,
            robot: text(path, &info, "robot.toml")?,
            model: model.map(|text| (quoted(&text, "model"), quoted(&text, "hash"))),
            onnx: onnx.transpose()?,
            kernel_class: about.and_then(|about| about.get("kernel_class")).cloned().unwrap_or_default(),
        })
    }

    /// The model that drove.
    ///
    /// # Errors
    /// [`ReplayError::Model`] where it is neither within nor the embedded one.
    pub fn model_bytes(&self, path: &Path) -> Result<Vec<u8>, ReplayError> {
        if let Some(onnx) = &self.onnx {
            return Ok(onnx.clone());
        }
        let embedded = sidestep_policy::embedded();
        let held = format!("{:016x}", sidestep_policy::fingerprint(embedded));
        match &self.model {
            Some((name, found)) if *found != held => {
                let (name, found) = (name.clone(), found.clone());
                Err(ReplayError::Model { path: path.to_path_buf(), name, found, held })
            }
            _ => Ok(embedded.to_vec()),
        }
    }
}

/// What to replay with.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The graph file.
    pub graph: GraphFile,
    /// The robot.
    pub robot: Robot,
    /// The policy model.
    pub onnx: Vec<u8>,
    /// What messages about the model call it.
    pub model_name: String,
    /// Whether anything differs from the recording on purpose: nodes then take changed inputs, and nothing is a failure.
    pub changed: bool,
    /// The lead of the recording, which may differ from that of the graph.
    pub recorded_lead: String,
}

//! What a recording says of itself: robot, weights of the expert, who led, which model.

use crate::error::CompareError;
use serde::Serialize;
use sidestep_expert::Weights;
use sidestep_msgs::Robot;
use sidestep_player::{Info, attachment};
use std::path::{Path, PathBuf};

/// A recording, before its messages are read.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub(crate) path: PathBuf,
    pub(crate) robot: Robot,
    pub(crate) weights: Weights,
    pub(crate) origin: Origin,
}

/// A recording in a few words.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Origin {
    /// Name of the file.
    pub file: String,
    /// `[byte]` its size.
    pub size_bytes: u64,
    /// `[s]` graph time from its first to its last frame or command.
    pub duration_s: f64,
    /// Where and why it ends early, if it does.
    pub damage: Option<String>,
    /// Messages that the recorder lost, all topics.
    pub lost: u64,
    /// Name of the robot.
    pub robot: String,
    /// Who led.
    pub lead: String,
    /// The policy's model.
    pub model: String,
    /// How hard the expert thought.
    pub expert: String,
    /// The version that recorded it.
    pub version: String,
}

impl Source {
    pub(crate) fn open(path: &Path) -> Result<Self, CompareError> {
        let info = Info::read(path)?;
        let foreign =
            !info.channels.iter().any(|channel| sidestep_msgs::topic_named(&channel.topic).is_some());
        if foreign {
            // The stream of messages knows how to say what was found instead.
            if let Some(Err(error)) = sidestep_player::Messages::open(path)?.next() {
                return Err(error.into());
            }
        }
        let unfit = |file, detail: String| CompareError::Origin { path: path.to_path_buf(), file, detail };
        let text = |name: &'static str| -> Result<Option<String>, CompareError> {
            if !info.attachments.contains_key(name) {
                return Ok(None);
            }
            Ok(Some(String::from_utf8_lossy(&attachment(path, name)?).into_owned()))
        };
        let robot = text("robot.toml")?.ok_or_else(|| unfit("robot.toml", "is not in it".into()))?;
        let robot = Robot::from_toml("robot.toml", &robot)
            .map_err(|error| unfit("robot.toml", format!("cannot be read ({error})")))?;
        let table = |name: &'static str, text: Option<String>| {
            toml::from_str::<toml::Table>(&text.unwrap_or_default())
                .map_err(|error| unfit(name, format!("cannot be read ({error})")))
        };
        let (graph, model) =
            (table("graph.toml", text("graph.toml")?)?, table("model.toml", text("model.toml")?)?);
        let word = |table: &toml::Table, key: &str| {
            table.get(key).and_then(toml::Value::as_str).unwrap_or("unknown").to_owned()
        };
        let expert = ["nodes", "expert", "config"]
            .iter()
            .try_fold(&graph, |table, key| table.get(*key).and_then(toml::Value::as_table));
        let weights = expert.and_then(|config| config.get("weights").cloned());
        // Without a graph file the weights of the shipped one are the best guess; labels have them too.
        let weights = weights
            .map_or(Ok(Weights::STANDARD), toml::Value::try_into)
            .map_err(|error: toml::de::Error| unfit("graph.toml", format!("has unfit weights ({error})")))?;
        let lead = word(&graph, "lead");
        let mode = expert.map_or_else(|| "unknown".into(), |config| word(config, "mode"));
        let origin = Origin {
            file: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            size_bytes: info.size_bytes,
            duration_s: info.duration_s,
            damage: info.damage.clone(),
            lost: info.lost().values().sum(),
            robot: robot.name.clone(),
            expert: if ["solved", "refined"].contains(&lead.as_str()) { lead.clone() } else { mode },
            lead,
            model: word(&model, "model"),
            version: info
                .metadata
                .get("sidestep")
                .and_then(|own| own.get("version"))
                .cloned()
                .unwrap_or_default(),
        };
        Ok(Self { path: path.to_path_buf(), robot, weights, origin })
    }
}

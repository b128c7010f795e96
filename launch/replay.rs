//! `sidestep replay`: the nodes of a recording again, byte for byte or changed on purpose.

use crate::failure::Failure;
use crate::manifest::{robot_named, with_settings};
use clap::Args;
use sidestep_bus::{GraphFile, host_ns};
use sidestep_msgs::Robot;
use sidestep_replay::{Origin, ReplayError, Settings, replay};
use std::path::PathBuf;

/// What to replay, and what to change.
#[derive(Debug, Args)]
pub(crate) struct ReplayArguments {
    /// An .mcap or .mcap.active file of a drive.
    file: PathBuf,
    /// Another policy model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Another robot: built-in name or path.
    #[arg(long)]
    robot: Option<String>,
    /// Another lead: policy, expert, solved or refined.
    #[arg(long, value_parser = ["policy", "expert", "solved", "refined"])]
    lead: Option<String>,
    /// Changes a value of the recorded graph file: NODE.KEY=VALUE.
    #[arg(long = "set", value_name = "NODE.KEY=VALUE")]
    settings: Vec<String>,
    /// Writes the report as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn failure(error: &ReplayError) -> Failure {
    match error {
        ReplayError::Refused(_) | ReplayError::Model { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

impl ReplayArguments {
    /// What differs from the recording on purpose, as it was asked for.
    fn changes(&self) -> String {
        let mut changes: Vec<_> = self.settings.iter().map(|setting| format!("--set {setting}")).collect();
        changes.extend(self.lead.iter().map(|lead| format!("--lead {lead}")));
        changes.extend(self.robot.iter().map(|robot| format!("--robot {robot}")));
        changes.extend(self.model.iter().map(|model| format!("--model {}", model.display())));
        changes.join(" ")
    }

    fn settings(&self, origin: &Origin) -> Result<Settings, Failure> {
        let recorded = GraphFile::parse("of the recording", &origin.graph)?;
        let mut changes = self.settings.clone();
        changes.extend(self.lead.iter().map(|lead| format!("lead=\"{lead}\"")));
        let graph = with_settings("of the recording", &origin.graph, &changes)?;
        let robot = match &self.robot {
            Some(name) => robot_named(name)?.0,
            None => Robot::from_toml("robot.toml of the recording", &origin.robot)
                .map_err(|error| Failure::usage(error.to_string()))?,
        };
        let onnx = match &self.model {
            Some(path) => std::fs::read(path).map_err(|error| {
                Failure::usage(format!("model {}: {error}; name an ONNX file", path.display()))
            })?,
            None => origin.model_bytes(&self.file).map_err(|error| failure(&error))?,
        };
        Ok(Settings {
            graph: GraphFile::parse("of the recording", &graph)?,
            robot,
            onnx,
            model_name: self
                .model
                .as_ref()
                .map_or("of the recording".into(), |path| path.display().to_string()),
            changed: !changes.is_empty() || self.robot.is_some() || self.model.is_some(),
            recorded_lead: recorded.lead().to_owned(),
        })
    }
}

/// Replays a recording and says what differs.
///
/// # Errors
/// Exit code 1 where an output differs and nothing was changed on purpose, 2 for a model, robot or setting that does not
/// fit, 3 for a recording that cannot be replayed.
pub(crate) fn run(arguments: &ReplayArguments) -> Result<(), Failure> {
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    let origin = Origin::read(&arguments.file).map_err(|error| failure(&error))?;
    let settings = arguments.settings(&origin)?;
    let begun_ns = host_ns();
    let report = replay(&arguments.file, &settings).map_err(|error| failure(&error))?;
    let spent_s = (host_ns() - begun_ns) as f64 * 1e-9;
    if settings.changed {
        crate::output::line(&format!("changed on purpose: {}", arguments.changes()));
    }
    crate::output::line(report.text().trim_end());
    let rate = report.recorded_s / spent_s.max(1e-9);
    crate::output::line(&format!("replayed in {spent_s:.2} s, {rate:.1} times real time"));
    let class = sidestep_recorder::kernel_class();
    if origin.kernel_class != class {
        let recorded = &origin.kernel_class;
        crate::output::line(&format!(
            "recorded on a machine of kernel class {recorded:?}, this one is {class:?}: the policy may differ in last bits"
        ));
    }
    if let Some(path) = &arguments.json {
        let mut value = serde_json::to_value(&report).unwrap_or_default();
        value["times_real_time"] = rate.into();
        value["changed"] = settings.changed.then(|| arguments.changes()).into();
        crate::output::json(path, &value)?;
    }
    if report.compared() == 0 {
        let why = "no step could be compared; a file replays from its first state record on, which comes within 10 s";
        return Err(Failure::unmet(why));
    }
    if settings.changed || report.differing() == 0 {
        return Ok(());
    }
    let what =
        format!("{} steps or states differ from the recording; the first stands above", report.differing());
    Err(Failure::unmet(what))
}

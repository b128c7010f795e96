//! What a dataset holds, drawn: some of its samples with both labels.

use crate::error::EvaluateError;
use crate::plots::{Frame, named};
use serde_json::json;
use sidestep_expert::{Judge, Weights};
use sidestep_msgs::Robot;
use sidestep_report::{Figure, Ink, Report};
use sidestep_train::{Dataset, PARTLY_UNKNOWN, Record};
use std::path::Path;

/// Draws `count` samples of a dataset, evenly spread over the file.
///
/// # Errors
/// [`EvaluateError`] where the file is no dataset of the robot.
pub fn samples_report(path: &Path, robot: &Robot, count: u64) -> Result<Report, EvaluateError> {
    let data = Dataset::open(path)?;
    data.require(robot)?;
    let header = data.header();
    let subtitle = format!(
        "{} records, {} of them made-up maps, seed {}, content {:016x}",
        header.count, header.by_source[0], header.seed, header.content_hash
    );
    let numbers = json!({ "records": header.count, "by_source": header.by_source, "seed": header.seed });
    let mut report = Report::new(&format!("Samples of {}", path.display()), &subtitle, numbers);
    let shown = count.clamp(1, header.count);
    let figures: Result<Vec<Figure>, EvaluateError> = (0..shown)
        .map(|number| {
            let index = number * header.count / shown;
            Ok(sample(index, &data.read(index)?, robot)?)
        })
        .collect();
    report.figures(&figures?, 3);
    Ok(report)
}

fn sample(index: u64, record: &Record, robot: &Robot) -> Result<Figure, sidestep_report::ReportError> {
    let mut judge = Judge::new(&robot.limits, &Weights::STANDARD, 734);
    let plan = judge.solve(&record.planning_cost, usize::from(record.goal_cell), record.twist());
    let way = judge.trajectory(&plan).map(|pose| (pose.x_m, pose.y_m));
    let kind = kind_name(record.kind);
    Frame {
        title: format!("{index}: {kind}"),
        subtitle: format!(
            "world {}, step {}, {}",
            record.world,
            record.stream,
            named("from", record.velocity)
        ),
        cost: &record.planning_cost,
        partly_unknown: record.kind & PARTLY_UNKNOWN != 0,
        goal_cell: record.goal_cell,
        way_m: std::iter::once((0.0, 0.0)).chain(way).collect(),
        wishes: vec![
            ("solved", Ink::Vermilion, record.label_solved),
            ("734 candidates", Ink::Green, record.label_734),
        ],
    }
    .figure(robot)
}

/// The name of a kind of world, as [`Record::kind`] has it.
fn kind_name(kind: u8) -> &'static str {
    match kind & !PARTLY_UNKNOWN {
        0 => "clusters",
        1 => "corridor drawn",
        2 => "door drawn",
        3 => "close wall drawn",
        4 => "recording",
        8 => "office",
        9 => "corridor",
        10 => "room",
        11 => "named world",
        _ => "kind unknown to this build",
    }
}

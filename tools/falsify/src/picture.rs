//! A case from above: what stands there, the robot's way, and its outline now and then.

use crate::error::FalsifyError;
use crate::evaluation::{Evaluator, Trace};
use crate::genes::Case;
use crate::thing::footprint;
use sidestep_msgs::Robot;
use sidestep_report::{Axis, Cloud, Figure, Ink, Scatter};
use sidestep_sim::{Outline, Solid};

/// Ticks between two outlines.
const OUTLINE_TICKS: usize = 25;
/// `[m]` shown round the way.
const ROUND_M: f64 = 0.8;

fn cloud(name: &str, ink: Ink, points: Vec<(f64, f64)>) -> Cloud {
    Cloud { name: name.into(), ink, points, joined: true }
}

/// The edge of a solid, closed.
fn edge(solid: &Solid) -> Vec<(f64, f64)> {
    match solid.outline {
        Outline::Disc { radius_m } => (0..=24)
            .map(|part| {
                let (sin, cos) = libm::sincos(f64::from(part) * std::f64::consts::TAU / 24.0);
                (solid.x_m + radius_m * cos, solid.y_m + radius_m * sin)
            })
            .collect(),
        Outline::Rectangle { .. } => {
            let corners = solid.corners();
            corners.iter().chain(&corners[..1]).map(|corner| (corner[0], corner[1])).collect()
        }
    }
}

/// Draws a case.
///
/// # Errors
/// The arbiter refuses the robot.
pub fn picture(case: &Case, robot: &Robot) -> Result<Figure, FalsifyError> {
    let mut evaluator = Evaluator::new(robot)?;
    let mut traces: Vec<Trace> = Vec::new();
    let outcome = evaluator.evaluate(case, &mut |trace| traces.push(*trace))?;
    let things = evaluator.scenario(case).things;
    let end_s = traces.last().map_or(0.0, |trace| trace.time_s);
    let mut clouds = Vec::new();
    for (number, thing) in things.0.iter().enumerate() {
        let name = match (thing.exists, thing.seen) {
            (true, true) => format!("{number}: obstacle"),
            (true, false) => format!("{number}: obstacle nobody saw"),
            (false, true) => format!("{number}: mark only"),
            (false, false) => format!("{number}: unseen floor"),
        };
        let ink = if thing.exists { Ink::Text } else { Ink::Grey };
        clouds.push(cloud(&name, ink, edge(&thing.at(end_s))));
    }
    let mut polygon = Vec::new();
    for (index, trace) in traces.iter().enumerate() {
        if index % OUTLINE_TICKS == 0 || index + 1 == traces.len() {
            footprint(robot, &trace.pose, &mut polygon);
            let points = polygon.iter().chain(&polygon[..1]).map(|corner| (corner[0], corner[1])).collect();
            let last = index + 1 == traces.len();
            clouds.push(cloud(
                if last { "at the end" } else { "" },
                if last { Ink::Vermilion } else { Ink::Sky },
                points,
            ));
        }
    }
    let way: Vec<(f64, f64)> = traces.iter().map(|trace| (trace.pose.x_m, trace.pose.y_m)).collect();
    let over = |along: fn(&(f64, f64)) -> f64| {
        let least = way.iter().map(along).fold(0.0, f64::min);
        let most = way.iter().map(along).fold(0.0, f64::max);
        (least - ROUND_M, most + ROUND_M)
    };
    let ((left, right), (low, high)) = (over(|point| point.0), over(|point| point.1));
    clouds.push(cloud("way", Ink::Blue, way));
    let title = format!("{}: {:.4} m", Case::label(case.relaxed), outcome.robustness_m);
    let (x, y) = (Axis::new("x", "m").over(left, right), Axis::new("y", "m").over(low, high));
    Ok(Scatter { title, x, y, clouds, guide: None, equal: true }.figure())
}

//! Figures of worlds from above, of maps, and of what a camera saw.

use crate::beside::Beside;
use crate::corridor::{CORRIDOR_M, Corridor, TRAININGS};
use crate::sudden::{Sudden, View};
use crate::suite::Failure;
use sidestep_drive::Lead;
use sidestep_msgs::Robot;
use sidestep_report::{
    Axis, Cells, Cloud, Figure, Ink, MapPicture, Overlay, Picture, ReportError, Scatter, Shade,
};
use sidestep_sim::World;

/// `[m]` between the dots that fill an obstacle.
const DOT_M: f64 = 0.03;
/// `[m]` what is farther is drawn as dark as this.
const FAR_M: f32 = 3.5;
/// Width of a depth picture in its figure, near that of the map beside it.
const DEPTH_WIDTH: f64 = 330.0;

/// Inks of the leads.
pub(crate) fn ink(lead: Lead) -> Ink {
    match lead {
        Lead::Policy => Ink::Orange,
        Lead::Expert => Ink::Vermilion,
        Lead::Solved => Ink::Blue,
        Lead::Refined => Ink::Green,
    }
}

fn pairs(points_m: &[[f64; 2]]) -> Vec<(f64, f64)> {
    points_m.iter().map(|point| (point[0], point[1])).collect()
}

/// Whatever stands on a floor between the origin and `size_m`, as dots.
fn obstacles(world: &World, size_m: [f64; 2]) -> Cloud {
    let mut points = Vec::new();
    let [columns, rows] = size_m.map(|side| (side / DOT_M) as usize);
    for place in 0..=columns * rows {
        let point = [(place % columns) as f64 * DOT_M, (place / columns) as f64 * DOT_M];
        if world.solids.iter().any(|solid| solid.distance_m(point) < 0.5 * DOT_M) {
            points.push((point[0], point[1]));
        }
    }
    Cloud { name: "obstacles".into(), ink: Ink::Grey, points, joined: false }
}

fn line(name: &str, ink: Ink, points_m: &[[f64; 2]]) -> Cloud {
    Cloud { name: name.into(), ink, points: pairs(points_m), joined: true }
}

fn above(title: &str, size_m: [f64; 2], clouds: Vec<Cloud>) -> Scatter {
    let axis = |label: &str, side: f64| Axis::new(label, "m").over(0.0, side);
    let (x, y) = (axis("x", size_m[0]), axis("y", size_m[1]));
    Scatter { title: title.into(), x, y, clouds, guide: None, equal: true }
}

/// Fig. 7: the reference path and everybody's way.
pub(crate) fn side_by_side(beside: &Beside) -> Figure {
    let mut clouds = vec![obstacles(&beside.world, [9.0, 5.0])];
    clouds.push(line("reference", Ink::Text, &beside.reference_m));
    let ways = beside.drives.iter().rev();
    clouds.extend(ways.map(|drive| line(drive.lead.label(), ink(drive.lead), &drive.trace_m)));
    above(&beside.name, [9.0, 5.0], clouds).figure()
}

/// A course that was not reached: the way, and where it ended.
pub(crate) fn failed(failure: &Failure, size_m: [f64; 2]) -> Figure {
    let world = &failure.whole.world;
    let path: Vec<[f64; 2]> = world.legs_m.iter().flatten().copied().collect();
    let clouds = vec![
        obstacles(world, size_m),
        line("reference", Ink::Text, &path),
        line("way", Ink::Orange, &failure.trace_m),
        Cloud {
            name: "end".into(),
            ink: Ink::Purple,
            points: vec![(failure.at_m[0], failure.at_m[1])],
            joined: false,
        },
    ];
    above(&format!("{} ({})", failure.course, failure.grade), size_m, clouds).figure()
}

/// Fig. 9: the ways of both models without an arbiter, and where someone had to intervene.
pub(crate) fn patrols(corridor: &Corridor) -> Figure {
    let mut clouds = vec![obstacles(&corridor.world, CORRIDOR_M)];
    clouds.push(line("reference", Ink::Text, &corridor.world.legs_m[0]));
    let inks = [Ink::Vermilion, Ink::Blue];
    for (drive, (name, ink)) in corridor.alone.iter().zip(TRAININGS.iter().zip(inks)) {
        clouds.push(line(name, ink, &drive.trace_m));
    }
    for (drive, (name, ink)) in corridor.alone.iter().zip(TRAININGS.iter().zip(inks)) {
        if !drive.interventions_m.is_empty() {
            let name = format!("put back, {name}");
            clouds.push(Cloud { name, ink, points: pairs(&drive.interventions_m), joined: false });
        }
    }
    above(&format!("Seed {}", corridor.seed), CORRIDOR_M, clouds).figure()
}

/// Fig. 8: the map with the command, and the camera's view.
pub(crate) fn reaction(sudden: &Sudden, robot: &Robot) -> Result<[Figure; 2], ReportError> {
    let view = &sudden.view;
    let shades = view.cells.iter().map(|cell| cell.map_or(Shade::Unknown, Shade::Filled)).collect();
    let cells = Cells::local(shades);
    let overlays = vec![
        Overlay::outline(&robot.footprint.polygon_m),
        Overlay::Line(view.path_m.clone(), Ink::Text, true),
        Overlay::velocity(sudden.velocity, Ink::Blue, 6.0),
        Overlay::velocity(sudden.command, Ink::Vermilion, 3.0),
    ];
    let says = |name: &str, [v, w]: [f32; 2]| format!("{name}: {v:.2} m/s, {w:+.2} rad/s");
    let notes = vec![
        (Ink::Vermilion, says("action command", sudden.command)),
        (Ink::Blue, says("latest velocity", sudden.velocity)),
        (Ink::Grey, says("without it", sudden.command_without)),
    ];
    let subtitle =
        sudden.reaction_s.map_or("no reaction".into(), |after| format!("{after:.2} s after it appeared"));
    let map = MapPicture { title: sudden.name.into(), subtitle, cells, overlays, notes }.figure()?;
    Ok([map, seen(view)?])
}

/// A depth image: near is light, not measured is blue.
fn seen(view: &View) -> Result<Figure, ReportError> {
    let colour = |depth_m: &f32| {
        if *depth_m <= 0.0 {
            return [62, 78, 110, 255];
        }
        let light = (250.0 - 220.0 * (depth_m / FAR_M).min(1.0)) as u8;
        [light, light, light, 255]
    };
    let rgba = view.depth_m.iter().flat_map(colour).collect();
    let [width, height] = view.size;
    Picture { title: "Depth camera".into(), width, height, rgba, shown_width: DEPTH_WIDTH }.figure()
}

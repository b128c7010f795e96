//! Draws a drive of each lead through the office from above: `cargo run --release -p sidestep-drive --example picture > FILE.svg`.
#![allow(clippy::print_stdout, reason = "the picture is the output")]

use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{Robot, Winner};
use sidestep_policy::Policy;
use sidestep_sim::{Outline, World};
use std::error::Error;
use std::fmt::Write;

/// `[m]` of the world to pixels.
const SCALE: f64 = 60.0;
/// `[s]` length of each drive.
const DRIVE_S: f64 = 60.0;
/// Seed of the office.
const SEED: u64 = 1;

/// A corner of a world in the picture's pixels, y up turned to y down.
fn place(x_m: f64, y_m: f64, corner_m: [f64; 2]) -> (f64, f64) {
    ((x_m - corner_m[0]) * SCALE, (corner_m[1] - y_m) * SCALE)
}

fn main() -> Result<(), Box<dyn Error>> {
    let robot = Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml"))?;
    let world = World::named("office", SEED)?;
    let bounds = world.solids.iter().flat_map(sidestep_sim::Solid::corners);
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for corner in bounds {
        for axis in 0..2 {
            low[axis] = low[axis].min(corner[axis] - 0.1);
            high[axis] = high[axis].max(corner[axis] + 0.1);
        }
    }
    let corner_m = [low[0], high[1]];
    let (width, height) = ((high[0] - low[0]) * SCALE, (high[1] - low[1]) * SCALE);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {:.0}\" font-family=\"sans-serif\" font-size=\"15\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fbfaf7\"/>\n",
        height + 30.0
    );
    for solid in &world.solids {
        let fill = if solid.bottom_m > 0.3 { "#e4d8c4" } else { "#5b6470" };
        if let Outline::Disc { radius_m } = solid.outline {
            let (x, y) = place(solid.x_m, solid.y_m, corner_m);
            writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\" fill=\"{fill}\"/>",
                radius_m * SCALE
            )?;
        } else {
            let corners = solid.corners().map(|[x_m, y_m]| place(x_m, y_m, corner_m));
            let points: Vec<_> = corners.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
            writeln!(svg, "<polygon points=\"{}\" fill=\"{fill}\"/>", points.join(" "))?;
        }
    }
    for (row, (lead, colour)) in
        [(Winner::Expert, "#c2452d"), (Winner::Policy, "#2667b0")].into_iter().enumerate()
    {
        let mut setup = Setup::shipped(robot.clone(), world.clone(), lead);
        setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &robot)?);
        let mut drive = Drive::new(setup)?;
        let outcome = drive.run(u32::MAX, DRIVE_S);
        let points: Vec<_> =
            outcome.trace.iter().map(|point| place(point.pose.x_m, point.pose.y_m, corner_m)).collect();
        let line: Vec<_> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let style = "fill=\"none\" stroke-width=\"3\" stroke-linejoin=\"round\" opacity=\"0.85\"";
        writeln!(svg, "<polyline points=\"{}\" {style} stroke=\"{colour}\"/>", line.join(" "))?;
        let name = if lead == Winner::Policy { "policy" } else { "expert" };
        writeln!(
            svg,
            "<text x=\"{:.0}\" y=\"{:.0}\" fill=\"{colour}\">{name}: {:.1} m in {DRIVE_S:.0} s, {} goals, {} contacts</text>",
            10.0 + row as f64 * width / 2.0,
            height + 20.0,
            outcome.distance_m,
            outcome.arrivals,
            outcome.collisions
        )?;
    }
    println!("{svg}</svg>");
    Ok(())
}

//! Drives rooms at map level and prints shares and failures: `cargo run --release -p sidestep-navigate --example rooms
//! [ROOMS] [SEED] [LEADS] [on|off|both] [grid|camera]`.
#![allow(clippy::print_stdout, missing_docs, reason = "an example prints")]

use sidestep_drive::{Lead, Sight};
use sidestep_msgs::Robot;
use sidestep_navigate::{SuiteOptions, rooms};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given: Vec<String> = std::env::args().collect();
    let text = |index: usize, standard: &'static str| given.get(index).map_or(standard, String::as_str);
    let leads: Vec<Lead> = Lead::ALL
        .into_iter()
        .filter(|lead| text(3, "policy,expert,solved,refined").contains(lead.label()))
        .collect();
    let arbitrated = match text(4, "both") {
        "on" => vec![true],
        "off" => vec![false],
        _ => vec![true, false],
    };
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch/robots/loomo.toml");
    let robot = Robot::from_toml(path, &std::fs::read_to_string(path)?)?;
    let options = SuiteOptions {
        robot: &robot,
        model: sidestep_policy::embedded(),
        model_name: "embedded",
        leads,
        arbitrated,
        sight: if text(5, "grid") == "camera" { Sight::Camera } else { Sight::Grid },
        limit_s: 60.0,
        threads: 2,
    };
    let suite =
        rooms(&options, text(2, "1").parse()?, text(1, "20").parse()?, &mut |line| println!("{line}"))?;
    println!(
        "straight line blocked: {}; path blocked: {}",
        suite.straight_blocked.text(),
        suite.path_blocked.text()
    );
    for group in &suite.groups {
        println!(
            "{} arbiter {}: reached {}, contact {}, {:.1} s, {:.2} m, {:.2} m/s, standing {:.2} s, {:.2} stops, clearance {:.3} (least {:.3}), J {:.3}",
            group.lead.label(),
            group.arbitrated,
            group.reached.text(),
            group.contact.text(),
            group.time_s,
            group.distance_m,
            group.speed_m_s,
            group.standing_s,
            group.stops,
            group.clearance_m,
            group.min_clearance_m,
            group.cost
        );
        for failure in &group.failures {
            println!(
                "  {} {} seed {} {:?} at {:.2} {:.2}: {}",
                failure.course,
                failure.grade,
                failure.seed,
                failure.ending,
                failure.at_m[0],
                failure.at_m[1],
                failure.summary
            );
        }
    }
    Ok(())
}

//! Drives each lead through offices of many seeds and adds up what came of it:
//! `cargo run --release -p sidestep-drive --example offices [OFFICES] [SECONDS] [AHEAD_RAD]`.
#![allow(clippy::print_stdout, reason = "the figures are the output")]

use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{Robot, Winner};
use sidestep_policy::Policy;
use sidestep_sim::World;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let offices: u64 = arguments.next().map_or(Ok(16), |text| text.parse())?;
    let drive_s: f64 = arguments.next().map_or(Ok(120.0), |text| text.parse())?;
    let ahead_rad: Option<f32> = arguments.next().map(|text| text.parse()).transpose()?;
    let robot = Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml"))?;
    for lead in [Winner::Policy, Winner::Expert] {
        let (mut goals, mut contacts, mut distance_m, mut standing_s) = (0, 0, 0.0, 0.0);
        for seed in 1..=offices {
            let mut setup = Setup::shipped(robot.clone(), World::named("office", seed)?, lead);
            (setup.sim.width_px, setup.sim.height_px, setup.sim.seed) = (320, 240, seed);
            setup.goal.ahead_rad = ahead_rad.unwrap_or(setup.goal.ahead_rad);
            setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &robot)?);
            let mut drive = Drive::new(setup)?;
            let outcome = drive.run(u32::MAX, drive_s);
            goals += outcome.arrivals;
            contacts += outcome.collisions;
            distance_m += outcome.distance_m;
            standing_s += outcome.standing_s;
        }
        println!(
            "{lead:?}: {goals} goals, {contacts} contacts, {distance_m:.0} m, {standing_s:.0} s standing in {offices} offices of {drive_s} s"
        );
    }
    Ok(())
}

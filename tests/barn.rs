//! BARN: cylinder fields with the Jackal's 270 degree scan, the whole chain in one process, the expert in the lead.

use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{Robot, Winner};
use sidestep_sim::{barn_selection, barn_worlds};
use std::path::PathBuf;

/// `[s]` time limit of the challenge.
const LIMIT_S: f64 = 100.0;

/// Every twelfth world of the data folder's sorted list, along its reference path: at least 18 of 20 arrive, none touches.
#[test]
fn the_expert_passes_the_barn_worlds_without_contact() {
    let Some(data) = std::env::var_os("SIDESTEP_DATA").map(|data| PathBuf::from(data).join("barn")) else {
        println!("skipped: SIDESTEP_DATA is not set (the_expert_passes_the_barn_worlds_without_contact)");
        return;
    };
    let robot = Robot::from_toml("jackal.toml", include_str!("../launch/robots/jackal.toml")).unwrap();
    let numbers = barn_selection(&data, 12).unwrap();
    assert_eq!(numbers.len(), 20);
    let worlds = barn_worlds(&data.join("worlds.tar.xz"), |number| numbers.contains(&number)).unwrap();
    let (mut arrived, mut touched) = (0, 0);
    for (number, world) in worlds {
        let mut drive = Drive::new(Setup::shipped(robot.clone(), world, Winner::Expert)).unwrap();
        let outcome = drive.run(1, LIMIT_S);
        println!("world {number}: {}", outcome.summary());
        arrived += outcome.arrivals;
        touched += outcome.collisions;
    }
    assert!(arrived >= 18 && touched == 0, "{arrived} of 20 arrived, {touched} contacts");
}

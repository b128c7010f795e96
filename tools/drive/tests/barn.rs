//! BARN worlds, driven by the expert with the Jackal's lidar, along the reference paths.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{Robot, Winner};
use sidestep_sim::{barn_selection, barn_worlds};

#[test]
fn the_expert_passes_the_barn_worlds() {
    let Some(data) = std::env::var_os("SIDESTEP_DATA").map(std::path::PathBuf::from) else {
        println!("skipped: SIDESTEP_DATA is not set (the_expert_passes_the_barn_worlds)");
        return;
    };
    let path = format!("{}/../../launch/robots/jackal.toml", env!("CARGO_MANIFEST_DIR"));
    let robot = Robot::from_toml(&path, &std::fs::read_to_string(&path).unwrap()).unwrap();
    let numbers = barn_selection(&data.join("barn"), 12).unwrap();
    let only: Option<u32> = std::env::var("BARN").ok().and_then(|text| text.parse().ok());
    let worlds =
        barn_worlds(&data.join("barn/worlds.tar.xz"), |n| only.map_or(numbers.contains(&n), |o| o == n))
            .unwrap();
    let (mut arrived, mut touched) = (0, 0);
    for (number, world) in worlds {
        let mut drive = Drive::new(Setup::shipped(robot.clone(), world, Winner::Expert)).unwrap();
        let outcome = drive.run(1, 100.0);
        println!("world {number}: {}", outcome.summary());
        arrived += outcome.arrivals;
        touched += outcome.collisions;
    }
    assert!(only.is_some() || arrived >= 18 && touched == 0, "{arrived} of 20 arrived, {touched} contacts");
}

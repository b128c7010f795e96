//! The expert drives, in one process.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_drive::{Drive, Setup};
use sidestep_msgs::{Robot, Winner};
use sidestep_sim::World;

fn robot(name: &str) -> Robot {
    let path = format!("{}/../../launch/robots/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Robot::from_toml(&path, &std::fs::read_to_string(&path).unwrap()).unwrap()
}

fn setup(name: &str, world: World) -> Setup {
    let mut setup = Setup::shipped(robot(name), world, Winner::Expert);
    if setup.robot.camera.is_some() {
        (setup.sim.width_px, setup.sim.height_px) = (320, 240);
    }
    setup
}

#[test]
fn the_expert_crosses_an_empty_room() {
    let mut drive = Drive::new(setup("loomo", World::room(1, 0.0))).unwrap();
    let outcome = drive.run(1, 30.0);
    println!("{}", outcome.summary());
    assert!(outcome.arrivals == 1 && outcome.collisions == 0, "{}", outcome.summary());
}

#[test]
fn the_expert_goes_round_the_office() {
    let mut drive = Drive::new(setup("loomo", World::office(1))).unwrap();
    let outcome = drive.run(5, 90.0);
    println!("{}", outcome.summary());
    assert!(outcome.arrivals == 5 && outcome.collisions == 0, "{}", outcome.summary());
}

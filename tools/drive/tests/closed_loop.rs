//! Expert and policy drive, in one process.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_arbiter::Lead;
use sidestep_drive::{Drive, Setup, Sight};
use sidestep_mapper::Mapper;
use sidestep_msgs::{
    Code, Command, DepthFrame, EstopAction, Odometry, Pose2, Reason, Robot, SAFETY_GRID, SafetyMap, Twist,
    Winner,
};
use sidestep_policy::Policy;
use sidestep_sim::{Simulator, Solid, World};

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

/// Offices whose turns lie beside furniture, a minute with each lead: nobody is boxed in for want of having looked.
#[test]
fn turns_are_driven_over_floor_that_was_seen() {
    for lead in [Winner::Policy, Winner::Expert] {
        for seed in [3, 4, 8] {
            let mut setup = setup("loomo", World::office(seed));
            setup.arbiter.lead = if lead == Winner::Policy { Lead::Policy } else { Lead::Expert };
            setup.sim.seed = seed;
            setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &setup.robot).unwrap());
            let mut drive = Drive::new(setup).unwrap();
            let outcome = drive.run(u32::MAX, 60.0);
            println!("{lead:?}, seed {seed}: {}", outcome.summary());
            let boxed_in = outcome.reasons.get(Reason::BoxedIn.label()).copied().unwrap_or(0);
            assert!(
                outcome.arrivals >= 5 && outcome.collisions == 0 && boxed_in == 0,
                "{lead:?}, seed {seed}: {}",
                outcome.summary()
            );
        }
    }
}

/// Before a wall that fills the view and is too near to be measured, the goal behind.
fn too_near() -> World {
    let mut world = World::empty();
    world.solids.push(Solid::block([0.5, 0.0], [0.2, 4.0], 0.0, [0.0, 2.0]));
    world.start = Pose2::ORIGIN;
    world.legs_m = vec![vec![[0.0, 0.0], [-2.5, 0.0]]];
    world
}

/// The wall is heard, and the robot leaves it.
#[test]
fn who_stands_too_near_to_a_wall_to_see_it_leaves() {
    let mut drive = Drive::new(setup("loomo", too_near())).unwrap();
    let outcome = drive.run(1, 30.0);
    println!("{}", outcome.summary());
    assert!(outcome.arrivals == 1 && outcome.collisions == 0, "{}", outcome.summary());
}

/// In the office, before a wall too near to see, and round and round with a wish that overrules both: whether the policy
/// always runs beside the expert that leads or only stands by, the same is commanded for the same reasons, the policy's own
/// turns included.
#[test]
fn a_policy_that_stands_by_changes_no_command() {
    let mut others = 0;
    for (world, sight, wish) in [
        (World::office(1), Sight::Noisy, None),
        (World::office(3), Sight::Grid, Some(Twist::new(1.0, 0.6))),
        (too_near(), Sight::Camera, None),
    ] {
        let [mut always, mut stands_by] = [false, true].map(|policy_stands_by| {
            let mut setup = Setup { policy_stands_by, sight, ..setup("loomo", world.clone()) };
            setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &setup.robot).unwrap());
            Drive::new(setup).unwrap()
        });
        while always.outcome().time_s < 60.0 {
            for drive in [&mut always, &mut stands_by] {
                drive.overrule(wish);
                drive.tick();
            }
            let told = |drive: &Drive| {
                let Command { twist, wish, winner, reason, limiting_cell, .. } = *drive.command();
                (twist, wish, winner, reason, limiting_cell)
            };
            assert_eq!(told(&always), told(&stands_by), "{sight:?} after {} s", always.outcome().time_s);
            others += u32::from(always.command().winner == Winner::Policy as u32);
        }
        assert_eq!(always.truth(), stands_by.truth());
    }
    assert!(others > 0, "the policy never drove");
}

/// Held on the way for five minutes of simulated time, the robot goes on to its goals: what it knew of the last metre,
/// which the camera cannot see, still counts.
#[test]
fn standing_for_five_minutes_then_driving_on_works() {
    let mut drive = Drive::new(setup("loomo", World::office(1))).unwrap();
    drive.run(u32::MAX, 5.0);
    drive.operator(EstopAction::Hold);
    drive.run(u32::MAX, 305.0);
    let held_m = drive.outcome().distance_m;
    assert!(drive.outcome().standing_s > 290.0, "{}", drive.outcome().summary());
    drive.operator(EstopAction::Resume);
    let outcome = drive.run(2, 360.0);
    println!("{}", outcome.summary());
    assert!(
        outcome.arrivals >= 2 && outcome.collisions == 0 && outcome.distance_m > held_m,
        "{}",
        outcome.summary()
    );
}

/// Creeps up to a box in front of a far wall until it is below the camera's view, with the noise of the stereo camera:
/// from where it is first marked, the face of the box stays occupied all the way.
#[test]
fn a_box_stays_occupied_until_it_is_below_the_view() {
    const FACE_M: f64 = 2.0;
    for height_m in [0.1, 0.3, 0.5] {
        let mut world = World::empty();
        world.solids.push(Solid::block([FACE_M + 0.15, 0.0], [0.3, 0.4], 0.0, [0.0, height_m]));
        world.solids.push(Solid::wall([6.0, -3.0], [6.0, 3.0], 0.1, 2.4));
        let robot = robot("loomo");
        let mut simulator = Simulator::new(&sidestep_sim::Config::default(), &robot, world, Pose2::ORIGIN, 7);
        let mut mapper = Mapper::new(&sidestep_mapper::Config::shipped(), &robot).unwrap();
        let (mut depth, mut map) = (Box::<DepthFrame>::default(), Box::<SafetyMap>::default());
        let (mut odometry, mut marked, mut frames) = (Odometry::default(), false, 0);
        let creep = Twist::new(0.2, 0.0);
        // The front of the robot ends 5 cm before the box.
        while odometry.pose.x_m < FACE_M - 0.14 - 0.05 {
            frames += 1;
            for tick in 0..3 {
                let now_ns = frames * 33_333_333 + tick * 10_000_000;
                simulator.command(
                    &Command { twist: creep, valid_until_ns: now_ns + 80_000_000, ..Command::default() },
                    now_ns,
                );
                simulator.advance(now_ns);
                simulator.odometry(&mut odometry);
                mapper.odometry(&odometry);
            }
            simulator.render(&mut depth);
            mapper.depth(&depth);
            mapper.write_safety(&mut map);
            let (x_m, y_m) = map.frame().inverse_transform(FACE_M + 0.03, 0.0);
            let occupied =
                SAFETY_GRID.index(x_m as f32, y_m as f32).is_some_and(|cell| map.occupancy[cell] > 128);
            assert!(occupied || !marked, "{height_m} m box lost at {x_m:.2} m");
            marked |= occupied;
            assert!(marked || x_m > 1.6, "{height_m} m box not marked at {x_m:.2} m");
        }
        assert!(frames > 200 && frames < 1000, "{frames} frames");
    }
}

//! Doors, through the whole chain, with every lead. `SIDESTEP_DOORS=N` drives N of them and prints; without it a few must be
//! passed.
#![allow(clippy::unwrap_used, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_crew::in_order;
use sidestep_drive::{Drive, Lead, Outcome, Setup};
use sidestep_msgs::{Pose2, Robot};
use sidestep_policy::Policy;
use sidestep_sim::{Random, Solid, World};

/// `[m]` the narrowest door of an old flat, and how deep the wall's surroundings count as the door.
const DOOR_M: f64 = 0.80;
const DEEP_M: f64 = 0.8;
/// `[m/s]` mean speed through a door, at least; and doors of a short run.
const LEAST_M_S: f64 = 0.3;
const FEW: usize = 4;

/// A room 4 m wide with a wall across it and a door somewhere in the wall, and where the wall stands. The path leads from
/// beside the door straight through it.
fn flat(number: u64) -> (World, f64) {
    let mut random = Random::new(number);
    let mut about = |middle: f64, most: f64| random.between(middle - most, middle + most);
    let (middle, aside, yaw_rad) = (about(0.0, 0.4), about(0.0, 0.4), about(0.0, 0.2));
    let (thick, wall) = (about(0.1, 0.025), about(2.5, 0.1));
    let mut world = World::empty();
    let corners = [[-1.5, -2.0], [6.0, -2.0], [6.0, 2.0], [-1.5, 2.0]];
    for side in 0..4 {
        world.solids.push(Solid::wall(corners[side], corners[(side + 1) % 4], 0.1, 2.4));
    }
    for (post, end) in [(middle - 0.5 * DOOR_M, -2.0), (middle + 0.5 * DOOR_M, 2.0)] {
        world.solids.push(Solid::wall([wall, post], [wall, end], thick, 2.4));
    }
    world.start = Pose2::new(0.0, middle + aside, yaw_rad);
    let way = [[0.0, middle + aside], [wall - 1.0, middle], [wall + 1.0, middle], [wall + 2.0, middle]];
    world.legs_m = vec![way.to_vec()];
    (world, wall)
}

/// `[m/s]` mean speed through a door; `None` where the robot did not arrive behind it.
fn speed_m_s(outcome: &Outcome, wall_m: f64) -> Option<f64> {
    let near = |x_m: f64| (x_m - wall_m).abs() < 0.5 * DEEP_M;
    let mut inside = outcome.trace.iter().filter(|point| near(point.pose.x_m));
    let (first, last) = (inside.next()?, inside.next_back()?);
    (outcome.arrivals > 0).then(|| (last.pose.x_m - first.pose.x_m) / (last.time_s - first.time_s))
}

/// One drive through door `number`: its speed, contacts, and what it was held up by.
fn drive_through(number: u64, lead: Lead, robot: &Robot) -> (Option<f64>, u32, String) {
    let (world, wall_m) = flat(number);
    let mut setup = Setup::led_by(robot.clone(), world, lead);
    setup.sim.seed = number;
    setup.sim.people = 0;
    setup.policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", robot).unwrap());
    let mut drive = Drive::new(setup).unwrap();
    let outcome = drive.run(1, 40.0);
    (speed_m_s(outcome, wall_m), outcome.collisions, outcome.summary())
}

#[test]
fn a_door_of_80_cm_is_driven_through_at_30_cm_s() {
    let asked = std::env::var("SIDESTEP_DOORS").ok().map(|text| text.parse::<usize>().unwrap());
    let robot = Robot::from_toml("loomo", include_str!("../../../launch/robots/loomo.toml")).unwrap();
    let threads = std::thread::available_parallelism().unwrap().get();
    for lead in Lead::ALL {
        let drive = |number: usize| drive_through(number as u64, lead, &robot);
        let driven: Result<Vec<_>, ()> =
            in_order(asked.unwrap_or(FEW), threads, || Ok(()), |(), number| Ok(drive(number)), &mut |_| ());
        let driven = driven.unwrap();
        let mut speeds: Vec<f64> = driven.iter().filter_map(|(speed, ..)| *speed).collect();
        speeds.sort_by(f64::total_cmp);
        let fast = speeds.iter().filter(|speed| **speed >= LEAST_M_S).count();
        for (number, (speed, _, summary)) in driven.iter().enumerate() {
            if speed.is_none_or(|speed| speed < LEAST_M_S) {
                println!("door {number}, {}: {speed:.2?} m/s, {summary}", lead.label());
            }
        }
        println!(
            "{}: {} of {} doors passed, {fast} at 0.3 m/s or more, median {:.2?}, slowest {:.2?} m/s",
            lead.label(),
            speeds.len(),
            driven.len(),
            speeds.get(speeds.len() / 2),
            speeds.first()
        );
        assert!(driven.iter().all(|(_, collisions, _)| *collisions == 0), "{}: contacts", lead.label());
        assert!(asked.is_some() || fast == FEW, "{}: {fast} of {FEW}", lead.label());
    }
}

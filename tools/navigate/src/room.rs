//! Rooms strewn by a seed, of stated difficulty, always with a way through; and the path that a global planner would give.

use crate::reference::{Floor, is_blocked};
use serde::Serialize;
use sidestep_msgs::Pose2;
use sidestep_sim::{FREE_M, Solid, World};
use sidestep_train::Random;

/// `[m]` length and width of every room.
pub const SIZE_M: [f64; 2] = [8.0, 6.0];
/// `[m]` radius of the disc for which there is always a way: the robot's half-width is 0.285 m, and the office grants
/// as much beside its loop.
pub const WAY_M: f64 = FREE_M;
/// `[m]` free round the start: the disc that a robot with a camera is granted, and a little.
const START_FREE_M: f64 = 1.25;
/// `[m]` free round the goal.
const GOAL_FREE_M: f64 = 0.6;
/// Draws of an obstacle's place before the room stays as it is.
const PLACES: usize = 200;
/// `[m]` radius of the circle round the footprint of the robot, for the share of straight lines that are blocked.
const ROBOT_M: f64 = 0.32;

/// What makes a room difficult.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Grade {
    /// Its name.
    pub name: &'static str,
    /// Obstacles strewn: boxes, columns, poles.
    pub obstacles: usize,
    /// `[m]` least gap between two obstacles, and between obstacle and wall.
    pub passage_m: f64,
    /// `[m]` width of the doors in the inner walls.
    pub door_m: [f64; 2],
    /// Inner walls from side to side, each with one door.
    pub walls: usize,
    /// Obstacles that the reference path does not know of.
    pub unmapped: usize,
}

/// The difficulties; room `n` has grade `n` modulo their number.
pub const GRADES: [Grade; 4] = [
    Grade { name: "sparse", obstacles: 5, passage_m: 1.0, door_m: [1.0, 1.2], walls: 0, unmapped: 0 },
    Grade { name: "dense", obstacles: 12, passage_m: 0.9, door_m: [1.0, 1.2], walls: 0, unmapped: 0 },
    Grade { name: "walled", obstacles: 5, passage_m: 1.0, door_m: [0.95, 1.2], walls: 1, unmapped: 0 },
    Grade { name: "unmapped", obstacles: 8, passage_m: 1.0, door_m: [1.0, 1.2], walls: 0, unmapped: 4 },
];

/// A world with a task, as a suite drives it.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// Its name within the suite.
    pub name: String,
    /// Name of its difficulty.
    pub grade: String,
    /// Seed of everything that looks random in the drive.
    pub seed: u64,
    /// World, start and path.
    pub world: World,
    /// Whether the straight line from start to goal is blocked for the robot.
    pub straight_blocked: bool,
    /// Whether the path itself is.
    pub path_blocked: bool,
}

impl Course {
    /// A course in a world that has a start and a path of its own.
    #[must_use]
    pub fn of(name: &str, grade: &str, seed: u64, world: World) -> Self {
        let path: Vec<[f64; 2]> = world.legs_m.iter().flatten().copied().collect();
        let goal = path.last().copied().unwrap_or([world.start.x_m, world.start.y_m]);
        let straight = [[world.start.x_m, world.start.y_m], goal];
        let straight_blocked = is_blocked(&world, &straight, ROBOT_M);
        let path_blocked = is_blocked(&world, &path, ROBOT_M);
        Self { name: name.into(), grade: grade.into(), seed, world, straight_blocked, path_blocked }
    }
}

/// Room `number` of a seed.
#[must_use]
pub fn room(seed: u64, number: u64) -> Course {
    let grade = &GRADES[number as usize % GRADES.len()];
    let mut random = Random::new(seed, 0x524f_4f4d_0000 + number);
    let world = loop {
        // Of what is drawn without a way through nothing is kept.
        if let Some(world) = draw(&mut random, grade) {
            break world;
        }
    };
    Course::of(&format!("room {number}"), grade.name, random.bits() >> 16, world)
}

fn draw(random: &mut Random, grade: &Grade) -> Option<World> {
    let [length, width] = SIZE_M;
    let start = [between(random, 1.4, 1.9), between(random, 1.4, width - 1.4)];
    let goal = [between(random, length - 1.8, length - 0.8), between(random, 0.8, width - 0.8)];
    let mut world = World::empty();
    let corners = [[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]];
    for index in 0..4 {
        world.solids.push(Solid::wall(corners[index], corners[(index + 1) % 4], 0.1, 2.4));
    }
    for _ in 0..grade.walls {
        let x = between(random, 3.8, 5.2);
        let door = between(random, grade.door_m[0], grade.door_m[1]);
        let middle = between(random, 0.9, width - 0.9);
        world.solids.push(Solid::wall([x, 0.0], [x, middle - 0.5 * door], 0.1, 2.4));
        world.solids.push(Solid::wall([x, middle + 0.5 * door], [x, width], 0.1, 2.4));
    }
    let mapped = grade.obstacles - grade.unmapped;
    strew(&mut world, random, mapped, grade, [start, goal]);
    let path = Floor::new(&world, SIZE_M).way(start, goal, WAY_M)?;
    if grade.unmapped > 0 {
        strew(&mut world, random, grade.unmapped, grade, [start, goal]);
        Floor::new(&world, SIZE_M).way(start, goal, WAY_M)?;
    }
    let ahead = path.get(10).or(path.last())?;
    let bearing = libm::atan2(ahead[1] - start[1], ahead[0] - start[0]);
    world.start = Pose2::new(start[0], start[1], bearing + between(random, -0.5, 0.5));
    world.legs_m = vec![path];
    Some(world)
}

/// Puts obstacles where they leave the passage, the start and the goal free.
fn strew(world: &mut World, random: &mut Random, count: usize, grade: &Grade, ends: [[f64; 2]; 2]) {
    for _ in 0..count {
        for _ in 0..PLACES {
            let centre = [between(random, 0.4, SIZE_M[0] - 0.4), between(random, 0.4, SIZE_M[1] - 0.4)];
            let solid = obstacle(random, centre);
            let reach = solid.reach_m();
            let off_ends = ends
                .iter()
                .zip([START_FREE_M, GOAL_FREE_M])
                .all(|(end, free)| libm::hypot(end[0] - centre[0], end[1] - centre[1]) > free + reach);
            if off_ends && world.clearance_m(centre, 3.0) >= grade.passage_m + reach {
                world.solids.push(solid);
                break;
            }
        }
    }
}

/// A box, a column or a pole.
fn obstacle(random: &mut Random, centre: [f64; 2]) -> Solid {
    let size = [between(random, 0.2, 0.7), between(random, 0.2, 0.7)];
    let top = between(random, 0.25, 1.2);
    match random.below(4) {
        0 => Solid::column(centre, 0.5 * size[0], [0.0, top]),
        1 => Solid::column(centre, 0.02, [0.0, 1.5]),
        _ => Solid::block(centre, size, between(random, 0.0, std::f64::consts::PI), [0.0, top]),
    }
}

pub(crate) fn between(random: &mut Random, least: f64, most: f64) -> f64 {
    least + (most - least) * f64::from(random.unit())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::TOP_M;

    #[test]
    fn there_is_always_a_way_for_the_robot_and_the_start_is_free() {
        for number in 0..60 {
            let world = room(7, number).world;
            let floor = Floor::new(&world, SIZE_M);
            let start = [world.start.x_m, world.start.y_m];
            let goal = *world.legs_m[0].last().unwrap();
            assert!(floor.way(start, goal, WAY_M).is_some(), "room {number}");
            assert!(world.clearance_m(start, TOP_M) >= START_FREE_M - 0.06, "room {number}");
        }
    }

    #[test]
    fn a_path_keeps_clear_of_what_it_knows_of() {
        for number in 0..60 {
            let course = room(7, number);
            let expected = course.grade == "unmapped";
            assert!(!course.path_blocked || expected, "{}", course.name);
            assert_eq!(course, room(7, number));
        }
    }

    #[test]
    fn straight_lines_are_often_blocked() {
        let blocked = (0..100).filter(|number| room(7, *number).straight_blocked).count();
        println!("{blocked} of 100");
        assert!((40..=95).contains(&blocked), "{blocked}");
    }
}

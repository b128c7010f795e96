//! The built-in office: three rooms round a loop, tables on thin legs, chairs, boxes, people.
//!
//! 12 x 8 m. The loop leads through three doors; what stands in the rooms is turned, moved and strewn by the seed,
//! and never nearer to the loop than [`FREE_M`].

use crate::people::Walker;
use crate::random::Random;
use crate::solid::Solid;
use crate::world::{World, resample};
use sidestep_msgs::Pose2;
use std::f64::consts::{FRAC_PI_2, PI};

/// `[m]` free round the start: the disc that a robot with a camera must be granted.
const START_FREE_M: f64 = 1.25;
/// `[m]` free on both sides of the loop; a door post is as near as anything may be.
pub const FREE_M: f64 = 0.45;
const WALL_M: f64 = 0.12;
const WALL_TOP_M: f64 = 2.4;
const LEG_RADIUS_M: f64 = 0.016;

/// The loop, leg by leg: each leg begins where the one before ends. Turns lie at the ends of legs, after
/// straight stretches, so that a camera of 55 degrees has seen the ground on which the robot turns.
const LEGS: [&[[f64; 2]]; 6] = [
    &[[1.6, 1.4], [5.8, 1.4]],
    &[[5.8, 1.4], [10.0, 1.4]],
    &[[10.0, 1.4], [10.0, 6.7]],
    &[[10.0, 6.7], [7.6, 6.7]],
    &[[7.6, 6.7], [2.0, 6.7]],
    &[[2.0, 6.7], [2.0, 1.8], [1.6, 1.4]],
];

/// Tables: centre, size, yaw.
const TABLES: [([f64; 2], [f64; 2], f64); 6] = [
    ([5.0, 3.1], [1.6, 0.8], 0.0),
    ([6.9, 3.2], [1.2, 0.7], 0.3),
    ([11.4, 1.2], [1.4, 0.7], FRAC_PI_2),
    ([8.2, 7.6], [1.6, 0.6], 0.0),
    ([4.0, 7.6], [1.6, 0.6], 0.0),
    ([4.6, 4.6], [1.4, 0.7], 0.0),
];

/// Chairs: centre, yaw.
const CHAIRS: [([f64; 2], f64); 5] =
    [([4.9, 3.75], -FRAC_PI_2), ([6.0, 2.6], PI), ([7.6, 3.6], PI), ([7.0, 5.1], 0.2), ([5.3, 5.0], PI)];

impl World {
    /// The office with what the seed strews.
    #[must_use]
    pub fn office(seed: u64) -> Self {
        let mut world = Self::empty();
        world.legs_m = LEGS.iter().map(|leg| leg.to_vec()).collect();
        world.endless = true;
        world.start = Pose2::new(1.6, 1.4, 0.0);
        walls(&mut world.solids);
        world.walkers = walkers();
        let mut way: Vec<[f64; 2]> = LEGS.iter().flat_map(|leg| resample(leg, 0.1)).collect();
        let mut random = Random::new(seed);
        furniture(&mut world.solids, &way, &mut random);
        way.extend(world.walkers.iter().flat_map(|walker| resample(&walker.waypoints_m, 0.1)));
        strew(&mut world.solids, &way, &mut random, 12);
        world
    }
}

fn walls(solids: &mut Vec<Solid>) {
    let mut wall = |from, to| solids.push(Solid::wall(from, to, WALL_M, WALL_TOP_M));
    wall([0.0, 0.0], [12.0, 0.0]);
    wall([12.0, 0.0], [12.0, 8.0]);
    wall([12.0, 8.0], [0.0, 8.0]);
    wall([0.0, 8.0], [0.0, 0.0]);
    // Doors of 0.95 m at x = 2 and x = 10, of 1.0 m at y = 6.7.
    wall([0.0, 4.0], [1.525, 4.0]);
    wall([2.475, 4.0], [9.525, 4.0]);
    wall([10.475, 4.0], [12.0, 4.0]);
    wall([6.0, 4.0], [6.0, 6.2]);
    wall([6.0, 7.2], [6.0, 8.0]);
}

/// A point of a piece of furniture in the world.
fn place(centre: [f64; 2], yaw: f64, point: [f64; 2]) -> [f64; 2] {
    let (x, y) = Pose2::new(centre[0], centre[1], yaw).transform(point[0], point[1]);
    [x, y]
}

/// A table top at 0.70 to 0.74 m on four legs of 3.2 cm.
pub(crate) fn table(centre: [f64; 2], size: [f64; 2], yaw: f64) -> Vec<Solid> {
    let mut solids = vec![Solid::block(centre, size, yaw, [0.70, 0.74])];
    let (l, w) = (0.5 * size[0] - 0.06, 0.5 * size[1] - 0.06);
    for corner in [[-l, -w], [l, -w], [l, w], [-l, w]] {
        solids.push(Solid::column(place(centre, yaw, corner), LEG_RADIUS_M, [0.0, 0.70]));
    }
    solids
}

/// A chair: seat, back, four legs.
fn chair(centre: [f64; 2], yaw: f64) -> Vec<Solid> {
    let mut solids = vec![
        Solid::block(centre, [0.42, 0.42], yaw, [0.42, 0.46]),
        Solid::block(place(centre, yaw, [-0.2, 0.0]), [0.03, 0.42], yaw, [0.46, 0.85]),
    ];
    for corner in [[-0.19, -0.19], [0.19, -0.19], [0.19, 0.19], [-0.19, 0.19]] {
        solids.push(Solid::column(place(centre, yaw, corner), 0.012, [0.0, 0.42]));
    }
    solids
}

fn is_free(parts: &[Solid], way: &[[f64; 2]], free_m: f64) -> bool {
    parts.iter().all(|solid| way.iter().all(|point| solid.distance_m(*point) >= free_m))
}

/// Moves and turns each piece a little by the seed, back to its plan where it would block the way.
fn furniture(solids: &mut Vec<Solid>, way: &[[f64; 2]], random: &mut Random) {
    let mut put = |make: &dyn Fn([f64; 2], f64) -> Vec<Solid>, centre: [f64; 2], yaw: f64, turn: f64| {
        let moved = [centre[0] + random.between(-0.15, 0.15), centre[1] + random.between(-0.1, 0.1)];
        let parts = make(moved, yaw + random.between(-turn, turn));
        solids.extend(if is_free(&parts, way, FREE_M + 0.1) { parts } else { make(centre, yaw) });
    };
    for (centre, size, yaw) in TABLES {
        put(&|place, turn| table(place, size, turn), centre, yaw, 0.1);
    }
    for (centre, yaw) in CHAIRS {
        put(&chair, centre, yaw, 0.4);
    }
    // Shelves and cabinets along the walls, a coat stand, a pole.
    for (centre, size, top) in
        [([0.3, 3.3], [0.4, 1.0], 1.8), ([11.7, 7.0], [0.4, 1.6], 1.9), ([0.35, 7.0], [0.45, 1.2], 0.75)]
    {
        solids.push(Solid::block(centre, size, 0.0, [0.0, top]));
    }
    for (centre, radius, top) in [([7.0, 4.4], 0.03, 1.7), ([11.4, 3.5], 0.15, 0.5), ([4.9, 0.3], 0.15, 0.6)]
    {
        solids.push(Solid::column(centre, radius, [0.0, top]));
    }
}

/// Boxes on the floor, 0.1 to 0.6 m high, off the way.
fn strew(solids: &mut Vec<Solid>, way: &[[f64; 2]], random: &mut Random, count: usize) {
    let mut left = count;
    for _ in 0..40 * count {
        if left == 0 {
            return;
        }
        let centre = [random.between(0.4, 11.6), random.between(0.4, 7.6)];
        let size = [random.between(0.2, 0.5), random.between(0.2, 0.5)];
        let block = Solid::block(centre, size, random.between(0.0, PI), [0.0, random.between(0.1, 0.6)]);
        let apart = solids.iter().all(|solid| solid.gap_m(&block.corners()) > 0.05);
        let off_start = block.distance_m(LEGS[0][0]) > START_FREE_M;
        if apart && off_start && !hides_a_turn(centre) && is_free(&[block], way, FREE_M + 0.15) {
            solids.push(block);
            left -= 1;
        }
    }
}

/// Whether something at `centre` lies inside the loop near a turn, where it would hide the ground that the robot turns to.
fn hides_a_turn(centre: [f64; 2]) -> bool {
    let inside = (2.0..10.0).contains(&centre[0]) && (1.4..6.7).contains(&centre[1]);
    inside && LEGS.iter().any(|leg| libm::hypot(leg[0][0] - centre[0], leg[0][1] - centre[1]) < 2.5)
}

fn walkers() -> Vec<Walker> {
    let walk = |waypoints_m: &[[f64; 2]], speed_m_s| Walker { waypoints_m: waypoints_m.to_vec(), speed_m_s };
    vec![
        walk(&[[11.1, 2.6], [11.2, 3.3]], 0.3),
        walk(&[[0.8, 2.4]], 0.0),
        walk(&[[11.2, 5.0], [11.2, 6.0]], 0.4),
        walk(&[[1.2, 7.4], [2.6, 7.4]], 0.4),
        walk(&[[3.2, 5.5], [5.4, 5.5]], 0.5),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_office_is_drivable_all_round() {
        for seed in 0..50 {
            let world = World::office(seed);
            for point in world.legs_m.iter().flat_map(|leg| resample(leg, 0.05)) {
                let clearance = world.clearance_m(point, 1.0);
                assert!(clearance >= FREE_M, "seed {seed}: {clearance:.3} m at {point:?}");
            }
            assert!(
                world.clearance_m([world.start.x_m, world.start.y_m], 1.0) >= START_FREE_M,
                "seed {seed}"
            );
        }
    }

    #[test]
    fn the_legs_close_a_loop_of_two_to_six_metres_each() {
        for (index, leg) in LEGS.iter().enumerate() {
            let next = LEGS[(index + 1) % LEGS.len()];
            assert_eq!(leg.last(), next.first());
            let metres: f64 = leg.windows(2).map(|w| libm::hypot(w[1][0] - w[0][0], w[1][1] - w[0][1])).sum();
            assert!((2.0..6.0).contains(&metres), "leg {index}: {metres}");
        }
    }

    #[test]
    fn two_seeds_give_two_offices_and_one_seed_gives_one() {
        assert_eq!(World::office(3), World::office(3));
        assert_ne!(World::office(3).solids, World::office(4).solids);
    }
}

//! Corridors and rooms strewn by a seed, always with a way through.

use crate::office::table;
use crate::random::Random;
use crate::solid::Solid;
use crate::world::World;
use sidestep_msgs::Pose2;

/// `[m]` passage left beside every obstacle.
const PASSAGE_M: f64 = 1.0;

impl World {
    /// A corridor of 18 x 2.5 m as in the paper's Fig. 9; `density` 1 = an obstacle every 1.8 m.
    ///
    /// The path is the middle line, straight through what stands there; beside each obstacle 1 m is free.
    #[must_use]
    pub fn corridor(seed: u64, density: f64) -> Self {
        let (length, width) = (18.0, 2.5);
        let mut world = fenced(length, width);
        world.start = Pose2::new(1.4, 0.5 * width, 0.0);
        world.legs_m = vec![vec![[1.4, 0.5 * width], [length - 0.8, 0.5 * width]]];
        let mut random = Random::new(seed);
        let mut x = 3.4;
        while x < length - 2.0 {
            let size = [random.between(0.2, 0.5), random.between(0.2, 0.6)];
            // The outline lies within this half width whatever its yaw.
            let reach = 0.5 * libm::hypot(size[0], size[1]);
            let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
            let y = 0.5 * width + side * random.between(0.0, 0.5 * width - reach);
            let far_wall = if y > 0.5 * width { 0.0 } else { width };
            let y = if (y - far_wall).abs() - reach < PASSAGE_M {
                far_wall - side_of(far_wall) * (PASSAGE_M + reach)
            } else {
                y
            };
            world.solids.push(obstacle(&mut random, [x, y], size));
            x += random.between(1.4, 2.2) / density.max(0.1);
        }
        world
    }

    /// A room of 8 x 6 m with `6 * density` obstacles at least 1 m apart, and a path from corner to corner.
    #[must_use]
    pub fn room(seed: u64, density: f64) -> Self {
        let (length, width) = (8.0, 6.0);
        let mut world = fenced(length, width);
        world.start = Pose2::new(1.4, 1.4, 0.6);
        world.legs_m = vec![vec![[1.4, 1.4], [length - 1.0, width - 1.0]]];
        let mut random = Random::new(seed);
        let mut left = libm::round(6.0 * density.max(0.0)) as usize;
        for _ in 0..2000 {
            if left == 0 {
                break;
            }
            let centre = [random.between(0.5, length - 0.5), random.between(0.5, width - 0.5)];
            let size = [random.between(0.2, 0.6), random.between(0.2, 0.6)];
            let reach = 0.5 * libm::hypot(size[0], size[1]);
            let ends = [[1.4, 1.4], [length - 1.0, width - 1.0]];
            let off_ends = ends.iter().all(|e| libm::hypot(e[0] - centre[0], e[1] - centre[1]) > 1.2 + reach);
            if off_ends && world.clearance_m(centre, 3.0) >= PASSAGE_M + reach {
                world.solids.push(obstacle(&mut random, centre, size));
                left -= 1;
            }
        }
        world
    }

    /// One room with one table in the middle, for tests of thin legs.
    #[must_use]
    pub fn with_table() -> Self {
        let mut world = fenced(8.0, 6.0);
        world.solids.extend(table([4.0, 3.0], [1.6, 0.8], 0.0));
        world.start = Pose2::new(1.0, 3.0, 0.0);
        world
    }
}

fn side_of(wall_m: f64) -> f64 {
    if wall_m > 0.0 { 1.0 } else { -1.0 }
}

fn fenced(length: f64, width: f64) -> World {
    let corners = [[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]];
    let mut world = World::empty();
    for i in 0..4 {
        world.solids.push(Solid::wall(corners[i], corners[(i + 1) % 4], 0.1, 2.4));
    }
    world
}

/// A box, a column or a pole.
fn obstacle(random: &mut Random, centre: [f64; 2], size: [f64; 2]) -> Solid {
    let yaw = random.between(0.0, std::f64::consts::PI);
    let top = random.between(0.15, 1.2);
    match random.bits() % 4 {
        0 => Solid::column(centre, 0.5 * size[0].min(size[1]), [0.0, top]),
        1 => Solid::column(centre, 0.02, [0.0, 1.5]),
        _ => Solid::block(centre, size, yaw, [0.0, top]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a disc gets from start to goal on a grid of 5 cm.
    fn passable(world: &World, radius_m: f64, size: [f64; 2]) -> bool {
        let cell = 0.05;
        let (nx, ny) = ((size[0] / cell) as usize, (size[1] / cell) as usize);
        let free =
            |x: usize, y: usize| world.clearance_m([x as f64 * cell, y as f64 * cell], 3.0) >= radius_m;
        let end = world.legs_m[0].last().unwrap();
        let goal = ((end[0] / cell) as usize, (end[1] / cell) as usize);
        let start = ((world.start.x_m / cell) as usize, (world.start.y_m / cell) as usize);
        let mut seen = vec![false; nx * ny];
        let mut open = vec![start];
        while let Some((x, y)) = open.pop() {
            if x.abs_diff(goal.0) <= 1 && y.abs_diff(goal.1) <= 1 {
                return true;
            }
            for (x, y) in [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)] {
                if x > 0 && y > 0 && x < nx && y < ny && !seen[y * nx + x] && free(x, y) {
                    seen[y * nx + x] = true;
                    open.push((x, y));
                }
            }
        }
        false
    }

    #[test]
    fn there_is_always_a_way_for_a_disc_of_forty_centimetres() {
        for seed in 0..20 {
            assert!(passable(&World::corridor(seed, 1.0), 0.40, [18.0, 2.5]), "corridor {seed}");
            assert!(passable(&World::room(seed, 1.5), 0.40, [8.0, 6.0]), "room {seed}");
        }
    }
}

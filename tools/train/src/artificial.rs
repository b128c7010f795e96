//! Made-up local maps (paper section III-E): worlds that a well-behaved demonstrator rarely drives into.
//!
//! A world is a few shapes round the robot, drawn as occupancy, blurred as a sensor would, partly hidden as a camera
//! with a memory would hide it, and then turned into planning cost by the mapper's own function.

use crate::random::Random;
use crate::record::PARTLY_UNKNOWN;
use sidestep_mapper::{Widening, planning_cost};
use sidestep_msgs::{AGE_NEVER, LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Limits, Robot, Twist};

/// Cells of border round the map in which shapes are drawn too, so that the blur has no edge.
const BORDER: usize = 4;
/// Cells along a side of the canvas.
const SIDE: usize = LOCAL_SIDE + 2 * BORDER;

/// What the policy would see, without labels.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// `[1/255]` planning cost.
    pub planning_cost: [u8; LOCAL_CELLS],
    /// Cell of the goal, projected.
    pub goal_cell: usize,
    /// `[m]` goal before projection.
    pub goal_m: [f32; 2],
    /// u'.
    pub twist: Twist,
    /// 0 clusters, 1 corridor, 2 door, 3 close wall; plus 128 where parts are unknown.
    pub kind: u8,
}

/// An obstacle: where it is and how it is turned, and whether a point of its own frame is inside.
#[derive(Debug, Clone, Copy)]
struct Shape {
    x_m: f32,
    y_m: f32,
    cos: f32,
    sin: f32,
    /// `[m]` half length and half width; a disc where the second is zero.
    half_m: [f32; 2],
}

impl Shape {
    fn bar(x_m: f32, y_m: f32, yaw_rad: f32, half_m: [f32; 2]) -> Self {
        let (sin, cos) = libm::sincosf(yaw_rad);
        Self { x_m, y_m, cos, sin, half_m }
    }

    fn disc(x_m: f32, y_m: f32, radius_m: f32) -> Self {
        Self { x_m, y_m, cos: 1.0, sin: 0.0, half_m: [radius_m, 0.0] }
    }

    fn holds(&self, x_m: f32, y_m: f32) -> bool {
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        let (along, across) = (self.cos * dx + self.sin * dy, self.cos * dy - self.sin * dx);
        if self.half_m[1] > 0.0 {
            along.abs() <= self.half_m[0] && across.abs() <= self.half_m[1]
        } else {
            along * along + across * across <= self.half_m[0] * self.half_m[0]
        }
    }
}

/// Occupancy in [0, 1] on the canvas.
type Canvas = [f32; SIDE * SIDE];

/// `[m]` centre of a canvas cell in `base`.
fn centre(row: usize, col: usize) -> (f32, f32) {
    let cell =
        |from: f32, index: usize| from + (LOCAL_SIDE as f32 - 1.0 + BORDER as f32 - index as f32 + 0.5) * 0.1;
    (cell(LOCAL_GRID.rear_m, row), cell(LOCAL_GRID.right_m, col))
}

/// Makes scene `stream` of `seed` for a robot.
#[must_use]
pub fn scene(seed: u64, stream: u64, robot: &Robot) -> Scene {
    let mut random = Random::new(seed, stream);
    let (shapes, mut kind) = world(&mut random);
    let mut canvas = draw(&shapes);
    if random.chance(0.9) {
        clear_robot(&mut canvas, random.between(0.3, 0.8));
    }
    if random.chance(0.7) {
        let sigma = random.between(0.3, 1.4);
        blur(&mut canvas, sigma, random.between(1.0, 1.0 + sigma));
    }
    let hide = random.chance(0.5);
    let seen = if hide { visible(&mut random, &canvas) } else { [true; SIDE * SIDE] };
    if hide {
        kind |= PARTLY_UNKNOWN;
    }
    let (occupancy, age) = measured(&mut random, &canvas, &seen);
    // A scanner sees what is near, a camera does not: maps of both.
    let blind = random.chance(0.5);
    let widening = if blind { Widening::of(robot) } else { Widening::by(robot.half_width_m()) };
    let mut cost = [0; LOCAL_CELLS];
    planning_cost(&occupancy, &age, widening, &mut cost);
    let (goal_m, goal_cell) = goal(&mut random, &cost);
    Scene { planning_cost: cost, goal_cell, goal_m, twist: twist(&mut random, &robot.limits), kind }
}

fn world(random: &mut Random) -> (Vec<Shape>, u8) {
    let pi = std::f32::consts::PI;
    let mut shapes = Vec::new();
    let kind = match random.below(10) {
        0..=3 => 0,
        4..=5 => 1,
        6..=7 => 2,
        _ => 3,
    };
    let yaw = if random.chance(0.5) { random.between(-0.4, 0.4) } else { random.between(-pi, pi) };
    let (sin, cos) = libm::sincosf(yaw);
    let thick = random.between(0.03, 0.15);
    // A point `along` the direction `yaw` and `across` it, in `base`.
    let at = |along: f32, across: f32| (cos * along - sin * across, sin * along + cos * across);
    match kind {
        1 => {
            let width = random.between(0.75, 2.2);
            let offset = random.between(-0.5, 0.5) * (width - 0.6).max(0.1);
            for side in [offset + 0.5 * width + thick, offset - 0.5 * width - thick] {
                let (x, y) = at(0.0, side);
                shapes.push(Shape::bar(x, y, yaw, [5.0, thick]));
            }
            if random.chance(0.3) {
                let (x, y) = at(random.between(0.6, 2.2), offset);
                shapes.push(Shape::bar(x, y, yaw + 0.5 * pi, [width, thick]));
            }
        }
        2 => {
            let (distance, middle) = (random.between(-0.1, 2.0), random.between(-0.9, 0.9));
            let half_gap = 0.5 * random.between(0.75, 1.3);
            for side in [1.0, -1.0] {
                let (x, y) = at(distance, middle + side * (half_gap + 2.0));
                shapes.push(Shape::bar(x, y, yaw + 0.5 * pi, [2.0, thick]));
            }
        }
        3 => {
            let (x, y) = at(random.between(0.25, 1.2) + thick, random.between(-1.0, 1.0));
            shapes.push(Shape::bar(x, y, yaw + 0.5 * pi, [random.between(0.3, 4.0), thick]));
            if random.chance(0.5) {
                let (x, y) = at(0.0, if random.chance(0.5) { 1.0 } else { -1.0 } * random.between(0.4, 1.2));
                shapes.push(Shape::bar(x, y, yaw, [random.between(0.3, 4.0), thick]));
            }
        }
        _ => {}
    }
    let most = if kind == 0 { 7 } else { 3 };
    for _ in 0..random.below(most) {
        cluster(random, &mut shapes);
    }
    (shapes, kind)
}

/// A disc, a box, a wall, a random walk of discs, or the legs of a table.
fn cluster(random: &mut Random, shapes: &mut Vec<Shape>) {
    let (mut x, mut y) = (random.between(-0.6, 2.6), random.between(-1.6, 1.6));
    let yaw = random.between(-std::f32::consts::PI, std::f32::consts::PI);
    match random.below(5) {
        0 => shapes.push(Shape::disc(x, y, random.between(0.05, 0.35))),
        1 => shapes.push(Shape::bar(x, y, yaw, [random.between(0.08, 0.4), random.between(0.08, 0.4)])),
        2 => shapes.push(Shape::bar(x, y, yaw, [random.between(0.3, 1.2), random.between(0.04, 0.1)])),
        3 => {
            for _ in 0..random.below(10) + 3 {
                shapes.push(Shape::disc(x, y, random.between(0.05, 0.12)));
                x += random.between(-0.15, 0.15);
                y += random.between(-0.15, 0.15);
            }
        }
        _ => {
            let (sin, cos) = libm::sincosf(yaw);
            let (length, width) = (random.between(0.25, 0.7), random.between(0.2, 0.4));
            for (along, across) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let (along, across) = (along * length, across * width);
                shapes.push(Shape::disc(
                    x + cos * along - sin * across,
                    y + sin * along + cos * across,
                    0.06,
                ));
            }
        }
    }
}

fn draw(shapes: &[Shape]) -> Canvas {
    let mut canvas = [0.0; SIDE * SIDE];
    for (index, cell) in canvas.iter_mut().enumerate() {
        let (x, y) = centre(index / SIDE, index % SIDE);
        // A cell is occupied where any of its quarters is, as the mapper's finer grid would have it.
        let quarters = [(0.025, 0.025), (0.025, -0.025), (-0.025, 0.025), (-0.025, -0.025)];
        if quarters.iter().any(|(dx, dy)| shapes.iter().any(|shape| shape.holds(x + dx, y + dy))) {
            *cell = 1.0;
        }
    }
    canvas
}

fn clear_robot(canvas: &mut Canvas, radius_m: f32) {
    for (index, cell) in canvas.iter_mut().enumerate() {
        let (x, y) = centre(index / SIDE, index % SIDE);
        if x * x + y * y < radius_m * radius_m {
            *cell = 0.0;
        }
    }
}

/// Gaussian of `sigma` cells, both ways; `gain` keeps thin walls certain, as seeing them again does.
fn blur(canvas: &mut Canvas, sigma: f32, gain: f32) {
    const REACH: usize = 4;
    let weight = |distance: usize| libm::expf(-0.5 * (distance as f32 / sigma) * (distance as f32 / sigma));
    let sum = weight(0) + 2.0 * (1..=REACH).map(weight).sum::<f32>();
    for stride in [1, SIDE] {
        let source = *canvas;
        for (index, cell) in canvas.iter_mut().enumerate() {
            let place = index / stride % SIDE;
            let mut total = source[index];
            for distance in 1..=REACH {
                let before = if place >= distance { source[index - distance * stride] } else { 0.0 };
                let after = if place + distance < SIDE { source[index + distance * stride] } else { 0.0 };
                total += weight(distance) * (before + after);
            }
            *cell = total / sum;
        }
    }
    for cell in canvas {
        *cell = (*cell * gain).min(1.0);
    }
}

/// What the camera has seen from here and from a few poses before.
fn visible(random: &mut Random, canvas: &Canvas) -> [bool; SIDE * SIDE] {
    let mut seen = [false; SIDE * SIDE];
    let half_view = if random.chance(0.8) { 0.485 } else { random.between(0.4, 2.4) };
    let near_m = random.between(0.3, 1.0);
    let (mut x, mut y, mut yaw) = (0.0_f32, 0.0_f32, 0.0_f32);
    let (step_m, turn) = (random.between(0.0, 0.35), random.between(-0.25, 0.25));
    for _ in 0..=random.below(10) {
        look(&mut seen, canvas, [x, y, yaw], half_view, near_m);
        let (sin, cos) = libm::sincosf(yaw);
        x -= step_m * cos;
        y -= step_m * sin;
        yaw += turn;
    }
    let disc_m = if random.chance(0.5) { 0.75 } else { random.between(0.3, 0.6) };
    for (index, seen) in seen.iter_mut().enumerate() {
        let (x, y) = centre(index / SIDE, index % SIDE);
        *seen |= x * x + y * y < disc_m * disc_m;
    }
    seen
}

/// Marks what is in view from a pose and not behind something.
fn look(seen: &mut [bool; SIDE * SIDE], canvas: &Canvas, pose: [f32; 3], half_view: f32, near_m: f32) {
    let [x, y, yaw] = pose;
    let beams = 96;
    for beam in 0..=beams {
        let bearing = yaw + half_view * (2.0 * beam as f32 / beams as f32 - 1.0);
        let (sin, cos) = libm::sincosf(bearing);
        for step in 0..68 {
            let range = 0.05 * step as f32;
            let Some(cell) = canvas_cell(x + range * cos, y + range * sin) else { continue };
            if range >= near_m {
                seen[cell] = true;
            }
            if canvas[cell] > 0.5 {
                break;
            }
        }
    }
}

fn canvas_cell(x_m: f32, y_m: f32) -> Option<usize> {
    let border = BORDER as f32 * 0.1;
    let forward = libm::floorf((x_m - LOCAL_GRID.rear_m + border) / 0.1);
    let left = libm::floorf((y_m - LOCAL_GRID.right_m + border) / 0.1);
    let inside = forward >= 0.0 && left >= 0.0 && forward < SIDE as f32 && left < SIDE as f32;
    inside.then(|| (SIDE - 1 - forward as usize) * SIDE + SIDE - 1 - left as usize)
}

/// Occupancy and age as the mapper would publish them.
fn measured(
    random: &mut Random,
    canvas: &Canvas,
    seen: &[bool; SIDE * SIDE],
) -> ([u8; LOCAL_CELLS], [u8; LOCAL_CELLS]) {
    let (mut occupancy, mut age) = ([128; LOCAL_CELLS], [AGE_NEVER; LOCAL_CELLS]);
    let certainty = if random.chance(0.7) { random.between(0.85, 1.0) } else { random.between(0.55, 0.85) };
    let floor = random.between(0.0, 0.12);
    for cell in 0..LOCAL_CELLS {
        let from = (cell / LOCAL_SIDE + BORDER) * SIDE + cell % LOCAL_SIDE + BORDER;
        if !seen[from] {
            continue;
        }
        let noise = floor * random.unit();
        occupancy[cell] = (255.0 * (canvas[from] * certainty).max(noise)) as u8;
        age[cell] = 0;
    }
    (occupancy, age)
}

/// A goal on the plate or all round it; mostly one that can be reached.
fn goal(random: &mut Random, cost: &[u8; LOCAL_CELLS]) -> ([f32; 2], usize) {
    let picky = random.chance(0.8);
    let mut found = ([1.0, 0.0], 0);
    for _ in 0..8 {
        let (x, y) = match random.below(4) {
            0 | 1 => (random.between(-0.4, 2.4), random.between(-1.4, 1.4)),
            2 => polar(random.between(1.0, 5.0), random.between(-std::f32::consts::PI, std::f32::consts::PI)),
            // The goal node looks ahead along a path.
            _ => polar(random.between(0.8, 2.8), random.between(-1.0, 1.0)),
        };
        found = ([x, y], project(x, y));
        if !picky || cost[found.1] < 102 {
            break;
        }
    }
    found
}

fn polar(radius_m: f32, bearing_rad: f32) -> (f32, f32) {
    let (sin, cos) = libm::sincosf(bearing_rad);
    (radius_m * cos, radius_m * sin)
}

/// The cell of a point, or of its projection towards the robot onto the border of the map (paper eq. 3).
fn project(x_m: f32, y_m: f32) -> usize {
    let part = |value: f32, least: f32, most: f32| {
        if value > most {
            most / value
        } else if value < least {
            least / value
        } else {
            1.0
        }
    };
    let grid = LOCAL_GRID;
    let shrink = part(x_m, grid.rear_m, grid.front_m()).min(part(y_m, grid.right_m, grid.left_m()));
    let inner = if shrink < 1.0 { shrink * 0.9999 } else { 1.0 };
    grid.index(x_m * inner, y_m * inner).unwrap_or(0)
}

/// A velocity: a fifth standing, a few in reverse.
fn twist(random: &mut Random, limits: &Limits) -> Twist {
    if random.chance(0.2) {
        return Twist::STOP;
    }
    let v = if random.chance(0.04) {
        random.between(-limits.reverse_m_s, 0.0)
    } else {
        random.between(0.0, limits.forward_m_s)
    };
    let w = if random.chance(0.4) {
        0.35 * random.normal()
    } else {
        random.between(-limits.turn_rad_s, limits.turn_rad_s)
    };
    Twist::new(v, w.clamp(-limits.turn_rad_s, limits.turn_rad_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Robot {
        Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
    }

    #[test]
    fn a_scene_depends_on_seed_and_stream_only() {
        assert_eq!(scene(1, 2, &robot()), scene(1, 2, &robot()));
        assert_ne!(scene(1, 2, &robot()), scene(1, 3, &robot()));
        assert_ne!(scene(1, 2, &robot()), scene(2, 2, &robot()));
    }

    #[test]
    fn goals_outside_are_projected_towards_the_robot() {
        assert_eq!(project(5.0, 0.05), 13);
        assert_eq!(project(-3.0, 0.05), 27 * LOCAL_SIDE + 13);
        // Straight left of the axle.
        assert_eq!(project(0.04, 4.0) % LOCAL_SIDE, 0);
        for bearing in 0..64 {
            let (x, y) = polar(4.0, bearing as f32 * 0.1);
            let (cx, cy) = LOCAL_GRID.centre(project(x, y) / LOCAL_SIDE, project(x, y) % LOCAL_SIDE);
            let border = !(-0.3..=2.3).contains(&cx) || cy.abs() > 1.3;
            assert!(border && (cx * y - cy * x).abs() / 4.0 < 0.08, "{x} {y}: {cx} {cy}");
        }
    }

    #[test]
    fn every_kind_occurs_and_half_of_the_maps_are_partly_unknown() {
        let mut kinds = [0; 4];
        let mut unknown = 0;
        for stream in 0..400 {
            let scene = scene(7, stream, &robot());
            kinds[usize::from(scene.kind & 3)] += 1;
            unknown += usize::from(scene.kind & PARTLY_UNKNOWN != 0);
            assert!(scene.goal_cell < LOCAL_CELLS && scene.twist.is_finite());
        }
        assert!(
            kinds.iter().all(|count| *count > 40) && (150..250).contains(&unknown),
            "{kinds:?} {unknown}"
        );
    }
}

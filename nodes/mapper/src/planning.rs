//! The planning cost m_o of eq. (3): occupancy widened by the robot, since eq. (6) moves a point.

use sidestep_msgs::{
    AGE_NEVER, FREE_BELOW, LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, OBSTACLE_FROM, Robot, probability_code,
};

/// Cost of a cell that was never seen: 0.3, below the limit 0.4 of the expert.
pub const UNKNOWN_COST: u8 = 77;
/// Occupancy below this (0.35) counts as free: one clear sighting of the floor is enough.
pub const CLEAR_BELOW: u8 = 90;
/// Occupancy from here on is not free for the arbiter.
const NOT_FREE_FROM: u8 = probability_code(FREE_BELOW);
/// P of a cell of which nothing is known.
const PRIOR: u16 = 128;
/// `[m]` beyond the half-width, over which the weight falls to zero.
const FALL_M: f32 = 0.165;
/// Cells by which the kernel may reach: half-widths up to 0.9 m.
const REACH_MAX: usize = 10;
const PADDED: usize = LOCAL_SIDE + 2 * REACH_MAX;

/// How far a cell that is not free reaches into the costs of others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Widening {
    /// `[m]` half-width of the footprint.
    pub half_width_m: f32,
    /// `[m]` distance from the axle within which what is not known free is widened too: [`Robot::blind_m`], or 0 for maps
    /// of which nothing can be hidden so.
    pub blind_m: f32,
}

impl Widening {
    /// That of a robot that sees with its own sensor.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        Self { half_width_m: robot.half_width_m(), blind_m: robot.blind_m() }
    }

    /// That of a robot of this half-width on a map that hides nothing nearby.
    #[must_use]
    pub fn by(half_width_m: f32) -> Self {
        Self { half_width_m, blind_m: 0.0 }
    }
}

/// Whether the centre of a cell lies nearer to the axle than a distance.
fn is_nearer(row: usize, col: usize, distance_m: f32) -> bool {
    let (x_m, y_m) = LOCAL_GRID.centre(row, col);
    x_m * x_m + y_m * y_m < distance_m * distance_m
}

/// Weight, in 1/256, of an obstacle at a distance from a cell: 1 up to the half-width, then falling linearly to 0.
fn weight(distance_m: f32, half_width_m: f32) -> u16 {
    let part = 1.0 - (distance_m - half_width_m) / FALL_M;
    (part.clamp(0.0, 1.0) * 256.0 + 0.5) as u16
}

/// Fills `out` with max over obstacle cells k of P(k) w(|c - k|), and at least 0.3 where the cell itself is unknown or in
/// doubt.
///
/// A cell that is not known free and lies nearer to the robot than [`Widening::blind_m`] counts as an obstacle of P = 0.5:
/// its sensor cannot see it any more before the footprint would be there, and the arbiter lets nobody cross it.
///
/// The same function makes the bytes that the robot drives by and those that a network is trained with.
pub fn planning_cost(
    occupancy: &[u8; LOCAL_CELLS],
    age: &[u8; LOCAL_CELLS],
    widening: Widening,
    out: &mut [u8; LOCAL_CELLS],
) {
    let mut padded = [[0u16; PADDED]; PADDED];
    for (index, (&occupancy, &age)) in occupancy.iter().zip(age).enumerate() {
        let (row, col) = (index / LOCAL_SIDE, index % LOCAL_SIDE);
        let is_known = age != AGE_NEVER;
        padded[REACH_MAX + row][REACH_MAX + col] = match occupancy {
            OBSTACLE_FROM.. if is_known => u16::from(occupancy),
            _ if (!is_known || occupancy >= NOT_FREE_FROM) && is_nearer(row, col, widening.blind_m) => PRIOR,
            _ => 0,
        };
    }
    let mut cost = [[0u16; LOCAL_SIDE]; LOCAL_SIDE];
    for down in 0..=2 * REACH_MAX {
        for right in 0..=2 * REACH_MAX {
            let (dy, dx) = (down as f32 - REACH_MAX as f32, right as f32 - REACH_MAX as f32);
            let distance_m = LOCAL_GRID.cell_m * (dx * dx + dy * dy).sqrt();
            let weight = weight(distance_m, widening.half_width_m);
            if weight == 0 {
                continue;
            }
            for (row, cost) in cost.iter_mut().enumerate() {
                let near = &padded[row + down][right..right + LOCAL_SIDE];
                for (cost, &near) in cost.iter_mut().zip(near) {
                    // 255 * 256 is the largest product and fits.
                    *cost = (*cost).max((near * weight) >> 8);
                }
            }
        }
    }
    for (((out, cost), &age), &occupancy) in out.iter_mut().zip(cost.as_flattened()).zip(age).zip(occupancy) {
        let least = if age == AGE_NEVER || occupancy >= CLEAR_BELOW { UNKNOWN_COST } else { 0 };
        *out = (*cost as u8).max(least);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HALF_WIDTH_M: f32 = 0.285;

    fn cost_of(occupancy: &[u8; LOCAL_CELLS], age: &[u8; LOCAL_CELLS]) -> [u8; LOCAL_CELLS] {
        let mut out = [0; LOCAL_CELLS];
        planning_cost(occupancy, age, Widening::by(HALF_WIDTH_M), &mut out);
        out
    }

    /// One occupied cell; every cost must be the closed form of its distance.
    #[test]
    fn a_single_obstacle_falls_off_as_the_formula_says() {
        let mut occupancy = [0; LOCAL_CELLS];
        occupancy[14 * LOCAL_SIDE + 14] = 255;
        let cost = cost_of(&occupancy, &[0; LOCAL_CELLS]);
        for (index, &cost) in cost.iter().enumerate() {
            let (dy, dx) = ((index / LOCAL_SIDE) as f32 - 14.0, (index % LOCAL_SIDE) as f32 - 14.0);
            let distance_m = 0.1 * libm::hypotf(dx, dy);
            let expected = 255.0 * (1.0 - (distance_m - HALF_WIDTH_M) / 0.165).clamp(0.0, 1.0);
            assert!((f32::from(cost) - expected).abs() < 1.5, "at {distance_m} m: {cost}, not {expected}");
        }
    }

    /// Walls with a gap of eight cells; the middle stays below the limit 0.4. With seven cells it does not.
    #[test]
    fn a_door_of_80_cm_stays_open_and_one_of_60_cm_is_closed() {
        for (gap, open) in [(8, true), (6, false)] {
            let mut occupancy = [0; LOCAL_CELLS];
            for col in 0..LOCAL_SIDE {
                if !(10..10 + gap).contains(&col) {
                    occupancy[10 * LOCAL_SIDE + col] = 255;
                }
            }
            let cost = cost_of(&occupancy, &[0; LOCAL_CELLS]);
            let least = cost[10 * LOCAL_SIDE..11 * LOCAL_SIDE].iter().min().unwrap();
            assert_eq!(*least < 102, open, "gap {gap}: least cost {least}");
        }
    }

    #[test]
    fn unknown_costs_a_third_and_is_not_widened() {
        let mut age = [0; LOCAL_CELLS];
        age[5 * LOCAL_SIDE + 5] = AGE_NEVER;
        let cost = cost_of(&[128; LOCAL_CELLS].map(|_: u8| 0), &age);
        assert_eq!(cost[5 * LOCAL_SIDE + 5], UNKNOWN_COST);
        assert_eq!(cost.iter().filter(|&&cost| cost > 0).count(), 1);
        let all_unknown = cost_of(&[128; LOCAL_CELLS], &[AGE_NEVER; LOCAL_CELLS]);
        assert!(all_unknown.iter().all(|&cost| cost == UNKNOWN_COST));
    }

    /// A hole of unseen floor beside the robot and one beyond what its camera misses; then the near one fades instead.
    #[test]
    fn what_is_too_near_to_be_seen_is_kept_off_and_what_is_farther_is_not() {
        let (near, far) = (LOCAL_GRID.index(0.45, 0.65).unwrap(), LOCAL_GRID.index(1.45, 0.65).unwrap());
        for (occupancy_of_hole, age_of_hole) in [(128, AGE_NEVER), (NOT_FREE_FROM, 9)] {
            let (mut occupancy, mut age, mut cost) = ([0; LOCAL_CELLS], [0; LOCAL_CELLS], [0; LOCAL_CELLS]);
            for hole in [near, far] {
                (occupancy[hole], age[hole]) = (occupancy_of_hole, age_of_hole);
            }
            planning_cost(&occupancy, &age, Widening { half_width_m: HALF_WIDTH_M, blind_m: 1.0 }, &mut cost);
            assert_eq!((cost[near], cost[far]), (128, UNKNOWN_COST));
            // Two cells aside, within the half-width, a plan may not pass; beside the far one it may.
            assert_eq!((cost[near + 2], cost[far + 2]), (128, 0));
            planning_cost(&occupancy, &age, Widening::by(HALF_WIDTH_M), &mut cost);
            assert_eq!((cost[near], cost[near + 2]), (UNKNOWN_COST, 0));
        }
    }

    #[test]
    fn a_free_cell_that_is_forgotten_never_costs_more_than_the_unknown() {
        for occupancy in 0..128 {
            let mut cells = [0; LOCAL_CELLS];
            cells[200] = occupancy;
            let cost = cost_of(&cells, &[0; LOCAL_CELLS]);
            assert!(cost.iter().all(|&cost| cost <= UNKNOWN_COST), "occupancy {occupancy}");
        }
    }

    proptest! {
        /// Compares with the formula of SPEC section 3 written as four loops.
        #[test]
        fn the_fast_form_equals_the_formula(seed in any::<u64>(), half_width_m in 0.1f32..0.6) {
            let mut state = seed;
            let mut draw = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            };
            let occupancy: [u8; LOCAL_CELLS] = std::array::from_fn(|_| if draw() < 40 { draw() } else { 20 });
            let age: [u8; LOCAL_CELLS] = std::array::from_fn(|_| if draw() < 60 { AGE_NEVER } else { 3 });
            let mut out = [0; LOCAL_CELLS];
            planning_cost(&occupancy, &age, Widening::by(half_width_m), &mut out);
            for c in 0..LOCAL_CELLS {
                let in_doubt = age[c] == AGE_NEVER || occupancy[c] >= CLEAR_BELOW;
                let mut expected = if in_doubt { 77.0f32 } else { 0.0 };
                for k in 0..LOCAL_CELLS {
                    if age[k] == AGE_NEVER || occupancy[k] < OBSTACLE_FROM {
                        continue;
                    }
                    let dy = (c / LOCAL_SIDE) as f32 - (k / LOCAL_SIDE) as f32;
                    let dx = (c % LOCAL_SIDE) as f32 - (k % LOCAL_SIDE) as f32;
                    let fall = 1.0 - (0.1 * libm::hypotf(dx, dy) - half_width_m) / 0.165;
                    expected = expected.max(f32::from(occupancy[k]) * fall.clamp(0.0, 1.0));
                }
                prop_assert!((f32::from(out[c]) - expected).abs() < 1.6, "cell {}: {} not {}", c, out[c], expected);
            }
        }
    }
}

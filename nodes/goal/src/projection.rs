//! Paper eq. (3): the goal as one cell of the local map, with every special case.
//!
//! A goal outside the map moves along its ray from the robot to the border: by the smaller of the scales bound /
//! component over the bounds that it crosses, so to a corner only where both agree. Behind the robot that is the rear
//! border. A goal on the front or left border belongs to the last cell. Ties between two columns go away from the
//! axis on both sides, so that a mirrored goal has the mirrored cell. A goal on the axis counts as left, or as the
//! side kept.

use sidestep_msgs::{LOCAL_GRID, LOCAL_SIDE, Twist};

/// The side on which a goal behind the robot is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// y > 0.
    Left,
    /// y < 0.
    Right,
}

/// A goal on the local map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Index of the cell.
    pub cell: usize,
    /// `[m]` centre of the cell, x in `base`.
    pub x_m: f32,
    /// `[m]` centre of the cell, y in `base`.
    pub y_m: f32,
}

/// The cell of a goal in `base`, on the given side where it lies on the axis; `None` where it is not finite.
#[must_use]
pub fn project(x_m: f32, y_m: f32, on_axis: Side) -> Option<Projection> {
    if !(x_m.is_finite() && y_m.is_finite()) {
        return None;
    }
    let (front_m, rear_m, left_m) = (LOCAL_GRID.front_m(), LOCAL_GRID.rear_m, LOCAL_GRID.left_m());
    let mut scale = 1.0_f32;
    if x_m > front_m {
        scale = scale.min(front_m / x_m);
    }
    if x_m < rear_m {
        scale = scale.min(rear_m / x_m);
    }
    if y_m.abs() > left_m {
        scale = scale.min(left_m / y_m.abs());
    }
    let (x_m, y_m) = (x_m * scale, y_m * scale);
    let forward = ((x_m - rear_m) / LOCAL_GRID.cell_m).clamp(0.0, (LOCAL_SIDE - 1) as f32) as usize;
    let half = LOCAL_SIDE / 2;
    let outward = (y_m.abs() / LOCAL_GRID.cell_m).min((half - 1) as f32) as usize;
    let left = y_m > 0.0 || (y_m.abs() < f32::MIN_POSITIVE && on_axis == Side::Left);
    let (row, col) = (LOCAL_SIDE - 1 - forward, if left { half - 1 - outward } else { half + outward });
    let (x_m, y_m) = LOCAL_GRID.centre(row, col);
    Some(Projection { cell: row * LOCAL_SIDE + col, x_m, y_m })
}

/// Keeps a goal that lies nearly straight behind on one side, since left and right cost the same there.
///
/// Returns y on the kept side and the side to keep. A first goal straight behind goes to the side the robot turns to.
#[must_use]
pub(crate) fn keep_side(x_m: f32, y_m: f32, side_rad: f32, kept: Option<Side>, twist: Twist) -> (f32, Side) {
    let behind = x_m < 0.0 && libm::atan2f(y_m.abs(), -x_m) < side_rad;
    let turning = if twist.w_rad_s < 0.0 { Side::Right } else { Side::Left };
    let seen = if y_m > 0.0 {
        Side::Left
    } else if y_m < 0.0 {
        Side::Right
    } else {
        turning
    };
    let side = if behind { kept.unwrap_or(seen) } else { seen };
    let y_m = if !behind {
        y_m
    } else if side == Side::Left {
        y_m.abs()
    } else {
        -y_m.abs()
    };
    (y_m, side)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row_col(x_m: f32, y_m: f32) -> (usize, usize) {
        let cell = project(x_m, y_m, Side::Left).unwrap().cell;
        (cell / LOCAL_SIDE, cell % LOCAL_SIDE)
    }

    /// Paper: x_g > x_max and y in range gives (x_max, y_g / x_g * x_max).
    #[test]
    fn ahead_of_the_map_it_is_the_printed_case() {
        assert_eq!(row_col(4.8, 1.1), LOCAL_GRID.row_col(2.39, 0.55).unwrap());
        assert_eq!(row_col(24.0, -13.9), LOCAL_GRID.row_col(2.39, -1.39).unwrap());
    }

    #[test]
    fn where_both_bounds_are_crossed_the_smaller_scale_rules() {
        // (3.0, 7.0): the side is crossed first, at (0.6, 1.4). (4.8, 1.6): the front, at (2.4, 0.8).
        assert_eq!(row_col(3.01, 7.0), LOCAL_GRID.row_col(0.601, 1.39).unwrap());
        assert_eq!(row_col(4.8, 1.62), LOCAL_GRID.row_col(2.39, 0.81).unwrap());
        assert_eq!(row_col(24.0, 14.0), (0, 0));
        assert_eq!(row_col(24.0, -14.0), (0, 27));
    }

    #[test]
    fn beside_the_robot_the_side_border_takes_it() {
        assert_eq!(row_col(0.0, 9.0).1, 0);
        assert_eq!(row_col(0.0, -9.0).1, 27);
        assert_eq!(row_col(0.0, 9.0).0, row_col(0.0, 0.0).0);
    }

    #[test]
    fn behind_the_robot_the_rear_border_takes_it() {
        assert_eq!(row_col(-2.0, 0.6), LOCAL_GRID.row_col(-0.39, 0.12).unwrap());
        assert_eq!(row_col(-0.5, 0.01), (27, 13));
    }

    #[test]
    fn a_goal_on_the_border_lies_in_the_last_cell() {
        for (x_m, y_m, cell) in
            [(2.4, 0.05, (0, 13)), (-0.4, 0.05, (27, 13)), (0.05, 1.4, (23, 0)), (0.05, -1.4, (23, 27))]
        {
            assert_eq!(row_col(x_m, y_m), cell, "{x_m} {y_m}");
        }
    }

    #[test]
    fn a_goal_at_the_robot_has_the_robots_cell_on_the_side_asked_for() {
        assert_eq!(project(0.05, 0.0, Side::Left).unwrap().cell, 23 * 28 + 13);
        assert_eq!(project(0.05, -0.0, Side::Right).unwrap().cell, 23 * 28 + 14);
    }

    #[test]
    fn what_is_not_finite_has_no_cell() {
        for (x_m, y_m) in [(f32::NAN, 0.0), (0.0, f32::NAN), (f32::INFINITY, 0.0), (0.0, f32::NEG_INFINITY)] {
            assert_eq!(project(x_m, y_m, Side::Left), None);
        }
    }

    #[test]
    fn straight_behind_the_side_is_kept_until_the_goal_leaves_the_sector() {
        let keep = |y_m, kept| keep_side(-2.0, y_m, 0.35, kept, Twist::STOP);
        assert_eq!(keep(-0.1, Some(Side::Left)), (0.1, Side::Left));
        assert_eq!(keep(0.1, Some(Side::Right)), (-0.1, Side::Right));
        assert_eq!(keep(-1.0, Some(Side::Left)), (-1.0, Side::Right));
        assert_eq!(keep(-0.1, None), (-0.1, Side::Right));
        assert_eq!(keep_side(-2.0, 0.0, 0.35, None, Twist::new(0.0, -0.1)).1, Side::Right);
    }

    proptest! {
        #[test]
        fn inside_the_map_the_cell_is_the_one_that_holds_the_goal(x in -0.399_f32..2.399, y in -1.399_f32..1.399) {
            let found = project(x, y, Side::Left).unwrap();
            prop_assert!((found.x_m - x).abs() < 0.0501 && (found.y_m - y).abs() < 0.0501);
        }

        #[test]
        fn outside_the_cell_lies_on_the_border_and_on_the_ray(angle in -3.1_f32..3.1, range in 3.0_f32..1e6) {
            let (x, y) = (range * libm::cosf(angle), range * libm::sinf(angle));
            let found = project(x, y, Side::Left).unwrap();
            let (row, col) = (found.cell / 28, found.cell % 28);
            prop_assert!(row == 0 || row == 27 || col == 0 || col == 27);
            let across = (found.x_m * y - found.y_m * x) / range;
            prop_assert!(across.abs() < 0.08 && found.x_m * x + found.y_m * y > 0.0);
        }

        #[test]
        fn a_mirrored_goal_has_the_mirrored_cell(x in -9.0_f32..9.0, y in -90_i32..90) {
            let y = y as f32 * 0.1;
            let (one, other) = (project(x, y, Side::Left).unwrap(), project(x, -y, Side::Right).unwrap());
            prop_assert_eq!((one.cell / 28, one.cell % 28), (other.cell / 28, 27 - other.cell % 28));
        }
    }
}

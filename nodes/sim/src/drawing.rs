//! Solids drawn into the grids of the maps, exactly: for maps made from the world itself, without camera and mapper.

use crate::solid::{Outline, Solid};
use sidestep_msgs::{Grid, Pose2};
use std::ops::RangeInclusive;

/// `[1/255]` probability of what is known to stand there; in an array of ages, the mark of what nobody saw.
const TAKEN: u8 = 255;

/// A solid of the world, placed in the frame of a pose.
#[must_use]
pub fn seen_from(solid: &Solid, pose: &Pose2) -> Solid {
    let (x_m, y_m) = pose.inverse_transform(solid.x_m, solid.y_m);
    let (sin, cos) = libm::sincos(pose.yaw_rad);
    let outline = match solid.outline {
        Outline::Rectangle { half_length_m, half_width_m, cos: c, sin: s } => {
            Outline::Rectangle { half_length_m, half_width_m, cos: c * cos + s * sin, sin: s * cos - c * sin }
        }
        disc @ Outline::Disc { .. } => disc,
    };
    Solid { x_m, y_m, outline, ..*solid }
}

/// Marks every cell that a solid in the grid's frame touches, with 255.
pub fn draw(solid: &Solid, grid: &Grid, cells: &mut [u8]) {
    runs(solid, grid, |run| cells[run].fill(TAKEN));
}

/// Lowers every cell to how far, in m, a solid in the grid's frame must be grown to touch it, where that is `most_m` or less.
pub fn near(solid: &Solid, most_m: f64, grid: &Grid, cells: &mut [f32]) {
    let Some(grown) = solid.grown(most_m) else { return };
    let cell_m = f64::from(grid.cell_m);
    runs(&grown, grid, |run| {
        let (x, y) = grid.centre(run.start() / grid.side, run.start() % grid.side);
        let (x, y) = (f64::from(x), f64::from(y));
        for (step, cell) in cells[run].iter_mut().enumerate() {
            let growth_m = solid.growth_m([x, y - step as f64 * cell_m], 0.5 * cell_m) as f32;
            *cell = if growth_m < *cell { growth_m } else { *cell };
        }
    });
}

/// Names the cells that a solid in the grid's frame touches: it is convex, so that in each row these are one run of cells.
fn runs(solid: &Solid, grid: &Grid, mut take: impl FnMut(RangeInclusive<usize>)) {
    let (cell_m, rear_m, right_m) = (f64::from(grid.cell_m), f64::from(grid.rear_m), f64::from(grid.right_m));
    let last = grid.side as f64 - 1.0;
    let corners = solid.corners();
    let least = corners.iter().map(|corner| corner[0]).fold(f64::INFINITY, f64::min);
    let most = corners.iter().map(|corner| corner[0]).fold(f64::NEG_INFINITY, f64::max);
    let (first, end) =
        (libm::floor((least - rear_m) / cell_m).max(0.0), libm::floor((most - rear_m) / cell_m).min(last));
    if first > end {
        return;
    }
    for forward in first as usize..=end as usize {
        let behind_m = rear_m + forward as f64 * cell_m;
        let Some((from_m, to_m)) = across(solid, &corners, behind_m, behind_m + cell_m) else { continue };
        let right = libm::floor((from_m - right_m) / cell_m).max(0.0);
        let left = libm::floor((to_m - right_m) / cell_m).min(last);
        if right <= left {
            let last_of_row = (grid.side - forward) * grid.side - 1;
            take(last_of_row - left as usize..=last_of_row - right as usize);
        }
    }
}

/// Least and most y of the part of a solid between two values of x; `None` where nothing of it lies there.
fn across(solid: &Solid, corners: &[[f64; 2]; 4], behind_m: f64, ahead_m: f64) -> Option<(f64, f64)> {
    if let Outline::Disc { radius_m } = solid.outline {
        let off_m = (behind_m - solid.x_m).max(solid.x_m - ahead_m).max(0.0);
        let half_m = libm::sqrt(radius_m * radius_m - off_m * off_m);
        return (off_m <= radius_m).then_some((solid.y_m - half_m, solid.y_m + half_m));
    }
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut take = |y: f64| (least, most) = (least.min(y), most.max(y));
    for (index, corner) in corners.iter().enumerate() {
        let next = corners[(index + 1) % 4];
        if (behind_m..=ahead_m).contains(&corner[0]) {
            take(corner[1]);
        }
        for edge_m in [behind_m, ahead_m] {
            if (corner[0] - edge_m) * (next[0] - edge_m) < 0.0 {
                take(corner[1] + (next[1] - corner[1]) * (edge_m - corner[0]) / (next[0] - corner[0]));
            }
        }
    }
    (least <= most).then_some((least, most))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{LOCAL_GRID, LOCAL_SIDE};

    /// Blocks and columns at many places and turns; every cell is compared with the gap between solid and cell.
    #[test]
    fn a_cell_is_taken_exactly_where_a_solid_touches_it() {
        for step in 0..200 {
            let t = f64::from(step);
            let centre = [1.0 + libm::sin(t), 1.2 * libm::cos(1.7 * t)];
            let height = [0.0, 1.0];
            let size = [0.02 + 0.9 * libm::fabs(libm::sin(0.3 * t)), 0.3];
            let solid = if step % 3 == 0 {
                Solid::column(centre, 0.5 * size[0], height)
            } else {
                Solid::block(centre, size, t, height)
            };
            let mut cells = [0; LOCAL_SIDE * LOCAL_SIDE];
            draw(&solid, &LOCAL_GRID, &mut cells);
            for (index, cell) in cells.iter().enumerate() {
                let (x, y) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
                let corner = |dx: f64, dy: f64| [f64::from(x) + 0.05 * dx, f64::from(y) + 0.05 * dy];
                let square = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                let deep = square.map(|[a, b]| {
                    [f64::from(x) + 0.98 * (a - f64::from(x)), f64::from(y) + 0.98 * (b - f64::from(y))]
                });
                assert!(solid.gap_m(&square) < 1e-5 || *cell == 0, "step {step}, cell {index}: not touched");
                assert!(solid.gap_m(&deep) > 0.0 || *cell == TAKEN, "step {step}, cell {index}: missed");
            }
        }
    }

    #[test]
    fn a_solid_is_seen_where_the_robot_looks() {
        let pose = Pose2::new(2.0, 1.0, std::f64::consts::FRAC_PI_2);
        let seen = seen_from(&Solid::block([1.5, 2.0], [0.4, 0.1], 0.3, [0.0, 1.0]), &pose);
        assert!((seen.x_m - 1.0).abs() < 1e-9 && (seen.y_m - 0.5).abs() < 1e-9, "{seen:?}");
        let Outline::Rectangle { cos, sin, .. } = seen.outline else { panic!("{seen:?}") };
        let yaw = libm::atan2(sin, cos);
        assert!((yaw - (0.3 - std::f64::consts::FRAC_PI_2)).abs() < 1e-9, "{yaw}");
    }
}

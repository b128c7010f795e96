//! What the robot knows without a camera: the floor it stands on is free, and so is the disc it was granted at its start.

use crate::grid::{CELL_M, Grid, Moment, cells_near};
use sidestep_msgs::{Pose2, Robot};

/// Makes the cells that lie wholly under the footprint free: nothing else can be where the robot is.
pub(crate) fn free_under(robot: &Robot, pose: &Pose2, now: &Moment, grid: &mut Grid) {
    let polygon = &robot.footprint.polygon_m;
    for [x, y] in round(grid, pose, robot.radius_m()) {
        let under = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].iter().all(|(dx, dy)| {
            let (px_m, py_m) = point(grid, x as f64 + dx, y as f64 + dy);
            let (bx, by) = pose.inverse_transform(px_m, py_m);
            inside(polygon, bx as f32, by as f32)
        });
        if under {
            grid.set_free(grid.index(x, y), now);
        }
    }
}

/// Grants the disc round the start: cells in it that were never seen become free, as seen at `now`.
pub(crate) fn grant_disc(radius_m: f32, pose: &Pose2, now: &Moment, grid: &mut Grid) {
    for [x, y] in round(grid, pose, radius_m) {
        let (px_m, py_m) = point(grid, x as f64 + 0.5, y as f64 + 0.5);
        let distance_m = libm::hypot(px_m - pose.x_m, py_m - pose.y_m);
        let index = grid.index(x, y);
        if distance_m <= f64::from(radius_m) && grid.seen_tick[index] == 0 {
            grid.set_free(index, now);
        }
    }
}

fn point(grid: &Grid, x: f64, y: f64) -> (f64, f64) {
    let [ox, oy] = grid.origin();
    ((f64::from(ox) + x) * CELL_M, (f64::from(oy) + y) * CELL_M)
}

/// The cells within a radius of the robot, and a cell more.
fn round(grid: &Grid, pose: &Pose2, radius_m: f32) -> impl Iterator<Item = [usize; 2]> + use<> {
    cells_near(grid.window(pose.x_m, pose.y_m), radius_m / CELL_M as f32 + 1.0)
}

/// Whether a point lies in a convex, counter-clockwise polygon.
fn inside(polygon: &[[f32; 2]], x: f32, y: f32) -> bool {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).all(|(a, b)| (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) >= 0.0)
}

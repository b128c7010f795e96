//! The way that a camera or robot took, as a path to follow.

use sidestep_msgs::{PATH_POINTS, Path, PathPoint, Pose2};

/// `[m]` between two points of the path.
const PATH_STEP_M: f64 = 0.25;

/// Fills a path with a point every 0.25 m along the poses; one that stands still looks at a point ahead.
pub fn way(poses: impl Iterator<Item = Pose2>, pose_epoch: u32, path: &mut Path) {
    *path = Path { id: 1, pose_epoch, ..Path::default() };
    let mut last: Option<Pose2> = None;
    for pose in poses {
        let far = last.is_none_or(|last| last.distance_m(&pose) >= PATH_STEP_M);
        if far && (path.count as usize) < PATH_POINTS {
            path.points[path.count as usize] = PathPoint { x_m: pose.x_m as f32, y_m: pose.y_m as f32 };
            path.count += 1;
            last = Some(pose);
        }
    }
    if path.count == 1 {
        path.points[1] = PathPoint { x_m: path.points[0].x_m + 3.0, ..path.points[0] };
        path.count = 2;
    }
}

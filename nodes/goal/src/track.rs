//! A path as a line with lengths: where along it is the robot, and what lies how far along.

use sidestep_msgs::{PATH_POINTS, Path, PathPoint};

/// Price of each metre of progress against each metre of distance: where a path meets itself, the earlier branch wins.
const ADVANCE_PRICE: f64 = 0.1;
/// `[m]` coordinates beyond this are garbage.
const FARTHEST_M: f32 = 1e6;

/// The path's points with the length up to each.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    points: Vec<(f64, f64)>,
    /// `[m]` length from the first point to each.
    along_m: Vec<f64>,
}

impl Track {
    pub(crate) fn new() -> Self {
        Self { points: Vec::with_capacity(PATH_POINTS), along_m: Vec::with_capacity(PATH_POINTS) }
    }

    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.along_m.clear();
    }

    /// Takes the points; a path with a point that is not finite, or with an impossible count, is empty.
    pub(crate) fn measure(&mut self, path: &Path) {
        self.clear();
        let count = path.count as usize;
        let is_sane = |point: &PathPoint| point.x_m.abs() <= FARTHEST_M && point.y_m.abs() <= FARTHEST_M;
        if count > PATH_POINTS || !path.points[..count].iter().all(is_sane) {
            return;
        }
        let mut length_m = 0.0;
        for point in &path.points[..count] {
            let next = (f64::from(point.x_m), f64::from(point.y_m));
            if let Some(last) = self.points.last() {
                length_m += libm::hypot(next.0 - last.0, next.1 - last.1);
            }
            self.points.push(next);
            self.along_m.push(length_m);
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// `[m]` length of the path.
    pub(crate) fn length_m(&self) -> f64 {
        self.along_m.last().copied().unwrap_or(0.0)
    }

    /// The point that lies `along_m` from the start, in `odom`; ends are kept.
    pub(crate) fn at(&self, along_m: f64) -> (f64, f64) {
        let next = self.along_m.partition_point(|&length| length <= along_m);
        if next == 0 || next >= self.points.len() {
            let end = if next == 0 { self.points.first() } else { self.points.last() };
            return end.copied().unwrap_or((0.0, 0.0));
        }
        let (from, to) = (self.points[next - 1], self.points[next]);
        let part = (along_m - self.along_m[next - 1]) / (self.along_m[next] - self.along_m[next - 1]);
        (from.0 + part * (to.0 - from.0), from.1 + part * (to.1 - from.1))
    }

    /// `[m]` progress of a robot at a point of `odom`: the nearest place from `progress_m` on, at most `window_m` ahead.
    pub(crate) fn advance(&self, progress_m: f64, x_m: f64, y_m: f64, window_m: f64) -> f64 {
        let end_m = progress_m + window_m;
        let first = self.along_m.partition_point(|&length| length <= progress_m).max(1);
        let (mut best_m, mut least) = (progress_m, f64::INFINITY);
        for next in first..self.points.len() {
            let (start_m, stop_m) = (self.along_m[next - 1], self.along_m[next]);
            if start_m > end_m {
                break;
            }
            let (from, to) = (self.points[next - 1], self.points[next]);
            let length_m = stop_m - start_m;
            if length_m <= 0.0 {
                continue;
            }
            let (ux, uy) = ((to.0 - from.0) / length_m, (to.1 - from.1) / length_m);
            let along = (x_m - from.0) * ux + (y_m - from.1) * uy;
            let place_m = (start_m + along).clamp(start_m.max(progress_m), stop_m.min(end_m));
            let on = place_m - start_m;
            let distance_m = libm::hypot(from.0 + on * ux - x_m, from.1 + on * uy - y_m);
            let price = distance_m + ADVANCE_PRICE * (place_m - progress_m);
            if price < least {
                (best_m, least) = (place_m, price);
            }
        }
        best_m
    }
}

#[cfg(test)]
pub(crate) fn path(id: u64, points: &[(f32, f32)]) -> Path {
    let mut path = Path { id, count: points.len() as u32, ..Path::default() };
    for (to, &(x_m, y_m)) in path.points.iter_mut().zip(points) {
        *to = PathPoint { x_m, y_m };
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn track(points: &[(f32, f32)]) -> Track {
        let mut track = Track::new();
        track.measure(&path(1, points));
        track
    }

    #[test]
    fn lengths_and_places_are_those_of_the_polygon() {
        let track = track(&[(0.0, 0.0), (3.0, 0.0), (3.0, 0.0), (3.0, 4.0)]);
        assert!((track.length_m() - 7.0).abs() < 1e-12);
        for (along_m, place) in
            [(-1.0, (0.0, 0.0)), (1.5, (1.5, 0.0)), (3.0, (3.0, 0.0)), (5.0, (3.0, 2.0)), (9.0, (3.0, 4.0))]
        {
            assert_eq!(track.at(along_m), place);
        }
    }

    #[test]
    fn garbage_is_an_empty_path() {
        let mut track = track(&[(0.0, 0.0), (f32::NAN, 0.0)]);
        assert!(track.is_empty());
        track.measure(&Path { count: u32::MAX, ..Path::default() });
        assert!(track.is_empty() && track.at(1.0) == (0.0, 0.0));
        assert!(track.advance(0.0, 1.0, 1.0, 1.0).abs() < 1e-12);
    }

    /// A figure of eight through the origin, branches 6.3 m apart along the path: driving it never cuts a loop.
    #[test]
    fn a_path_that_crosses_itself_is_driven_in_order() {
        let points: Vec<(f32, f32)> = (0..=200)
            .map(|step| {
                let t = step as f32 / 200.0 * std::f32::consts::TAU;
                (libm::sinf(t) * 2.0, libm::sinf(2.0 * t))
            })
            .collect();
        let track = track(&points);
        let mut progress_m = 0.0;
        for step in 0..=400 {
            let driven_m = track.length_m() * f64::from(step) / 400.0;
            let (x_m, y_m) = track.at(driven_m);
            progress_m = track.advance(progress_m, x_m, y_m + 0.02, 1.5);
            assert!((progress_m - driven_m).abs() < 0.06, "{driven_m} {progress_m}");
        }
    }

    /// There and back on the same line: the way back is not taken for the way out.
    #[test]
    fn a_path_that_returns_on_itself_is_driven_to_its_turn_first() {
        let track = track(&[(0.0, 0.0), (5.0, 0.0), (0.0, 0.0)]);
        let mut progress_m = 0.0;
        for step in 0..=50 {
            progress_m = track.advance(progress_m, f64::from(step) * 0.1, 0.0, 1.5);
            assert!((progress_m - f64::from(step) * 0.1).abs() < 1e-6, "{step}: {progress_m}");
        }
        progress_m = track.advance(progress_m, 4.5, 0.0, 1.5);
        assert!((progress_m - 5.5).abs() < 1e-6, "{progress_m}");
    }

    proptest! {
        #[test]
        fn progress_never_runs_back_nor_beyond_the_window(
            points in prop::collection::vec((-5.0_f32..5.0, -5.0_f32..5.0), 1..40),
            robots in prop::collection::vec((-6.0_f64..6.0, -6.0_f64..6.0), 1..40),
        ) {
            let track = track(&points);
            let mut progress_m = 0.0;
            for (x_m, y_m) in robots {
                let next_m = track.advance(progress_m, x_m, y_m, 1.5);
                prop_assert!(next_m >= progress_m && next_m <= progress_m + 1.5 + 1e-9);
                prop_assert!(next_m <= track.length_m() + 1e-9);
                progress_m = next_m;
            }
        }
    }
}

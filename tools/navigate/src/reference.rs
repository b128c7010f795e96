//! The reference path that a global planner would give: the cheapest way on a coarse grid, with room to both sides.

use sidestep_sim::{World, resample};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// `[m]` side of a cell of the search.
const CELL_M: f64 = 0.1;
/// `[m]` clearance from which more of it is worth nothing.
const ROOMY_M: f64 = 0.9;
/// `[1]` price of a metre without clearance, beside its length.
const NARROW_PRICE: f64 = 2.0;
/// `[1/m]` whole prices per metre: equal sums whatever their order.
const PRICE_UNIT: f64 = 100_000.0;
/// Passes of a moving mean over the path found.
const SMOOTHINGS: usize = 20;
/// `[m]` whatever reaches below this height stands in the way.
pub(crate) const TOP_M: f64 = 1.0;

/// The clearance of a rectangle of floor, cell by cell.
pub(crate) struct Floor<'a> {
    world: &'a World,
    size_m: [f64; 2],
    columns: usize,
    rows: usize,
    clearance_m: Vec<f64>,
}

impl<'a> Floor<'a> {
    /// The floor between the origin and `size_m`.
    pub(crate) fn new(world: &'a World, size_m: [f64; 2]) -> Self {
        let [columns, rows] = size_m.map(|side| libm::floor(side / CELL_M) as usize + 1);
        let place = |index: usize| [(index % columns) as f64 * CELL_M, (index / columns) as f64 * CELL_M];
        let clearance_m = (0..columns * rows).map(|index| world.clearance_m(place(index), TOP_M)).collect();
        Self { world, size_m, columns, rows, clearance_m }
    }

    fn place(&self, index: usize) -> [f64; 2] {
        [(index % self.columns) as f64 * CELL_M, (index / self.columns) as f64 * CELL_M]
    }

    fn index(&self, point_m: [f64; 2]) -> usize {
        let [x, y] = [0, 1].map(|axis| libm::round(point_m[axis].clamp(0.0, self.size_m[axis]) / CELL_M));
        (y as usize).min(self.rows - 1) * self.columns + (x as usize).min(self.columns - 1)
    }

    /// The way from one point to another for a disc of `radius_m`, every 0.1 m; `None` where there is none.
    pub(crate) fn way(&self, from_m: [f64; 2], to_m: [f64; 2], radius_m: f64) -> Option<Vec<[f64; 2]>> {
        let (start, goal) = (self.index(from_m), self.index(to_m));
        let before = self.search(start, goal, radius_m)?;
        let mut points = vec![to_m];
        let mut at = goal;
        while at != start {
            at = before[at];
            points.push(self.place(at));
        }
        points.push(from_m);
        points.reverse();
        self.smooth(&mut points, radius_m);
        Some(resample(&points, CELL_M))
    }

    /// For each cell reached the one before it.
    fn search(&self, start: usize, goal: usize, radius_m: f64) -> Option<Vec<usize>> {
        let mut least = vec![u64::MAX; self.clearance_m.len()];
        let mut before = vec![start; least.len()];
        let mut open = BinaryHeap::from([(Reverse(0_u64), start)]);
        least[start] = 0;
        while let Some((Reverse(spent), at)) = open.pop() {
            if at == goal {
                return Some(before);
            }
            if spent > least[at] {
                continue;
            }
            for (next, length_m) in self.neighbours(at) {
                if self.clearance_m[next] < radius_m {
                    continue;
                }
                let narrow = (1.0 - self.clearance_m[next] / ROOMY_M).max(0.0);
                let price = spent + (length_m * (1.0 + NARROW_PRICE * narrow) * PRICE_UNIT) as u64;
                if price < least[next] {
                    (least[next], before[next]) = (price, at);
                    open.push((Reverse(price), next));
                }
            }
        }
        None
    }

    fn neighbours(&self, at: usize) -> impl Iterator<Item = (usize, f64)> {
        let (column, row) = ((at % self.columns) as i64, (at / self.columns) as i64);
        (0..9_i64).filter(|step| *step != 4).filter_map(move |step| {
            let (dx, dy) = (step % 3 - 1, step / 3 - 1);
            let (x, y) = (column + dx, row + dy);
            let inside = (0..self.columns as i64).contains(&x) && (0..self.rows as i64).contains(&y);
            let length_m = CELL_M * libm::sqrt((dx * dx + dy * dy) as f64);
            inside.then_some((y as usize * self.columns + x as usize, length_m))
        })
    }

    /// Moves each point towards the middle of its neighbours, where that keeps the clearance.
    fn smooth(&self, points: &mut [[f64; 2]], radius_m: f64) {
        for _ in 0..SMOOTHINGS {
            for index in 1..points.len().saturating_sub(1) {
                let (before, after) = (points[index - 1], points[index + 1]);
                let middle =
                    [0, 1].map(|axis| 0.5 * points[index][axis] + 0.25 * (before[axis] + after[axis]));
                if self.world.clearance_m(middle, TOP_M) >= radius_m {
                    points[index] = middle;
                }
            }
        }
    }
}

/// Whether a disc cannot follow a line of points, the robot's start excepted.
pub(crate) fn is_blocked(world: &World, line_m: &[[f64; 2]], radius_m: f64) -> bool {
    resample(line_m, 0.5 * CELL_M).iter().any(|point| world.clearance_m(*point, TOP_M) < radius_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_sim::Solid;

    /// A wall with a door at its end: the way leads through the door, keeps its distance, and is no longer than it must.
    #[test]
    fn the_way_leads_through_the_door_with_room_to_both_sides() {
        let mut world = World::empty();
        world.solids.push(Solid::wall([3.0, 0.0], [3.0, 2.9], 0.1, 2.0));
        world.solids.push(Solid::wall([3.0, 4.1], [3.0, 6.0], 0.1, 2.0));
        let floor = Floor::new(&world, [6.0, 6.0]);
        let way = floor.way([1.0, 1.0], [5.0, 1.0], 0.45).unwrap();
        assert!(way.iter().all(|point| world.clearance_m(*point, TOP_M) >= 0.44), "{way:?}");
        let length_m: f64 =
            way.windows(2).map(|pair| libm::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1])).sum();
        assert!(length_m < 7.6, "{length_m}");
        assert!(is_blocked(&world, &[[1.0, 1.0], [5.0, 1.0]], 0.3));
        assert!(!is_blocked(&world, &way, 0.4));
    }

    #[test]
    fn where_a_disc_does_not_fit_there_is_no_way() {
        let mut world = World::empty();
        world.solids.push(Solid::wall([3.0, 0.0], [3.0, 2.9], 0.1, 2.0));
        world.solids.push(Solid::wall([3.0, 3.7], [3.0, 6.0], 0.1, 2.0));
        assert!(Floor::new(&world, [6.0, 6.0]).way([1.0, 1.0], [5.0, 1.0], 0.45).is_none());
    }
}

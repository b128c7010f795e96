//! The middle of a gap: where an advance towards a goal gets farthest.
//!
//! The footprint is tried, turned to the goal, on lines beside each other that lead there. No path is planned: the answer
//! is a point to head for, and every motion towards it passes the filter as any other.

use crate::clearance::{Heading, Outline, Rows};

/// `[m]` between lines, and how many lie on either side of the straight one.
const ASIDE_M: f32 = 0.02;
const LINES: i32 = 15;
/// `[m]` between the places tried on a line, and the numbers of the first and the last.
const ALONG_M: f32 = 0.1;
const FIRST: i32 = 2;
const LAST: i32 = 7;
const STEPS: usize = (LAST - FIRST + 1) as usize;
/// `[m]` ahead where the point to head for lies.
const AIM_M: f32 = 0.4;

/// Where to head for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Aim {
    /// `[m]` in `base`.
    pub(crate) x_m: f32,
    pub(crate) y_m: f32,
    /// Whether it leads through a gap this side of the goal: free for 0.7 m, and on both sides not.
    pub(crate) is_gap: bool,
}

/// What is needed to look for gaps from where the robot is.
pub(crate) struct Gaps<'a> {
    pub(crate) outline: &'a Outline,
    pub(crate) blocked: &'a Rows,
    pub(crate) at: Heading,
    /// `[m]` by which the outline is widened.
    pub(crate) margin_m: f32,
}

impl Gaps<'_> {
    /// The point to head for, with a goal at a point of `base`; of lines that lead equally far, the middle one of those side
    /// by side that are nearest to the straight one.
    pub(crate) fn aim(&self, goal_m: (f64, f64)) -> Aim {
        let (x_m, y_m) = (goal_m.0 as f32, goal_m.1 as f32);
        let range_m = libm::hypotf(x_m, y_m);
        let (cos, sin) = if range_m > 1e-3 { (x_m / range_m, y_m / range_m) } else { (1.0, 0.0) };
        let at = &self.at;
        let along = [at.cos * cos - at.sin * sin, at.sin * cos + at.cos * sin];
        let far: [usize; 2 * LINES as usize + 1] =
            std::array::from_fn(|line| self.steps(along, (line as i32 - LINES) as f32 * ASIDE_M));
        let most = far.iter().copied().max().unwrap_or(0);
        let aside_m = if most == 0 { 0.0 } else { middle_of(&far, most) * ASIDE_M };
        let has_sides = far[0] < most && far[far.len() - 1] < most;
        Aim {
            x_m: AIM_M * cos - aside_m * sin,
            y_m: AIM_M * sin + aside_m * cos,
            is_gap: range_m > LAST as f32 * ALONG_M && most == STEPS && has_sides,
        }
    }

    /// Places where the outline stands free, one after another on the line along `along` and `aside_m` to its left.
    fn steps(&self, along: [f32; 2], aside_m: f32) -> usize {
        let is_free = |step: &i32| {
            let ahead_m = *step as f32 * ALONG_M;
            let place = Heading {
                x_m: self.at.x_m + ahead_m * along[0] - aside_m * along[1],
                y_m: self.at.y_m + ahead_m * along[1] + aside_m * along[0],
                cos: along[0],
                sin: along[1],
            };
            self.outline.blocked(&place, self.margin_m, self.blocked).is_none()
        };
        (FIRST..=LAST).take_while(is_free).count()
    }
}

/// The middle, in lines from the straight one, of the run of lines that lead `most` steps and is nearest to the straight one.
fn middle_of(far: &[usize], most: usize) -> f32 {
    let straight = (far.len() / 2) as f32;
    let mut best = f32::MAX;
    let mut begin = 0;
    for run in far.chunk_by(|a, b| (*a == most) == (*b == most)) {
        let middle = begin as f32 + 0.5 * (run.len() as f32 - 1.0) - straight;
        if run[0] == most && middle.abs() < best.abs() {
            best = middle;
        }
        begin += run.len();
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::loomo;
    use sidestep_msgs::SAFETY_SIDE;

    const MIDDLE: Heading = Heading { x_m: 0.0, y_m: 0.0, cos: 1.0, sin: 0.0 };

    /// The aim at a goal ahead, where cells are taken that lie so.
    fn aimed(taken: impl Fn(f32, f32) -> bool, goal_x_m: f64) -> Aim {
        let mut rows: Rows = [0; SAFETY_SIDE];
        for (row, bits) in rows.iter_mut().enumerate() {
            for bit in 0..SAFETY_SIDE {
                let (x_m, y_m) = ((row as f32 - 39.5) * 0.05, (bit as f32 - 39.5) * 0.05);
                *bits |= u128::from(taken(x_m, y_m)) << bit;
            }
        }
        let outline = Outline::new(&loomo()).unwrap();
        Gaps { outline: &outline, blocked: &rows, at: MIDDLE, margin_m: 0.025 }.aim((goal_x_m, 0.0))
    }

    /// A door of 0.8 m whose middle lies `left_m` to the left, in a wall ahead.
    fn door(left_m: f32) -> impl Fn(f32, f32) -> bool {
        move |x_m, y_m| (0.5..0.6).contains(&x_m) && (y_m - left_m).abs() > 0.4
    }

    #[test]
    fn the_aim_is_the_middle_of_a_gap_on_either_side() {
        for left_m in [-0.2, -0.1, 0.0, 0.1, 0.2] {
            let Aim { x_m, y_m, is_gap } = aimed(door(left_m), 2.0);
            assert!((y_m - left_m).abs() < 0.011 && (x_m - 0.4).abs() < 1e-6 && is_gap, "{left_m}: {y_m}");
        }
    }

    #[test]
    fn what_leads_nowhere_has_open_sides_or_lies_behind_the_goal_is_no_gap() {
        assert_eq!(aimed(|_, _| false, 2.0), Aim { x_m: 0.4, y_m: 0.0, is_gap: false });
        assert!(!aimed(|x_m, _| x_m > 0.6, 2.0).is_gap);
        assert!(!aimed(|x_m, y_m| x_m > 0.3 && y_m > 0.35, 2.0).is_gap);
        assert!(!aimed(door(0.0), 0.6).is_gap);
    }

    /// In lines from the straight one; of two runs equally near, the right one.
    #[test]
    fn of_several_runs_the_nearest_one_counts() {
        for (far, middle) in [
            ([6, 6, 0, 0, 0, 6, 6, 6, 6], 2.5),
            ([0, 6, 6, 6, 0, 0, 0, 0, 0], -2.0),
            ([6, 6, 6, 0, 0, 0, 6, 6, 6], -3.0),
        ] {
            assert!((middle_of(&far, 6) - middle).abs() < 1e-6, "{far:?}");
        }
    }
}

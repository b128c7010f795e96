//! What the world is made of: upright blocks and columns, and how far the robot's outline is from them.

/// Shape on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outline {
    /// A rectangle turned by a yaw.
    Rectangle {
        /// `[m]` half of the side along the solid's own x axis.
        half_length_m: f64,
        /// `[m]` half of the side along the solid's own y axis.
        half_width_m: f64,
        /// `[1]` cosine of the yaw in the world.
        cos: f64,
        /// `[1]` sine of the yaw in the world.
        sin: f64,
    },
    /// A disc.
    Disc {
        /// `[m]` radius.
        radius_m: f64,
    },
}

/// An upright prism or cylinder in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    /// `[m]` centre along x of the world.
    pub x_m: f64,
    /// `[m]` centre along y of the world.
    pub y_m: f64,
    /// `[m]` lower face above the floor.
    pub bottom_m: f64,
    /// `[m]` upper face above the floor.
    pub top_m: f64,
    /// Shape on the floor.
    pub outline: Outline,
}

impl Solid {
    /// A block of `length_m` by `width_m` turned by `yaw_rad`.
    #[must_use]
    pub fn block(centre_m: [f64; 2], size_m: [f64; 2], yaw_rad: f64, height_m: [f64; 2]) -> Self {
        let (sin, cos) = libm::sincos(yaw_rad);
        let outline =
            Outline::Rectangle { half_length_m: 0.5 * size_m[0], half_width_m: 0.5 * size_m[1], cos, sin };
        Self { x_m: centre_m[0], y_m: centre_m[1], bottom_m: height_m[0], top_m: height_m[1], outline }
    }

    /// A wall between two points of its middle line.
    #[must_use]
    pub fn wall(from_m: [f64; 2], to_m: [f64; 2], thickness_m: f64, top_m: f64) -> Self {
        let (dx, dy) = (to_m[0] - from_m[0], to_m[1] - from_m[1]);
        let centre = [0.5 * (from_m[0] + to_m[0]), 0.5 * (from_m[1] + to_m[1])];
        Self::block(centre, [libm::hypot(dx, dy), thickness_m], libm::atan2(dy, dx), [0.0, top_m])
    }

    /// A column.
    #[must_use]
    pub fn column(centre_m: [f64; 2], radius_m: f64, height_m: [f64; 2]) -> Self {
        let outline = Outline::Disc { radius_m };
        Self { x_m: centre_m[0], y_m: centre_m[1], bottom_m: height_m[0], top_m: height_m[1], outline }
    }

    /// `[m]` radius of the circle round the centre that holds the outline.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, .. } => {
                libm::hypot(half_length_m, half_width_m)
            }
            Outline::Disc { radius_m } => radius_m,
        }
    }

    /// `[m]` how far it may be shrunk before nothing is left of it.
    fn least_m(&self) -> f64 {
        match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, .. } => half_length_m.min(half_width_m),
            Outline::Disc { radius_m } => radius_m,
        }
    }

    /// The solid with its sides or its radius moved out by `by_m`, or in by a negative one; `None` where nothing is left of it.
    #[must_use]
    pub fn grown(&self, by_m: f64) -> Option<Self> {
        let outline = match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, cos, sin } => Outline::Rectangle {
                half_length_m: half_length_m + by_m,
                half_width_m: half_width_m + by_m,
                cos,
                sin,
            },
            Outline::Disc { radius_m } => Outline::Disc { radius_m: radius_m + by_m },
        };
        (self.least_m() + by_m > 0.0).then_some(Self { outline, ..*self })
    }

    /// `[m]` how far it must be grown, or with a negative number may be shrunk, to touch a square with sides along the axes
    /// and no more: of the four directions that can separate two rectangles, the one that takes most.
    #[must_use]
    pub fn growth_m(&self, centre_m: [f64; 2], half_side_m: f64) -> f64 {
        let (dx, dy) = (centre_m[0] - self.x_m, centre_m[1] - self.y_m);
        let (off_x, off_y) = (dx.abs() - half_side_m, dy.abs() - half_side_m);
        let greater = |a: f64, b: f64| if a > b { a } else { b };
        match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, cos, sin } => {
                let (c, s) = (cos.abs(), sin.abs());
                let (own_m, per_growth) = (half_side_m * (c + s), 1.0 / (c + s));
                let ahead = (cos * dx + sin * dy).abs() - own_m - half_length_m;
                let aside = (cos * dy - sin * dx).abs() - own_m - half_width_m;
                let x = (off_x - half_length_m * c - half_width_m * s) * per_growth;
                let y = (off_y - half_length_m * s - half_width_m * c) * per_growth;
                greater(greater(ahead, aside), greater(greater(x, y), -self.least_m()))
            }
            Outline::Disc { radius_m } => {
                let (x, y) = (greater(off_x, 0.0), greater(off_y, 0.0));
                libm::sqrt(x * x + y * y) - radius_m
            }
        }
    }

    /// `[m]` corners of a rectangle, counter-clockwise; of the square round a disc.
    #[must_use]
    pub fn corners(&self) -> [[f64; 2]; 4] {
        let (l, w, cos, sin) = match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, cos, sin } => {
                (half_length_m, half_width_m, cos, sin)
            }
            Outline::Disc { radius_m } => (radius_m, radius_m, 1.0, 0.0),
        };
        [[-l, -w], [l, -w], [l, w], [-l, w]]
            .map(|[x, y]| [self.x_m + cos * x - sin * y, self.y_m + sin * x + cos * y])
    }

    /// `[m]` distance of a point on the floor to the outline; 0 inside.
    #[must_use]
    pub fn distance_m(&self, point_m: [f64; 2]) -> f64 {
        let (dx, dy) = (point_m[0] - self.x_m, point_m[1] - self.y_m);
        match self.outline {
            Outline::Rectangle { half_length_m, half_width_m, cos, sin } => {
                let ahead = (cos * dx + sin * dy).abs() - half_length_m;
                let aside = (cos * dy - sin * dx).abs() - half_width_m;
                libm::hypot(ahead.max(0.0), aside.max(0.0))
            }
            Outline::Disc { radius_m } => (libm::hypot(dx, dy) - radius_m).max(0.0),
        }
    }

    /// Whether it stands in the robot's way: something of it lies between the floor and `top_m`.
    #[must_use]
    pub fn is_in_band(&self, top_m: f64) -> bool {
        self.bottom_m < top_m && self.top_m > 0.0
    }

    /// `[m]` distance between the outline and a convex polygon, counter-clockwise; 0 where they overlap.
    #[must_use]
    pub fn gap_m(&self, polygon_m: &[[f64; 2]]) -> f64 {
        match self.outline {
            Outline::Disc { radius_m } => {
                (distance_to_polygon_m([self.x_m, self.y_m], polygon_m) - radius_m).max(0.0)
            }
            Outline::Rectangle { .. } => {
                let corners = self.corners();
                if overlap(&corners, polygon_m) {
                    return 0.0;
                }
                let to_polygon = corners.iter().map(|c| distance_to_polygon_m(*c, polygon_m));
                let to_solid = polygon_m.iter().map(|c| self.distance_m(*c));
                to_polygon.chain(to_solid).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

fn edges(polygon: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
    (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]))
}

/// Distance of a point to a convex polygon, counter-clockwise; 0 inside.
fn distance_to_polygon_m(point: [f64; 2], polygon: &[[f64; 2]]) -> f64 {
    let mut inside = true;
    let mut nearest = f64::INFINITY;
    for (a, b) in edges(polygon) {
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        let (px, py) = (point[0] - a[0], point[1] - a[1]);
        inside &= ex * py - ey * px >= 0.0;
        let part = ((px * ex + py * ey) / (ex * ex + ey * ey).max(1e-12)).clamp(0.0, 1.0);
        nearest = nearest.min(libm::hypot(px - part * ex, py - part * ey));
    }
    if inside { 0.0 } else { nearest }
}

/// Whether two convex polygons overlap: no edge of either separates them.
fn overlap(one: &[[f64; 2]], other: &[[f64; 2]]) -> bool {
    let separated = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        edges(a).any(|(from, to)| {
            let (ex, ey) = (to[0] - from[0], to[1] - from[1]);
            b.iter().all(|p| ex * (p[1] - from[1]) - ey * (p[0] - from[0]) < 0.0)
        })
    };
    !separated(one, other) && !separated(other, one)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 2]; 4] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];

    #[test]
    fn gaps_are_those_of_plane_geometry() {
        let column = Solid::column([2.0, 0.0], 0.3, [0.0, 1.0]);
        assert!((column.gap_m(&SQUARE) - 1.2).abs() < 1e-12);
        let block = Solid::block([2.0, 0.0], [1.0, 1.0], 0.0, [0.0, 1.0]);
        assert!((block.gap_m(&SQUARE) - 1.0).abs() < 1e-12);
        let diagonal = Solid::block([2.0, 0.0], [1.0, 1.0], std::f64::consts::FRAC_PI_4, [0.0, 1.0]);
        assert!((diagonal.gap_m(&SQUARE) - (1.5 - libm::sqrt(0.5))).abs() < 1e-12);
    }

    #[test]
    fn a_grown_solid_is_nearer_by_as_much_and_one_shrunk_to_nothing_is_none() {
        let column = Solid::column([2.0, 0.0], 0.3, [0.0, 1.0]);
        let block = Solid::block([2.0, 0.0], [1.0, 0.2], 0.0, [0.0, 1.0]);
        for solid in [column, block] {
            for by_m in [-0.09, -0.01, 0.0, 0.15] {
                let gap_m = solid.grown(by_m).unwrap().gap_m(&SQUARE);
                assert!((gap_m - (solid.gap_m(&SQUARE) - by_m)).abs() < 1e-12, "{solid:?} by {by_m}");
            }
        }
        assert_eq!((column.grown(-0.3), block.grown(-0.1)), (None, None));
    }

    /// Blocks and columns at many places and turns: grown a little more they touch the square, a little less they do not.
    #[test]
    fn what_is_grown_by_its_growth_just_touches() {
        for step in 0..400 {
            let t = f64::from(step);
            let centre = [0.9 * libm::sin(t), 0.9 * libm::cos(1.7 * t)];
            let size = 0.02 + 0.9 * libm::fabs(libm::sin(0.3 * t));
            let solid = if step % 3 == 0 {
                Solid::column(centre, 0.5 * size, [0.0, 1.0])
            } else {
                Solid::block(centre, [size, 0.3], t, [0.0, 1.0])
            };
            let growth_m = solid.growth_m([0.0; 2], 0.5);
            let touches = |by_m| solid.grown(by_m).is_some_and(|grown| grown.gap_m(&SQUARE) < 1e-9);
            assert!(touches(growth_m + 1e-6) && !touches(growth_m - 1e-6), "step {step}: {growth_m}");
        }
    }

    #[test]
    fn crossing_bars_touch_although_no_corner_lies_inside() {
        let bar = Solid::block([0.0, 0.0], [4.0, 0.1], 0.7, [0.0, 1.0]);
        assert!(bar.gap_m(&SQUARE) < 1e-12);
        assert!(Solid::column([0.0, 0.0], 0.01, [0.0, 1.0]).gap_m(&SQUARE) < 1e-12);
    }
}

//! Ranges in a horizontal plane: lidar beams and ultrasonic cones.

use crate::solid::{Outline, Solid};

/// `[m]` distance from `origin_m` along the unit `direction` to the outline of a solid; infinite where it misses.
///
/// From inside an outline the distance is 0.
pub(crate) fn range_m(solid: &Solid, origin_m: [f64; 2], direction: [f64; 2]) -> f64 {
    let o = [origin_m[0] - solid.x_m, origin_m[1] - solid.y_m];
    let (enter, leave) = match solid.outline {
        Outline::Disc { radius_m } => {
            let along = o[0] * direction[0] + o[1] * direction[1];
            let cross = o[0] * direction[1] - o[1] * direction[0];
            let half2 = radius_m * radius_m - cross * cross;
            if half2 < 0.0 {
                return f64::INFINITY;
            }
            let half = libm::sqrt(half2);
            (-along - half, -along + half)
        }
        Outline::Rectangle { half_length_m, half_width_m, cos, sin } => {
            let turn = |p: [f64; 2]| [cos * p[0] + sin * p[1], cos * p[1] - sin * p[0]];
            let (o, d) = (turn(o), turn(direction));
            let slab = |o: f64, d: f64, half: f64| {
                if d.abs() < 1e-12 {
                    let inside = o.abs() <= half;
                    return if inside { (f64::NEG_INFINITY, f64::INFINITY) } else { (1.0, -1.0) };
                }
                let (a, b) = ((-half - o) / d, (half - o) / d);
                (a.min(b), a.max(b))
            };
            let (x, y) = (slab(o[0], d[0], half_length_m), slab(o[1], d[1], half_width_m));
            (x.0.max(y.0), x.1.min(y.1))
        }
    };
    if leave < enter || leave < 0.0 { f64::INFINITY } else { enter.max(0.0) }
}

/// `[m]` shortens the ranges of evenly spread beams by one solid; only beams that can meet it are touched.
///
/// Beam `i` looks along `first_rad + i * step_rad` in the world.
pub(crate) fn shorten(
    ranges_m: &mut [f64],
    solid: &Solid,
    origin_m: [f64; 2],
    first_rad: f64,
    step_rad: f64,
) {
    let (dx, dy) = (solid.x_m - origin_m[0], solid.y_m - origin_m[1]);
    let (distance, reach) = (libm::hypot(dx, dy), solid.reach_m());
    let half_rad = if distance > reach { libm::asin(reach / distance) } else { std::f64::consts::PI };
    let middle = sidestep_msgs::wrap_angle(libm::atan2(dy, dx) - first_rad);
    // The middle may lie a turn before or after the first beam.
    for turn in [-1.0, 0.0, 1.0] {
        let centre = middle + turn * std::f64::consts::TAU;
        let from = libm::ceil((centre - half_rad) / step_rad).max(0.0) as usize;
        let to =
            (libm::floor((centre + half_rad) / step_rad) + 1.0).clamp(0.0, ranges_m.len() as f64) as usize;
        for (index, range) in ranges_m.iter_mut().enumerate().take(to).skip(from) {
            let (sin, cos) = libm::sincos(first_rad + index as f64 * step_rad);
            *range = range.min(range_m(solid, origin_m, [cos, sin]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_plane_geometry() {
        let disc = Solid::column([3.0, 0.0], 0.5, [0.0, 1.0]);
        assert!((range_m(&disc, [0.0, 0.0], [1.0, 0.0]) - 2.5).abs() < 1e-12);
        assert!(range_m(&disc, [0.0, 0.6], [1.0, 0.0]).is_infinite());
        assert!(range_m(&disc, [0.0, 0.0], [-1.0, 0.0]).is_infinite());
        let block = Solid::block([3.0, 0.0], [2.0, 1.0], std::f64::consts::FRAC_PI_2, [0.0, 1.0]);
        assert!((range_m(&block, [0.0, 0.9], [1.0, 0.0]) - 2.5).abs() < 1e-9);
        assert!(range_m(&block, [0.0, 1.1], [1.0, 0.0]).is_infinite());
        assert!(range_m(&block, [3.0, 0.0], [1.0, 0.0]).abs() < 1e-12);
    }

    #[test]
    fn shortening_by_bounds_is_the_same_as_casting_every_beam() {
        let world = crate::World::office(2);
        for (first, step) in [(-2.356, 4.712 / 719.0), (2.9, 6.2 / 500.0), (-9.0, 0.01)] {
            let origin = [5.2, 2.4];
            let mut fast = [f64::INFINITY; 500];
            let mut slow = fast;
            for solid in &world.solids {
                shorten(&mut fast, solid, origin, first, step);
                for (index, range) in slow.iter_mut().enumerate() {
                    let (sin, cos) = libm::sincos(first + index as f64 * step);
                    *range = range.min(range_m(solid, origin, [cos, sin]));
                }
            }
            let same = fast.iter().zip(&slow).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{first} {step}");
        }
    }
}

//! Exact depth of the scene at every pixel, by a z-buffer of inverse depth.
//!
//! The inverse depth of a plane is affine in the pixel, so that a face of a block is filled with one addition and one
//! comparison per pixel; a column is solved per pixel inside its bounds. Faces turned away and solids outside the
//! view are dropped before any pixel is touched.

use crate::solid::{Outline, Solid};
use sidestep_msgs::{Isometry, Pose2};

/// `[m]` nothing nearer is drawn.
const NEAR_M: f32 = 0.02;
/// Most corners of a face after clipping at the near plane.
const CORNERS_MAX: usize = 8;

type Vector = [f32; 3];

fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Where the camera is and how it projects.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) focal: [f32; 2],
    pub(crate) centre: [f32; 2],
    origin_m: [f64; 3],
    right: Vector,
    down: Vector,
    forward: Vector,
}

impl View {
    /// The camera, mounted in `body`, of a base at `pose` with a pitch.
    pub(crate) fn new(
        size: [usize; 2],
        focal: [f32; 2],
        camera: &Isometry,
        pose: &Pose2,
        pitch_rad: f64,
    ) -> Self {
        let (sin_yaw, cos_yaw) = libm::sincos(pose.yaw_rad);
        let (sin_pitch, cos_pitch) = libm::sincos(pitch_rad);
        let to_world = |p: [f64; 3]| {
            let (x, z) = (cos_pitch * p[0] + sin_pitch * p[2], cos_pitch * p[2] - sin_pitch * p[0]);
            [cos_yaw * x - sin_yaw * p[1], sin_yaw * x + cos_yaw * p[1], z]
        };
        let rotation = camera.rotation();
        let axis =
            |i: usize| to_world([0, 1, 2].map(|row: usize| f64::from(rotation[row][i]))).map(|x| x as f32);
        let mounted = to_world(camera.translation_m.map(f64::from));
        Self {
            width: size[0],
            height: size[1],
            focal,
            centre: size.map(|pixels| 0.5 * (pixels as f32 - 1.0)),
            origin_m: [pose.x_m + mounted[0], pose.y_m + mounted[1], mounted[2]],
            right: axis(0),
            down: axis(1),
            forward: axis(2),
        }
    }

    /// A world point, from the camera, along world axes.
    fn relative(&self, x_m: f64, y_m: f64, z_m: f64) -> Vector {
        [x_m - self.origin_m[0], y_m - self.origin_m[1], z_m - self.origin_m[2]].map(|d| d as f32)
    }

    /// The point in camera axes (right, down, forward).
    fn turn(&self, relative: Vector) -> Vector {
        [dot(self.right, relative), dot(self.down, relative), dot(self.forward, relative)]
    }

    /// Coefficients (per column, per row, constant) of the inverse depth of the plane through `point` with `normal`.
    fn plane(&self, point: Vector, normal: Vector) -> [f32; 3] {
        let scale = 1.0 / dot(normal, point);
        let per_column = scale * dot(normal, self.right) / self.focal[0];
        let per_row = scale * dot(normal, self.down) / self.focal[1];
        let ahead = scale * dot(normal, self.forward);
        [per_column, per_row, ahead - per_column * self.centre[0] - per_row * self.centre[1]]
    }

    /// Whether a ball lies wholly outside the view or beyond `far_m`.
    fn misses(&self, centre: Vector, radius: f32, far_m: f32) -> bool {
        let [x, y, z] = self.turn(centre);
        let beyond = |offset: f32, half: f32, focal: f32| {
            offset.abs() * focal - z * half > radius * libm::sqrtf(focal * focal + half * half)
        };
        z + radius < NEAR_M
            || z - radius > far_m
            || beyond(x, self.centre[0] + 1.0, self.focal[0])
            || beyond(y, self.centre[1] + 1.0, self.focal[1])
    }
}

/// The z-buffer.
#[derive(Debug, Clone)]
pub(crate) struct Raster {
    /// `[1/m]` inverse depth per pixel; 0 = nothing.
    pub(crate) inverse_m: Vec<f32>,
    left: Vec<f32>,
    right: Vec<f32>,
}

impl Raster {
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self { inverse_m: vec![0.0; width * height], left: vec![0.0; height], right: vec![0.0; height] }
    }

    /// Draws the floor and everything up to `far_m`.
    pub(crate) fn draw(&mut self, view: &View, solids: impl Iterator<Item = Solid>, far_m: f32) {
        self.floor(view);
        for solid in solids {
            let half_m = 0.5 * (solid.top_m - solid.bottom_m);
            let centre = view.relative(solid.x_m, solid.y_m, solid.bottom_m + half_m);
            let radius = libm::hypot(solid.reach_m(), half_m) as f32;
            if view.misses(centre, radius, far_m) {
                continue;
            }
            match solid.outline {
                Outline::Rectangle { cos, sin, .. } => {
                    self.block(view, &solid, [cos as f32, sin as f32]);
                }
                Outline::Disc { radius_m } => self.column(view, &solid, radius_m as f32),
            }
        }
    }

    fn floor(&mut self, view: &View) {
        let [per_column, per_row, constant] = view.plane(view.relative(0.0, 0.0, 0.0), [0.0, 0.0, 1.0]);
        for (row, line) in self.inverse_m.chunks_exact_mut(view.width).enumerate() {
            let at_left = constant + per_row * row as f32;
            for (column, pixel) in line.iter_mut().enumerate() {
                let inverse = at_left + per_column * column as f32;
                *pixel = if inverse > 0.0 { inverse } else { 0.0 };
            }
        }
    }

    fn block(&mut self, view: &View, solid: &Solid, yaw: [f32; 2]) {
        let corners = solid.corners();
        let low = corners.map(|c| view.relative(c[0], c[1], solid.bottom_m));
        let high = corners.map(|c| view.relative(c[0], c[1], solid.top_m));
        let [cos, sin] = yaw;
        let sides = [[sin, -cos, 0.0], [cos, sin, 0.0], [-sin, cos, 0.0], [-cos, -sin, 0.0]];
        for (i, normal) in sides.into_iter().enumerate() {
            let next = (i + 1) % 4;
            self.face(view, &[low[i], low[next], high[next], high[i]], normal);
        }
        self.face(view, &high, [0.0, 0.0, 1.0]);
        self.face(view, &low, [0.0, 0.0, -1.0]);
    }

    /// Fills one face, if it is turned towards the camera.
    fn face(&mut self, view: &View, corners: &[Vector; 4], normal: Vector) {
        if dot(normal, corners[0]) > -1e-5 {
            return;
        }
        let plane = view.plane(corners[0], normal);
        let (outline, count) = clip_near(&corners.map(|corner| view.turn(corner)));
        let projected = outline.map(|[x, y, z]| {
            let z = z.max(NEAR_M);
            [view.focal[0] * x / z + view.centre[0], view.focal[1] * y / z + view.centre[1]]
        });
        let Some((first, last)) = self.spans(view, &projected[..count]) else { return };
        for row in first..=last {
            let (from, to) = clamp_span(self.left[row], self.right[row], view.width);
            let at_left = plane[2] + plane[1] * row as f32;
            let line = &mut self.inverse_m[row * view.width + from..row * view.width + to];
            for (offset, pixel) in line.iter_mut().enumerate() {
                let inverse = at_left + plane[0] * (from + offset) as f32;
                *pixel = if inverse > *pixel { inverse } else { *pixel };
            }
        }
    }

    /// Left and right end of a convex outline in every row it crosses; first and last such row.
    fn spans(&mut self, view: &View, outline: &[[f32; 2]]) -> Option<(usize, usize)> {
        let top = outline.iter().fold(f32::INFINITY, |least, p| least.min(p[1]));
        let bottom = outline.iter().fold(f32::NEG_INFINITY, |most, p| most.max(p[1]));
        if outline.len() < 3 || bottom < 0.0 || top > (view.height - 1) as f32 {
            return None;
        }
        let first = libm::ceilf(top.max(0.0)) as usize;
        let last = libm::floorf(bottom.min((view.height - 1) as f32)) as usize;
        if first > last {
            return None;
        }
        self.left[first..=last].fill(f32::INFINITY);
        self.right[first..=last].fill(f32::NEG_INFINITY);
        for i in 0..outline.len() {
            let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
            let (upper, lower) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            let slope = (lower[0] - upper[0]) / (lower[1] - upper[1]).max(1e-6);
            let from = libm::ceilf(upper[1].max(first as f32)) as usize;
            let to = libm::floorf(lower[1].min(last as f32));
            if to < 0.0 {
                continue;
            }
            for row in from..=to as usize {
                let x = upper[0] + slope * (row as f32 - upper[1]);
                self.left[row] = self.left[row].min(x);
                self.right[row] = self.right[row].max(x);
            }
        }
        Some((first, last))
    }

    /// Solves the column per pixel within the bounds of the block round it.
    fn column(&mut self, view: &View, solid: &Solid, radius: f32) {
        let Some([left, right, top, bottom]) = bounds(view, solid) else { return };
        let [x, y, _] = view.relative(solid.x_m, solid.y_m, 0.0);
        let outside = x * x + y * y - radius * radius;
        if outside <= 0.0 {
            return;
        }
        let per_outside = 1.0 / outside;
        let low = (solid.bottom_m - view.origin_m[2]) as f32;
        let high = (solid.top_m - view.origin_m[2]) as f32;
        // The horizontal face that can be seen: the top from above, the bottom from below.
        let cap = if high < 0.0 { 1.0 / high } else { 1.0 / low };
        let step = view.right.map(|r| r / view.focal[0]);
        for row in top..=bottom {
            let across = (row as f32 - view.centre[1]) / view.focal[1];
            let start = [0, 1, 2].map(|i| view.forward[i] + across * view.down[i] - view.centre[0] * step[i]);
            let line = &mut self.inverse_m[row * view.width + left..row * view.width + right];
            for (offset, pixel) in line.iter_mut().enumerate() {
                let u = (left + offset) as f32;
                let (dx, dy, dz) = (start[0] + step[0] * u, start[1] + step[1] * u, start[2] + step[2] * u);
                let cross = dx * y - dy * x;
                // Not a number where the ray passes by; then every comparison below is false.
                let root = ((dx * dx + dy * dy) * radius * radius - cross * cross).sqrt();
                let along = dx * x + dy * y;
                let (near, far) = ((along + root) * per_outside, (along - root) * per_outside);
                let on_side = dz >= low * near && dz <= high * near;
                let flat = dz * cap;
                let on_cap = flat <= near && flat >= far && flat > 0.0 && !on_side;
                let inverse = if on_cap { flat } else { near };
                *pixel = if (on_side || on_cap) && inverse > *pixel { inverse } else { *pixel };
            }
        }
    }
}

/// Columns `from..to` of a span.
fn clamp_span(left: f32, right: f32, width: usize) -> (usize, usize) {
    let from = libm::ceilf(left.max(0.0)) as usize;
    let to = (libm::floorf(right.min((width - 1) as f32)) + 1.0).max(0.0) as usize;
    (from.min(to), to)
}

/// Columns `left..right` and rows `top..=bottom` that hold the block round a column, or `None` outside the view.
fn bounds(view: &View, solid: &Solid) -> Option<[usize; 4]> {
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for corner in solid.corners() {
        for z_m in [solid.bottom_m, solid.top_m] {
            let [x, y, z] = view.turn(view.relative(corner[0], corner[1], z_m));
            if z < NEAR_M {
                return Some([0, view.width, 0, view.height - 1]);
            }
            let at = [view.focal[0] * x / z + view.centre[0], view.focal[1] * y / z + view.centre[1]];
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
    }
    let (left, right) = clamp_span(low[0], high[0], view.width);
    let (top, bottom) = clamp_span(low[1], high[1], view.height);
    (left < right && top < bottom).then(|| [left, right, top, bottom - 1])
}

/// Cuts off what lies nearer than the near plane (Sutherland and Hodgman).
fn clip_near(corners: &[Vector; 4]) -> ([Vector; CORNERS_MAX], usize) {
    let mut out = [[0.0; 3]; CORNERS_MAX];
    let mut count = 0;
    for i in 0..4 {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        if a[2] >= NEAR_M {
            out[count] = a;
            count += 1;
        }
        if (a[2] >= NEAR_M) != (b[2] >= NEAR_M) {
            let part = (NEAR_M - a[2]) / (b[2] - a[2]);
            out[count] = [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), NEAR_M];
            count += 1;
        }
    }
    (out, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOCAL: f32 = 300.0;
    const SIZE: [usize; 2] = [320, 240];

    fn view(pose: Pose2, pitch_rad: f64) -> View {
        let camera = Isometry::camera(0.1, 0.0, 0.55, 0.17);
        View::new(SIZE, [FOCAL; 2], &camera, &pose, pitch_rad)
    }

    fn depth(solids: &[Solid], view: &View) -> Vec<f32> {
        let mut raster = Raster::new(SIZE[0], SIZE[1]);
        raster.draw(view, solids.iter().copied(), 50.0);
        raster.inverse_m.iter().map(|inverse| 1.0 / inverse).collect()
    }

    /// The ray of a pixel in the world, of unit depth.
    fn ray(view: &View, column: usize, row: usize) -> Vector {
        let u = (column as f32 - view.centre[0]) / view.focal[0];
        let v = (row as f32 - view.centre[1]) / view.focal[1];
        [0, 1, 2].map(|i| view.forward[i] + u * view.right[i] + v * view.down[i])
    }

    #[test]
    fn the_floor_is_where_its_rays_meet_it_at_every_row_and_pitch() {
        for pitch in [-0.1, 0.0, 0.05] {
            let view = view(Pose2::new(1.0, 2.0, 0.7), pitch);
            let found = depth(&[], &view);
            for (pixel, depth) in found.iter().enumerate() {
                let down = -ray(&view, pixel % SIZE[0], pixel / SIZE[0])[2];
                let expected = if down > 1e-4 { view.origin_m[2] as f32 / down } else { f32::INFINITY };
                assert!(
                    expected > 1e3 || (depth / expected - 1.0).abs() < 1e-3,
                    "{pixel}: {depth} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_wall_straight_ahead_has_its_distance_at_every_pixel_of_a_level_camera() {
        let camera = Isometry::camera(0.1, 0.0, 0.55, 0.0);
        let view = View::new(SIZE, [FOCAL; 2], &camera, &Pose2::ORIGIN, 0.0);
        let wall = Solid::block([3.05, 0.0], [0.1, 20.0], 0.0, [0.0, 5.0]);
        let found = depth(&[wall], &view);
        for (pixel, depth) in found.iter().enumerate() {
            let down = -ray(&view, pixel % SIZE[0], pixel / SIZE[0])[2];
            let floor = if down > 1e-4 { 0.55 / down } else { f32::INFINITY };
            assert!((depth - floor.min(2.9)).abs() < 2e-3, "{pixel}: {depth}");
        }
    }

    /// Casts every ray against every solid by slabs and quadratics in double precision.
    fn cast(solids: &[Solid], view: &View, column: usize, row: usize) -> f64 {
        let d = ray(view, column, row).map(f64::from);
        let mut nearest = if d[2] < 0.0 { view.origin_m[2] / -d[2] } else { f64::INFINITY };
        for solid in solids {
            let o = [view.origin_m[0] - solid.x_m, view.origin_m[1] - solid.y_m];
            let slab = |o: f64, d: f64, low: f64, high: f64| {
                let (a, b) = ((low - o) / d, (high - o) / d);
                (a.min(b), a.max(b))
            };
            let mut spans = vec![slab(view.origin_m[2], d[2], solid.bottom_m, solid.top_m)];
            match solid.outline {
                Outline::Rectangle { half_length_m: l, half_width_m: w, cos, sin } => {
                    spans.push(slab(cos * o[0] + sin * o[1], cos * d[0] + sin * d[1], -l, l));
                    spans.push(slab(cos * o[1] - sin * o[0], cos * d[1] - sin * d[0], -w, w));
                }
                Outline::Disc { radius_m: r } => {
                    let (a, b) = (d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1]);
                    let root = (b * b - a * (o[0] * o[0] + o[1] * o[1] - r * r)).sqrt();
                    spans.push(((-b - root) / a, (-b + root) / a));
                }
            }
            let enter =
                spans.iter().fold(f64::NEG_INFINITY, |most, span| if span.0 > most { span.0 } else { most });
            let missed = spans.iter().any(|span| span.1.is_nan() || span.1 < enter);
            if !missed && enter > 0.0 && enter < nearest {
                nearest = enter;
            }
        }
        nearest
    }

    #[test]
    fn an_office_drawn_is_an_office_cast() {
        let world = crate::World::office(5);
        let mut random = crate::random::Random::new(9);
        for _ in 0..40 {
            let pose =
                Pose2::new(random.between(0.5, 11.5), random.between(0.5, 7.5), random.between(-3.0, 3.0));
            if world.clearance_m([pose.x_m, pose.y_m], 3.0) < 0.3 {
                continue;
            }
            let view = view(pose, random.between(-0.05, 0.05));
            let found = depth(&world.solids, &view);
            let (mut wrong, mut checked) = (0, 0);
            for pixel in (0..SIZE[0] * SIZE[1]).step_by(7) {
                let expected = cast(&world.solids, &view, pixel % SIZE[0], pixel / SIZE[0]) as f32;
                checked += 1;
                if (found[pixel] - expected).abs() > 1e-3 * expected {
                    wrong += 1;
                }
            }
            // Only pixels whose ray grazes an edge may differ.
            assert!(wrong * 1000 <= checked, "{wrong} of {checked} pixels differ at {pose:?}");
        }
    }
}

//! A tiny world for tests and the bench: a floor with holes, and boxes, seen by a pinhole camera without noise.

#![allow(dead_code, reason = "each test binary uses its own part")]

use sidestep_msgs::{DepthFrame, Isometry, Odometry, Pose2, Robot};

/// A box that stands or hangs: least and greatest corner in `odom`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    /// `[m]` least corner.
    pub(crate) least: [f64; 3],
    /// `[m]` greatest corner.
    pub(crate) most: [f64; 3],
}

/// The world.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scene {
    /// Boxes.
    pub(crate) blocks: Vec<Block>,
    /// `[m]` rectangles (x from, x to, y from, y to) where the floor lies 0.5 m deeper.
    pub(crate) holes: Vec<[f64; 4]>,
    /// Where the floor gives no return.
    pub(crate) black: Vec<[f64; 4]>,
}

/// The robot, its tilt and its camera at one moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Pose of `base` in `odom`.
    pub(crate) pose: Pose2,
    /// `[rad]` roll of the body.
    pub(crate) roll_rad: f32,
    /// `[rad]` pitch of the body.
    pub(crate) pitch_rad: f32,
    /// Camera in `body`.
    pub(crate) camera: Isometry,
}

/// The Loomo of the shipped robot file.
pub(crate) fn loomo() -> Robot {
    let text = include_str!("../../../../launch/robots/loomo.toml");
    Robot::from_toml("loomo.toml", text).unwrap_or_else(|error| unreachable!("{error}"))
}

/// The Jackal of the shipped robot file.
pub(crate) fn jackal() -> Robot {
    let text = include_str!("../../../../launch/robots/jackal.toml");
    Robot::from_toml("jackal.toml", text).unwrap_or_else(|error| unreachable!("{error}"))
}

impl View {
    /// The shipped camera: 0.55 m high, 10 degrees down.
    pub(crate) fn level(pose: Pose2) -> Self {
        let camera = Isometry::camera(0.1, 0.0, 0.55, 10f32.to_radians());
        Self { pose, roll_rad: 0.0, pitch_rad: 0.0, camera }
    }

    /// The odometry message of this moment.
    pub(crate) fn odometry(&self, stamp_ns: u64) -> Odometry {
        Odometry {
            stamp_ns,
            pose: self.pose,
            roll_rad: self.roll_rad,
            pitch_rad: self.pitch_rad,
            ..Odometry::default()
        }
    }
}

/// A frame without pixels, 640 x 480 or a part of it, in millimetres.
pub(crate) fn frame(divide: u32) -> Box<DepthFrame> {
    let mut frame: Box<DepthFrame> = Box::default();
    let scale = 1.0 / divide as f32;
    (frame.width, frame.height) = (640 / divide, 480 / divide);
    frame.metres_per_unit = 0.001;
    (frame.fx_px, frame.fy_px) = (606.97 * scale, 606.97 * scale);
    frame.cx_px = 0.5 * frame.width as f32 - 0.5;
    frame.cy_px = 0.5 * frame.height as f32 - 0.5;
    frame
}

fn turn(axis: usize, angle_rad: f64) -> [[f64; 3]; 3] {
    let (s, c) = libm::sincos(angle_rad);
    match axis {
        0 => [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
        1 => [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        _ => [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
    }
}

fn apply(turn: &[[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    turn.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
}

impl Scene {
    /// A box standing on the floor.
    pub(crate) fn stand(mut self, x_m: [f64; 2], y_m: [f64; 2], height_m: f64) -> Self {
        self.blocks.push(Block { least: [x_m[0], y_m[0], -1.0], most: [x_m[1], y_m[1], height_m] });
        self
    }

    /// A box hanging between two heights.
    pub(crate) fn hang(mut self, x_m: [f64; 2], y_m: [f64; 2], z_m: [f64; 2]) -> Self {
        self.blocks.push(Block { least: [x_m[0], y_m[0], z_m[0]], most: [x_m[1], y_m[1], z_m[1]] });
        self
    }

    /// Renders what a camera sees, exact but for the rounding to whole units.
    pub(crate) fn render(&self, view: &View, capture_ns: u64, frame: &mut DepthFrame) {
        frame.capture_ns = capture_ns;
        frame.camera = view.camera;
        let body = |p: [f64; 3]| {
            let p = apply(&turn(1, view.pitch_rad.into()), apply(&turn(0, view.roll_rad.into()), p));
            apply(&turn(2, view.pose.yaw_rad), p)
        };
        let mount = view.camera.rotation().map(|row| row.map(f64::from));
        let eye = body(view.camera.translation_m.map(f64::from));
        let eye = [eye[0] + view.pose.x_m, eye[1] + view.pose.y_m, eye[2]];
        let (width, unit) = (frame.width as usize, f64::from(frame.metres_per_unit));
        let count = width * frame.height as usize;
        for (index, pixel) in frame.pixels[..count].iter_mut().enumerate() {
            let x = ((index % width) as f64 - f64::from(frame.cx_px)) / f64::from(frame.fx_px);
            let y = ((index / width) as f64 - f64::from(frame.cy_px)) / f64::from(frame.fy_px);
            let ray = body(apply(&mount, [x, y, 1.0]));
            let depth_m = self.depth_m(eye, ray);
            let units = depth_m / unit + 0.5;
            *pixel = if units < 60_000.0 { units as u16 } else { 0 };
        }
    }

    /// Depth along a ray, infinite where nothing is.
    fn depth_m(&self, eye: [f64; 3], ray: [f64; 3]) -> f64 {
        let mut nearest = f64::INFINITY;
        if ray[2] < 0.0 {
            let at = |height: f64| {
                let t = (height - eye[2]) / ray[2];
                (t, [eye[0] + t * ray[0], eye[1] + t * ray[1]])
            };
            let within = |areas: &[[f64; 4]], p: [f64; 2]| {
                areas.iter().any(|a| p[0] >= a[0] && p[0] < a[1] && p[1] >= a[2] && p[1] < a[3])
            };
            let (t, p) = at(0.0);
            nearest = match (within(&self.holes, p), within(&self.black, p)) {
                (true, _) => at(-0.5).0,
                (_, true) => f64::INFINITY,
                _ => t,
            };
        }
        for block in &self.blocks {
            let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
            for k in 0..3 {
                let (a, b) = ((block.least[k] - eye[k]) / ray[k], (block.most[k] - eye[k]) / ray[k]);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            }
            if enter < leave && enter < nearest {
                nearest = enter;
            }
        }
        nearest
    }
}

//! The whole simulated robot: commands in; odometry, ranges, paths, depth, scans and truth out; time from outside.

use crate::base::Response;
use crate::config::{Config, ConfigError};
use crate::motion::{Motion, Outline};
use crate::people::People;
use crate::planar;
use crate::random::{Random, mix};
use crate::raster::{Raster, View};
use crate::solid::Solid;
use crate::stereo::{FAR_FACTOR, Stereo, UNIT_M};
use crate::world::{World, resample};
use sidestep_msgs::{
    Camera, Command, DepthFrame, Isometry, Odometry, PATH_POINTS, Path, PathPoint, Pose2, Range, Ranges,
    Robot, SCAN_BEAMS, Scan, Truth, Twist,
};

/// `[ns]` step of the integration.
const STEP_NS: u64 = 1_000_000;
/// `[m]` a path is done when the robot is this near to its end.
const ARRIVED_M: f64 = 0.35;
/// `[m]` between the points of a published path.
const SPACING_M: f64 = 0.1;
/// `[rad]` standard deviation of the measured pitch.
const PITCH_SIGMA_RAD: f64 = 0.002;
/// `[1]` standard deviation of an ultrasonic range, of the range.
const SONAR_SIGMA: f64 = 0.01;
/// Rays of an ultrasonic cone.
const SONAR_RAYS: usize = 9;

#[derive(Debug, Clone)]
struct Eye {
    camera: Camera,
    mount: Isometry,
    size: [usize; 2],
    focal: [f32; 2],
    raster: Raster,
    stereo: Stereo,
    frames: u64,
}

/// A robot in a world.
#[derive(Debug, Clone)]
pub struct Simulator {
    robot: Robot,
    world: World,
    noise: bool,
    response: Response,
    outline: Outline,
    /// State at `grid_ns`, a whole number of steps after the beginning.
    motion: Motion,
    grid_ns: Option<u64>,
    /// State at `now_ns`.
    current: Motion,
    now_ns: u64,
    eye: Option<Eye>,
    beams_m: Vec<f64>,
    random: Random,
    leg: usize,
    arrivals: u32,
    path_due: bool,
    pose_epoch: u32,
}

impl Simulator {
    /// A robot at `start` in a world; time begins with the first call that names one.
    #[must_use]
    pub fn new(config: &Config, robot: &Robot, world: World, start: Pose2, seed: u64) -> Self {
        let mut random = Random::new(mix(seed, 5));
        let people = People::new(&world.walkers, config.people as usize, || random.unit());
        let motion = Motion::new(start, people);
        let eye = robot.camera.map(|camera| eye(&camera, config, seed));
        let beams = robot.lidar.map_or(0, |lidar| (lidar.beams as usize).clamp(1, SCAN_BEAMS));
        Self {
            robot: robot.clone(),
            noise: config.noise,
            response: Response::new(config, robot, seed),
            outline: Outline::new(robot),
            current: motion.clone(),
            motion,
            grid_ns: None,
            now_ns: 0,
            eye,
            beams_m: vec![f64::INFINITY; beams],
            random,
            leg: 0,
            arrivals: 0,
            path_due: !world.legs_m.is_empty(),
            pose_epoch: 0,
            world,
        }
    }

    /// A robot in the world and at the start that the configuration names.
    ///
    /// # Errors
    /// [`ConfigError`] with key, found and needed; a world that cannot be had counts as such.
    pub fn configured(config: &Config, robot: &Robot) -> Result<Self, ConfigError> {
        config.check()?;
        let world = World::named(&config.world, config.seed)?;
        let start = config.start.map_or(world.start, |[x_m, y_m, yaw_rad]| Pose2::new(x_m, y_m, yaw_rad));
        Ok(Self::new(config, robot, world, start, config.seed))
    }

    /// `[Hz]` frames of the camera, or sweeps of the lidar of a robot without one.
    #[must_use]
    pub fn rate_hz(&self) -> f32 {
        let camera = self.robot.camera.map(|camera| camera.rate_hz);
        camera.or(self.robot.lidar.map(|lidar| lidar.rate_hz)).unwrap_or(30.0)
    }

    /// `[ns]` graph time of the state that the sensors show.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The world.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// True pose in the world.
    #[must_use]
    pub fn pose(&self) -> Pose2 {
        self.current.base.pose
    }

    /// `[m]` gap between the robot and the nearest thing, were it at `pose` now.
    #[must_use]
    pub fn clearance_at_m(&self, pose: &Pose2) -> f64 {
        self.current.clearance_at_m(pose, &self.world, &self.outline)
    }

    /// Everything that stands or walks there now.
    pub fn solids(&self) -> impl Iterator<Item = Solid> {
        let people = self.current.people.solids(&self.world.walkers);
        self.world.solids.iter().copied().chain(people)
    }

    /// Puts something into the world.
    pub fn place(&mut self, solid: Solid) {
        self.world.solids.push(solid);
        self.motion.look_again();
        self.current.look_again();
    }

    /// Pushes the robot to a pose near its own: the wheels turn with it, so that odometry follows.
    pub fn push(&mut self, pose: &Pose2) {
        self.motion.push(pose);
        self.current.push(pose);
    }

    /// Has the path published again, placed where a localiser sees it now: drift does not add up along a long path.
    pub fn localise(&mut self) {
        self.path_due = self.leg < self.world.legs_m.len();
    }

    /// Names the epoch of the poses; a driver raises it when it starts again elsewhere.
    pub fn set_pose_epoch(&mut self, pose_epoch: u32) {
        self.pose_epoch = pose_epoch;
    }

    /// Whether [`Self::path`] has a new path to give.
    #[must_use]
    pub fn is_path_due(&self) -> bool {
        self.path_due
    }

    /// Takes a command that reaches the base at `now_ns`.
    pub fn command(&mut self, command: &Command, now_ns: u64) {
        self.grid_ns.get_or_insert(now_ns);
        self.motion.base.command(command, now_ns, &self.response);
        self.current.base.command(command, now_ns, &self.response);
    }

    /// Moves the truth on to `to_ns`; an earlier time changes nothing.
    pub fn advance(&mut self, to_ns: u64) {
        let mut grid_ns = *self.grid_ns.get_or_insert(to_ns);
        let step_s = STEP_NS as f64 * 1e-9;
        while grid_ns + STEP_NS <= to_ns {
            self.motion.step(grid_ns, step_s, &self.world, &self.outline, &self.response);
            grid_ns += STEP_NS;
        }
        self.grid_ns = Some(grid_ns);
        self.now_ns = self.now_ns.max(to_ns);
        self.current = self.ahead(self.now_ns);
        let clearance = self.current.clearance_m(&self.world, &self.outline);
        self.motion.min_clearance_m = self.motion.min_clearance_m.min(clearance);
        self.arrive();
    }

    /// The state at a time not before the grid's, as far as the commands known now lead.
    fn ahead(&self, to_ns: u64) -> Motion {
        let mut motion = self.motion.clone();
        let mut at_ns = self.grid_ns.unwrap_or(to_ns);
        while at_ns < to_ns {
            let step_ns = STEP_NS.min(to_ns - at_ns);
            motion.step(at_ns, step_ns as f64 * 1e-9, &self.world, &self.outline, &self.response);
            at_ns += step_ns;
        }
        motion
    }

    fn arrive(&mut self) {
        let Some(end) = self.world.legs_m.get(self.leg).and_then(|leg| leg.last()) else { return };
        let pose = &self.current.base.pose;
        if libm::hypot(end[0] - pose.x_m, end[1] - pose.y_m) < ARRIVED_M {
            self.arrivals += 1;
            self.leg += 1;
            if self.leg == self.world.legs_m.len() && self.world.endless {
                self.leg = 0;
            }
            self.path_due = self.leg < self.world.legs_m.len();
        }
    }

    /// What the wheels and the gyroscope say now.
    pub fn odometry(&mut self, out: &mut Odometry) {
        let base = &self.current.base;
        let error_rad = if self.noise { PITCH_SIGMA_RAD * self.random.normal() } else { 0.0 };
        *out = Odometry {
            stamp_ns: self.now_ns,
            pose: base.believed,
            twist: Twist::new(base.v_m_s as f32, base.w_rad_s as f32),
            roll_rad: 0.0,
            pitch_rad: (base.pitch_rad + error_rad) as f32,
            variance: base.variance(&self.response),
            slip: u32::from(base.slipping),
            pose_epoch: self.pose_epoch,
            _pad: 0,
        };
    }

    /// What the ultrasonic sensors say now.
    pub fn ranges(&mut self, out: &mut Ranges) {
        *out = Ranges { stamp_ns: self.now_ns, ..Ranges::default() };
        let motion = &self.current;
        let pose = &motion.base.pose;
        for (sensor, range) in self.robot.ultrasonic.iter().zip(&mut out.sensors) {
            let (x, y) = pose.transform(f64::from(sensor.x_m), f64::from(sensor.y_m));
            let height = f64::from(sensor.height_m);
            let axis = pose.yaw_rad + f64::from(sensor.yaw_rad);
            let mut nearest = f64::INFINITY;
            for ray in 0..SONAR_RAYS {
                let part = ray as f64 / (SONAR_RAYS - 1) as f64 - 0.5;
                let (sin, cos) = libm::sincos(axis + part * f64::from(sensor.field_of_view_rad));
                let people = motion.people.solids(&self.world.walkers);
                for solid in self.world.solids.iter().copied().chain(people) {
                    if solid.bottom_m <= height && solid.top_m > height {
                        nearest = nearest.min(planar::range_m(&solid, [x, y], [cos, sin]));
                    }
                }
            }
            let error = if self.noise { 1.0 + SONAR_SIGMA * self.random.normal() } else { 1.0 };
            let heard = (nearest * error).max(f64::from(sensor.near_m));
            *range = Range {
                x_m: sensor.x_m,
                y_m: sensor.y_m,
                yaw_rad: sensor.yaw_rad,
                field_of_view_rad: sensor.field_of_view_rad,
                near_m: sensor.near_m,
                far_m: sensor.far_m,
                range_m: if heard > f64::from(sensor.far_m) { f32::INFINITY } else { heard as f32 },
                _pad: 0,
            };
            out.count += 1;
        }
    }

    /// The path to follow, placed in `odom` where a localiser would see it now; false where it has not changed.
    pub fn path(&mut self, out: &mut Path) -> bool {
        if !std::mem::take(&mut self.path_due) {
            return false;
        }
        let base = &self.current.base;
        let points = resample(&self.world.legs_m[self.leg], SPACING_M);
        let stride = points.len().div_ceil(PATH_POINTS);
        *out = Path { id: u64::from(self.arrivals) + 1, pose_epoch: self.pose_epoch, ..Path::default() };
        let last = points.last().into_iter().filter(|_| !(points.len() - 1).is_multiple_of(stride));
        for (slot, point) in out.points.iter_mut().zip(points.iter().step_by(stride).chain(last)) {
            let (x, y) = base.pose.inverse_transform(point[0], point[1]);
            let (x, y) = base.believed.transform(x, y);
            *slot = PathPoint { x_m: x as f32, y_m: y as f32 };
            out.count += 1;
        }
        true
    }

    /// What is true now.
    pub fn truth(&self, out: &mut Truth) {
        let motion = &self.current;
        let base = &motion.base;
        *out = Truth {
            stamp_ns: self.now_ns,
            pose: base.pose,
            twist: Twist::new(base.v_m_s as f32, base.w_rad_s as f32),
            distance_m: base.distance_m,
            clearance_m: motion.clearance_m(&self.world, &self.outline) as f32,
            min_clearance_m: self.motion.min_clearance_m as f32,
            contact: u32::from(motion.contact),
            collisions: motion.collisions,
            arrivals: self.arrivals,
            ..Truth::default()
        };
        out.people_count = motion.people.report(&self.world.walkers, &mut out.people);
    }

    /// The depth image of now; left as it is for a robot without a camera.
    pub fn render(&mut self, out: &mut DepthFrame) {
        self.render_ahead(self.now_ns, out);
    }

    /// The depth image of a time not before now, from where the commands known now lead: exact when no command of
    /// the time between takes effect before it, which the dead time grants.
    pub fn render_ahead(&mut self, capture_ns: u64, out: &mut DepthFrame) {
        let motion = if capture_ns == self.now_ns { self.current.clone() } else { self.ahead(capture_ns) };
        let Some(eye) = &mut self.eye else { return };
        let base = &motion.base;
        let view = View::new(eye.size, eye.focal, &eye.mount, &base.pose, base.pitch_rad);
        let people = motion.people.solids(&self.world.walkers);
        let far_m = eye.camera.far_m * FAR_FACTOR;
        eye.raster.draw(&view, self.world.solids.iter().copied().chain(people), far_m);
        eye.frames += 1;
        let used = eye.size[0] * eye.size[1];
        out.capture_ns = capture_ns;
        out.width = eye.size[0] as u32;
        out.height = eye.size[1] as u32;
        out.metres_per_unit = UNIT_M;
        [out.fx_px, out.fy_px] = eye.focal;
        [out.cx_px, out.cy_px] = view.centre;
        out.capture_latency_s = 0.0;
        out.camera = eye.mount;
        if self.noise {
            eye.stereo.measure(&eye.raster.inverse_m, &view, eye.frames, &mut out.pixels[..used]);
        } else {
            eye.stereo.exact(&eye.raster.inverse_m, &mut out.pixels[..used]);
        }
        out.pixels[used..].fill(0);
    }

    /// The sweep of now; left as it is for a robot without a lidar.
    pub fn scan(&mut self, out: &mut Scan) {
        self.scan_ahead(self.now_ns, out);
    }

    /// The sweep of a time not before now, as [`Self::render_ahead`].
    pub fn scan_ahead(&mut self, capture_ns: u64, out: &mut Scan) {
        let Some(lidar) = self.robot.lidar else { return };
        let motion = if capture_ns == self.now_ns { self.current.clone() } else { self.ahead(capture_ns) };
        let sensor = Pose2::new(f64::from(lidar.forward_m), 0.0, 0.0);
        let placed = motion.base.pose.compose(&sensor);
        let beams = self.beams_m.len();
        let view_rad = f64::from(lidar.field_of_view_rad);
        let step_rad = view_rad / (beams.max(2) - 1) as f64;
        let height = f64::from(lidar.height_m);
        self.beams_m.fill(f64::INFINITY);
        let first = placed.yaw_rad - 0.5 * view_rad;
        let people = motion.people.solids(&self.world.walkers);
        for solid in self.world.solids.iter().copied().chain(people) {
            let near = solid.distance_m([placed.x_m, placed.y_m]) < f64::from(lidar.far_m);
            if near && solid.bottom_m <= height && solid.top_m > height {
                planar::shorten(&mut self.beams_m, &solid, [placed.x_m, placed.y_m], first, step_rad);
            }
        }
        *out = Scan {
            capture_ns,
            sensor,
            first_rad: (-0.5 * view_rad) as f32,
            step_rad: step_rad as f32,
            near_m: lidar.near_m,
            far_m: lidar.far_m,
            height_m: lidar.height_m,
            count: beams as u32,
            ..Scan::default()
        };
        for (beam, range) in out.range_m.iter_mut().zip(&self.beams_m) {
            let error = if self.noise { f64::from(lidar.sigma_m) * self.random.normal() } else { 0.0 };
            let measured = (range + error) as f32;
            let beyond = if measured > lidar.far_m { f32::INFINITY } else { measured };
            *beam = if measured < lidar.near_m { f32::NAN } else { beyond };
        }
    }
}

fn eye(camera: &Camera, config: &Config, seed: u64) -> Eye {
    let pixels = |asked: u32, own: u32, most: u32| if asked == 0 { own.min(most) } else { asked.min(most) };
    let width = pixels(config.width_px, camera.width_px, 640);
    let height = pixels(config.height_px, camera.height_px, 480);
    let focal = camera.focal_px;
    let scale = [width as f32 / camera.width_px as f32, height as f32 / camera.height_px as f32];
    Eye {
        camera: *camera,
        mount: Isometry::camera(camera.forward_m, 0.0, camera.height_m, camera.pitch_down_rad),
        size: [width as usize, height as usize],
        focal: [focal * scale[0], focal * scale[1]],
        raster: Raster::new(width as usize, height as usize),
        stereo: Stereo::new(camera, config.noise, seed),
        frames: 0,
    }
}

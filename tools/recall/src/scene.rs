//! The hall of a trial, what stands in it, and the camera that looks at it.

use crate::class::{Class, Fault, Thing};
use sidestep_msgs::{Command, DepthFrame, Isometry, Odometry, Pose2, Robot};
use sidestep_sim::{Config, Random, Simulator, Solid, World};

/// `[m]` half of the width of the hall.
const HALF_HALL_M: f64 = 3.0;
/// `[m]` walls of the hall above the floor that the robot drives on.
const WALL_M: f64 = 2.5;
/// `[m]` hall behind the start, and beyond the near edge of what is in the way.
const BEHIND_M: f64 = 2.0;
const BEYOND_M: f64 = 6.0;
/// Steps of the stairs, and their rise and run.
const STEPS: u32 = 8;
const RISE_M: f64 = 0.17;
const RUN_M: f64 = 0.28;
/// `[m]` thickness of the landing: so thin that the lower floor is out of the simulated robot's reach.
const LANDING_M: f64 = 0.3;

/// Where the thing of a trial is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// `[m]` its near edge along the way of the robot, which starts at 0.
    pub(crate) near_m: f64,
    /// `[m]` its middle, to the left of the robot's axis.
    pub(crate) aside_m: f64,
}

impl Thing {
    /// Its outline on the floor that the robot drives on, if there is any.
    pub(crate) fn solid(self, place: &Place) -> Option<Solid> {
        let block = |size_m: [f64; 2], height_m| {
            Solid::block([place.near_m + 0.5 * size_m[0], place.aside_m], size_m, 0.0, height_m)
        };
        match self {
            Self::Nothing => None,
            Self::Pole => Some(Solid::column([place.near_m + 0.01, place.aside_m], 0.01, [0.0, 1.0])),
            Self::Board => Some(block([0.6, 1.2], [0.70, 0.74])),
            Self::Box { height_m } => Some(block([0.3, 0.3], [0.0, height_m])),
            Self::Pane => Some(block([0.01, 1.0], [0.0, 2.0])),
            Self::Stairs => {
                let size_m = [f64::from(STEPS) * RUN_M, 2.0 * HALF_HALL_M];
                Some(Solid::block([place.near_m + 0.5 * size_m[0], 0.0], size_m, 0.0, [-RISE_M, 0.0]))
            }
        }
    }

    /// `[m]` how far the simulator's floor lies below the one that the robot drives on: it has no holes, so that a robot
    /// before stairs drives on a slab above the lower floor.
    fn drop_m(self) -> f64 {
        if self == Self::Stairs { f64::from(STEPS) * RISE_M } else { 0.0 }
    }
}

/// The robot with its camera in the hall.
#[derive(Debug)]
pub(crate) struct Scene {
    simulator: Simulator,
    /// The same hall without the thing, where it must be known which pixels show the thing.
    bare: Option<(Simulator, Box<DepthFrame>)>,
    fault: Fault,
    /// Where the robot believes its camera to be.
    mount: Isometry,
    random: Random,
}

impl Scene {
    /// The scene of a trial; `None` for a robot without a camera.
    pub(crate) fn new(class: &Class, robot: &Robot, place: &Place, seed: u64) -> Option<Self> {
        let camera = robot.camera?;
        let mount = Isometry::camera(camera.forward_m, 0.0, camera.height_m, camera.pitch_down_rad);
        let mut real = robot.clone();
        if let Some(camera) = &mut real.camera {
            if let Fault::Pitched { down } = class.fault {
                camera.pitch_down_rad += down.to_radians() as f32;
            }
            camera.height_m += class.thing.drop_m() as f32;
        }
        if class.thing == Thing::Stairs {
            // The body would lean about the lower floor, and move the camera ahead with it.
            real.actuator.pitch_rad_per_m_s2 = 0.0;
        }
        let simulator = |with_thing| {
            let config = Config { people: 0, ..Config::default() };
            let world = World { solids: solids(class, place, with_thing), ..World::empty() };
            Simulator::new(&config, &real, world, Pose2::ORIGIN, seed)
        };
        let black = matches!(class.fault, Fault::Black { .. });
        Some(Self {
            simulator: simulator(class.fault != Fault::Clear),
            bare: black.then(|| (simulator(false), Box::default())),
            fault: class.fault,
            mount,
            random: Random::new(seed),
        })
    }

    fn simulators(&mut self) -> impl Iterator<Item = &mut Simulator> {
        std::iter::once(&mut self.simulator).chain(self.bare.as_mut().map(|(simulator, _)| simulator))
    }

    /// Moves on to a time.
    pub(crate) fn advance(&mut self, to_ns: u64) {
        self.simulators().for_each(|simulator| simulator.advance(to_ns));
    }

    /// Gives the base a command.
    pub(crate) fn command(&mut self, command: &Command, now_ns: u64) {
        self.simulators().for_each(|simulator| simulator.command(command, now_ns));
    }

    /// What the wheels say.
    pub(crate) fn odometry(&mut self, out: &mut Odometry) {
        self.simulator.odometry(out);
    }

    /// `[Hz]` frames of the camera.
    pub(crate) fn rate_hz(&self) -> f32 {
        self.simulator.rate_hz()
    }

    /// Where the robot is.
    pub(crate) fn pose(&self) -> Pose2 {
        self.simulator.pose()
    }

    /// The depth image of now, with its fault.
    pub(crate) fn render(&mut self, out: &mut DepthFrame) {
        self.simulator.render(out);
        // The robot knows the mounting of its file, not the real one.
        out.camera = self.mount;
        let used = out.used_pixels().len();
        let pixels = &mut out.pixels[..used];
        match self.fault {
            Fault::None | Fault::Clear | Fault::Pitched { .. } => {}
            Fault::Dropout { lost } => lose(pixels, lost, &mut self.random, |_| true),
            Fault::Black { lost } => {
                if let Some((simulator, frame)) = &mut self.bare {
                    simulator.render(frame);
                    // Equal seeds make equal noise: what differs shows the thing, or its edge.
                    let bare = |pixel: usize| frame.pixels[pixel];
                    let shown: Vec<u16> = pixels.to_vec();
                    lose(pixels, lost, &mut self.random, |pixel| shown[pixel] != bare(pixel));
                }
            }
        }
    }
}

/// Loses a share of the pixels that are concerned.
fn lose(pixels: &mut [u16], share: f64, random: &mut Random, is_concerned: impl Fn(usize) -> bool) {
    for (index, pixel) in pixels.iter_mut().enumerate() {
        if is_concerned(index) && random.unit() < share {
            *pixel = 0;
        }
    }
}

/// Walls, and what the camera sees in the way.
fn solids(class: &Class, place: &Place, with_thing: bool) -> Vec<Solid> {
    let drop_m = class.thing.drop_m();
    let (back_m, end_m) = (-BEHIND_M, place.near_m + BEYOND_M);
    let (right, left) = (-HALF_HALL_M, HALF_HALL_M);
    let corners = [[back_m, right], [end_m, right], [end_m, left], [back_m, left]];
    let mut solids: Vec<Solid> =
        (0..4).map(|i| Solid::wall(corners[i], corners[(i + 1) % 4], 0.1, WALL_M + drop_m)).collect();
    if class.thing == Thing::Stairs {
        let hall = |from_m: f64, to_m: f64, height_m| {
            let size_m = [to_m - from_m, 2.0 * HALF_HALL_M];
            Solid::block([0.5 * (from_m + to_m), 0.0], size_m, 0.0, height_m)
        };
        solids.push(hall(back_m, place.near_m, [drop_m - LANDING_M, drop_m]));
        solids.extend((1..STEPS).map(|step| {
            let from_m = place.near_m + RUN_M * f64::from(step - 1);
            hall(from_m, from_m + RUN_M, [0.0, drop_m - RISE_M * f64::from(step)])
        }));
    } else if with_thing {
        solids.extend(class.thing.solid(place));
    }
    solids
}

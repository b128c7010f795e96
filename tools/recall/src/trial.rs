//! One trial: a straight drive at a thing, up to the last moment at which a brake still helps.

use crate::class::Class;
use crate::error::RecallError;
use crate::judge::{Judge, Target};
use crate::reach::reach_m;
use crate::scene::{Place, Scene};
use sidestep_guard::Guard;
use sidestep_mapper::Mapper;
use sidestep_msgs::{Command, DepthFrame, NearField, Odometry, Robot, SafetyMap, Twist, VALID_FOR_NS};
use sidestep_sim::{Event, Random, Timeline, mix};

/// `[m]` least and most that the robot drives before the tube touches the thing; it is up to speed after 0.6 m.
const DRIVEN_M: [f64; 2] = [1.0, 2.0];
/// `[m]` a thing stands at least so far outside the start disc, which the operator grants to be free.
const OUTSIDE_DISC_M: f64 = 0.1;

/// What is known of the thing when the tube would first touch it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seen {
    /// The safety map holds it.
    pub marked: bool,
    /// The safety map does not call all of it free: it is marked, or was not seen; either stops the robot.
    pub unfree: bool,
    /// The guard sees it.
    pub guarded: bool,
}

/// Mapper and guard with their memory, taken once for all trials of a thread.
#[derive(Debug)]
pub struct Witness {
    robot: Robot,
    arbiter: sidestep_arbiter::Config,
    judge: Judge,
    mapper: Mapper,
    guard: Guard,
    frame: Box<DepthFrame>,
    field: NearField,
    map: Box<SafetyMap>,
}

impl Witness {
    /// The nodes as shipped.
    ///
    /// # Errors
    /// The node that refuses its configuration; a robot without a depth camera.
    pub fn new(robot: &Robot) -> Result<Self, RecallError> {
        if robot.camera.is_none() {
            return Err(RecallError::Blind { robot: robot.name.clone() });
        }
        let arbiter = sidestep_arbiter::Config::STANDARD;
        Ok(Self {
            judge: Judge::new(robot, &arbiter),
            mapper: Mapper::new(&sidestep_mapper::Config::shipped(), robot)?,
            guard: Guard::new(&sidestep_guard::Config::STANDARD, robot)?,
            robot: robot.clone(),
            arbiter,
            frame: Box::default(),
            field: NearField::default(),
            map: Box::default(),
        })
    }

    /// Drives at a thing of a class at `speed_m_s`; a seed makes the place and all noise.
    ///
    /// # Errors
    /// A robot without a depth camera.
    pub fn trial(&mut self, class: &Class, speed_m_s: f64, seed: u64) -> Result<Seen, RecallError> {
        let mut random = Random::new(mix(seed, 1));
        let reach_m = reach_m(&self.robot, &self.arbiter, speed_m_s) + self.judge.front_m();
        let half_m = f64::from(self.robot.half_width_m());
        let driven_m = random.between(DRIVEN_M[0], DRIVEN_M[1]);
        let place = Place {
            near_m: (reach_m + driven_m).max(f64::from(self.robot.start.disc_m) + OUTSIDE_DISC_M),
            aside_m: random.between(-half_m, half_m),
        };
        let scene = Scene::new(class, &self.robot, &place, mix(seed, 2));
        let mut scene = scene.ok_or_else(|| RecallError::Blind { robot: self.robot.name.clone() })?;
        self.mapper.reset();
        let target = self.drive(&mut scene, class, &place, [speed_m_s, place.near_m - reach_m]);
        self.mapper.write_safety(&mut self.map);
        // The guard remembers nothing: the newest frame is all it knows.
        let _ = self.guard.step(&self.frame, &mut self.field);
        let (marked, is_free) = self.judge.map(&self.map, &target);
        Ok(Seen { marked, unfree: !is_free, guarded: self.judge.guard(&self.field, &target) })
    }

    /// Drives at a speed until the axle has come to the given place on the way.
    fn drive(&mut self, scene: &mut Scene, class: &Class, place: &Place, [speed, stop]: [f64; 2]) -> Target {
        let mut odometry = Odometry::default();
        let mut timeline = Timeline::new(scene.rate_hz());
        let twist = Twist::new(speed as f32, 0.0);
        let mut seen_from = scene.pose();
        loop {
            match timeline.next() {
                Event::Tick { stamp_ns, .. } => {
                    scene.advance(stamp_ns);
                    scene.odometry(&mut odometry);
                    self.mapper.odometry(&odometry);
                    if scene.pose().x_m >= stop {
                        return Target { solid: class.thing.solid(place), near_m: place.near_m, seen_from };
                    }
                    let valid_until_ns = stamp_ns + VALID_FOR_NS;
                    scene.command(&Command { twist, valid_until_ns, ..Command::default() }, stamp_ns);
                }
                Event::Frame { stamp_ns, .. } => {
                    scene.advance(stamp_ns);
                    scene.render(&mut self.frame);
                    // A frame that is refused leaves the map as the arbiter would have it.
                    let _ = self.mapper.depth(&self.frame);
                    seen_from = scene.pose();
                }
            }
        }
    }
}

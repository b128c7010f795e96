//! A drive: the simulator and the chain, event by event.

use crate::chain::{Chain, Image};
use crate::noise::{Noise, Outlook, body};
use crate::outcome::Outcome;
use crate::sight::{Sight, Surroundings};
use sidestep_msgs::{
    Command, DepthFrame, EstopAction, Odometry, Path, Pose2, Ranges, Robot, Scan, Status, Truth, Twist,
    Winner,
};
use sidestep_policy::Policy;
use sidestep_sim::{BEGIN_NS, Event, Simulator, Solid, TICK_NS, TICKS_PER_RANGES, Timeline, World};

/// Why a drive could not begin.
#[derive(Debug, thiserror::Error)]
pub enum DriveError {
    /// A node refuses its configuration or the robot.
    #[error("{0}")]
    Refused(String),
}

/// Who leads, as a graph file's key `lead` names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lead {
    /// The network.
    Policy,
    /// The best of 734 candidates.
    Expert,
    /// The best candidates, improved.
    Solved,
    /// The network's proposal, improved.
    Refined,
}

impl Lead {
    /// Every lead.
    pub const ALL: [Self; 4] = [Self::Policy, Self::Expert, Self::Solved, Self::Refined];

    /// The name in a graph file.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Policy => "policy",
            Self::Expert => "expert",
            Self::Solved => "solved",
            Self::Refined => "refined",
        }
    }

    /// Whether it cannot drive without the network.
    #[must_use]
    pub fn needs_policy(self) -> bool {
        matches!(self, Self::Policy | Self::Refined)
    }
}

/// Everything that makes a drive what it is.
pub struct Setup {
    /// The robot.
    pub robot: Robot,
    /// The world.
    pub world: World,
    /// Where the robot starts.
    pub start: Pose2,
    /// Configuration of the simulator; its world and start are not used.
    pub sim: sidestep_sim::Config,
    /// Configuration of the mapper.
    pub mapper: sidestep_mapper::Config,
    /// Configuration of the depth guard; without it, as for a robot without a camera, nobody guards.
    pub guard: Option<sidestep_guard::Config>,
    /// Configuration of the goal.
    pub goal: sidestep_goal::Config,
    /// Configuration of the expert.
    pub expert: sidestep_expert::Config,
    /// Configuration of the arbiter, the lead excepted.
    pub arbiter: sidestep_arbiter::Config,
    /// The policy, if one takes part.
    pub policy: Option<Policy>,
    /// Whether a policy that does not lead is asked only while its proposal may be heard: the commands are the same, but for
    /// the age of the policy's proposal that they tell.
    pub policy_stands_by: bool,
    /// How the robot sees.
    pub sight: Sight,
    /// Whether the arbiter filters; without it the lead's proposal goes to the base as it is.
    pub arbitrated: bool,
}

impl Setup {
    /// Shipped configurations, the start of the world, and a lead: [`Winner::Expert`] or [`Winner::Policy`].
    #[must_use]
    pub fn shipped(robot: Robot, world: World, lead: Winner) -> Self {
        let lead = if lead == Winner::Policy {
            sidestep_arbiter::Lead::Policy
        } else {
            sidestep_arbiter::Lead::Expert
        };
        Self {
            start: world.start,
            robot,
            world,
            sim: sidestep_sim::Config::default(),
            mapper: sidestep_mapper::Config::shipped(),
            guard: Some(sidestep_guard::Config::STANDARD),
            goal: sidestep_goal::Config::STANDARD,
            expert: sidestep_expert::Config::STANDARD,
            arbiter: sidestep_arbiter::Config { lead, ..sidestep_arbiter::Config::STANDARD },
            policy: None,
            policy_stands_by: false,
            sight: Sight::Camera,
            arbitrated: true,
        }
    }

    /// Shipped configurations under a lead of a graph file.
    #[must_use]
    pub fn led_by(robot: Robot, world: World, lead: Lead) -> Self {
        let winner = if lead == Lead::Policy { Winner::Policy } else { Winner::Expert };
        let setup = Self::shipped(robot, world, winner);
        Self { expert: setup.expert.led_by(lead.label()), ..setup }
    }
}

/// A drive in progress.
pub struct Drive {
    simulator: Simulator,
    chain: Chain,
    sight: Sight,
    /// What reaches below this stands in the way.
    band_top_m: f64,
    half_width_m: f32,
    body: Solid,
    noise: Option<Noise>,
    arbitrated: bool,
    has_camera: bool,
    timeline: Timeline,
    odometry: Odometry,
    ranges: Ranges,
    path: Box<Path>,
    depth: Box<DepthFrame>,
    scan: Box<Scan>,
    solids: Vec<Solid>,
    command: Command,
    truth: Truth,
    outcome: Outcome,
}

impl Drive {
    /// The robot at its start, everything switched on.
    ///
    /// # Errors
    /// [`DriveError`] with the node that refuses its configuration.
    pub fn new(mut setup: Setup) -> Result<Self, DriveError> {
        setup.sim.check().map_err(|error| DriveError::Refused(error.to_string()))?;
        let chain = Chain::new(&mut setup)?;
        let seed = setup.sim.seed;
        let simulator = Simulator::new(&setup.sim, &setup.robot, setup.world, setup.start, seed);
        Ok(Self {
            chain,
            sight: setup.sight,
            band_top_m: f64::from(setup.mapper.band_top_m),
            half_width_m: setup.robot.half_width_m(),
            body: body(&setup.robot),
            noise: (setup.sight == Sight::Noisy).then_some(Noise(seed)),
            arbitrated: setup.arbitrated,
            has_camera: setup.robot.camera.is_some(),
            timeline: Timeline::new(simulator.rate_hz()),
            simulator,
            odometry: Odometry::default(),
            ranges: Ranges::default(),
            path: Box::default(),
            depth: Box::default(),
            scan: Box::default(),
            solids: Vec::new(),
            command: Command::default(),
            truth: Truth::default(),
            outcome: Outcome::default(),
        })
    }

    /// Goes on to the next tick, with the frames before it.
    pub fn tick(&mut self) {
        let (tick_ns, number) = loop {
            match self.timeline.next() {
                Event::Frame { stamp_ns, .. } => self.frame(stamp_ns),
                Event::Tick { stamp_ns, number } => break (stamp_ns, number),
            }
        };
        self.simulator.advance(tick_ns);
        self.simulator.odometry(&mut self.odometry);
        self.chain.odometry(&self.odometry, tick_ns);
        if number.is_multiple_of(TICKS_PER_RANGES) {
            self.simulator.ranges(&mut self.ranges);
            self.chain.ranges(&self.ranges);
        }
        if self.simulator.path(&mut self.path) {
            self.chain.path(&self.path);
        }
        self.drive(tick_ns);
        self.simulator.truth(&mut self.truth);
        let time_s = (tick_ns - BEGIN_NS) as f64 * 1e-9;
        self.outcome.note(&self.truth, &self.command, time_s, TICK_NS as f64 * 1e-9);
    }

    fn frame(&mut self, now_ns: u64) {
        self.simulator.advance(now_ns);
        let status = match self.sight {
            Sight::Grid | Sight::Noisy => self.known_frame(now_ns),
            Sight::Camera if self.has_camera => {
                self.simulator.render(&mut self.depth);
                self.chain.frame(Image::Depth(&self.depth), now_ns)
            }
            Sight::Camera => {
                self.simulator.scan(&mut self.scan);
                self.chain.frame(Image::Scan(&self.scan), now_ns)
            }
        };
        self.outcome.refused += u64::from(status != Status::Ok);
        self.drive(now_ns);
    }

    /// A frame of all that stands there, placed where the wheels believe the robot to be.
    fn known_frame(&mut self, now_ns: u64) -> Status {
        let since_s = now_ns.saturating_sub(self.odometry.stamp_ns) as f64 * 1e-9;
        self.solids.clear();
        let band_top_m = self.band_top_m;
        self.solids.extend(self.simulator.solids().filter(|solid| solid.is_in_band(band_top_m)));
        let surroundings = Surroundings {
            outlook: Outlook { solids: &self.solids, pose: self.simulator.pose(), body: self.body },
            noise: self.noise,
            believed: self.odometry.pose.advance(&self.odometry.twist, since_s),
            pose_epoch: self.odometry.pose_epoch,
            capture_ns: now_ns,
            half_width_m: self.half_width_m,
        };
        self.chain.frame(Image::Known(&surroundings), now_ns)
    }

    fn drive(&mut self, now_ns: u64) {
        if self.arbitrated {
            self.chain.command(now_ns, &mut self.command);
        } else {
            self.chain.pass(now_ns, &mut self.command);
        }
        self.simulator.command(&self.command, now_ns);
    }

    /// Says something as the operator: emergency stop, reset, hold, resume.
    pub fn operator(&mut self, action: EstopAction) {
        self.chain.operator(action);
    }

    /// Puts a wish in the place of the proposals ([`Chain::overrule`]).
    pub fn overrule(&mut self, wish: Option<Twist>) {
        self.chain.overrule(wish);
    }

    /// Puts something into the world, all at once.
    pub fn place(&mut self, solid: Solid) {
        self.simulator.place(solid);
    }

    /// Pushes the robot to a pose near its own; odometry follows.
    pub fn push(&mut self, pose: &Pose2) {
        self.simulator.push(pose);
    }

    /// Has the path placed where a localiser sees it now.
    pub fn localise(&mut self) {
        self.simulator.localise();
    }

    /// The policy, for the next drive: a model takes longer to load than a room to cross.
    #[must_use]
    pub fn into_policy(self) -> Option<Policy> {
        self.chain.into_policy()
    }

    /// Drives until `arrivals` goals are reached, something is hit, or `limit_s` have passed.
    pub fn run(&mut self, arrivals: u32, limit_s: f64) -> &Outcome {
        while self.outcome.arrivals < arrivals
            && self.outcome.collisions == 0
            && self.outcome.time_s < limit_s
        {
            self.tick();
        }
        &self.outcome
    }

    /// The nodes with their newest messages.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// What is true.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// The newest depth image; empty but with [`Sight::Camera`].
    #[must_use]
    pub fn depth(&self) -> &DepthFrame {
        &self.depth
    }

    /// The newest command.
    #[must_use]
    pub fn command(&self) -> &Command {
        &self.command
    }

    /// The world and the robot in it.
    #[must_use]
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// What came of it so far.
    #[must_use]
    pub fn outcome(&self) -> &Outcome {
        &self.outcome
    }
}

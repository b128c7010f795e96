//! The nodes of a replay: each takes what a header names, steps, and hands out what the graph's node would have sent.

use crate::error::ReplayError;
use crate::proposers::{ExpertAgain, PolicyAgain};
use crate::settings::Settings;
use bytemuck::bytes_of;
use sidestep_arbiter::Arbiter;
use sidestep_goal::Goal;
use sidestep_guard::Guard;
use sidestep_mapper::Mapper;
use sidestep_msgs::{
    ARBITER_STATE_BYTES, COMMAND, Code, Command, DEPTH, DepthFrame, ESTOP, EXPERT_COMMAND, GOAL_STATE_BYTES,
    Header, LOCAL_GOAL, LOCAL_MAP, LocalGoal, LocalMap, MAPPER_STATE_BYTES, Message, NEAR_FIELD, NearField,
    ODOMETRY, PATH, POLICY_COMMAND, RANGES, SAFETY_MAP, SCAN, STATE_ARBITER, STATE_GOAL, STATE_MAPPER,
    SafetyMap, Status, TARGET, TELEOP, Winner,
};
use sidestep_player::Entry;

/// What a step publishes on one topic.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Output {
    pub(crate) topic: usize,
    pub(crate) source_frame: u64,
    pub(crate) status: u32,
    pub(crate) bytes: Vec<u8>,
}

impl Output {
    pub(crate) fn new<M: Message>(topic: usize, source_frame: u64, status: Status, message: &M) -> Self {
        Self { topic, source_frame, status: status.code(), bytes: bytes_of(message).to_vec() }
    }
}

/// A node that steps as headers say.
pub(crate) trait Again {
    /// Takes one input.
    fn take(&mut self, entry: &Entry);
    /// Steps at the time of a recorded output; `None` where the step knew something from before the recording.
    fn step(&mut self, recorded: &Entry) -> Option<Vec<Output>>;
    /// Graph time jumped.
    fn reset(&mut self);
    /// Goes on from a recorded state; false where it does not fit.
    fn restore(&mut self, _bytes: &[u8]) -> bool {
        true
    }
    /// What it keeps, for the nodes that say so.
    fn state(&self) -> Vec<u8> {
        Vec::new()
    }
}

/// A kind of node: its name, its outputs (the first gives the step its name) and its state's topic.
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) outputs: &'static [usize],
    pub(crate) state: Option<usize>,
    pub(crate) make: fn(&Settings) -> Result<Box<dyn Again>, ReplayError>,
}

/// In the order of the data.
pub(crate) const KINDS: &[Kind] = &[
    Kind {
        name: "mapper",
        outputs: &[LOCAL_MAP.index, SAFETY_MAP.index],
        state: Some(STATE_MAPPER.index),
        make: |settings| Ok(Box::new(MapperAgain::new(settings)?)),
    },
    Kind {
        name: "guard",
        outputs: &[NEAR_FIELD.index],
        state: None,
        make: |settings| Ok(Box::new(GuardAgain::new(settings)?)),
    },
    Kind {
        name: "goal",
        outputs: &[LOCAL_GOAL.index],
        state: Some(STATE_GOAL.index),
        make: |settings| Ok(Box::new(GoalAgain::new(settings)?)),
    },
    Kind {
        name: "policy",
        outputs: &[POLICY_COMMAND.index],
        state: None,
        make: |settings| Ok(Box::new(PolicyAgain::new(settings)?)),
    },
    Kind {
        name: "expert",
        outputs: &[EXPERT_COMMAND.index],
        state: None,
        make: |settings| Ok(Box::new(ExpertAgain::new(settings)?)),
    },
    Kind {
        name: "arbiter",
        outputs: &[COMMAND.index],
        state: Some(STATE_ARBITER.index),
        make: |settings| Ok(Box::new(ArbiterAgain::new(settings)?)),
    },
];

pub(crate) fn refused(error: &dyn std::fmt::Display) -> ReplayError {
    ReplayError::Refused(error.to_string())
}

pub(crate) fn status_of(header: &Header) -> Status {
    Status::from_code(header.status).unwrap_or(Status::Fault)
}

/// What a node writes of itself into a room of this size.
fn written(room: usize, write: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut bytes = vec![0; room];
    let size = write(&mut bytes);
    bytes.truncate(size);
    bytes
}

struct MapperAgain {
    mapper: Mapper,
    depth: Box<DepthFrame>,
    /// The frame or sweep of this step.
    image: Option<Entry>,
    local: LocalMap,
    safety: Box<SafetyMap>,
}

impl MapperAgain {
    fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let config = settings.graph.config("mapper").map_err(|error| refused(&error))?;
        Ok(Self {
            mapper: Mapper::new(&config, &settings.robot).map_err(|error| refused(&error))?,
            depth: bytemuck::allocation::zeroed_box(),
            image: None,
            local: LocalMap::default(),
            safety: Box::default(),
        })
    }
}

impl Again for MapperAgain {
    fn take(&mut self, entry: &Entry) {
        if let Some(odometry) = entry.read(ODOMETRY) {
            self.mapper.odometry(&odometry);
        } else if let Some(ranges) = entry.read(RANGES) {
            self.mapper.ranges(&ranges);
        } else if entry.read_into(DEPTH, &mut self.depth) {
            // The pixels are in their place; only the header is kept beside them.
            self.image = Some(Entry { message: Vec::new(), ..*entry });
        } else if entry.topic == SCAN.index {
            self.image = Some(entry.clone());
        }
    }

    fn step(&mut self, _recorded: &Entry) -> Option<Vec<Output>> {
        let image = self.image.take()?;
        let status = match image.read(SCAN) {
            Some(scan) => self.mapper.scan(&scan),
            None => self.mapper.depth(&self.depth),
        };
        self.mapper.write_local(&mut self.local);
        self.mapper.write_safety(&mut self.safety);
        let frame = image.header.source_frame;
        Some(vec![
            Output::new(LOCAL_MAP.index, frame, status, &self.local),
            Output::new(SAFETY_MAP.index, frame, status, &*self.safety),
        ])
    }

    fn reset(&mut self) {
        self.mapper.reset();
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.mapper.restore(bytes)
    }

    fn state(&self) -> Vec<u8> {
        written(MAPPER_STATE_BYTES, |bytes| self.mapper.state(bytes))
    }
}

struct GuardAgain {
    guard: Guard,
    depth: Box<DepthFrame>,
    /// The frame of this step.
    frame: Option<u64>,
}

impl GuardAgain {
    fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let config = settings.graph.config("guard").map_err(|error| refused(&error))?;
        let guard = Guard::new(&config, &settings.robot).map_err(|error| refused(&error))?;
        Ok(Self { guard, depth: bytemuck::allocation::zeroed_box(), frame: None })
    }
}

impl Again for GuardAgain {
    fn take(&mut self, entry: &Entry) {
        if entry.read_into(DEPTH, &mut self.depth) {
            self.frame = Some(entry.header.source_frame);
        }
    }

    fn step(&mut self, _recorded: &Entry) -> Option<Vec<Output>> {
        let frame = self.frame.take()?;
        let mut out = NearField::default();
        let status = self.guard.step(&self.depth, &mut out);
        Some(vec![Output::new(NEAR_FIELD.index, frame, status, &out)])
    }

    fn reset(&mut self) {}
}

struct GoalAgain {
    goal: Goal,
    map: Option<Entry>,
}

impl GoalAgain {
    fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let config = settings.graph.config("goal").map_err(|error| refused(&error))?;
        let goal = Goal::new(&config, &settings.robot).map_err(|error| refused(&error))?;
        Ok(Self { goal, map: None })
    }
}

impl Again for GoalAgain {
    fn take(&mut self, entry: &Entry) {
        if let Some(odometry) = entry.read(ODOMETRY) {
            self.goal.odometry(&odometry, entry.header.sequence);
        } else if let Some(path) = entry.read(PATH) {
            self.goal.path(&path);
        } else if let Some(target) = entry.read(TARGET) {
            self.goal.target(&target);
        } else if entry.topic == LOCAL_MAP.index {
            self.map = Some(entry.clone());
        }
    }

    fn step(&mut self, _recorded: &Entry) -> Option<Vec<Output>> {
        let entry = self.map.take()?;
        let map = entry.read(LOCAL_MAP)?;
        let mut out = LocalGoal::default();
        let status = self.goal.step(&map, entry.header.sequence, status_of(&entry.header), &mut out);
        Some(vec![Output::new(LOCAL_GOAL.index, entry.header.source_frame, status, &out)])
    }

    fn reset(&mut self) {
        self.goal.reset();
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.goal.restore(bytes)
    }

    fn state(&self) -> Vec<u8> {
        written(GOAL_STATE_BYTES, |bytes| self.goal.state(bytes))
    }
}

struct ArbiterAgain {
    arbiter: Arbiter,
}

impl ArbiterAgain {
    fn new(settings: &Settings) -> Result<Self, ReplayError> {
        let graph = &settings.graph;
        let config: sidestep_arbiter::Config = graph.config("arbiter").map_err(|error| refused(&error))?;
        let config = config.under(graph.lead_winner(), graph.text("resume"));
        let arbiter = Arbiter::new(&config, &settings.robot, 0).map_err(|error| refused(&error))?;
        Ok(Self { arbiter })
    }
}

impl Again for ArbiterAgain {
    fn take(&mut self, entry: &Entry) {
        let (arbiter, header) = (&mut self.arbiter, &entry.header);
        if let Some(odometry) = entry.read(ODOMETRY) {
            arbiter.odometry(&odometry, header);
        } else if let Some(ranges) = entry.read(RANGES) {
            arbiter.ranges(&ranges);
        } else if let Some(teleop) = entry.read(TELEOP) {
            arbiter.teleop(&teleop);
        } else if let Some(estop) = entry.read(ESTOP) {
            arbiter.estop(&estop);
        } else if let Some(near) = entry.read(NEAR_FIELD) {
            arbiter.near_field(&near);
        } else if let Some(map) = entry.read(SAFETY_MAP) {
            arbiter.safety_map(&map, header);
        } else if let Some(goal) = entry.read(LOCAL_GOAL) {
            arbiter.local_goal(&goal, header);
        } else if let Some(proposal) = entry.read(POLICY_COMMAND) {
            arbiter.proposal(Winner::Policy, &proposal, header);
        } else if let Some(proposal) = entry.read(EXPERT_COMMAND) {
            arbiter.proposal(Winner::Expert, &proposal, header);
        }
    }

    fn step(&mut self, recorded: &Entry) -> Option<Vec<Output>> {
        let open_loop = recorded.read(COMMAND)?.open_loop != 0;
        let mut out = Command::default();
        let status = self.arbiter.step(recorded.header.now_ns, open_loop, &mut out);
        Some(vec![Output::new(COMMAND.index, self.arbiter.source_frame(), status, &out)])
    }

    fn reset(&mut self) {
        self.arbiter.reset();
    }

    fn restore(&mut self, bytes: &[u8]) -> bool {
        self.arbiter.restore(bytes)
    }

    fn state(&self) -> Vec<u8> {
        written(ARBITER_STATE_BYTES, |bytes| self.arbiter.state(bytes))
    }
}

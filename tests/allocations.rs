//! After its start no step allocates: counted by the allocator itself, on a drive through the office.

use bytemuck::Zeroable;
use sidestep_arbiter::Arbiter;
use sidestep_expert::Expert;
use sidestep_goal::Goal;
use sidestep_guard::Guard;
use sidestep_mapper::Mapper;
use sidestep_msgs::{
    Command, DepthFrame, Header, LocalGoal, LocalMap, NearField, Odometry, Path, Pose2, Proposal, Ranges,
    Robot, SAFETY_GRID, SAFETY_SIDE, SafetyMap, Status, Twist, Winner,
};
use sidestep_policy::Policy;
use sidestep_sim::Simulator;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

#[allow(
    unsafe_code,
    reason = "an allocator is unsafe by nature; this one only counts what the system's does"
)]
// SAFETY: every call is passed on unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of this thread during a piece of work.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

/// The graph's own configuration of a node.
fn config<C: serde::de::DeserializeOwned>(node: &str) -> C {
    let graph: toml::Table = include_str!("../launch/graphs/sim.toml").parse().unwrap();
    graph["nodes"][node]["config"].clone().try_into().unwrap()
}

/// The nodes under test and the messages between them.
struct Chain {
    mapper: Mapper,
    guard: Guard,
    goal: Goal,
    expert: Expert,
    policy: Policy,
    arbiter: Arbiter,
    local: Box<LocalMap>,
    safety: Box<SafetyMap>,
    near: NearField,
    local_goal: LocalGoal,
    proposals: [Proposal; 2],
    command: Command,
    /// Allocations of mapper, goal, expert, arbiter and guard so far.
    counts: [u64; 5],
    /// Allocations of each inference of the policy.
    inferences: Vec<u64>,
}

impl Chain {
    fn new(robot: &Robot) -> Self {
        Self {
            mapper: Mapper::new(&config("mapper"), robot).unwrap(),
            guard: Guard::new(&config("guard"), robot).unwrap(),
            goal: Goal::new(&config("goal"), robot).unwrap(),
            expert: Expert::new(&config("expert"), robot).unwrap(),
            policy: Policy::load(sidestep_policy::embedded(), "embedded", robot).unwrap(),
            arbiter: Arbiter::new(&config("arbiter"), robot, 0).unwrap(),
            local: Box::default(),
            safety: Box::default(),
            near: NearField::default(),
            local_goal: LocalGoal::default(),
            proposals: [Proposal::default(); 2],
            command: Command::default(),
            counts: [0; 5],
            inferences: Vec::with_capacity(1000),
        }
    }

    fn odometry(&mut self, odometry: &Odometry, ranges: &Ranges, header: &Header) {
        self.counts[0] += allocations(|| {
            self.mapper.odometry(odometry);
            self.mapper.ranges(ranges);
        });
        self.counts[1] += allocations(|| self.goal.odometry(odometry, header.sequence));
        self.counts[3] += allocations(|| {
            self.arbiter.odometry(odometry, header);
            self.arbiter.ranges(ranges);
        });
    }

    fn frame(&mut self, depth: &DepthFrame, path: &Path, header: &Header) {
        self.counts[0] += allocations(|| {
            self.mapper.depth(depth);
            self.mapper.write_local(&mut self.local);
            self.mapper.write_safety(&mut self.safety);
        });
        self.counts[4] += allocations(|| {
            self.guard.step(depth, &mut self.near);
        });
        let mut status = Status::Ok;
        self.counts[1] += allocations(|| {
            self.goal.path(path);
            status = self.goal.step(&self.local, header.sequence, Status::Ok, &mut self.local_goal);
        });
        let [by_policy, by_expert] = &mut self.proposals;
        let inference = allocations(|| {
            self.policy.propose(&self.local, &self.local_goal, status, by_policy);
        });
        self.inferences.push(inference);
        self.counts[2] += allocations(|| {
            self.expert.plan(&self.local, &self.local_goal, status, None, by_expert);
        });
        self.counts[3] += allocations(|| {
            self.arbiter.near_field(&self.near);
            self.arbiter.safety_map(&self.safety, header);
            self.arbiter.local_goal(&self.local_goal, header);
            self.arbiter.proposal(Winner::Policy, by_policy, header);
            self.arbiter.proposal(Winner::Expert, by_expert, header);
            self.arbiter.step(header.now_ns, false, &mut self.command);
        });
    }
}

#[test]
fn no_step_allocates_and_the_policy_a_constant() {
    let robot = Robot::from_toml("loomo", include_str!("../launch/robots/loomo.toml")).unwrap();
    let mut simulator = Simulator::configured(&config("sim"), &robot).unwrap();
    let mut chain = Chain::new(&robot);
    let (mut depth, mut path): (Box<DepthFrame>, Box<Path>) = (Box::default(), Box::default());
    let (mut odometry, mut ranges) = (Odometry::default(), Ranges::default());
    simulator.path(&mut path);
    for frame in 1..=60u64 {
        let header = |sequence, now_ns| Header { sequence, source_frame: frame, now_ns, ..Header::default() };
        for tick in 0..3 {
            let now_ns = frame * 33_000_000 + tick * 10_000_000;
            simulator.advance(now_ns);
            simulator.odometry(&mut odometry);
            simulator.ranges(&mut ranges);
            chain.odometry(&odometry, &ranges, &header(frame * 3 + tick, now_ns));
        }
        simulator.render(&mut depth);
        let now_ns = frame * 33_000_000 + 20_000_000;
        chain.frame(&depth, &path, &header(frame, now_ns));
        simulator.command(&chain.command, now_ns);
    }
    // The first inferences fill tract's own caches.
    let settled = &chain.inferences[10..];
    eprintln!("allocations per inference of the policy: {}", settled[0]);
    assert!(settled.iter().all(|&count| count == settled[0]), "{:?}", chain.inferences);
    assert_eq!(chain.counts, [0; 5], "mapper, goal, expert, arbiter, guard");
}

/// A robot in the end of a slot, with the goal beside it, until it is led out.
#[test]
fn looking_for_a_way_out_allocates_nothing() {
    let robot = Robot::from_toml("loomo", include_str!("../launch/robots/loomo.toml")).unwrap();
    let mut arbiter = Arbiter::new(&config("arbiter"), &robot, 0).unwrap();
    let mut map = SafetyMap::zeroed();
    for (index, occupancy) in map.occupancy.iter_mut().enumerate() {
        let (x_m, y_m) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        let stands = x_m > -0.3 && (x_m > 0.25 || y_m.abs() > 0.36) && y_m.abs() < 0.6;
        *occupancy = if stands { 250 } else { 10 };
    }
    let (mut command, mut count, mut led_out) = (Command::default(), 0, false);
    for tick in 100..600_u64 {
        let stamp_ns = tick * 10_000_000;
        map.capture_ns = stamp_ns;
        let header = Header { source_frame: tick, now_ns: stamp_ns, ..Header::default() };
        // The last bits of a live odometry never stand still.
        let pose = Pose2::new(0.0, (tick % 2) as f64 * 1e-12, 0.0);
        let odometry = Odometry { stamp_ns, pose, ..Odometry::default() };
        let goal =
            LocalGoal { capture_ns: stamp_ns, x_m: -1.0, y_m: 2.0, remaining_m: 3.0, ..LocalGoal::default() };
        let twist = Twist::new(0.5, 0.0);
        let wish = Proposal { capture_ns: stamp_ns, twist, ..Proposal::default() };
        count += allocations(|| {
            arbiter.odometry(&odometry, &header);
            arbiter.safety_map(&map, &header);
            arbiter.local_goal(&goal, &header);
            arbiter.proposal(Winner::Policy, &wish, &header);
            arbiter.step(stamp_ns, false, &mut command);
        });
        led_out |= command.winner == Winner::Recovery as u32;
    }
    assert!(led_out && count == 0, "{led_out} {count}");
}

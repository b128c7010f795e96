//! After its start no step allocates: counted by the allocator itself, on a drive through the office.

use sidestep_arbiter::Arbiter;
use sidestep_expert::Expert;
use sidestep_goal::Goal;
use sidestep_mapper::Mapper;
use sidestep_msgs::{
    Command, DepthFrame, Header, LocalGoal, LocalMap, Odometry, Path, Proposal, Ranges, Robot, SafetyMap,
    Status, Winner,
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

#[test]
fn no_step_allocates_and_the_policy_a_constant() {
    let robot = Robot::from_toml("loomo", include_str!("../launch/robots/loomo.toml")).unwrap();
    let mut simulator = Simulator::configured(&config("sim"), &robot).unwrap();
    let mut mapper = Mapper::new(&config("mapper"), &robot).unwrap();
    let mut goal = Goal::new(&config("goal"), &robot).unwrap();
    let mut expert = Expert::new(&config("expert"), &robot).unwrap();
    let mut policy = Policy::load(sidestep_policy::embedded(), "embedded", &robot).unwrap();
    let mut arbiter = Arbiter::new(&config("arbiter"), &robot, 0).unwrap();

    let mut depth: Box<DepthFrame> = Box::default();
    let mut path: Box<Path> = Box::default();
    let (mut local, mut safety): (Box<LocalMap>, Box<SafetyMap>) = (Box::default(), Box::default());
    let (mut odometry, mut ranges, mut local_goal) =
        (Odometry::default(), Ranges::default(), LocalGoal::default());
    let (mut by_policy, mut by_expert, mut command) =
        (Proposal::default(), Proposal::default(), Command::default());
    simulator.path(&mut path);
    let mut counts = [0u64; 5];
    let mut inference = Vec::new();
    for frame in 1..=60u64 {
        for tick in 0..3 {
            let now_ns = frame * 33_000_000 + tick * 10_000_000;
            simulator.advance(now_ns);
            simulator.odometry(&mut odometry);
            simulator.ranges(&mut ranges);
            let header =
                Header { sequence: frame * 3 + tick, source_frame: frame, now_ns, ..Header::default() };
            counts[0] += allocations(|| mapper.odometry(&odometry));
            counts[4] += allocations(|| arbiter.odometry(&odometry, &header));
        }
        simulator.render(&mut depth);
        let now_ns = frame * 33_000_000 + 20_000_000;
        let header = Header { sequence: frame, source_frame: frame, now_ns, ..Header::default() };
        counts[0] += allocations(|| {
            mapper.ranges(&ranges);
            mapper.depth(&depth);
            mapper.write_local(&mut local);
            mapper.write_safety(&mut safety);
        });
        let mut status = Status::Ok;
        counts[1] += allocations(|| {
            goal.path(&path);
            goal.odometry(&odometry, frame);
            status = goal.step(&local, frame, Status::Ok, &mut local_goal);
        });
        let mut of_policy = 0;
        of_policy += allocations(|| {
            policy.propose(&local, &local_goal, status, &mut by_policy);
        });
        inference.push(of_policy);
        counts[3] += allocations(|| {
            expert.plan(&local, &local_goal, status, None, &mut by_expert);
        });
        counts[4] += allocations(|| {
            arbiter.safety_map(&safety, &header);
            arbiter.local_goal(&local_goal, &header);
            arbiter.proposal(Winner::Policy, &by_policy, &header);
            arbiter.proposal(Winner::Expert, &by_expert, &header);
            arbiter.ranges(&ranges);
            arbiter.step(now_ns, false, &mut command);
        });
        simulator.command(&command, now_ns);
    }
    // The first inferences fill tract's own caches.
    let constant = inference[10];
    eprintln!("allocations per inference of the policy: {constant}");
    assert!(inference[10..].iter().all(|&count| count == constant), "{inference:?}");
    assert_eq!(counts, [0; 5], "mapper, goal, -, expert, arbiter");
}

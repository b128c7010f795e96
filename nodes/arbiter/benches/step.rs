//! Time of one step: in the open, in a doorway, before a wall where every scale is searched, and of taking a map.

use sidestep_arbiter::{Arbiter, Config};
use sidestep_msgs::{
    Command, Header, LocalGoal, Odometry, Pose2, Proposal, Robot, SAFETY_CELLS, SAFETY_GRID, SAFETY_SIDE,
    STILL, SafetyMap, Twist, Winner,
};

const NOW_NS: u64 = 1_000_000_000;

fn main() {
    divan::main();
}

fn map(occupied: impl Fn(f32, f32) -> bool) -> Box<SafetyMap> {
    let mut map: Box<SafetyMap> = bytemuck::zeroed_box();
    map.capture_ns = NOW_NS;
    for index in 0..SAFETY_CELLS {
        let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        map.occupancy[index] = if occupied(x, y) { 250 } else { 10 };
        map.still[index] = STILL;
    }
    map
}

fn robot() -> Robot {
    let text = include_str!("../../../launch/robots/loomo.toml");
    Robot::from_toml("loomo.toml", text).unwrap_or_else(|error| unreachable!("{error}"))
}

/// The same, which minds movers.
fn wary() -> Robot {
    let mut robot = robot();
    robot.start.mover_m_s = 0.5;
    robot
}

/// An arbiter of a robot that drives at `twist` and wishes to go on so.
fn driving(robot: &Robot, map: &SafetyMap, twist: Twist) -> Arbiter {
    let mut arbiter =
        Arbiter::new(&Config::STANDARD, robot, 0).unwrap_or_else(|error| unreachable!("{error}"));
    let mut command = Command::default();
    let header = Header { source_frame: 1, now_ns: NOW_NS, ..Header::default() };
    for tick in 0..150 {
        let stamp_ns = NOW_NS - 1_500_000_000 / 2 + tick * 5_000_000;
        // The last bits of a live odometry never stand still.
        let pose = Pose2::new(0.0, tick as f64 * 1e-12, 0.0);
        arbiter.odometry(&Odometry { stamp_ns, pose, twist, ..Odometry::default() }, &header);
        arbiter.safety_map(&SafetyMap { capture_ns: stamp_ns, ..*map }, &header);
        arbiter.local_goal(
            &LocalGoal { capture_ns: stamp_ns, x_m: 2.0, remaining_m: f32::NAN, ..LocalGoal::default() },
            &header,
        );
        arbiter.proposal(
            Winner::Policy,
            &Proposal { capture_ns: stamp_ns, twist, ..Proposal::default() },
            &header,
        );
        arbiter.step(stamp_ns, false, &mut command);
    }
    arbiter
}

fn step(bencher: divan::Bencher<'_, '_>, robot: &Robot, map: &SafetyMap, twist: Twist) {
    let arbiter = driving(robot, map, twist);
    bencher.with_inputs(|| arbiter.clone()).bench_local_refs(|arbiter| {
        let mut command = Command::default();
        arbiter.step(NOW_NS + 5_000_000, false, &mut command);
        command
    });
}

#[divan::bench]
fn open_1_m_s(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|_, _| false), Twist::new(1.0, 0.3));
}

#[divan::bench]
fn doorway_0_5_m_s(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|x, y| y.abs() > 0.45 && x > -0.2), Twist::new(0.5, 0.0));
}

#[divan::bench]
fn corridor_1_m_s(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|_, y| y.abs() > 0.45), Twist::new(0.9, 0.0));
}

#[divan::bench]
fn corridor_end(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|x, y| y.abs() > 0.45 || x > 1.2), Twist::new(0.8, 0.0));
}

/// At 1 m/s in a curve between posts, one of which is too near ahead: every scale is searched, each over more than a metre.
#[divan::bench]
fn between_posts_1_m_s(bencher: divan::Bencher<'_, '_>) {
    let beside = (-4i8..8).flat_map(|number| [0.42, -0.42].map(|y| [0.25 * f32::from(number), y]));
    let posts: Vec<[f32; 2]> = beside.chain([[1.3, 0.1]]).collect();
    let map =
        map(|x, y| posts.iter().any(|[at_x, at_y]| (x - at_x).powi(2) + (y - at_y).powi(2) < 0.04 * 0.04));
    step(bencher, &robot(), &map, Twist::new(1.0, 0.1));
}

#[divan::bench]
fn boxed_in(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|x, y| y.abs() > 0.34 || x.abs() > 0.2), Twist::new(0.0, 0.5));
}

/// The left flank stands 3.5 cm deep in the cells of a wall.
#[divan::bench]
fn flank_in_a_wall(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|_, y| y > 0.25), Twist::new(0.1, 0.3));
}

#[divan::bench]
fn doorway_with_movers(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &wary(), &map(|x, y| y.abs() > 0.45 && x > -0.2), Twist::new(0.5, 0.0));
}

#[divan::bench]
fn open_with_movers(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &wary(), &map(|_, _| false), Twist::new(0.7, 0.3));
}

/// A lead that crawls in a doorway is led on: the gap is looked for at each step.
#[divan::bench]
fn led_through_a_doorway(bencher: divan::Bencher<'_, '_>) {
    step(bencher, &robot(), &map(|x, y| y.abs() > 0.45 && x > 0.2), Twist::new(0.1, 0.0));
}

#[divan::bench]
fn take_map(bencher: divan::Bencher<'_, '_>) {
    take(bencher, &robot());
}

#[divan::bench]
fn take_map_with_movers(bencher: divan::Bencher<'_, '_>) {
    take(bencher, &wary());
}

fn take(bencher: divan::Bencher<'_, '_>, robot: &Robot) {
    let mut seen = map(|x, y| y.abs() > 0.45 || x > 1.2);
    let mut arbiter = driving(robot, &seen, Twist::new(0.5, 0.0));
    bencher.bench_local(move || {
        seen.capture_ns += 1000;
        arbiter.safety_map(&seen, &Header::default());
    });
}

/// The step in which a way out is looked for: from the end of a slot, with the goal beside it.
#[divan::bench]
fn look_for_a_way_out(bencher: divan::Bencher<'_, '_>) {
    looking(bencher, |x, y| x > -0.4 && (x > 0.25 || y.abs() > 0.34) && y.abs() < 0.6);
}

/// The same where there is none: both widths are searched until nothing more is reached.
#[divan::bench]
fn look_for_a_way_out_in_vain(bencher: divan::Bencher<'_, '_>) {
    looking(bencher, |x, y| x.abs().max(y.abs()) > 1.2 || x > 0.25 && y.abs() < 0.6);
}

fn looking(bencher: divan::Bencher<'_, '_>, occupied: impl Fn(f32, f32) -> bool) {
    let (robot, map) = (robot(), map(occupied));
    let mut arbiter =
        Arbiter::new(&Config::STANDARD, &robot, 0).unwrap_or_else(|error| unreachable!("{error}"));
    let mut command = Command::default();
    // The last step before it leaves the wish.
    for tick in 0..1000 {
        let stamp_ns = NOW_NS + tick * 10_000_000;
        stand(&mut arbiter, &map, stamp_ns);
        let before = arbiter.clone();
        arbiter.step(stamp_ns, false, &mut command);
        if command.winner == Winner::Recovery as u32 {
            bencher.with_inputs(|| before.clone()).bench_local_refs(|arbiter| {
                let mut command = Command::default();
                arbiter.step(stamp_ns, false, &mut command);
                command
            });
            return;
        }
    }
}

/// Gives an arbiter that is to drive ahead, with the goal to the left, what it needs to do so.
fn stand(arbiter: &mut Arbiter, map: &SafetyMap, stamp_ns: u64) {
    let header = Header { source_frame: 1, now_ns: stamp_ns, ..Header::default() };
    let pose = Pose2::new(0.0, (stamp_ns / 10_000_000 % 2) as f64 * 1e-12, 0.0);
    arbiter.odometry(&Odometry { stamp_ns, pose, ..Odometry::default() }, &header);
    arbiter.safety_map(&SafetyMap { capture_ns: stamp_ns, ..*map }, &header);
    arbiter.local_goal(
        &LocalGoal { capture_ns: stamp_ns, y_m: 2.0, remaining_m: f32::NAN, ..LocalGoal::default() },
        &header,
    );
    let proposal = Proposal { capture_ns: stamp_ns, twist: Twist::new(0.5, 0.0), ..Proposal::default() };
    arbiter.proposal(Winner::Policy, &proposal, &header);
}

//! A driver of another process sends what no driver should: the robot stops for it with a reason, no node dies of it,
//! and the drive goes on once the input is good again.

use crate::harness::{Alone, Folder, Outcome, Running, sidestep};
use serde_json::Value;
use sidestep_bus::{Inbox, Keep, Link, Outbox, Step, host_ns, pause};
use sidestep_msgs::{
    COMMAND, Code, Command, DEPTH, DepthFrame, LOCAL_MAP, LocalMap, ODOMETRY, Odometry, PATH, Path, RANGES,
    Ranges, Reason, Robot, Stage, Status,
};
use sidestep_sim::{Simulator, World};
use std::time::Duration;

const TICK_NS: u64 = 10_000_000;
/// Ticks per frame: 33 a second.
const FRAME_TICKS: u64 = 3;
/// Ticks that bad input lasts: longer than any age limit, and long enough to come to rest.
const BAD_TICKS: u64 = 200;

/// What a spoiled driver does to its next message.
#[derive(Clone, Copy)]
enum Fault {
    Depth(fn(&mut DepthFrame)),
    Odometry(fn(&mut Odometry)),
    /// Every frame carries the stamp of the last good one.
    Repeat,
}

/// A driver in this process: the simulated robot, without its node.
struct Driver {
    running: Running,
    _alone: Alone,
    folder: Folder,
    simulator: Simulator,
    link: Link,
    step: Step,
    depth: Outbox<DepthFrame>,
    odometry: Outbox<Odometry>,
    ranges: Outbox<Ranges>,
    path: Outbox<Path>,
    commands: Inbox<Command>,
    maps: Inbox<LocalMap>,
    command: Command,
    /// `[ns]` stamp of the last good frame.
    capture_ns: u64,
    /// Reasons of commands and statuses of maps since the last look.
    seen: Vec<Reason>,
    statuses: Vec<Status>,
    ticks: u64,
}

impl Driver {
    fn start() -> Self {
        let alone = Alone::wait();
        let folder = Folder::new("abnormal");
        // The shipped graph of a robot; its driver is this test.
        let graph = include_str!("../launch/graphs/robot.toml");
        let graph = graph.split_once("# The driver publishes").unwrap().0;
        let graph = folder.write("graph.toml", graph);
        let (json, recordings) = (folder.join("summary.json"), folder.join("recordings"));
        let mut command = sidestep(&["run", &graph, "--lead", "expert", "--record"]);
        command.arg(recordings).arg("--json").arg(json).args(["--set", "supervision.start_ms=60000"]);
        // A shared machine may hold a node for longer than a robot's would.
        command.args(["--set", "supervision.hang_ms=5000"]);
        let mut running = Running::start(command);
        let link = running
            .wait_for("a link", |running| Link::attach(&running.domain("arbiter")?, "driver", 0, 0).ok());
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/launch/robots/loomo.toml");
        let robot = Robot::from_toml(path, &std::fs::read_to_string(path).unwrap()).unwrap();
        let config =
            sidestep_sim::Config { width_px: 160, height_px: 120, ..sidestep_sim::Config::default() };
        let world = World::office(1);
        let start = world.start;
        Self {
            simulator: Simulator::new(&config, &robot, world, start, 1),
            depth: link.outbox(DEPTH).unwrap(),
            odometry: link.outbox(ODOMETRY).unwrap(),
            ranges: link.outbox(RANGES).unwrap(),
            path: link.outbox(PATH).unwrap(),
            commands: link.inbox(COMMAND, Keep::All).unwrap(),
            maps: link.inbox(LOCAL_MAP, Keep::All).unwrap(),
            command: Command::default(),
            capture_ns: 0,
            seen: Vec::new(),
            statuses: Vec::new(),
            ticks: 0,
            step: Step::new(),
            running,
            _alone: alone,
            folder,
            link,
        }
    }

    /// One tick of the driver, spoiled or not.
    fn tick(&mut self, fault: Option<Fault>) {
        pause(Duration::from_nanos(TICK_NS));
        self.link.look(&mut self.step).unwrap();
        let (step, now_ns) = (&mut self.step, host_ns());
        let (seen, newest, simulator) = (&mut self.seen, &mut self.command, &mut self.simulator);
        let take = |command: &Command, _: &_| {
            simulator.command(command, now_ns);
            seen.push(Reason::from_code(command.reason).unwrap());
            *newest = *command;
        };
        self.commands.each(step, take).unwrap();
        let statuses = &mut self.statuses;
        self.maps.each(step, |_, header| statuses.push(Status::from_code(header.status).unwrap())).unwrap();
        self.simulator.advance(now_ns);
        if self.simulator.is_path_due() {
            self.path.send(step, |path| assert!(self.simulator.path(path))).unwrap();
        }
        let spoil = |odometry: &mut Odometry| {
            if let Some(Fault::Odometry(spoil)) = fault {
                spoil(odometry);
            }
        };
        self.odometry
            .send(step, |odometry| {
                self.simulator.odometry(odometry);
                spoil(odometry);
            })
            .unwrap();
        self.ticks += 1;
        if self.ticks.is_multiple_of(5) {
            self.ranges.send(step, |ranges| self.simulator.ranges(ranges)).unwrap();
        }
        if self.ticks.is_multiple_of(FRAME_TICKS) {
            step.originate(self.depth.next_sequence(), Stage::Depth);
            self.depth
                .send(step, |frame| {
                    self.simulator.render(frame);
                    match fault {
                        Some(Fault::Depth(spoil)) => spoil(frame),
                        Some(Fault::Repeat) => frame.capture_ns = self.capture_ns,
                        _ => self.capture_ns = frame.capture_ns,
                    }
                })
                .unwrap();
        }
    }

    /// Drives with good input until the robot rolls.
    fn until_driving(&mut self, what: &str) {
        for _ in 0..3000 {
            self.tick(None);
            if self.command.twist.v_m_s > 0.2 {
                return;
            }
        }
        panic!("not driving {what}; the last reasons: {:?}", &self.seen[self.seen.len() - 20..]);
    }

    fn end(self) -> (Outcome, Value) {
        self.running.signal(libc::SIGTERM);
        let outcome = self.running.finish();
        let json = std::fs::read_to_string(self.folder.join("summary.json")).unwrap();
        (outcome, serde_json::from_str(&json).unwrap())
    }
}

/// Name, what it does to the input, what the mapper says of it, why the robot stops.
const CASES: &[(&str, Fault, Option<Status>, &[Reason])] = {
    use Reason::{BackwardOdometry, RefusedMap, UnfitOdometry};
    const MAP: &[Reason] = &[RefusedMap];
    const BACKWARD: &[Reason] = &[BackwardOdometry];
    const UNFIT: &[Reason] = &[UnfitOdometry];
    &[
        ("a wrong size", Fault::Depth(|f| f.width = 9999), Some(Status::RefusedShape), MAP),
        ("no focal length", Fault::Depth(|f| f.fx_px = 0.0), Some(Status::RefusedShape), MAP),
        ("zeros", Fault::Depth(|f| f.pixels.fill(0)), Some(Status::RefusedEmpty), MAP),
        ("65535", Fault::Depth(|f| f.pixels.fill(u16::MAX)), Some(Status::RefusedSaturated), MAP),
        (
            "a camera pose of NaN",
            Fault::Depth(|f| f.camera.translation_m = [f32::NAN; 3]),
            Some(Status::RefusedPose),
            MAP,
        ),
        ("a repeated stamp", Fault::Repeat, Some(Status::RefusedStamp), MAP),
        (
            "a stamp of the past",
            Fault::Depth(|f| f.capture_ns -= 3_000_000_000),
            Some(Status::RefusedStamp),
            MAP,
        ),
        (
            "a stamp of the future",
            Fault::Depth(|f| f.capture_ns += 3_000_000_000),
            Some(Status::RefusedOdometry),
            MAP,
        ),
        ("a pose of NaN", Fault::Odometry(|o| o.pose.x_m = f64::NAN), Some(Status::RefusedPose), UNFIT),
        ("a velocity of NaN", Fault::Odometry(|o| o.twist.v_m_s = f32::NAN), None, UNFIT),
        ("odometry of one stamp", Fault::Odometry(|o| o.stamp_ns = 1), None, BACKWARD),
        ("odometry of the past", Fault::Odometry(|o| o.stamp_ns -= 3_000_000_000), None, BACKWARD),
    ]
};

#[test]
fn abnormal_input_stops_the_robot_and_kills_no_node() {
    let mut driver = Driver::start();
    for (name, fault, status, reasons) in CASES {
        driver.until_driving(&format!("before {name}"));
        (driver.seen, driver.statuses) = (Vec::new(), Vec::new());
        for _ in 0..BAD_TICKS {
            driver.tick(Some(*fault));
        }
        let Driver { seen, statuses, command, .. } = &driver;
        let told = seen.iter().find(|reason| reasons.contains(reason));
        println!("{name}: {:?}, {told:?}", statuses.iter().find(|status| **status != Status::Ok));
        assert!(told.is_some(), "{name}: no reason of {reasons:?} in {seen:?}");
        assert!(status.is_none_or(|status| statuses.contains(&status)), "{name}: {statuses:?}");
        assert!(command.twist.v_m_s == 0.0 && command.twist.w_rad_s == 0.0, "{name}: {command:?}");
    }
    driver.until_driving("at the end");
    let (outcome, summary) = driver.end();
    for node in ["mapper", "guard", "goal", "policy", "expert", "arbiter", "recorder"] {
        assert_eq!(summary["nodes"][node]["restarts"], 0, "{node}: {}", outcome.err);
        assert_eq!(summary["nodes"][node]["exit"], "exit 0", "{node}: {}", outcome.err);
    }
    assert_eq!(outcome.code, 0, "{}", outcome.err);
}

//! The simulator in the graph: it publishes what a robot's drivers would, in real time.

use crate::random::{Random, mix};
use crate::schedule::{Schedule, TICKS_PER_CLOCK, TICKS_PER_RANGES};
use crate::simulator::Simulator;
use sidestep_bus::{Boot, Inbox, Keep, Link, NodeError, Outbox, Step};
use sidestep_msgs::{
    CLOCK, COMMAND, Clock, ClockMode, Command, DEPTH, DepthFrame, ODOMETRY, Odometry, PATH, Path, RANGES,
    Ranges, Robot, SCAN, Scan, Stage, TRUTH, Truth,
};

/// What sees: a camera or a lidar; the next image is ready before its time.
enum Eye {
    Camera(Outbox<DepthFrame>, Box<DepthFrame>),
    Lidar(Outbox<Scan>, Box<Scan>),
}

/// The topics of the driver.
struct Topics {
    command: Inbox<Command>,
    clock: Outbox<Clock>,
    odometry: Outbox<Odometry>,
    ranges: Outbox<Ranges>,
    path: Outbox<Path>,
    truth: Outbox<Truth>,
    eye: Eye,
    /// Images sent, which is the sequence of the newest.
    frames: u64,
}

/// Simulates until asked to stop.
///
/// # Errors
/// [`NodeError::Configuration`] with what was found and what is needed, or [`NodeError::Transport`].
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let robot = boot.robot()?;
    let simulator = Simulator::configured(&boot.config()?, &robot);
    let mut simulator = simulator.map_err(|error| NodeError::Configuration(error.to_string()))?;
    // A simulator that starts again puts the robot back to its start: the pose jumps.
    simulator.set_pose_epoch(boot.incarnation);
    let mut link = Link::open(boot)?;
    let mut topics = open(&mut link, &robot)?;
    let phase = Random::new(mix(boot.run, u64::from(boot.incarnation))).unit();
    let mut schedule: Option<Schedule> = None;
    link.run(|step| {
        let now_ns = step.now_ns();
        let schedule = schedule.get_or_insert_with(|| Schedule::new(now_ns, simulator.rate_hz(), phase));
        topics.command.each(step, |command, header| {
            simulator.command(command, now_ns);
            schedule.answer(header.source_frame, topics.frames);
        })?;
        while let Some((stamp_ns, number)) = schedule.tick(now_ns) {
            simulator.advance(stamp_ns);
            topics.tick(step, number, &mut simulator)?;
        }
        if schedule.send(now_ns) {
            topics.send_image(step)?;
        }
        if schedule.render(now_ns) {
            topics.render(&mut simulator, schedule.capture_ns());
        }
        step.wake_at(schedule.wake_ns());
        Ok(())
    })
}

fn open(link: &mut Link, robot: &Robot) -> Result<Topics, NodeError> {
    link.wake_on(COMMAND)?;
    let eye = if robot.camera.is_some() {
        Eye::Camera(link.outbox(DEPTH)?, Box::default())
    } else {
        Eye::Lidar(link.outbox(SCAN)?, Box::default())
    };
    Ok(Topics {
        command: link.inbox(COMMAND, Keep::All)?,
        clock: link.outbox(CLOCK)?,
        odometry: link.outbox(ODOMETRY)?,
        ranges: link.outbox(RANGES)?,
        path: link.outbox(PATH)?,
        truth: link.outbox(TRUTH)?,
        eye,
        frames: 0,
    })
}

impl Topics {
    fn tick(&mut self, step: &mut Step, number: u64, simulator: &mut Simulator) -> Result<(), NodeError> {
        if number.is_multiple_of(TICKS_PER_CLOCK) {
            let now = step.now_ns();
            let word = Clock { graph0_ns: now, host0_ns: now, graph_ns: now, rate: 1.0, ..Clock::default() };
            self.clock.send(step, |clock| *clock = Clock { mode: ClockMode::RealTime as u32, ..word })?;
        }
        if simulator.is_path_due() {
            self.path.send(step, |path| {
                simulator.path(path);
            })?;
        }
        self.odometry.send(step, |odometry| simulator.odometry(odometry))?;
        if number.is_multiple_of(TICKS_PER_RANGES) {
            self.ranges.send(step, |ranges| simulator.ranges(ranges))?;
        }
        self.truth.send(step, |truth| simulator.truth(truth))
    }

    fn render(&mut self, simulator: &mut Simulator, capture_ns: u64) {
        match &mut self.eye {
            Eye::Camera(_, held) => simulator.render_ahead(capture_ns, held),
            Eye::Lidar(_, held) => simulator.scan_ahead(capture_ns, held),
        }
    }

    fn send_image(&mut self, step: &mut Step) -> Result<(), NodeError> {
        self.frames += 1;
        step.originate(self.frames, Stage::Depth);
        match &mut self.eye {
            Eye::Camera(outbox, held) => outbox.send(step, |frame| frame.clone_from(held)),
            Eye::Lidar(outbox, held) => outbox.send(step, |scan| scan.clone_from(held)),
        }
    }
}

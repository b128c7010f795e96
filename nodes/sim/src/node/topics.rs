//! The topics of the driver.

use crate::simulator::Simulator;
use crate::timeline::TICKS_PER_RANGES;
use sidestep_bus::{Boot, Inbox, Keep, Link, NodeError, Outbox, Step};
use sidestep_msgs::{
    CLOCK, COMMAND, Clock, Command, DEPTH, DepthFrame, ODOMETRY, Odometry, PATH, Path, RANGES, Ranges, SCAN,
    Scan, Stage, TRUTH, Truth,
};

/// What sees: a camera or a lidar; the next image is ready before its time.
enum Eye {
    Camera(Outbox<DepthFrame>, Box<DepthFrame>),
    Lidar(Outbox<Scan>, Box<Scan>),
}

/// The topics of the driver.
pub(crate) struct Topics {
    pub(crate) command: Inbox<Command>,
    pub(crate) clock: Outbox<Clock>,
    odometry: Outbox<Odometry>,
    ranges: Outbox<Ranges>,
    path: Outbox<Path>,
    truth: Outbox<Truth>,
    eye: Eye,
    /// Images sent, which is the sequence of the newest.
    pub(crate) frames: u64,
}

impl Topics {
    pub(crate) fn open(link: &mut Link, boot: &Boot) -> Result<Self, NodeError> {
        link.wake_on(COMMAND)?;
        let eye = if boot.robot()?.camera.is_some() {
            Eye::Camera(link.outbox(DEPTH)?, Box::default())
        } else {
            Eye::Lidar(link.outbox(SCAN)?, Box::default())
        };
        Ok(Self {
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

    pub(crate) fn tick(
        &mut self,
        step: &mut Step,
        number: u64,
        simulator: &mut Simulator,
    ) -> Result<(), NodeError> {
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

    pub(crate) fn render(&mut self, simulator: &mut Simulator, capture_ns: u64) {
        match &mut self.eye {
            Eye::Camera(_, held) => simulator.render_ahead(capture_ns, held),
            Eye::Lidar(_, held) => simulator.scan_ahead(capture_ns, held),
        }
    }

    pub(crate) fn send_image(&mut self, step: &mut Step) -> Result<(), NodeError> {
        self.frames += 1;
        step.originate(self.frames, Stage::Depth);
        match &mut self.eye {
            Eye::Camera(outbox, held) => outbox.send(step, |frame| frame.clone_from(held)),
            Eye::Lidar(outbox, held) => outbox.send(step, |scan| scan.clone_from(held)),
        }
    }
}

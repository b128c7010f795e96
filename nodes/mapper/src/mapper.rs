//! The step: what is checked before a frame is believed, and the order in which it changes the memory.

use crate::config::{Config, ConfigError};
use crate::evidence::Evidence;
use crate::footprint;
use crate::grid::{Grid, Moment};
use crate::history::{Arrival, History, Sample};
use crate::planning::{Widening, planning_cost};
use crate::projection::{Columns, Lens};
use crate::sonar;
use crate::sweep::{Sweep, is_shaped};
use crate::view::View;
use sidestep_msgs::{DepthFrame, LocalMap, Odometry, Pose2, Ranges, Robot, SafetyMap, Scan, Status};

/// `[m]` farthest a camera may be mounted from the axle; beyond, the pose is garbage.
const MOUNT_MAX_M: f32 = 5.0;
/// `[ns]` how old the echo of what a camera is too near to may be: that of four messages.
const FACED_NS: u64 = 200_000_000;

/// What the step keeps beside the grid.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
pub(crate) struct Memory {
    /// `[ns]` stamp that ticks are counted from; 0 = no stamp yet.
    pub(crate) first_ns: u64,
    /// `[ns]` capture stamp of the newest frame taken; 0 = none.
    pub(crate) capture_ns: u64,
    /// `[ns]` newest stamps taken per sensor.
    pub(crate) depth_ns: u64,
    pub(crate) scan_ns: u64,
    /// `[ns]` stamp of the newest ultrasonic readings, if they are of something that the camera is too near to; 0 = they are not.
    pub(crate) faced_ns: u64,
    /// Pose of the newest frame taken.
    pub(crate) pose: Pose2,
    /// `[m]` drift when it was taken, and the part of it that turns made.
    pub(crate) drift_m: f32,
    pub(crate) turned_m: f32,
    pub(crate) pose_epoch: u32,
    pub(crate) refused: u32,
    /// 1 once the start disc was granted or may no longer be.
    pub(crate) disc_settled: u32,
    pub(crate) _pad1: u32,
}

/// The mapper: all memory is taken at construction.
#[derive(Debug)]
pub struct Mapper {
    config: Config,
    robot: Robot,
    widening: Widening,
    pub(crate) grid: Grid,
    pub(crate) history: History,
    pub(crate) memory: Memory,
    evidence: Evidence,
    sweep: Sweep,
    view: View,
}

impl Mapper {
    /// A mapper that has seen nothing.
    ///
    /// # Errors
    /// The first value of the configuration that is out of its range.
    pub fn new(config: &Config, robot: &Robot) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config: *config,
            robot: robot.clone(),
            widening: Widening::of(robot),
            grid: Grid::new(config),
            history: History::new(),
            memory: bytemuck::Zeroable::zeroed(),
            evidence: Evidence::new(Columns::new()),
            sweep: Sweep::new(),
            view: View::new(),
        })
    }

    /// Forgets everything, as for a new epoch of graph time; the start disc is granted again if it was configured.
    pub fn reset(&mut self) {
        let refused = self.memory.refused;
        self.history = History::new();
        self.memory = bytemuck::Zeroable::zeroed();
        self.memory.refused = refused;
        self.grid.reset();
        self.view.reset();
    }

    /// Takes a pose. A jump, announced by its epoch or too far to be driven, voids the memory and the granted disc.
    pub fn odometry(&mut self, odometry: &Odometry) {
        if self.history.push(odometry, &self.robot, self.config.drift_lever_m) == Arrival::Jumped {
            self.grid.reset();
            self.view.reset();
            self.memory.disc_settled = 1;
            self.memory.pose = odometry.pose;
            self.memory.pose_epoch = odometry.pose_epoch;
        }
    }

    /// Takes ultrasonic readings; without a pose at their stamp, or before the first frame, they mark nothing.
    pub fn ranges(&mut self, ranges: &Ranges) {
        let is_faced = self.robot.camera.is_some_and(|camera| sonar::is_faced(ranges, &camera));
        self.memory.faced_ns = if is_faced { ranges.stamp_ns } else { 0 };
        let Ok(body) = self.history.at(ranges.stamp_ns, self.config.odometry_gap_s) else { return };
        if self.memory.capture_ns == 0 {
            return;
        }
        let Some(now) = self.moment(ranges.stamp_ns) else { return };
        sonar::take(ranges, &body.pose, &self.config, &now, &mut self.grid);
    }

    /// Takes a depth frame, or refuses it and leaves the memory as it was.
    pub fn depth(&mut self, frame: &DepthFrame) -> Status {
        let status = self.take_depth(frame);
        self.count(status)
    }

    /// Takes a lidar sweep, or refuses it and leaves the memory as it was.
    pub fn scan(&mut self, scan: &Scan) -> Status {
        let status = self.take_scan(scan);
        self.count(status)
    }

    fn count(&mut self, status: Status) -> Status {
        if status != Status::Ok {
            self.memory.refused = self.memory.refused.saturating_add(1);
        }
        status
    }

    fn take_depth(&mut self, frame: &DepthFrame) -> Status {
        let refusal = refusal(frame, self.config.valid_part_min);
        // What is heard too near to be measured may fill the view: the camera is not at fault, and nothing is learned.
        let is_filled = refusal == Status::RefusedEmpty && self.is_faced(frame.capture_ns);
        if refusal != Status::Ok && !is_filled {
            return refusal;
        }
        if frame.capture_ns <= self.memory.depth_ns {
            return Status::RefusedStamp;
        }
        let (body, now) = match self.arrive(frame.capture_ns) {
            Ok(arrived) => arrived,
            Err(status) => return status,
        };
        self.memory.depth_ns = frame.capture_ns;
        if !is_filled {
            let base = self.grid.window(body.pose.x_m, body.pose.y_m);
            let noise = self.robot.camera.map_or(0.0, |camera| camera.disparity_sigma_px / camera.baseline_m);
            let lens = Lens::new(frame, &body, base, noise, now);
            self.evidence.take(frame, &lens, &self.config, &mut self.grid);
        }
        self.finish(&body, &now);
        Status::Ok
    }

    /// Whether something that the camera is too near to was heard shortly before or after a stamp.
    fn is_faced(&self, capture_ns: u64) -> bool {
        self.memory.faced_ns != 0 && self.memory.faced_ns.abs_diff(capture_ns) <= FACED_NS
    }

    fn take_scan(&mut self, scan: &Scan) -> Status {
        if !is_shaped(scan) {
            return Status::RefusedShape;
        }
        let mount = scan.sensor;
        let most = f64::from(MOUNT_MAX_M);
        if !(mount.is_finite()
            && mount.x_m.abs() < most
            && mount.y_m.abs() < most
            && mount.yaw_rad.abs() < 10.0)
        {
            return Status::RefusedPose;
        }
        if !scan.range_m[..scan.count as usize].iter().any(|&range_m| range_m >= scan.near_m) {
            return Status::RefusedEmpty;
        }
        if scan.capture_ns <= self.memory.scan_ns {
            return Status::RefusedStamp;
        }
        let (body, now) = match self.arrive(scan.capture_ns) {
            Ok(arrived) => arrived,
            Err(status) => return status,
        };
        self.memory.scan_ns = scan.capture_ns;
        self.sweep.take(scan, &body.pose, &self.config, &now, &mut self.grid);
        self.finish(&body, &now);
        Status::Ok
    }

    /// Places the robot at a capture stamp, rolls the window there and grants the start disc once.
    fn arrive(&mut self, capture_ns: u64) -> Result<(Sample, Moment), Status> {
        let body = self.history.at(capture_ns, self.config.odometry_gap_s)?;
        let now = self.moment(capture_ns).ok_or(Status::RefusedStamp)?;
        if capture_ns >= self.memory.capture_ns {
            self.memory.capture_ns = capture_ns;
            self.memory.pose = body.pose;
            self.memory.pose_epoch = self.history.pose_epoch;
            self.memory.drift_m = now.drift_m;
            self.grid.recentre(&body.pose);
            let turned_m = self.history.turned_m as f32;
            self.grid.spare(&body.pose, turned_m - self.memory.turned_m, self.config.drift_lever_m, &now);
            self.memory.turned_m = turned_m;
        }
        if self.memory.disc_settled == 0 {
            self.memory.disc_settled = 1;
            if self.config.grant_start_disc {
                footprint::grant_disc(self.robot.start.disc_m, &body.pose, &now, &mut self.grid);
            }
        }
        Ok((body, now))
    }

    fn finish(&mut self, body: &Sample, now: &Moment) {
        footprint::free_under(&self.robot, &body.pose, now, &mut self.grid);
        self.look();
    }

    /// Makes the view at the newest capture.
    pub(crate) fn look(&mut self) {
        let Some(now) = self.moment(self.memory.capture_ns) else { return };
        let now = Moment { drift_m: self.memory.drift_m, ..now };
        let sonar_ticks = (self.config.sonar_hold_s * 100.0) as u32;
        self.view.refresh(&self.grid, &self.memory.pose, &now, sonar_ticks);
    }

    /// The time of a stamp in ticks; `None` when it lies 497 days after the first.
    fn moment(&mut self, stamp_ns: u64) -> Option<Moment> {
        if self.memory.first_ns == 0 {
            self.memory.first_ns = stamp_ns.max(1);
        }
        let ticks = stamp_ns.saturating_sub(self.memory.first_ns) / 10_000_000;
        let tick = u32::try_from(ticks).ok()?.checked_add(1)?;
        Some(Moment { tick, drift_m: self.history.drift_m as f32 })
    }

    /// Fills the map to plan on, from the memory at the newest capture taken.
    pub fn write_local(&self, map: &mut LocalMap) {
        map.capture_ns = self.memory.capture_ns;
        map.pose = self.memory.pose;
        map.pose_epoch = self.memory.pose_epoch;
        map.refused = self.memory.refused;
        self.view.local(&mut map.occupancy, &mut map.age);
        planning_cost(&map.occupancy, &map.age, self.widening, &mut map.planning_cost);
    }

    /// Fills the map to be safe with, from the memory at the newest capture taken.
    pub fn write_safety(&self, map: &mut SafetyMap) {
        map.capture_ns = self.memory.capture_ns;
        map.base = self.memory.pose;
        map.pose_epoch = self.memory.pose_epoch;
        map.refused = self.memory.refused;
        self.view.safety(&mut map.occupancy, &mut map.age, &mut map.still);
    }
}

/// Whether a frame can be used at all; [`Status::Ok`] if so.
fn refusal(frame: &DepthFrame, valid_part_min: f32) -> Status {
    let sized = (16..=640).contains(&frame.width) && (16..=480).contains(&frame.height);
    let scaled = frame.metres_per_unit > 0.0 && frame.metres_per_unit <= 0.1;
    let focal = |focal_px: f32| (8.0..1e5).contains(&focal_px);
    let principal = |centre_px: f32| centre_px.abs() < 1e4;
    let centred = principal(frame.cx_px) && principal(frame.cy_px);
    if !(sized && scaled && focal(frame.fx_px) && focal(frame.fy_px) && centred) {
        return Status::RefusedShape;
    }
    let mounted = frame.camera.translation_m.iter().all(|part| part.abs() < MOUNT_MAX_M);
    if !(frame.camera.is_valid() && mounted) {
        return Status::RefusedPose;
    }
    let pixels = frame.used_pixels();
    let measured = pixels.iter().map(|&raw| u32::from(raw != 0 && raw != u16::MAX)).sum::<u32>();
    if measured as f32 >= (valid_part_min * pixels.len() as f32).max(1.0) {
        return Status::Ok;
    }
    let saturated = pixels.iter().filter(|&&raw| raw == u16::MAX).count();
    if 2 * saturated > pixels.len() { Status::RefusedSaturated } else { Status::RefusedEmpty }
}

impl Mapper {
    /// Makes the view again after the memory was replaced.
    pub(crate) fn look_again(&mut self) {
        self.view.reset();
        if self.memory.capture_ns != 0 {
            self.look();
        }
    }
}

//! From path, person and map to the local goal of one frame.

use crate::config::{Config, ConfigError};
use crate::facing::Facing;
use crate::follower;
use crate::projection::{Projection, Side, keep_side, project};
use crate::sight::Sight;
use crate::standby;
use crate::track::Track;
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{
    Code, GOAL_STATE_BYTES, GoalKind, LOCAL_GRID, LocalGoal, LocalMap, Odometry, Path, Pose2, Robot, Status,
    Target, TargetState, Twist,
};

/// An arrival at a standby point ends when the robot is this many times the arrival distance away.
const LEAVE_FACTOR: f32 = 1.5;
/// The path left at arrival is at most this many times the arrival distance: a loop does not arrive at its start.
const LEFT_FACTOR: f64 = 2.0;

/// All that a step keeps, as plain bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Memory {
    path: Path,
    odometry: Odometry,
    target: Target,
    odometry_sequence: u64,
    progress_m: f64,
    standby_x_m: f64,
    standby_y_m: f64,
    tracked_ns: u64,
    has_odometry: u32,
    has_standby: u32,
    person_moves: u32,
    arrived: u32,
    waits: u32,
    /// 0 none, 1 left, 2 right.
    side: u32,
}

const _: () = assert!(size_of::<Memory>() <= GOAL_STATE_BYTES);

/// What a step found: where to go, and what to say of it.
struct Found {
    status: Status,
    kind: GoalKind,
    /// `[m]` in `base`.
    place_m: Option<(f32, f32)>,
}

impl Found {
    const fn nowhere(status: Status, kind: GoalKind) -> Self {
        Self { status, kind, place_m: None }
    }
}

/// The pure half of the node.
#[derive(Debug, Clone)]
pub struct Goal {
    config: Config,
    facing: Facing,
    memory: Box<Memory>,
    /// Made from the path in memory.
    track: Track,
}

impl Goal {
    /// A goal without path or person; the only call that allocates.
    ///
    /// # Errors
    /// A value of the configuration out of range.
    pub fn new(config: &Config, robot: &Robot) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config: *config,
            facing: Facing::new(config, robot),
            memory: Box::new(Memory::zeroed()),
            track: Track::new(),
        })
    }

    /// Forgets everything, as at a new epoch.
    pub fn reset(&mut self) {
        *self.memory = Memory::zeroed();
        self.track.clear();
    }

    /// Takes a path: a new id starts afresh, the same id keeps progress and arrival.
    pub fn path(&mut self, path: &Path) {
        if path.id != self.memory.path.id || self.track.is_empty() {
            self.memory.progress_m = 0.0;
            self.memory.arrived = 0;
        }
        self.memory.path = *path;
        self.measure();
    }

    /// Takes what the tracker says of the person.
    pub fn target(&mut self, target: &Target) {
        self.memory.target = *target;
    }

    /// Takes odometry; a new pose epoch voids the person's place.
    pub fn odometry(&mut self, odometry: &Odometry, sequence: u64) {
        let memory = &mut self.memory;
        if memory.has_odometry != 0 && odometry.pose_epoch != memory.odometry.pose_epoch {
            memory.target.state = TargetState::None.code();
            memory.has_standby = 0;
            memory.waits = 0;
        }
        memory.odometry = *odometry;
        memory.odometry_sequence = sequence;
        memory.has_odometry = 1;
    }

    /// Answers one map.
    pub fn step(
        &mut self,
        map: &LocalMap,
        map_sequence: u64,
        map_status: Status,
        out: &mut LocalGoal,
    ) -> Status {
        let memory = &self.memory;
        let known_twist = memory.has_odometry != 0 && memory.odometry.twist.is_finite();
        *out = LocalGoal {
            capture_ns: map.capture_ns,
            map_sequence,
            odometry_sequence: memory.odometry_sequence,
            pose: if map.pose.is_finite() { map.pose } else { Pose2::ORIGIN },
            twist: if known_twist { memory.odometry.twist } else { Twist::STOP },
            remaining_m: f32::NAN,
            ..LocalGoal::default()
        };
        let found = self.find(map, map_status);
        self.write(&found, map, out)
    }

    /// Copies all that is kept into `to`; the bytes used, or 0 where they do not fit.
    pub fn state(&self, to: &mut [u8]) -> usize {
        let bytes = bytemuck::bytes_of(&*self.memory);
        match to.get_mut(..bytes.len()) {
            Some(room) => {
                room.copy_from_slice(bytes);
                bytes.len()
            }
            None => 0,
        }
    }

    /// Takes back what [`Goal::state`] wrote; false, and nothing changed, where the bytes are something else.
    pub fn restore(&mut self, from: &[u8]) -> bool {
        let Ok(memory) = bytemuck::try_pod_read_unaligned::<Memory>(from) else { return false };
        if !(memory.progress_m >= 0.0 && memory.progress_m.is_finite() && memory.side <= 2) {
            return false;
        }
        *self.memory = memory;
        self.measure();
        true
    }

    fn measure(&mut self) {
        self.track.measure(&self.memory.path);
        self.memory.progress_m = self.memory.progress_m.min(self.track.length_m());
    }

    fn find(&mut self, map: &LocalMap, map_status: Status) -> Found {
        if map_status != Status::Ok {
            return Found::nowhere(Status::NoMap, GoalKind::Hold);
        }
        if self.memory.has_odometry == 0 {
            return Found::nowhere(Status::RefusedOdometry, GoalKind::Hold);
        }
        if !map.pose.is_finite() || !self.memory.odometry.twist.is_finite() {
            return Found::nowhere(Status::Fault, GoalKind::Hold);
        }
        if map.pose_epoch != self.memory.odometry.pose_epoch {
            // The pose jumped after this map.
            return Found::nowhere(Status::NoMap, GoalKind::Hold);
        }
        if standby::is_named(&self.memory.target) {
            return self.follow_person(map);
        }
        if self.track.is_empty() {
            return Found::nowhere(Status::NoGoal, GoalKind::None);
        }
        if self.memory.path.pose_epoch != map.pose_epoch {
            return Found::nowhere(Status::NoGoal, GoalKind::Hold);
        }
        self.follow_path(map)
    }

    fn follow_path(&mut self, map: &LocalMap) -> Found {
        let (pose, memory) = (&map.pose, &mut self.memory);
        let window_m = f64::from(self.config.search_ahead_m);
        memory.progress_m = self.track.advance(memory.progress_m, pose.x_m, pose.y_m, window_m);
        let (end_x_m, end_y_m) = self.track.at(self.track.length_m());
        let arrive_m = f64::from(self.config.arrive_m);
        let left_m = self.track.length_m() - memory.progress_m;
        let end_m = libm::hypot(end_x_m - pose.x_m, end_y_m - pose.y_m);
        if end_m <= arrive_m && left_m <= LEFT_FACTOR * arrive_m {
            memory.arrived = 1;
        }
        if memory.arrived != 0 {
            let (x_m, y_m) = pose.inverse_transform(end_x_m, end_y_m);
            let place_m = Some((x_m as f32, y_m as f32));
            return Found { status: Status::Arrived, kind: GoalKind::Path, place_m };
        }
        let sight = Sight { map, limit: self.config.limit };
        let waypoint = follower::choose(&self.track, &sight, pose, memory.progress_m, &self.config);
        let Some(waypoint) = waypoint else {
            return Found::nowhere(Status::Hold, GoalKind::Hold);
        };
        let status = if is_here(waypoint.x_m, waypoint.y_m) { Status::Hold } else { Status::Ok };
        Found { status, kind: GoalKind::Path, place_m: Some((waypoint.x_m, waypoint.y_m)) }
    }

    fn follow_person(&mut self, map: &LocalMap) -> Found {
        let (config, memory) = (&self.config, &mut self.memory);
        let seen = standby::is_seen(&memory.target, map.capture_ns, config);
        if seen {
            let sight = Sight { map, limit: config.limit };
            let moved = memory.person_moves != 0;
            let point = standby::find(&memory.target, map.capture_ns, &map.pose, moved, &sight, config);
            memory.standby_x_m = point.x_m;
            memory.standby_y_m = point.y_m;
            memory.has_standby = 1;
            memory.person_moves = u32::from(point.moves);
            memory.tracked_ns = memory.target.stamp_ns;
        }
        let lost_s = map.capture_ns.saturating_sub(memory.tracked_ns) as f64 * 1e-9;
        if memory.has_standby == 0 || (!seen && lost_s > f64::from(config.lost_hold_s)) {
            return Found::nowhere(Status::Lost, GoalKind::Hold);
        }
        let (x_m, y_m) = map.pose.inverse_transform(memory.standby_x_m, memory.standby_y_m);
        let (x_m, y_m) = (x_m as f32, y_m as f32);
        let reach_m = config.arrive_m * if memory.waits != 0 { LEAVE_FACTOR } else { 1.0 };
        // A walker is followed without halt; whoever stands, or is not seen, is waited for.
        let follows = seen && memory.person_moves != 0;
        let here = is_here(x_m, y_m) || (!follows && libm::hypotf(x_m, y_m) <= reach_m);
        memory.waits = u32::from(here);
        let status = match (here, seen) {
            (true, true) => Status::Arrived,
            (true, false) => Status::Hold,
            (false, _) => Status::Ok,
        };
        Found { status, kind: GoalKind::Standby, place_m: Some((x_m, y_m)) }
    }

    fn write(&mut self, found: &Found, map: &LocalMap, out: &mut LocalGoal) -> Status {
        let place_m = match found.status {
            Status::Ok => found.place_m.map(|(x_m, y_m)| self.facing.draw_near(x_m, y_m, map)),
            _ => found.place_m,
        };
        let placed = place_m.and_then(|(x_m, y_m)| Some((x_m, y_m, self.cell(x_m, y_m, out.twist)?)));
        let (status, kind) = match (placed, found.place_m) {
            (None, Some(_)) => (Status::NoGoal, GoalKind::Hold),
            _ => (found.status, found.kind),
        };
        let own = LOCAL_GRID.index(0.5 * LOCAL_GRID.cell_m, 0.5 * LOCAL_GRID.cell_m).unwrap_or(0);
        let (own_x_m, own_y_m) = (0.5 * LOCAL_GRID.cell_m, 0.5 * LOCAL_GRID.cell_m);
        let here = (0.0, 0.0, Projection { cell: own, x_m: own_x_m, y_m: own_y_m });
        let (x_m, y_m, projection) = placed.unwrap_or(here);
        (out.x_m, out.y_m, out.kind) = (x_m, y_m, kind.code());
        (out.cell, out.cell_x_m, out.cell_y_m) = (projection.cell as u32, projection.x_m, projection.y_m);
        if !self.track.is_empty() {
            out.progress_m = self.memory.progress_m as f32;
            if kind == GoalKind::Path {
                out.remaining_m = (self.track.length_m() - self.memory.progress_m) as f32;
            }
        }
        status
    }

    /// The cell of a place, with the side kept where it lies straight behind.
    fn cell(&mut self, x_m: f32, y_m: f32, twist: Twist) -> Option<Projection> {
        let kept = match self.memory.side {
            1 => Some(Side::Left),
            2 => Some(Side::Right),
            _ => None,
        };
        let (y_m, side) = keep_side(x_m, y_m, self.config.side_rad, kept, twist);
        let projection = project(x_m, y_m, side)?;
        self.memory.side = if side == Side::Left { 1 } else { 2 };
        Some(projection)
    }
}

/// Whether a place is nearer than half a cell: there is nothing to plan.
fn is_here(x_m: f32, y_m: f32) -> bool {
    libm::hypotf(x_m, y_m) < 0.5 * LOCAL_GRID.cell_m
}

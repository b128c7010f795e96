//! Where a command leads until the robot rests: the measured state through the commands on their way, the candidate,
//! then the brake, swept with the footprint over the known-free cells.
//!
//! Every member of the identified set gives another path; the corners of dead time and braking and one interior
//! member are simulated, the tracking error widens them. An answer is exact for what it simulates: each checked pose
//! asks for every cell under the widened outline, and poses lie no farther apart than the gap the widening covers.

use crate::clearance::{FreeSpace, Heading, Outline, Rows};
use crate::config::Config;
use crate::held::Held;
use crate::limits::{Limiter, Motion};
use crate::queue::{Pending, SENT_MAX};
use sidestep_msgs::{NO_CELL, Robot, Twist};

/// `[s]` one step of the simulation.
const STEP_S: f32 = 0.01;
/// Most steps: 8 s, longer than any stop the limits allow.
const STEPS_MAX: usize = 800;
/// `[m/s]` and [rad/s]: slower is rest.
const REST_M_S: f32 = 0.005;
const REST_RAD_S: f32 = 0.01;
/// `[m]` longest motion between two looks of a robot that has no more than the least margin, and of one that holds cells.
const NEAR_GAP_M: f32 = 0.002;
const HELD_GAP_M: f32 = 0.004;
/// `[m]` that rounding may take.
const ROUNDING_M: f32 = 1e-4;
/// `[m]` most by which the error of the turn rate widens the footprint along the path.
const TURN_ERROR_MOST_M: f32 = 0.015;

/// A member of the identified set of the actuator.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// `[s]` dead time.
    dead_s: f32,
    /// `[m/s^2]` strongest deceleration.
    brake_m_s2: f32,
}

/// What is true at a step for every candidate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Situation {
    /// Pose of the odometry in the frame of the map.
    pub(crate) at: Heading,
    /// Velocity of the odometry.
    pub(crate) twist: Twist,
    /// `[s]` from the odometry's stamp to now.
    pub(crate) age_s: f32,
    /// `[s]` from the map's capture to the odometry's stamp.
    pub(crate) map_s: f32,
    /// Whether what moves, or may come out of where nobody looks, is minded.
    pub(crate) movers: bool,
    /// Commands sent, oldest first.
    pub(crate) pending: [Pending; SENT_MAX],
    /// How many.
    pub(crate) pending_count: usize,
    /// `[m]` widening of the footprint that is free where the robot is; less than the full margin beside an obstacle.
    pub(crate) margin_m: f32,
    /// `[m]` the same for cells seen lately.
    pub(crate) old_margin_m: f32,
    /// Cells not known free, without those under the robot.
    pub(crate) blocked: Rows,
    /// The same for backing up.
    pub(crate) old: Rows,
    /// Those of them that are nearer than the least margin, which `blocked` has not.
    pub(crate) held: Held,
    /// Both together.
    pub(crate) taken: Rows,
}

/// A candidate command with the brake that would follow it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    /// The command.
    pub(crate) motion: Motion,
    /// Whether the brake after it respects the jerk.
    pub(crate) comfort: bool,
    /// Whether it may only cross cells seen lately.
    pub(crate) lately_seen: bool,
}

/// What is in the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Hit {
    /// The cell, or [`NO_CELL`] where the way leaves the map or never ends.
    pub(crate) cell: u32,
    /// Whether the cell is free, but something that moves could be there by then.
    pub(crate) moving: bool,
}

impl Hit {
    fn standing(cell: u32) -> Self {
        Self { cell, moving: false }
    }
}

/// The braking commands that follow a candidate.
struct Brake {
    twist: Twist,
    speed_m_s: f32,
    along_m_s2: f32,
    hardest_m_s2: f32,
    jerk_m_s3: f32,
    turn_s2: f32,
    now: Twist,
}

impl Brake {
    fn new(candidate: &Candidate, limiter: &Limiter, robot: &Robot) -> Self {
        let twist = candidate.motion.twist;
        let hardest = limiter.deceleration(twist);
        let along = if candidate.comfort {
            (candidate.motion.acceleration_m_s2 * twist.v_m_s.signum()).max(-hardest)
        } else {
            -hardest
        };
        Self {
            twist,
            speed_m_s: twist.v_m_s.abs(),
            along_m_s2: along,
            hardest_m_s2: hardest,
            jerk_m_s3: robot.limits.comfort_jerk_m_s3,
            turn_s2: robot.limits.turn_accelerate_rad_s2,
            now: twist,
        }
    }

    /// The next braking command.
    fn next(&mut self) -> Twist {
        let before = self.twist.v_m_s.abs();
        if before < 1e-3 {
            let less = self.turn_s2 * STEP_S;
            self.now.w_rad_s = (self.now.w_rad_s.abs() - less).max(0.0).copysign(self.now.w_rad_s);
            self.now.v_m_s = 0.0;
            return self.now;
        }
        self.along_m_s2 = (self.along_m_s2 - self.jerk_m_s3 * STEP_S).max(-self.hardest_m_s2);
        self.speed_m_s = (self.speed_m_s + self.along_m_s2 * STEP_S).max(0.0);
        let part = self.speed_m_s / before;
        self.now = Twist::new(self.twist.v_m_s * part, self.twist.w_rad_s * part.min(1.0));
        self.now
    }
}

/// Sweeps candidates over the free space.
#[derive(Debug, Clone)]
pub(crate) struct Tube {
    corners: [Corner; 5],
    outline: Outline,
    limiter: Limiter,
    robot: Robot,
    /// Part of a difference that the base follows within a step.
    follow: f32,
    hold_s: f32,
    gap_m: f32,
    full_margin_m: f32,
    /// `[m]` the least widening that leaves the pose its drift.
    pub(crate) least_margin_m: f32,
    overlap_m: f32,
}

impl Tube {
    pub(crate) fn new(config: &Config, robot: &Robot, outline: &Outline) -> Self {
        let a = &robot.actuator;
        let (soon, late) = (a.dead_time_min_s, a.dead_time_max_s);
        let strong = a.brake_max_m_s2.max(a.brake_min_m_s2);
        let corner = |dead_s, brake_m_s2| Corner { dead_s, brake_m_s2 };
        let ratio = STEP_S / a.lag_s.max(1e-4);
        Self {
            // The longest first: it fails soonest.
            corners: [
                corner(late, a.brake_min_m_s2),
                corner(soon, strong),
                corner(soon, a.brake_min_m_s2),
                corner(late, strong),
                corner(0.5 * (soon + late), 0.5 * (a.brake_min_m_s2 + strong)),
            ],
            outline: outline.clone(),
            limiter: Limiter::new(&robot.limits),
            robot: robot.clone(),
            // 1 - exp(-ratio) within 1e-3 for ratios below 1/4.
            follow: (ratio / (1.0 + 0.5 * ratio)).min(1.0),
            hold_s: config.hold_s,
            gap_m: config.gap_m,
            full_margin_m: config.margin_m + 0.5 * config.gap_m,
            least_margin_m: config.margin_m - ROUNDING_M,
            overlap_m: config.overlap_m,
        }
    }

    /// `[m]` the widening where nothing is near.
    pub(crate) fn full_margin_m(&self) -> f32 {
        self.full_margin_m
    }

    /// `[m]` longest motion between two looks with a widening, so that what is left between them is the least.
    fn look_m(&self, margin_m: f32) -> f32 {
        (2.0 * (margin_m - self.least_margin_m)).clamp(NEAR_GAP_M, self.gap_m)
    }

    /// Takes out of `blocked` the cells that the robot stands in, or within the least margin of; `None` where it stands in
    /// them deeper than the configured overlap.
    pub(crate) fn hold(&self, at: &Heading, blocked: &mut Rows) -> Option<Held> {
        let too_deep = self.outline.blocked(at, -self.overlap_m, blocked).is_some();
        if too_deep { None } else { Held::take(&self.outline, at, self.least_margin_m, blocked) }
    }

    /// `[m]` the largest widening, up to the full one, with which a robot stands free that does so with the least.
    pub(crate) fn margin_at(&self, at: &Heading, blocked: &Rows, least_m: f32) -> f32 {
        let free = |margin| self.outline.blocked(at, margin, blocked).is_none();
        if free(self.full_margin_m) {
            return self.full_margin_m;
        }
        let (mut low, mut high) = (least_m, self.full_margin_m);
        for _ in 0..5 {
            let middle = 0.5 * (low + high);
            if free(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Sweeps a candidate for every corner.
    ///
    /// # Errors
    /// What is in the way.
    pub(crate) fn check(
        &self,
        situation: &Situation,
        space: &FreeSpace,
        candidate: &Candidate,
    ) -> Result<(), Hit> {
        self.corners.iter().try_for_each(|corner| self.sweep(situation, space, candidate, corner))
    }

    fn sweep(
        &self,
        situation: &Situation,
        space: &FreeSpace,
        candidate: &Candidate,
        corner: &Corner,
    ) -> Result<(), Hit> {
        let actuator = &self.robot.actuator;
        let pending = &situation.pending[..situation.pending_count.min(SENT_MAX)];
        let begin_s = situation.age_s + corner.dead_s;
        let brake_s = begin_s + self.hold_s;
        let mut brake = Brake::new(candidate, &self.limiter, &self.robot);
        let mut at = situation.at;
        let (mut v, mut w) = (situation.twist.v_m_s, situation.twist.w_rad_s);
        // Before the first known command took effect, the base is assumed to go on as it goes.
        let mut command = situation.twist;
        let mut following = 0;
        // The start is checked too: a map may have come since.
        let (mut moved_m, mut step_m, mut allowed_m) = (0.0f32, 0.0f32, -1.0f32);
        let mut path_m = 0.0;
        // What moves comes nearer by itself.
        let nearer_m = if situation.movers { space.movers.speed_m_s() * STEP_S } else { 0.0 };
        for step in 0..STEPS_MAX {
            let time_s = step as f32 * STEP_S;
            // Looked at before the next step would pass what is allowed; NaN looks at every pose.
            let goes_on = moved_m + step_m <= allowed_m;
            if !goes_on {
                allowed_m = self.allowance(situation, space, candidate, &at, time_s, path_m)?;
                moved_m = 0.0;
            }
            if time_s >= brake_s {
                command = brake.next();
                if command == Twist::STOP && v.abs() < REST_M_S && w.abs() < REST_RAD_S {
                    return self.allowance(situation, space, candidate, &at, time_s, path_m).map(|_| ());
                }
            } else if time_s >= begin_s {
                command = candidate.motion.twist;
            } else {
                while pending.get(following).is_some_and(|next| next.sent_s + corner.dead_s <= time_s) {
                    command = pending[following].twist;
                    following += 1;
                }
            }
            let change = (command.v_m_s - v) * self.follow;
            let slowing = change * v < 0.0;
            let most = if slowing { corner.brake_m_s2 * STEP_S } else { f32::MAX };
            v += change.clamp(-most, most);
            w += (command.w_rad_s - w) * self.follow;
            let error = if command.v_m_s.abs() > 1e-3 { actuator.tracking_m_s } else { 0.0 };
            let length_m = (v + error.copysign(v)) * STEP_S;
            advance(&mut at, length_m, w * STEP_S);
            path_m += length_m.abs();
            step_m = length_m.abs() + w.abs() * STEP_S * self.outline.radius_m(self.full_margin_m) + nearer_m;
            moved_m += step_m;
        }
        Err(Hit::standing(NO_CELL))
    }

    /// `[m]` how far any point of the footprint may move before the next look.
    fn allowance(
        &self,
        situation: &Situation,
        space: &FreeSpace,
        candidate: &Candidate,
        at: &Heading,
        time_s: f32,
        path_m: f32,
    ) -> Result<f32, Hit> {
        let mut margin_m = if candidate.lately_seen { situation.old_margin_m } else { situation.margin_m };
        if margin_m >= self.full_margin_m {
            let error_m = 0.5 * self.robot.actuator.tracking_rad_s * time_s * path_m;
            margin_m += error_m.min(TURN_ERROR_MOST_M);
        }
        let slack_m = space.clearance_m(at.x_m, at.y_m) - self.outline.radius_m(margin_m);
        let mut allowed_m = if !candidate.lately_seen && slack_m >= self.gap_m {
            slack_m
        } else {
            let rows = if candidate.lately_seen { &situation.old } else { &situation.blocked };
            let hit = self.outline.blocked(at, margin_m, rows);
            hit.map_or(Ok(self.look_m(margin_m)), |cell| Err(Hit::standing(cell)))?
        };
        if situation.held.is_any() {
            if let Some(cell) = situation.held.approached(&self.outline, at) {
                return Err(Hit::standing(cell));
            }
            allowed_m = allowed_m.min(HELD_GAP_M);
        }
        if !situation.movers {
            return Ok(allowed_m);
        }
        let gone_m = space.movers.speed_m_s() * (situation.map_s + time_s).max(0.0);
        Ok(allowed_m.min(self.room_for_movers(space, at, margin_m, gone_m)?))
    }

    /// `[m]` how much nearer the footprint and movers that have gone `gone_m` may come to each other.
    fn room_for_movers(
        &self,
        space: &FreeSpace,
        at: &Heading,
        margin_m: f32,
        gone_m: f32,
    ) -> Result<f32, Hit> {
        let slack_m = space.movers.slack_m(at.x_m, at.y_m, self.outline.radius_m(margin_m), gone_m);
        if slack_m >= self.gap_m {
            return Ok(slack_m);
        }
        let moving = |cell| Hit { cell, moving: true };
        let rows = space.movers.reached(gone_m + self.gap_m).map_err(moving)?;
        let hit = self.outline.blocked(at, margin_m, rows);
        hit.map_or(Ok(self.gap_m), |cell| Err(moving(cell)))
    }
}

/// Moves a heading along an arc; the turn of one step is small enough for a short series.
fn advance(at: &mut Heading, length_m: f32, turn_rad: f32) {
    let half = 0.5 * turn_rad;
    let (sin, cos) = small(half);
    at.x_m += length_m * (at.cos * cos - at.sin * sin);
    at.y_m += length_m * (at.sin * cos + at.cos * sin);
    let (sin, cos) = small(turn_rad);
    (at.cos, at.sin) = (at.cos * cos - at.sin * sin, at.sin * cos + at.cos * sin);
}

/// Sine and cosine of an angle below 0.1 rad; larger ones (a measured spin beyond any limit) from the library.
fn small(angle_rad: f32) -> (f32, f32) {
    if angle_rad.abs() > 0.1 {
        return libm::sincosf(angle_rad);
    }
    let square = angle_rad * angle_rad;
    (angle_rad * (1.0 - square / 6.0), 1.0 - 0.5 * square + square * square / 24.0)
}

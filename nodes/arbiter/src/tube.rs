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
use crate::rollout::{Brake, Course, Member, Rollout, STEP_S, STEPS_MAX};
use sidestep_msgs::{NO_CELL, Robot, Twist};

/// `[m]` longest motion between two looks of a robot that has no more than the least margin, and of one that holds cells.
const NEAR_GAP_M: f32 = 0.002;
const HELD_GAP_M: f32 = 0.004;
/// `[m]` that rounding may take.
const ROUNDING_M: f32 = 1e-4;
/// `[m]` most by which the error of the turn rate widens the footprint along the path.
const TURN_ERROR_MOST_M: f32 = 0.015;

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

/// Sweeps candidates over the free space.
#[derive(Debug, Clone)]
pub(crate) struct Tube {
    /// The member that comes to rest last: it fails soonest.
    longest: [Member; 1],
    others: [Member; 4],
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
        let member = |dead_s, brake_m_s2| Member { dead_s, brake_m_s2 };
        let ratio = STEP_S / a.lag_s.max(1e-4);
        Self {
            longest: [member(late, a.brake_min_m_s2)],
            others: [
                member(soon, strong),
                member(soon, a.brake_min_m_s2),
                member(late, strong),
                member(0.5 * (soon + late), 0.5 * (a.brake_min_m_s2 + strong)),
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

    /// Sweeps a candidate for every member.
    ///
    /// # Errors
    /// What is in the way.
    pub(crate) fn check(
        &self,
        situation: &Situation,
        space: &FreeSpace,
        candidate: &Candidate,
    ) -> Result<(), Hit> {
        let course = Course {
            situation,
            twist: candidate.motion.twist,
            hold_s: self.hold_s,
            follow: self.follow,
            tracking_m_s: self.robot.actuator.tracking_m_s,
            radius_m: self.outline.radius_m(self.full_margin_m),
            // What moves comes nearer by itself.
            nearer_m: if situation.movers { space.movers.speed_m_s() * STEP_S } else { 0.0 },
        };
        let mut brake = Brake::new(candidate, &self.limiter, &self.robot);
        self.sweep(&course, space, candidate, &mut brake, &self.longest)?;
        self.sweep(&course, space, candidate, &mut brake, &self.others)
    }

    /// Sweeps members side by side; of several that fail, the first one's hit is the answer.
    fn sweep<const N: usize>(
        &self,
        course: &Course<'_>,
        space: &FreeSpace,
        candidate: &Candidate,
        brake: &mut Brake,
        members: &[Member; N],
    ) -> Result<(), Hit> {
        let look = |rollout: &Rollout<'_, N>, member: usize, time_s: f32| {
            let (at, path_m) = (rollout.at(member), rollout.path_m[member]);
            self.allowance(course.situation, space, candidate, &at, time_s, path_m)
        };
        let mut rollout = Rollout::new(course, members);
        // The start is checked too: a map may have come since.
        let (mut moved_m, mut allowed_m) = ([0.0f32; N], [-1.0f32; N]);
        let mut rests = [false; N];
        let (mut asked, mut found) = (N, Ok(()));
        for step in 0..STEPS_MAX {
            let time_s = step as f32 * STEP_S;
            let (command_m_s, command_rad_s) = rollout.commands(time_s, brake);
            for member in 0..N {
                if member >= asked || rests[member] {
                    continue;
                }
                // Looked at before the next step would pass what is allowed; NaN looks at every pose.
                let goes_on = moved_m[member] + rollout.step_m[member] <= allowed_m[member];
                let is_told = command_m_s[member] == 0.0 && command_rad_s[member] == 0.0;
                let is_last = is_told && rollout.rests(member);
                if goes_on && !is_last {
                    continue;
                }
                match look(&rollout, member, time_s) {
                    Ok(may_m) => (moved_m[member], allowed_m[member], rests[member]) = (0.0, may_m, is_last),
                    Err(hit) => (asked, found) = (member, Err(hit)),
                }
            }
            if rests[..asked].iter().all(|rests| *rests) {
                return found;
            }
            rollout.advance(&command_m_s, &command_rad_s);
            moved_m.iter_mut().zip(&rollout.step_m).for_each(|(moved_m, step_m)| *moved_m += step_m);
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

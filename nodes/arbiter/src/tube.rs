//! Where a command leads until the robot rests: the measured state through the commands on their way, the candidate,
//! then the brake, swept with the footprint over the known-free cells.
//!
//! Every member of the identified set gives another path; most of its corners and an interior one are simulated ([`members`]).
//! An answer is exact for what it simulates: each checked pose asks for every cell under the widened outline, and poses
//! lie no farther apart than the gap the widening covers.

use crate::brake::Brake;
use crate::clearance::{FreeSpace, Heading, Outline, Rows};
use crate::config::Config;
use crate::held::Held;
use crate::limits::{Limiter, Motion};
use crate::member::{FARTHEST, Fours, LANES, OTHERS, members};
use crate::queue::{Pending, SENT_MAX};
use crate::rollout::{Course, Rollout, STEP_S, STEPS_MAX, STRIDE};
use sidestep_msgs::{NO_CELL, Robot, Twist};
use wide::f32x4;

/// `[m]` longest motion between two looks of a robot that has no more than the least margin, and of one that holds cells.
const NEAR_GAP_M: f32 = 0.002;
const HELD_GAP_M: f32 = 0.004;
/// `[m]` that rounding may take.
const ROUNDING_M: f32 = 1e-4;
/// `[m]` that the errors of speed and turn rate may take of a widening that is not the full one, and of what is held.
pub(crate) const ERROR_M: f32 = 0.003;

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
    /// `[m]` what errors of speed and turn rate may still take of it.
    pub(crate) error_m: f32,
    /// `[m]` the same widening for cells seen lately.
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

/// What is swept, and where.
#[derive(Clone, Copy)]
struct Sweep<'a> {
    situation: &'a Situation,
    space: &'a FreeSpace,
    candidate: &'a Candidate,
}

/// Sweeps candidates over the free space.
#[derive(Debug, Clone)]
pub(crate) struct Tube {
    /// The members that go farthest: they fail soonest.
    farthest: Fours<FARTHEST>,
    others: Fours<OTHERS>,
    outline: Outline,
    limiter: Limiter,
    robot: Robot,
    /// Part of a difference that the base follows within a step.
    pub(crate) follow: f32,
    hold_s: f32,
    gap_m: f32,
    full_margin_m: f32,
    /// `[m]` the least widening that leaves the pose its drift.
    pub(crate) least_margin_m: f32,
    overlap_m: f32,
}

impl Tube {
    pub(crate) fn new(config: &Config, robot: &Robot, outline: &Outline) -> Self {
        let (farthest, others) = members(robot, config.hold_s);
        let ratio = STEP_S / robot.actuator.lag_s.max(1e-4);
        Self {
            farthest,
            others,
            outline: outline.clone(),
            limiter: Limiter::new(&robot.limits),
            robot: robot.clone(),
            // 1 - exp(-ratio) within 1e-3 for ratios below 1/4.
            follow: (ratio / (1.0 + 0.5 * ratio)).min(1.0),
            hold_s: config.hold_s,
            gap_m: config.gap_m,
            full_margin_m: config.margin_m + 0.5 * config.gap_m + ERROR_M,
            least_margin_m: config.margin_m - ROUNDING_M,
            overlap_m: config.overlap_m,
        }
    }

    /// `[m]` the widening where nothing is near.
    pub(crate) fn full_margin_m(&self) -> f32 {
        self.full_margin_m
    }

    /// `[m]` longest motion between two looks with a widening, so that what is left between them, but for errors, is the least.
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
        for _ in 0..10 {
            let middle = 0.5 * (low + high);
            if free(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// `[m]` the same where the robot may overlap cells, as deeply as it may.
    pub(crate) fn room_m(&self, at: &Heading, blocked: &Rows) -> f32 {
        self.margin_at(at, blocked, -self.overlap_m)
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
        let sweep = Sweep { situation, space, candidate };
        let mut brake = Brake::new(candidate, &self.limiter, &self.robot);
        // Without errors, hence with the larger widening: nobody may go farther.
        let from_m = self.allowance(&sweep, &situation.at, 0.0, 0.0)?;
        self.sweep(&sweep, &mut brake, &self.farthest, from_m)?;
        self.sweep(&sweep, &mut brake, &self.others, from_m)
    }

    /// Sweeps members side by side, from where they may go `from_m` before anybody looks; of what they hit, the answer is what
    /// is hit first.
    fn sweep<const FOURS: usize>(
        &self,
        sweep: &Sweep<'_>,
        brake: &mut Brake,
        members: &Fours<FOURS>,
        from_m: f32,
    ) -> Result<(), Hit> {
        let Sweep { situation, space, candidate } = *sweep;
        let course = Course {
            situation,
            twist: candidate.motion.twist,
            hold_s: self.hold_s,
            follow: self.follow,
            radius_m: self.outline.radius_m(self.full_margin_m),
            // What moves comes nearer by itself.
            nearer_m: if situation.movers { space.movers.speed_m_s() * STEP_S } else { 0.0 },
        };
        let mut rollout = Rollout::new(&course, members);
        let (mut moved_m, mut allowed_m) = ([f32x4::ZERO; FOURS], [f32x4::splat(from_m); FOURS]);
        let mut rests = [[false; LANES]; FOURS];
        for first in (0..STEPS_MAX).step_by(STRIDE) {
            rollout.stride(brake);
            for (step, begins) in rollout.begins.iter().enumerate() {
                // Looked at before the next step would pass what is allowed; NaN looks at every pose.
                let mut go_on = f32x4::splat(f32::from_bits(u32::MAX));
                for ((moved_m, allowed_m), begin) in moved_m.iter_mut().zip(&allowed_m).zip(begins) {
                    *moved_m += begin.moved_m;
                    go_on &= (*moved_m + begin.moved_m).simd_le(*allowed_m);
                }
                if go_on.all() {
                    continue;
                }
                let time_s = (first + step) as f32 * STEP_S;
                for (four, begin) in begins.iter().enumerate() {
                    let columns = (moved_m[four].as_mut_array(), allowed_m[four].as_mut_array());
                    for (lane, (moved_m, allowed_m)) in columns.0.iter_mut().zip(columns.1).enumerate() {
                        if rests[four][lane] || *moved_m + begin.moved_m.as_array()[lane] <= *allowed_m {
                            continue;
                        }
                        let errs = !members[four][lane].is_faithful();
                        let error_m = if errs { situation.error_m } else { 0.0 };
                        let at = begin.at(lane);
                        let may_m = self.allowance(sweep, &at, time_s, error_m)?;
                        rests[four][lane] = begin.rests(lane);
                        (*moved_m, *allowed_m) = (0.0, if begin.rests(lane) { f32::INFINITY } else { may_m });
                    }
                }
                if rests.as_flattened().iter().all(|rests| *rests) {
                    return Ok(());
                }
            }
        }
        Err(Hit::standing(NO_CELL))
    }

    /// `[m]` how far any point of the footprint may move before the next look.
    fn allowance(&self, sweep: &Sweep<'_>, at: &Heading, time_s: f32, error_m: f32) -> Result<f32, Hit> {
        let Sweep { situation, space, candidate } = *sweep;
        let margin_m = situation.margin_m - error_m;
        let slack_m = space.clearance_m(at.x_m, at.y_m) - self.outline.radius_m(margin_m);
        let mut allowed_m = if slack_m >= self.gap_m {
            slack_m
        } else {
            let hit = self.outline.blocked(at, margin_m, &situation.blocked);
            hit.map_or(Ok(self.look_m(situation.margin_m)), |cell| Err(Hit::standing(cell)))?
        };
        if candidate.lately_seen {
            let margin_m = (situation.old_margin_m - error_m).max(0.0);
            let hit = self.outline.blocked(at, margin_m, &situation.old);
            let may_m =
                hit.map_or(Ok(self.look_m(situation.old_margin_m)), |cell| Err(Hit::standing(cell)))?;
            allowed_m = allowed_m.min(may_m);
        }
        if situation.held.is_any() {
            if let Some(cell) = situation.held.approached(&self.outline, at, error_m) {
                return Err(Hit::standing(cell));
            }
            allowed_m = allowed_m.min(HELD_GAP_M);
        }
        if !situation.movers {
            return Ok(allowed_m);
        }
        let gone_m = space.movers.speed_m_s() * (situation.map_s + time_s).max(0.0);
        self.room_for_movers(space, at, margin_m, gone_m, allowed_m)
    }

    /// `[m]` how much nearer the footprint and movers that have gone `gone_m` may come to each other, up to `most_m`.
    fn room_for_movers(
        &self,
        space: &FreeSpace,
        at: &Heading,
        margin_m: f32,
        gone_m: f32,
        most_m: f32,
    ) -> Result<f32, Hit> {
        let radius_m = self.outline.radius_m(margin_m);
        let slack_m = space.movers.slack_m([at.x_m, at.y_m], radius_m, gone_m, [self.gap_m, most_m]);
        if let Some(slack_m) = slack_m {
            return Ok(slack_m);
        }
        let moving = |cell| Hit { cell, moving: true };
        let rows = space.movers.reached(gone_m + self.gap_m).map_err(moving)?;
        let hit = self.outline.blocked(at, margin_m, rows);
        hit.map_or(Ok(self.gap_m.min(most_m)), |cell| Err(moving(cell)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Stage, TICK, loomo};
    use crate::member::Member;
    use proptest::prelude::*;
    use sidestep_msgs::SAFETY_SIDE;

    /// What errors may take, and half of the way between two looks, leave the margin where nothing is near.
    #[test]
    fn the_full_widening_leaves_the_margin_and_less_of_it_the_least() {
        let (robot, config) = (loomo(), Config::STANDARD);
        let tube = Tube::new(&config, &robot, &Outline::new(&robot).unwrap());
        let left_m = tube.full_margin_m - ERROR_M - 0.5 * tube.look_m(tube.full_margin_m);
        assert!((left_m - config.margin_m).abs() < 1e-6, "{left_m}");
        // With less of it, half of the way between two looks takes no more than a millimetre of the least.
        for part in 0..=10 {
            let margin_m =
                tube.least_margin_m + 0.1 * part as f32 * (tube.full_margin_m - tube.least_margin_m);
            let left_m = margin_m - 0.5 * tube.look_m(margin_m);
            assert!(left_m > tube.least_margin_m - 0.5 * NEAR_GAP_M - 1e-6, "{margin_m}: {left_m}");
        }
    }

    /// Straight ahead at any speed: an error of the turn rate moves a point behind the axle aside by how far that point is
    /// from where the axle was then. Sides chosen at every moment, against one side for all.
    #[test]
    fn an_error_that_changes_sides_leads_the_rear_at_most_6_mm_farther() {
        let robot = loomo();
        let rear_m = Outline::new(&robot).unwrap().rear_m;
        let mut most_m = 0.0f32;
        for speed in 1..=20 {
            let twist = Twist::new(0.05 * speed as f32, 0.0);
            let mut stage = Stage::new(&Config::STANDARD, &[]);
            stage.ticks(10);
            let situation = Situation { twist, ..stage.arbiter.situation(stage.now_ns - TICK).unwrap() };
            let tube = &stage.arbiter.tube;
            let course = Course {
                situation: &situation,
                twist,
                hold_s: tube.hold_s,
                follow: tube.follow,
                radius_m: 0.4,
                nearer_m: 0.0,
            };
            let candidate = Candidate { motion: Motion::steady(twist), comfort: true, lately_seen: false };
            let mut brake = Brake::new(&candidate, &tube.limiter, &robot);
            let mut rollout = Rollout::new(&course, &tube.farthest);
            // Of each moment the way so far, and whether an error is to be reckoned with.
            let mut way = Vec::new();
            while !rollout.begins[STRIDE - 1][0].rests(0) {
                rollout.stride(&mut brake);
                let moments = rollout.begins.iter().zip(&rollout.told);
                way.extend(
                    moments.map(|(begins, told)| {
                        (begins[0].at(0).x_m, told[0].v_m_s.as_array()[0].abs() > 1e-3)
                    }),
                );
            }
            for end in 1..way.len() {
                let erring = way[..end].iter().filter(|(_, errs)| *errs);
                let levers = erring.map(|(x_m, _)| way[end].0 - rear_m - x_m);
                let (sum, sizes) =
                    levers.fold((0.0f32, 0.0), |(sum, sizes), lever| (sum + lever, sizes + lever.abs()));
                most_m = most_m.max(robot.actuator.tracking_rad_s * STEP_S * (sizes - sum.abs()));
            }
        }
        assert!((0.005..0.006).contains(&most_m), "{most_m}");
    }

    /// A post of 3 cm on the way, wherever: the robot would rest beyond it, and is looked for before.
    #[test]
    fn what_would_be_driven_over_is_met() {
        let candidate =
            Candidate { motion: Motion::steady(Twist::new(1.0, 0.0)), comfort: true, lately_seen: false };
        let is_free = |posts: &[[f64; 4]]| {
            let mut stage = Stage::new(&Config::STANDARD, posts);
            stage.ticks(10);
            let situation = stage.arbiter.situation(stage.now_ns - TICK).unwrap();
            stage.arbiter.tube.check(&situation, &stage.arbiter.space, &candidate).is_ok()
        };
        assert!(is_free(&[]));
        for step in 0..12 {
            let x_m = 0.25 + 0.05 * f64::from(step);
            assert!(!is_free(&[[x_m, 0.1, x_m + 0.03, 0.13]]), "{x_m}");
        }
    }

    /// A speed that nobody knows, of the base or of a command on its way, leaves no candidate, though commands have arrived since.
    #[test]
    fn nothing_is_free_for_a_base_of_unknown_speed() {
        let mut stage = Stage::new(&Config::STANDARD, &[]);
        stage.wish = Twist::new(0.4, 0.2);
        stage.ticks(60);
        let situation = stage.arbiter.situation(stage.now_ns - TICK).unwrap();
        let (tube, space) = (&stage.arbiter.tube, &stage.arbiter.space);
        let candidate = Candidate { motion: Motion::steady(stage.wish), comfort: true, lately_seen: false };
        assert!(situation.pending_count > 0 && tube.check(&situation, space, &candidate).is_ok());
        for unknown in [Twist::new(f32::NAN, 0.2), Twist::new(0.4, f32::NAN)] {
            assert!(tube.check(&Situation { twist: unknown, ..situation }, space, &candidate).is_err());
            let mut pending = situation.pending;
            pending.iter_mut().for_each(|pending| pending.twist = unknown);
            assert!(tube.check(&Situation { pending, ..situation }, space, &candidate).is_err());
        }
    }

    /// Backward, what was not seen lately is not entered by 2 mm, whatever errors may take of a widening.
    #[test]
    fn errors_take_nothing_where_there_is_no_widening() {
        let mut stage = Stage::new(&Config::STANDARD, &[]);
        stage.ticks(10);
        let mut situation = stage.arbiter.situation(stage.now_ns - TICK).unwrap();
        let tube = &stage.arbiter.tube;
        situation.old_margin_m = 0.0;
        situation.old = [0; SAFETY_SIDE];
        // The cell from 0.30 m to the left on, beside the axle.
        situation.old[SAFETY_SIDE / 2] = 1 << (SAFETY_SIDE / 2 + 6);
        let motion = Motion::steady(Twist::new(-0.1, 0.0));
        let candidate = Candidate { motion, comfort: true, lately_seen: true };
        for (beyond_m, is_free) in [(-0.002, true), (0.002, false)] {
            let y_m = 0.30 + beyond_m - loomo().half_width_m();
            let at = Heading { x_m: 0.0, y_m, cos: 1.0, sin: 0.0 };
            let sweep = Sweep { situation: &situation, space: &stage.arbiter.space, candidate: &candidate };
            let found = tube.allowance(&sweep, &at, 0.0, ERROR_M);
            assert_eq!(found.is_ok(), is_free, "{beyond_m}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// A candidate is free where it is so for each member alone, in a lane beside a post.
        #[test]
        fn a_candidate_is_free_where_every_member_alone_is(
            (post_x, post_y) in (0.2f64..1.5, 0.2f64..0.8),
            lane in 0.36f64..1.0,
            first in (0.0f32..1.0, -1.0f32..1.0),
            (v, w) in (0.0f32..1.0, -1.5f32..1.5),
        ) {
            let post = [post_x, post_y, post_x + 0.03, post_y + 0.03];
            let mut stage = Stage::new(&Config::STANDARD, &[post, [-3.0, -lane - 1.0, 3.0, -lane]]);
            stage.wish = Twist::new(first.0, first.1);
            stage.ticks(60);
            let Some(situation) = stage.arbiter.situation(stage.now_ns - TICK) else { return Ok(()) };
            let arbiter = &stage.arbiter;
            let motion = Motion::steady(Twist::new(v, w));
            let candidate = Candidate { motion, comfort: true, lately_seen: false };
            let tube = &arbiter.tube;
            let together = tube.check(&situation, &arbiter.space, &candidate);
            let sweep = Sweep { situation: &situation, space: &arbiter.space, candidate: &candidate };
            let free = |member: &Member| {
                let mut brake = Brake::new(&candidate, &tube.limiter, &tube.robot);
                let from_m = tube.allowance(&sweep, &situation.at, 0.0, 0.0);
                from_m.is_ok_and(|from_m| tube.sweep(&sweep, &mut brake, &[[*member; LANES]], from_m).is_ok())
            };
            let all = tube.farthest.as_flattened().iter().chain(tube.others.as_flattened());
            prop_assert_eq!(together.is_ok(), all.into_iter().all(free));
        }
    }
}

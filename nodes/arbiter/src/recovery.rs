//! What to do when nothing helps: drive the way out that is known, else go on where the lead hesitates, back up where the
//! filter stops it, to see what lay too near to be seen, turn round, then rest and ask. The map is never cleared.

use crate::clearance::Rows;
use crate::config::{Config, span_ns};
use crate::gap::{Aim, Gaps};
use crate::maneuver::Maneuver;
use crate::way_out::{Planner, Scene};
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Pose2, Reason, Twist, wrap_angle};

/// `[rad]` a scan is done after a full turn.
const SCAN_RAD: f64 = 2.0 * std::f64::consts::PI;
/// `[ns]` longest scan, longest back-up or advance, and longest way out.
const SCAN_NS: u64 = 20_000_000_000;
const MOVE_NS: u64 = 10_000_000_000;
const MANEUVER_NS: u64 = 20_000_000_000;
/// Ways out from about the same place.
const MANEUVERS_MOST: u32 = 6;
/// `[ns]` a recovery that moves nothing for this long is over, or one that the filter refuses for this long.
const BLOCKED_NS: u64 = 1_500_000_000;
const REFUSED_NS: u64 = 200_000_000;
/// `[ns]` a wish of which the filter makes a turn on the spot for this long needs a way out, and time between two looks for one.
const TURNED_NS: u64 = 300_000_000;
const LOOK_NS: u64 = 250_000_000;
/// `[rad]` a turn by this much is progress as well, for three times the span allowed without any.
const PROGRESS_RAD: f64 = 0.6;
/// `[m]` and `[rad]` what counts as having moved at all.
const MOVED_M: f64 = 0.08;
const MOVED_RAD: f64 = 0.3;
/// `[m/s]` and [rad/s] a lead that wants less wants to stand.
const AT_REST: f32 = 1e-3;
/// `[m/s]` a lead that wants to go no faster hesitates; `[rad/s]` one that does not want to turn faster either crawls.
const SLOW_M_S: f32 = 0.15;
const SLOW_RAD_S: f32 = 0.2;
/// `[m/s]` and `[m]` speed and longest way of an advance.
const ADVANCE_M_S: f32 = 0.5;
const ADVANCE_M: f64 = 1.0;
/// `[m]` an advance ends this near to its goal.
const THERE_M: f64 = 0.15;
/// `[rad]` bearing of the goal beyond which an advance only turns, and the gain `[1/s]` of that turn.
const TURN_FIRST_RAD: f32 = 0.25;
const TURN_GAIN: f32 = 3.0;
/// `[ns]` an advance that cannot turn to its goal for this long goes straight on.
const STRAIGHT_NS: u64 = 1_000_000_000;
/// Times a lead is led on from about the same place.
const LED_ON_MOST: u32 = 2;
/// `[m]` this much farther from the trouble than a back-up leads, the next one is a new one.
const AWAY_M: f64 = 0.5;

const FOLLOW: u32 = 0;
const SCAN: u32 = 1;
const BACK_UP: u32 = 2;
const REST: u32 = 3;
/// Towards the goal, or straight on where there is no room to turn to it.
const ADVANCE: u32 = 4;
const STRAIGHT: u32 = 5;
/// Along the legs of a way out.
const MANEUVER: u32 = 6;

/// What held the last wish back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum HeldBack {
    /// Nothing: who hardly moves, does so by its own wish.
    Nothing = 0,
    /// Something that was seen.
    Seen = 1,
    /// A cell that the camera does not see now: waiting shows no more of it.
    Unseen = 2,
    /// Itself: it wants to stand.
    Itself = 3,
}

/// What the filter made of what it was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// A motion, if only backward, or a wait for what moves.
    Moves,
    /// A turn on the spot instead.
    Turns,
    /// Nothing to speak of, because of a cell of the map, or of something that only a direct sensor sees ([`HeldBack::Nothing`]).
    Refuses(HeldBack),
}

/// What the filter is asked for instead of the wish.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Action {
    /// The wish itself.
    Follow,
    /// A turn on the spot.
    Scan(Twist),
    /// A motion backward over free cells.
    BackUp(Twist),
    /// A motion towards the goal, through the middle of a gap.
    Advance(Twist),
    /// Rest, with the trouble as the reason.
    Rest(Reason),
}

/// What a step of the recovery goes by.
pub(crate) struct Moment<'a> {
    pub(crate) now_ns: u64,
    /// Pose in `odom`.
    pub(crate) pose: &'a Pose2,
    /// `[m]` the local goal in `odom`, and the way left to the last one.
    pub(crate) goal_m: (f64, f64),
    pub(crate) left_m: f32,
    pub(crate) gaps: Gaps<'a>,
    /// Frame of the safety map in `odom`.
    pub(crate) frame: Pose2,
    /// Cells nobody saw.
    pub(crate) unknown: &'a Rows,
    pub(crate) config: &'a Config,
}

/// The progress of the robot and of its recovery.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Recovery {
    /// Pose in `odom` since which progress is measured.
    anchor: Pose2,
    /// Pose in `odom` at which the phase began.
    place: Pose2,
    /// Pose in `odom` at which the last trouble began.
    trouble: Pose2,
    /// `[m]` the local goal in `odom` when the last trouble began.
    goal_x_m: f64,
    goal_y_m: f64,
    /// `[rad]` turned since the scan began.
    turned_rad: f64,
    last_yaw_rad: f64,
    anchor_ns: u64,
    /// `[ns]` graph time of the last progress by way, not by turning.
    way_ns: u64,
    phase_ns: u64,
    /// Pose in `odom` at `still_ns`.
    still: Pose2,
    /// `[ns]` graph time since which the robot did not move although something wants it to.
    still_ns: u64,
    /// `[1, -1]` side of the scan.
    side: f32,
    phase: u32,
    /// [`Reason`] code of the trouble.
    cause: u32,
    /// One bit for each phase that was tried here.
    tried: u32,
    /// [`HeldBack`] code.
    held_back: u32,
    /// How often the lead was led on through a gap from about `gap` on.
    led_on: u32,
    /// `[ns]` graph time since which the lead hardly wants to move although nothing holds it back; 0 = it wants to.
    slow_ns: u64,
    /// `[ns]` the same of a lead that hardly wants to turn either, and does not want to stand.
    crawls_ns: u64,
    /// Pose in `odom` from which it was led on last.
    gap: Pose2,
    /// `[ns]` graph time since which the filter refuses what it is asked; 0 = it does not.
    refused_ns: u64,
    /// `[ns]` the same, or makes a turn on the spot of it.
    turned_ns: u64,
    /// `[ns]` graph time of the last look for a way out; 0 = none yet.
    looked_ns: u64,
    /// Way out that is driven.
    maneuver: Maneuver,
    /// Pose in `odom` from about which ways out are counted.
    out_from: Pose2,
    maneuvers: u32,
    /// [`HeldBack`] code of the last refusal.
    refused_by: u32,
}

impl Recovery {
    /// Begins afresh, as when somebody else drove or the robot stood for a reason.
    pub(crate) fn rest(&mut self, now_ns: u64, pose: &Pose2) {
        let keep = (self.tried, self.trouble, self.led_on, self.gap, self.maneuvers, self.out_from);
        *self = Self {
            anchor: *pose,
            anchor_ns: now_ns,
            way_ns: now_ns,
            still: *pose,
            still_ns: now_ns,
            ..Self::zeroed()
        };
        (self.tried, self.trouble, self.led_on, self.gap, self.maneuvers, self.out_from) = keep;
    }

    /// An operator's word: tries everything again.
    pub(crate) fn forgive(&mut self) {
        self.phase = FOLLOW;
        self.tried = 0;
        self.led_on = 0;
        self.maneuvers = 0;
        (self.slow_ns, self.crawls_ns, self.refused_ns, self.turned_ns) = (0, 0, 0, 0);
        self.still_ns = 0;
        self.anchor_ns = 0;
    }

    /// Ways out that were begun about here, and whether one is driven.
    #[cfg(test)]
    pub(crate) fn ways_out(&self) -> (u32, bool) {
        (self.maneuvers, self.phase == MANEUVER)
    }

    /// Hears what the filter answered.
    pub(crate) fn answered(&mut self, now_ns: u64, answer: Answer) {
        let by = if let Answer::Refuses(by) = answer { Some(by) } else { None };
        self.refused_by = by.unwrap_or(HeldBack::Nothing) as u32;
        note_since(&mut self.refused_ns, now_ns, by.is_some());
        note_since(&mut self.turned_ns, now_ns, answer != Answer::Moves);
    }

    /// Hears what the lead wished, and what held it back.
    pub(crate) fn heard(&mut self, now_ns: u64, wish: Twist, by: HeldBack) {
        let rests = wish.v_m_s.abs() < AT_REST && wish.w_rad_s.abs() < AT_REST;
        self.held_back = if rests && by == HeldBack::Nothing { HeldBack::Itself } else { by } as u32;
        let is_slow = by == HeldBack::Nothing && wish.v_m_s.abs() <= SLOW_M_S;
        note_since(&mut self.slow_ns, now_ns, is_slow);
        note_since(&mut self.crawls_ns, now_ns, is_slow && !rests && wish.w_rad_s.abs() <= SLOW_RAD_S);
    }

    /// What to do now, given that there is a goal to drive to.
    pub(crate) fn action(&mut self, moment: &Moment<'_>, planner: &mut Planner) -> Action {
        let Moment { now_ns, pose, config, .. } = *moment;
        if self.phase == FOLLOW && is_away(pose, &self.trouble, config) {
            self.tried = 0;
        }
        self.note_progress(now_ns, pose, config);
        self.note_stillness(now_ns, pose);
        let since = |begin_ns: u64| now_ns.saturating_sub(begin_ns);
        let still_ns = since(self.still_ns);
        let is_refused = has_lasted(self.refused_ns, now_ns, REFUSED_NS);
        match self.phase {
            SCAN => {
                self.turned_rad += wrap_angle(pose.yaw_rad - self.last_yaw_rad).abs();
                self.last_yaw_rad = pose.yaw_rad;
                if still_ns > BLOCKED_NS || is_refused {
                    self.begin(REST, now_ns, pose);
                } else if self.turned_rad >= SCAN_RAD || since(self.phase_ns) > SCAN_NS {
                    self.tried |= 1 << SCAN;
                    self.begin(FOLLOW, now_ns, pose);
                }
            }
            BACK_UP => {
                let way_m = pose.distance_m(&self.place);
                let stuck = is_refused || still_ns > BLOCKED_NS || since(self.phase_ns) > MOVE_NS;
                if stuck || way_m >= f64::from(config.back_up_m) {
                    // From another place a way out may be driven.
                    self.tried = (self.tried | 1 << BACK_UP) & !(1 << MANEUVER);
                    // No room behind: look round instead.
                    self.begin(if way_m > MOVED_M { FOLLOW } else { SCAN }, now_ns, pose);
                }
            }
            ADVANCE if still_ns > STRAIGHT_NS || is_refused => {
                let place = self.place;
                self.begin(STRAIGHT, now_ns, pose);
                self.place = place;
            }
            ADVANCE | STRAIGHT => {
                let (x_m, y_m) = self.goal_from(pose);
                let there = self.phase == ADVANCE && libm::hypot(x_m, y_m) < THERE_M;
                let stuck = is_refused || still_ns > BLOCKED_NS || since(self.phase_ns) > MOVE_NS;
                self.tried |= u32::from(stuck) << ADVANCE;
                if stuck {
                    self.give_up(moment, planner, is_refused);
                } else if there || pose.distance_m(&self.place) > ADVANCE_M {
                    self.begin(FOLLOW, now_ns, pose);
                }
            }
            MANEUVER => {
                let stuck = is_refused || still_ns > BLOCKED_NS || since(self.phase_ns) > MANEUVER_NS;
                // One that led nowhere leads nowhere again.
                self.tried |= u32::from(stuck && pose.distance_m(&self.place) < MOVED_M) << MANEUVER;
                if stuck {
                    self.give_up(moment, planner, is_refused);
                } else if self.maneuver.is_over(pose) {
                    self.begin(FOLLOW, now_ns, pose);
                }
            }
            REST => {}
            _ => self.follow(moment, planner),
        }
        self.asked(moment)
    }

    /// Whether the lead hesitates before a gap that the footprint fits through, and no advance got stuck here or led back here
    /// again and again.
    fn hesitates(&self, moment: &Moment<'_>) -> bool {
        let Moment { now_ns, pose, goal_m, gaps, config, .. } = moment;
        let is_slow = has_lasted(self.slow_ns, *now_ns, span_ns(config.hesitate_s));
        let in_vain = self.led_on >= LED_ON_MOST && self.is_at_gap(pose);
        let may = is_slow && !in_vain && self.tried & 1 << ADVANCE == 0;
        may && gaps.aim(pose.inverse_transform(goal_m.0, goal_m.1)).is_gap
    }

    fn is_at_gap(&self, pose: &Pose2) -> bool {
        pose.distance_m(&self.gap) < AWAY_M
    }

    /// Goes on where the robot stands for too long or comes nowhere, leads on through a gap, or looks for a way out where the
    /// filter lets the wish go nowhere.
    fn follow(&mut self, moment: &Moment<'_>, planner: &mut Planner) {
        let Moment { now_ns, pose, goal_m, config, .. } = *moment;
        let since = |begin_ns: u64| now_ns.saturating_sub(begin_ns);
        // More time shows nothing to who does not know the floor, or why he crawls.
        let crawls = has_lasted(self.crawls_ns, now_ns, span_ns(config.unseen_s));
        let is_soon = crawls || self.is_held_back(HeldBack::Unseen);
        let stands =
            since(self.still_ns) >= span_ns(if is_soon { config.unseen_s } else { config.boxed_in_s });
        let lost = since(self.anchor_ns) >= span_ns(config.no_progress_s);
        let is_refused = has_lasted(self.refused_ns, now_ns, REFUSED_NS);
        let by_map = is_refused && self.refused_by != HeldBack::Nothing as u32;
        let turns = !is_refused && has_lasted(self.turned_ns, now_ns, TURNED_NS);
        if stands || lost {
            let is_free = self.is_held_back(HeldBack::Nothing) || self.is_held_back(HeldBack::Itself);
            self.cause = if stands && !is_free { Reason::BoxedIn } else { Reason::NoProgress } as u32;
            self.go_on(moment, planner);
        } else if self.hesitates(moment) {
            // No trouble yet: what was tried stays tried where it was.
            self.cause = Reason::NoProgress as u32;
            (self.goal_x_m, self.goal_y_m) = goal_m;
            (self.gap, self.led_on) =
                if self.is_at_gap(pose) { (self.gap, self.led_on + 1) } else { (*pose, 1) };
            self.begin(ADVANCE, now_ns, pose);
        } else if (by_map || turns) && since(self.looked_ns) >= LOOK_NS {
            // Free cells lead round what is in the way: they need not wait for it.
            self.cause = Reason::NoProgress as u32;
            self.leave(moment, planner);
        }
    }

    fn is_held_back(&self, by: HeldBack) -> bool {
        self.held_back == by as u32
    }

    /// Ends an advance or a way out that got stuck: what the camera does not see will not get out of the way, all else may.
    fn give_up(&mut self, moment: &Moment<'_>, planner: &mut Planner, is_refused: bool) {
        self.trouble = *moment.pose;
        if is_refused && self.refused_by == HeldBack::Unseen as u32 {
            self.held_back = self.refused_by;
            self.go_on(moment, planner);
        } else {
            self.begin(FOLLOW, moment.now_ns, moment.pose);
        }
    }

    /// Begins what was not tried here yet, a way out first, but not for who wants to stand.
    fn go_on(&mut self, moment: &Moment<'_>, planner: &mut Planner) {
        let Moment { now_ns, pose, goal_m, .. } = *moment;
        (self.goal_x_m, self.goal_y_m) = goal_m;
        self.side = if self.goal_from(pose).1 < 0.0 { -1.0 } else { 1.0 };
        self.trouble = *pose;
        let rests = self.is_held_back(HeldBack::Itself);
        if !rests && self.leave(moment, planner) {
            return;
        }
        // Who hesitates goes on; who is held back sees more from farther off.
        let is_free = rests || self.is_held_back(HeldBack::Nothing);
        let order = if is_free { [ADVANCE, BACK_UP, SCAN] } else { [BACK_UP, ADVANCE, SCAN] };
        let next = order.into_iter().find(|phase| self.tried & 1 << phase == 0).unwrap_or(REST);
        self.tried |= u32::from(next == ADVANCE) << ADVANCE;
        self.begin(next, now_ns, pose);
    }

    /// Begins a way out, if there is one.
    fn leave(&mut self, moment: &Moment<'_>, planner: &mut Planner) -> bool {
        self.looked_ns = moment.now_ns;
        let is_elsewhere = is_away(moment.pose, &self.out_from, moment.config);
        let begun = if is_elsewhere { 0 } else { self.maneuvers };
        if begun >= MANEUVERS_MOST || self.tried & 1 << MANEUVER != 0 {
            return false;
        }
        let Some(maneuver) = way_out(moment, planner) else { return false };
        self.maneuver = maneuver;
        (self.out_from, self.maneuvers) =
            if begun == 0 { (*moment.pose, 1) } else { (self.out_from, begun + 1) };
        self.begin(MANEUVER, moment.now_ns, moment.pose);
        true
    }

    /// `[m]` the goal of the trouble, seen from a pose.
    fn goal_from(&self, pose: &Pose2) -> (f64, f64) {
        pose.inverse_transform(self.goal_x_m, self.goal_y_m)
    }

    /// Begins to count anew how long the robot has not moved, where it did.
    fn note_stillness(&mut self, now_ns: u64, pose: &Pose2) {
        let turned = wrap_angle(pose.yaw_rad - self.still.yaw_rad).abs();
        if self.still_ns == 0 || pose.distance_m(&self.still) > MOVED_M || turned > MOVED_RAD {
            self.still = *pose;
            self.still_ns = now_ns;
        }
    }

    /// Moves the anchor on where the robot came on since: by way, or for a while by turning.
    fn note_progress(&mut self, now_ns: u64, pose: &Pose2, config: &Config) {
        let way = self.anchor_ns == 0 || pose.distance_m(&self.anchor) >= f64::from(config.progress_m);
        let turns = now_ns.saturating_sub(self.way_ns) < 3 * span_ns(config.no_progress_s);
        let turned = wrap_angle(pose.yaw_rad - self.anchor.yaw_rad).abs() >= PROGRESS_RAD;
        if way || turns && turned {
            self.anchor = *pose;
            self.anchor_ns = now_ns;
        }
        if way {
            self.way_ns = now_ns;
        }
    }

    /// Whether the rest may end by itself, or because the wish is free again.
    pub(crate) fn end_rest(
        &mut self,
        now_ns: u64,
        pose: &Pose2,
        free: bool,
        may_retry: bool,
        config: &Config,
    ) {
        let waited = now_ns.saturating_sub(self.phase_ns) >= span_ns(config.wait_s);
        let boxed_in = self.cause == Reason::BoxedIn as u32;
        if self.phase == REST && (boxed_in && free || may_retry && waited) {
            self.begin(FOLLOW, now_ns, pose);
            (self.tried, self.maneuvers) = (0, 0);
        }
    }

    fn begin(&mut self, phase: u32, now_ns: u64, pose: &Pose2) {
        self.phase = phase;
        self.phase_ns = now_ns;
        self.place = *pose;
        self.anchor = *pose;
        self.anchor_ns = now_ns;
        self.way_ns = now_ns;
        self.turned_rad = 0.0;
        self.last_yaw_rad = pose.yaw_rad;
        self.still = *pose;
        self.still_ns = now_ns;
        self.slow_ns = 0;
        self.crawls_ns = 0;
        self.refused_ns = 0;
        self.turned_ns = 0;
    }

    fn asked(&self, moment: &Moment<'_>) -> Action {
        let config = moment.config;
        match self.phase {
            SCAN => Action::Scan(Twist::new(0.0, self.side * config.escape_turn_rad_s)),
            BACK_UP => Action::BackUp(Twist::new(-config.back_up_m_s, 0.0)),
            STRAIGHT => Action::Advance(Twist::new(ADVANCE_M_S, 0.0)),
            MANEUVER => match self.maneuver.wish(moment.pose, config) {
                back if back.v_m_s < 0.0 => Action::BackUp(back),
                on => Action::Advance(on),
            },
            ADVANCE => {
                let Aim { x_m, y_m, .. } = moment.gaps.aim(self.goal_from(moment.pose));
                let bearing_rad = libm::atan2f(y_m, x_m);
                let part = (1.0 - bearing_rad.abs() / TURN_FIRST_RAD).max(0.0);
                let most = config.escape_turn_rad_s;
                let turn_rad_s = (TURN_GAIN * bearing_rad).clamp(-most, most);
                Action::Advance(Twist::new(ADVANCE_M_S * part, turn_rad_s))
            }
            REST if self.cause == Reason::BoxedIn as u32 => Action::Rest(Reason::BoxedIn),
            REST => Action::Rest(Reason::NoProgress),
            _ => Action::Follow,
        }
    }
}

/// A way out from here.
fn way_out(moment: &Moment<'_>, planner: &mut Planner) -> Option<Maneuver> {
    let Moment { goal_m, left_m, frame, gaps, unknown, .. } = moment;
    let mut blocked = *gaps.blocked;
    gaps.outline.exempt(&gaps.at, unknown, &mut blocked);
    let (x_m, y_m) = frame.inverse_transform(goal_m.0, goal_m.1);
    let goal_m = [x_m as f32, y_m as f32];
    planner.find(&Scene { frame, at: &gaps.at, blocked: &blocked, unknown, goal_m, left_m: *left_m })
}

/// Keeps since when something is: graph time `[ns]`, 0 while it is not.
fn note_since(since_ns: &mut u64, now_ns: u64, is: bool) {
    *since_ns = match *since_ns {
        _ if !is => 0,
        0 => now_ns,
        since_ns => since_ns,
    };
}

/// Whether it has been for so long.
fn has_lasted(since_ns: u64, now_ns: u64, span_ns: u64) -> bool {
    since_ns != 0 && now_ns.saturating_sub(since_ns) >= span_ns
}

/// Whether a pose is farther from a trouble than a back-up leads.
fn is_away(pose: &Pose2, trouble: &Pose2, config: &Config) -> bool {
    pose.distance_m(trouble) > AWAY_M + f64::from(config.back_up_m)
}

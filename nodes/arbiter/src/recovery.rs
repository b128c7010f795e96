//! What to do when nothing helps: back up to see what lay too near to be seen, turn round, then rest and ask. The map is
//! never cleared.

use crate::config::{Config, span_ns};
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{Pose2, Reason, Twist, wrap_angle};

/// `[rad]` a scan is done after a full turn.
const SCAN_RAD: f64 = 2.0 * std::f64::consts::PI;
/// `[ns]` longest scan and longest back-up.
const SCAN_NS: u64 = 20_000_000_000;
const BACK_UP_NS: u64 = 10_000_000_000;
/// `[ns]` a recovery that moves nothing for this long is over.
const BLOCKED_NS: u64 = 1_500_000_000;
/// `[rad]` a turn by this much is progress as well, for three times the span allowed without any.
const PROGRESS_RAD: f64 = 0.6;
/// `[m]` and `[rad]` what counts as having moved at all.
const MOVED_M: f64 = 0.08;
const MOVED_RAD: f64 = 0.3;
/// `[m]` this much farther from the trouble than a back-up leads, the next one is a new one.
const AWAY_M: f64 = 0.5;

const FOLLOW: u32 = 0;
const SCAN: u32 = 1;
const BACK_UP: u32 = 2;
const REST: u32 = 3;

/// What the filter is asked for instead of the wish.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Action {
    /// The wish itself.
    Follow,
    /// A turn on the spot.
    Scan(Twist),
    /// A motion backward over free cells.
    BackUp(Twist),
    /// Rest, with the trouble as the reason.
    Rest(Reason),
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
    /// 1 once a scan was done here.
    scanned: u32,
    /// 1 once it backed up here.
    backed: u32,
    /// 1 while what stops the wish is a cell that nobody saw: waiting shows no more of it.
    unseen: u32,
}

impl Recovery {
    /// Begins afresh, as when somebody else drove or the robot stood for a reason.
    pub(crate) fn rest(&mut self, now_ns: u64, pose: &Pose2) {
        let keep = (self.scanned, self.backed, self.trouble);
        *self = Self {
            anchor: *pose,
            anchor_ns: now_ns,
            way_ns: now_ns,
            still: *pose,
            still_ns: now_ns,
            ..Self::zeroed()
        };
        (self.scanned, self.backed, self.trouble) = keep;
    }

    /// An operator's word: tries everything again.
    pub(crate) fn forgive(&mut self) {
        self.phase = FOLLOW;
        (self.scanned, self.backed) = (0, 0);
        self.still_ns = 0;
        self.anchor_ns = 0;
    }

    /// Hears what stopped the last wish: whether it is a cell that nobody saw.
    pub(crate) fn stopped_by(&mut self, unseen: bool) {
        self.unseen = u32::from(unseen);
    }

    /// What to do now, given that somebody wants to drive towards the side `side`; `wants` tells whether the wish is
    /// more than to stand.
    pub(crate) fn action(
        &mut self,
        now_ns: u64,
        pose: &Pose2,
        (wants, side): (bool, f32),
        config: &Config,
    ) -> Action {
        if self.phase == FOLLOW && pose.distance_m(&self.trouble) > AWAY_M + f64::from(config.back_up_m) {
            (self.scanned, self.backed) = (0, 0);
        }
        self.note_progress(now_ns, pose, config);
        let turned = wrap_angle(pose.yaw_rad - self.still.yaw_rad).abs();
        let idle = !wants && self.phase == FOLLOW;
        if self.still_ns == 0 || idle || pose.distance_m(&self.still) > MOVED_M || turned > MOVED_RAD {
            self.still = *pose;
            self.still_ns = now_ns;
        }
        let since = |begin_ns: u64| now_ns.saturating_sub(begin_ns);
        let still_ns = since(self.still_ns);
        match self.phase {
            SCAN => {
                self.turned_rad += wrap_angle(pose.yaw_rad - self.last_yaw_rad).abs();
                self.last_yaw_rad = pose.yaw_rad;
                if still_ns > BLOCKED_NS {
                    self.begin(REST, now_ns, pose);
                } else if self.turned_rad >= SCAN_RAD || since(self.phase_ns) > SCAN_NS {
                    self.scanned = 1;
                    self.begin(FOLLOW, now_ns, pose);
                }
            }
            BACK_UP => {
                let way_m = pose.distance_m(&self.place);
                let stuck = still_ns > BLOCKED_NS || since(self.phase_ns) > BACK_UP_NS;
                if stuck || way_m >= f64::from(config.back_up_m) {
                    self.backed = 1;
                    // No room behind: look round instead.
                    self.begin(if way_m > MOVED_M { FOLLOW } else { SCAN }, now_ns, pose);
                }
            }
            REST => {}
            _ => {
                let patience_s = if self.unseen != 0 { config.unseen_s } else { config.boxed_in_s };
                let boxed_in = still_ns >= span_ns(patience_s);
                let lost = since(self.anchor_ns) >= span_ns(config.no_progress_s);
                if boxed_in || lost {
                    self.cause = if boxed_in { Reason::BoxedIn } else { Reason::NoProgress } as u32;
                    self.side = if side < 0.0 { -1.0 } else { 1.0 };
                    let phase = match (self.backed, self.scanned) {
                        (0, _) => BACK_UP,
                        (_, 0) => SCAN,
                        _ => REST,
                    };
                    self.trouble = *pose;
                    self.begin(phase, now_ns, pose);
                }
            }
        }
        self.asked(config)
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
            (self.scanned, self.backed) = (0, 0);
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
    }

    fn asked(&self, config: &Config) -> Action {
        match self.phase {
            SCAN => Action::Scan(Twist::new(0.0, self.side * config.escape_turn_rad_s)),
            BACK_UP => Action::BackUp(Twist::new(-config.back_up_m_s, 0.0)),
            REST if self.cause == Reason::BoxedIn as u32 => Action::Rest(Reason::BoxedIn),
            REST => Action::Rest(Reason::NoProgress),
            _ => Action::Follow,
        }
    }
}

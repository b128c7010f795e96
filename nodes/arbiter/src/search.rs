//! The filter: the largest part of a wish after which the robot can still stop on known-free cells.
//!
//! The scale is searched by halving; every command that leaves has itself been swept, so the search need not be
//! monotone. More cells in the way only turn answers from yes to no, and each no leads to smaller scales: an obstacle
//! never raises the scale, unless it keeps movers away.

use crate::clearance::FreeSpace;
use crate::config::Config;
use crate::held::Held;
use crate::limits::{Limiter, Motion};
use crate::tube::{Candidate, Hit, Situation, Tube};
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{NO_CELL, Reason, SAFETY_GRID, Twist};

/// A part of the wish is found to this.
const FINE: f32 = 1.0 / 640.0;
/// `[m/s]` an escape begins only below this speed; above, the curve of the brake must not change. Who backs up already may go on.
const SLOW_M_S: f32 = 0.15;
/// `[m/s]` and [rad/s] that there must be room for, to begin to move at all and to leave an escape.
const BEGIN: (f32, f32) = (0.06, 0.3);
const LEAVE: (f32, f32) = (0.35, 0.6);
/// `[ns]` an escape keeps its side for this long after it was last needed.
const SIDE_NS: u64 = 1_000_000_000;

/// `[ns]` an escape of so long ago, some ticks, is still under way.
const UNDER_WAY_NS: u64 = 50_000_000;
/// `[ns]` so long after an escape the next one is a new one.
const FORGET_NS: u64 = 3_000_000_000;

/// What the filter lets through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Filtered {
    pub(crate) motion: Motion,
    /// `[1]` part of the wish.
    pub(crate) scale: f32,
    pub(crate) reason: Reason,
    /// The cell in the way.
    pub(crate) cell: u32,
}

/// What the filter keeps: the side of the last escape.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Escape {
    /// `[ns]` graph time of the last escape.
    used_ns: u64,
    /// `[m]` backed up in this escape and those shortly before it.
    reversed_m: f32,
    /// `[1, -1]` side of the last turn.
    side: f32,
}

/// A question to the filter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Question {
    pub(crate) from: Motion,
    pub(crate) wish: Twist,
    pub(crate) dt_s: f32,
    pub(crate) now_ns: u64,
    /// `[1]` no scale above this: a cap of speed from ranges, or beside an obstacle.
    pub(crate) scale_max: f32,
    /// Whether a direct sensor leaves nothing of the wish.
    pub(crate) is_barred: bool,
    /// Side to turn to where the wish has none.
    pub(crate) side: f32,
    /// What may come of the wish where no part of it is safe.
    pub(crate) ways: Ways,
}

/// What may replace a wish, from the least to the most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Ways {
    /// The brake.
    Wish,
    /// The wish without its turn too.
    Straight,
    /// A turn on the spot and a way back too.
    Escapes,
}

/// The filter of one step.
pub(crate) struct Filter<'a> {
    pub(crate) config: &'a Config,
    pub(crate) limiter: &'a Limiter,
    pub(crate) tube: &'a Tube,
    pub(crate) space: &'a FreeSpace,
    pub(crate) situation: &'a Situation,
}

impl Filter<'_> {
    fn try_motion(&self, motion: Motion, comfort: bool, lately_seen: bool) -> Result<Motion, Hit> {
        let candidate = Candidate { motion, comfort, lately_seen };
        self.tube.check(self.situation, self.space, &candidate).map(|()| motion)
    }

    /// The safest answer to a question.
    pub(crate) fn answer(&self, question: &Question, escape: &mut Escape) -> Filtered {
        let wish = self.limiter.bounded(question.wish);
        if wish.v_m_s.abs() < 1e-3 && wish.w_rad_s.abs() < 1e-3 {
            return Filtered { scale: 1.0, ..self.brake(question, Reason::Clear, NO_CELL) };
        }
        let Hit { cell, moving } = match self.along(question, wish, escape) {
            Ok(filtered) if question.is_barred => return self.back_off(question, filtered, escape),
            Ok(filtered) => return filtered,
            Err(hit) => hit,
        };
        if moving {
            // It passes, or shows that nothing was there.
            return self.brake(question, Reason::Yielding, cell);
        }
        if question.ways >= Ways::Straight
            && !question.is_barred
            && wish.v_m_s.abs() > self.config.crawl_m_s
            && wish.w_rad_s != 0.0
        {
            // A corner that swings out meets cells which the flank passes.
            let straight = Twist::new(wish.v_m_s, 0.0);
            if let Ok(filtered) = self.along(question, straight, escape) {
                return Filtered { scale: 0.0, reason: Reason::Straight, cell, ..filtered };
            }
        }
        if may_escape(question, escape) {
            let is_slow = question.from.twist.v_m_s > -SLOW_M_S;
            let turn = is_slow.then(|| self.turn(question, wish, escape)).flatten();
            if let Some((motion, reason)) = turn.or_else(|| self.back_up(question, escape)) {
                escape.used_ns = question.now_ns;
                return Filtered { motion, scale: 0.0, reason, cell };
            }
        }
        self.brake(question, Reason::Braking, cell)
    }

    /// The answer where the map is free but a direct sensor sees something right ahead: a turn might swing a corner into it, so the
    /// robot backs off.
    fn back_off(&self, question: &Question, filtered: Filtered, escape: &mut Escape) -> Filtered {
        let back = may_escape(question, escape).then(|| self.back_up(question, escape)).flatten();
        let Some((motion, reason)) = back else {
            return filtered;
        };
        escape.used_ns = question.now_ns;
        Filtered { motion, scale: 0.0, reason, cell: NO_CELL }
    }

    /// As much of a wish as is safe, or the cell in the way.
    fn along(&self, question: &Question, wish: Twist, escape: &Escape) -> Result<Filtered, Hit> {
        self.nudge(question, wish, escape)?;
        let (found, hit) = self.largest(question, wish);
        let (motion, scale) = found.ok_or(hit)?;
        let (reason, cell) = match hit {
            _ if scale >= 1.0 => (Reason::Clear, NO_CELL),
            Hit { cell, moving: true } => (Reason::Yielding, cell),
            Hit { cell, moving: false } => (Reason::Slowed, cell),
        };
        Ok(Filtered { motion, scale, reason, cell })
    }

    /// Whether a robot that hardly moves has room to move at all along the wish: one tick's worth of speed is always
    /// safe, and would end in creeping. During an escape more room is asked for, so that it is not left too soon.
    fn nudge(&self, question: &Question, wish: Twist, escape: &Escape) -> Result<(), Hit> {
        if question.from.twist.v_m_s * wish.v_m_s.signum() > self.config.crawl_m_s {
            return Ok(());
        }
        let escaping = escape.used_ns != 0 && question.now_ns.saturating_sub(escape.used_ns) < SIDE_NS;
        let (speed, turn) = if escaping && question.ways == Ways::Escapes { LEAVE } else { BEGIN };
        let part = (speed / wish.v_m_s.abs().max(1e-6)).min(turn / wish.w_rad_s.abs().max(1e-6));
        let part = part.min(question.scale_max);
        let motion = Motion::steady(Twist::new(wish.v_m_s * part, wish.w_rad_s * part));
        self.try_motion(motion, true, false).map(|_| ())
    }

    /// The largest safe scale with its command, and what was in the way of the next larger.
    fn largest(&self, question: &Question, wish: Twist) -> (Option<(Motion, f32)>, Hit) {
        let at = |scale: f32| {
            let part = Twist::new(wish.v_m_s * scale, wish.w_rad_s * scale);
            self.limiter.towards(&question.from, part, question.dt_s)
        };
        let mut hit = Hit { cell: NO_CELL, moving: false };
        // Neighbouring scales often give the same command; it is swept once.
        let (mut passed, mut failed) = (None, None);
        let mut sweep = |scale: f32| {
            let motion = at(scale);
            if failed == Some(motion) {
                return None;
            }
            if passed != Some(motion) {
                if let Err(found) = self.try_motion(motion, true, false) {
                    (failed, hit) = (Some(motion), found);
                    return None;
                }
                passed = Some(motion);
            }
            passed
        };
        let top = question.scale_max.clamp(0.0, 1.0);
        if let Some(motion) = sweep(top) {
            return (Some((motion, top)), hit);
        }
        let (mut best, mut low, mut high) = (None, 0.0, top);
        // What the limits of this tick leave of the wish lies between these two.
        for scale in [at(top), at(0.0)].map(|end| part(&end.twist, &wish)) {
            if scale <= FINE || scale >= high {
                continue;
            }
            if let Some(motion) = sweep(scale) {
                (best, low) = (Some((motion, scale)), scale);
                break;
            }
            high = scale;
        }
        while high - low > FINE {
            let middle = 0.5 * (low + high);
            match sweep(middle) {
                Some(motion) => (best, low) = (Some((motion, middle)), middle),
                None => high = middle,
            }
        }
        (best, hit)
    }

    /// A turn on the spot: to the side of the last escape, of the wish, or of the goal; then to the other.
    fn turn(&self, question: &Question, wish: Twist, escape: &mut Escape) -> Option<(Motion, Reason)> {
        let lately = question.now_ns.saturating_sub(escape.used_ns) < SIDE_NS;
        let side = if lately && escape.side != 0.0 {
            escape.side
        } else if wish.w_rad_s.abs() > 0.05 {
            wish.w_rad_s.signum()
        } else {
            question.side
        };
        [side, -side].into_iter().find_map(|side| {
            let turn = Twist::new(0.0, side * self.config.escape_turn_rad_s);
            self.room(question, Twist::new(0.0, side * BEGIN.1), false)?;
            let motion = self.limiter.towards(&question.from, turn, question.dt_s);
            let motion = self.try_motion(motion, true, false).ok()?;
            escape.side = side;
            Some((motion, Reason::Rotating))
        })
    }

    /// Whether an escape that did not begin yet has room to begin.
    fn room(&self, question: &Question, begin: Twist, lately_seen: bool) -> Option<()> {
        let from = question.from.twist;
        let along = from.v_m_s * begin.v_m_s + from.w_rad_s * begin.w_rad_s;
        let half = 0.5 * (begin.v_m_s * begin.v_m_s + begin.w_rad_s * begin.w_rad_s);
        if along >= half {
            return Some(());
        }
        self.try_motion(Motion::steady(begin), true, lately_seen).ok().map(|_| ())
    }

    /// A short way back over cells seen lately.
    fn back_up(&self, question: &Question, escape: &mut Escape) -> Option<(Motion, Reason)> {
        if question.now_ns.saturating_sub(escape.used_ns) > FORGET_NS {
            escape.reversed_m = 0.0;
        }
        if escape.reversed_m >= self.config.back_up_m || question.wish.v_m_s < 0.0 {
            return None;
        }
        let back = Twist::new(-self.config.back_up_m_s, 0.0);
        self.room(question, Twist::new(-BEGIN.0, 0.0), true)?;
        let motion = self.limiter.towards(&question.from, back, question.dt_s);
        let motion = self.try_motion(motion, true, true).ok()?;
        escape.reversed_m += (-motion.twist.v_m_s).max(0.0) * question.dt_s;
        Some((motion, Reason::Reversing))
    }

    /// The brake: gentle where even that is safe, else the brake that was swept with every command before. Movers give way
    /// to what stands: a brake that would not be at rest in time for them is still one that hits nothing.
    fn brake(&self, question: &Question, reason: Reason, cell: u32) -> Filtered {
        let at = |comfort| self.limiter.brake(&question.from, question.dt_s, comfort);
        let (gentle, hard) = (at(true), at(false));
        if let Ok(motion) = self.try_motion(gentle, true, false) {
            return Filtered { motion, scale: 0.0, reason, cell };
        }
        let Err(hit) = self.try_motion(hard, false, false) else {
            return Filtered { motion: hard, scale: 0.0, reason, cell };
        };
        let among_standing = Situation { movers: false, ..*self.situation };
        for (motion, comfort) in [(hard, false), (gentle, true)] {
            let candidate = Candidate { motion, comfort, lately_seen: false };
            if self.situation.movers && self.tube.check(&among_standing, self.space, &candidate).is_ok() {
                return Filtered { motion, scale: 0.0, reason, cell };
            }
        }
        // An edge seen again may come nearer by a cell: braking answers that. An emergency is what comes nearer than that.
        let margin_m = self.situation.margin_m.min(self.tube.full_margin_m()) - SAFETY_GRID.cell_m;
        let nearer =
            Situation { margin_m, blocked: self.situation.taken, held: Held::NONE, ..among_standing };
        let candidate = Candidate { motion: hard, comfort: false, lately_seen: false };
        let harmless = self.tube.check(&nearer, self.space, &candidate).is_ok();
        let reason = if harmless { Reason::Braking } else { Reason::Emergency };
        Filtered { motion: hard, scale: 0.0, reason, cell: hit.cell }
    }
}

/// Whether an escape may begin or go on. Who rolls backward by a wish, not by an escape, brakes first: a turn may do.
fn may_escape(question: &Question, escape: &Escape) -> bool {
    let v_m_s = question.from.twist.v_m_s;
    let is_under_way = question.now_ns.saturating_sub(escape.used_ns) <= UNDER_WAY_NS;
    question.ways == Ways::Escapes && v_m_s < SLOW_M_S && (v_m_s > -SLOW_M_S || is_under_way)
}

/// The part of a wish that a twist is: of its speed, or of its turn where it is one on the spot.
fn part(twist: &Twist, wish: &Twist) -> f32 {
    if wish.v_m_s == 0.0 { twist.w_rad_s / wish.w_rad_s } else { twist.v_m_s / wish.v_m_s }
}

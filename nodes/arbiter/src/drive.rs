//! How a wish, or the wish to stop, becomes a filtered motion: the situation, the caps, the recovery.

use crate::ahead::ahead;
use crate::arbiter::{Arbiter, Verdict};
use crate::clearance::heading;
use crate::config::Resume;
use crate::gap::Gaps;
use crate::queue::{Pending, SENT_MAX};
use crate::recovery::{Action, Answer, HeldBack, Moment};
use crate::search::{Filter, Filtered, Question, Ways};
use crate::select::Selected;
use crate::tube::{ERROR_M, Situation};
use sidestep_msgs::{NO_CELL, Pose2, Reason, Twist, Winner, safety_frame};

/// `[1]` a boxed-in robot drives on when this part of the wish is safe again.
const FREE_SCALE: f32 = 0.5;
/// `[m/s]` fastest while cells are held that are not free.
const HELD_M_S: f32 = 0.1;
/// `[rad/s]` slower than this is no turn.
const CRAWL_RAD_S: f32 = 0.1;

impl Arbiter {
    /// Brakes to rest: gently where nothing is wrong and that is safe, else at once.
    pub(crate) fn stop(&mut self, reason: Reason, faulty: bool, now_ns: u64, dt_s: f32) -> Verdict {
        let pose = self.memory.inputs.odometry.pose;
        self.memory.recovery.rest(now_ns, &pose);
        let at_once = faulty || matches!(reason, Reason::EstopLatched | Reason::Starting);
        let motion = match self.situation(now_ns) {
            Some(situation) if !at_once && !self.memory.last.is_rest() => {
                let stop = self.question(Twist::STOP, now_ns, dt_s);
                self.ask(&situation, &Question { ways: Ways::Wish, ..stop }).motion
            }
            _ => self.limiter.brake(&self.memory.last, dt_s, false),
        };
        let filtered = Filtered { motion, scale: 0.0, reason, cell: NO_CELL };
        Verdict { winner: Winner::Stop, wish: Twist::STOP, filtered }
    }

    /// Drives as far as is safe.
    pub(crate) fn drive(&mut self, selected: &Selected, now_ns: u64, dt_s: f32) -> Verdict {
        let pose = self.memory.inputs.odometry.pose;
        let mut question = self.question(selected.twist, now_ns, dt_s);
        let action = if selected.winner == Winner::Teleop || self.memory.open_loop != 0 {
            self.memory.recovery.rest(now_ns, &pose);
            question.ways = Ways::Wish;
            Action::Follow
        } else {
            self.recover(now_ns, &pose)
        };
        let (winner, named) = match action {
            Action::Scan(_) => (Winner::Recovery, Some(Reason::ScanRotation)),
            Action::BackUp(_) => (Winner::Recovery, Some(Reason::BackUp)),
            Action::Advance(_) => (Winner::Recovery, Some(Reason::Advance)),
            Action::Rest(_) => (Winner::Stop, None),
            Action::Follow => (selected.winner, None),
        };
        match action {
            Action::Scan(way) | Action::BackUp(way) => (question.wish, question.ways) = (way, Ways::Wish),
            Action::Advance(way) => (question.wish, question.ways) = (way, Ways::Straight),
            Action::Rest(_) => question.ways = Ways::Wish,
            Action::Follow => {}
        }
        let wish = question.wish;
        let Some(mut situation) = self.situation(now_ns) else {
            let motion = self.limiter.brake(&self.memory.last, dt_s, false);
            let filtered = Filtered { motion, scale: 0.0, reason: Reason::Braking, cell: NO_CELL };
            return Verdict { winner, wish, filtered };
        };
        if question.ways == Ways::Escapes {
            situation.old_margin_m = self.tube.margin_at(&situation.at, &situation.old, 0.0);
        }
        let emergency = self.cap(&mut question, &situation, now_ns);
        let mut filtered = if emergency {
            let motion = self.limiter.brake(&self.memory.last, dt_s, false);
            Filtered { motion, scale: 0.0, reason: Reason::Emergency, cell: NO_CELL }
        } else {
            self.ask(&situation, &question)
        };
        self.memory.recovery.answered(now_ns, self.answered(&question, &filtered));
        if action == Action::Follow {
            let by = self.held_back_by(&filtered, selected.reason);
            self.memory.recovery.heard(now_ns, selected.twist, by);
        }
        if let Action::Rest(reason) = action {
            let may_retry = self.config.resume == Resume::Auto;
            let free = filtered.scale >= FREE_SCALE;
            self.memory.recovery.end_rest(now_ns, &pose, free, may_retry, &self.config);
            let stop = Question { wish: Twist::STOP, ..question };
            filtered = Filtered { scale: 0.0, reason, ..self.ask(&situation, &stop) };
            return Verdict { winner, wish: selected.twist, filtered };
        }
        filtered.reason = match (filtered.reason, named) {
            (Reason::Clear | Reason::Slowed, Some(named)) => named,
            (Reason::Clear, None) => selected.reason,
            (reason, _) => reason,
        };
        Verdict { winner, wish, filtered }
    }

    /// What the recovery does, given where the goal is and where its gaps are.
    fn recover(&mut self, now_ns: u64, pose: &Pose2) -> Action {
        let inputs = &self.memory.inputs;
        let (x_m, y_m) = (f64::from(inputs.goal_x_m), f64::from(inputs.goal_y_m));
        let frame = safety_frame(&inputs.map_base);
        let moment = Moment {
            now_ns,
            pose,
            goal_m: inputs.map_base.transform(x_m, y_m),
            left_m: inputs.goal_left_m,
            gaps: Gaps {
                outline: &self.outline,
                blocked: &self.space.blocked,
                at: heading(&frame, pose),
                margin_m: self.tube.full_margin_m(),
            },
            frame,
            unknown: &self.space.unknown,
            config: &self.config,
        };
        self.memory.recovery.action(&moment, &mut self.planner)
    }

    /// What the filter made of a question. A start that is slow because of the limits is none that is refused.
    fn answered(&self, question: &Question, filtered: &Filtered) -> Answer {
        let is_small = |twist: Twist, part: f32| {
            part * twist.v_m_s.abs() < self.config.crawl_m_s && part * twist.w_rad_s.abs() < CRAWL_RAD_S
        };
        let refuses = match filtered.reason {
            Reason::Braking | Reason::Emergency => true,
            Reason::Slowed => is_small(question.wish, filtered.scale),
            _ => false,
        };
        if is_small(question.wish, 1.0) {
            Answer::Moves
        } else if filtered.reason == Reason::Rotating {
            Answer::Turns
        } else if refuses && is_small(filtered.motion.twist, 1.0) {
            Answer::Refuses(self.refused_by(filtered))
        } else {
            Answer::Moves
        }
    }

    /// What refuses: a cell that the camera does not see now, one that it sees, or no cell of the map.
    fn refused_by(&self, filtered: &Filtered) -> HeldBack {
        if filtered.cell == NO_CELL {
            HeldBack::Nothing
        } else if self.space.is_unwatched(filtered.cell) {
            HeldBack::Unseen
        } else {
            HeldBack::Seen
        }
    }

    /// What held a wish back. Proposers that both see no way are held back by what they see.
    fn held_back_by(&self, filtered: &Filtered, reason: Reason) -> HeldBack {
        match filtered.scale < FREE_SCALE {
            true if self.refused_by(filtered) == HeldBack::Unseen => HeldBack::Unseen,
            false if reason != Reason::UnfitProposals => HeldBack::Nothing,
            _ => HeldBack::Seen,
        }
    }

    fn question(&self, wish: Twist, now_ns: u64, dt_s: f32) -> Question {
        let side = if self.memory.inputs.goal_y_m < 0.0 { -1.0 } else { 1.0 };
        Question {
            from: self.memory.last,
            wish: self.limiter.bounded(wish),
            dt_s,
            now_ns,
            scale_max: 1.0,
            is_barred: false,
            side,
            ways: Ways::Escapes,
        }
    }

    fn ask(&mut self, situation: &Situation, question: &Question) -> Filtered {
        let filter = Filter {
            config: &self.config,
            limiter: &self.limiter,
            tube: &self.tube,
            space: &self.space,
            situation,
        };
        filter.answer(question, &mut self.memory.escape)
    }

    /// Caps the speed of a question beside obstacles and before what the direct sensors see; returns whether the
    /// robot could not stop any more.
    fn cap(&self, question: &mut Question, situation: &Situation, now_ns: u64) -> bool {
        let speed = question.wish.v_m_s.abs().max(1e-6);
        let mut most = f32::INFINITY;
        if situation.held.is_any() {
            most = HELD_M_S;
        } else if situation.margin_m < self.tube.full_margin_m() {
            most = self.config.squeeze_m_s;
        }
        let sees = |sign| ahead(&self.memory.inputs, &self.config, &self.robot, &self.outline, now_ns, sign);
        if let Some(seen) = sees(question.wish.v_m_s.signum()) {
            most = most.min(seen.speed_m_s);
            question.is_barred = speed > self.config.crawl_m_s && seen.speed_m_s < self.config.crawl_m_s;
        }
        question.scale_max = (most / speed).min(1.0);
        let rolls = situation.twist.v_m_s;
        rolls.abs() > 0.05 && sees(rolls.signum()).is_some_and(|seen| seen.emergency)
    }

    /// What is the same for every candidate of this step, or `None` where the robot overlaps cells that are not free
    /// too deeply to say what is safe. Notes how much nearer the last motion led.
    pub(crate) fn situation(&mut self, now_ns: u64) -> Option<Situation> {
        let inputs = &self.memory.inputs;
        let odometry = &inputs.odometry;
        let frame = safety_frame(&inputs.map_base);
        let at = heading(&frame, &odometry.pose);
        let (mut blocked, mut old) = (self.space.blocked, self.space.old);
        self.outline.exempt(&at, &self.space.unknown, &mut blocked);
        let taken = blocked;
        let room_m = |pose: &Pose2| self.tube.room_m(&heading(&frame, pose), &taken);
        self.memory.approach.note(&odometry.pose, self.tube.full_margin_m(), room_m);
        let held = self.tube.hold(&at, &mut blocked)?;
        // What the robot stands on it does not see: where nothing is held it is free, however long ago it was seen.
        let under = self.outline.overlapped(&at, 0.0, &old);
        old.iter_mut().zip(under).for_each(|(old, under)| *old &= !under);
        let margin_m = self.tube.margin_at(&at, &blocked, self.tube.least_margin_m);
        let mut pending = [Pending::default(); SENT_MAX];
        let reach_s = self.robot.actuator.dead_time_max_s;
        let pending_count = self.memory.queue.pending(odometry.stamp_ns, reach_s, &mut pending);
        Some(Situation {
            at,
            twist: odometry.twist,
            age_s: now_ns.saturating_sub(odometry.stamp_ns) as f32 * 1e-9,
            map_s: odometry.stamp_ns.wrapping_sub(inputs.map_stamps.stamp_ns).cast_signed() as f32 * 1e-9,
            movers: self.space.movers.speed_m_s() > 0.0,
            pending,
            pending_count,
            margin_m,
            error_m: (ERROR_M - self.memory.approach.taken_m).max(0.0),
            old_margin_m: f32::NAN,
            blocked,
            old,
            held,
            taken,
        })
    }
}

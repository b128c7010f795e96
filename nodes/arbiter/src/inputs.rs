//! The newest good message of every input, copied, and what makes it unusable.

use crate::config::{Config, span_ns};
use crate::freshness::{Stamps, Trouble};
use bytemuck::{Pod, Zeroable};
use sidestep_msgs::{
    Header, LocalGoal, NearField, Odometry, Pose2, Proposal, Range, Ranges, Reason, Robot, SafetyMap, Status,
    Teleop, Twist,
};

/// `[ns]` odometry that repeats its bytes over this span of stamps while the base is told to move is frozen.
const FROZEN_NS: u64 = 100_000_000;
/// `[s]` after the dead time: a base that was told to move must have moved.
const REACTION_S: f32 = 0.3;
/// `[m/s]` and [rad/s]: below this a base may well stand still.
const TOLD_M_S: f32 = 0.1;
const TOLD_RAD_S: f32 = 0.3;

/// A proposer's newest wish.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Wish {
    pub(crate) stamps: Stamps,
    /// Frame of the newest message, good or not.
    pub(crate) source_frame: u64,
    /// `[ns]` capture stamp of the newest message, good or not.
    heard_ns: u64,
    pub(crate) twist: Twist,
    pub(crate) doubt_v_m_s: f32,
    pub(crate) doubt_w_rad_s: f32,
    /// 1 while the newest message cannot be driven: not finite, infeasible or a fault.
    pub(crate) unfit: u32,
    /// [`Status`] of the newest message.
    pub(crate) status: u32,
    /// Good messages in a row.
    pub(crate) good: u32,
    pub(crate) _pad: u32,
}

impl Wish {
    /// Takes a proposal; returns whether its frame is new.
    pub(crate) fn take(&mut self, proposal: &Proposal, header: &Header) -> bool {
        // Copied, then checked: the original lies in shared memory.
        let twist = proposal.twist;
        let fit = header.status == Status::Ok as u32 && twist.is_finite();
        let good = self.stamps.offer(proposal.capture_ns, header.now_ns, fit);
        self.heard_ns = proposal.capture_ns;
        self.status = header.status;
        self.unfit = u32::from(!fit);
        self.good = if good { self.good.saturating_add(1) } else { 0 };
        if good {
            self.twist = twist;
            self.doubt_v_m_s = proposal.doubt_v_m_s;
            self.doubt_w_rad_s = proposal.doubt_w_rad_s;
        }
        // Any other frame is new: a restarted camera counts from one again.
        let new = header.source_frame != 0 && header.source_frame != self.source_frame;
        self.source_frame = header.source_frame;
        new
    }

    /// Whether it may drive.
    pub(crate) fn is_usable(&self, now_ns: u64, limit_s: f32) -> bool {
        self.unfit == 0 && self.stamps.is_fresh(now_ns, limit_s)
    }

    /// Whether its sender lives and its newest message cannot be driven.
    pub(crate) fn refuses(&self, now_ns: u64, limit_s: f32) -> bool {
        self.unfit != 0 && now_ns.abs_diff(self.heard_ns) <= span_ns(limit_s)
    }
}

/// What the arbiter keeps of its inputs; the cells of the map are kept beside it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Inputs {
    pub(crate) odometry: Odometry,
    pub(crate) odometry_stamps: Stamps,
    /// `[ns]` stamp of the first odometry with the same pose and twist as the newest.
    same_since_ns: u64,
    /// `[ns]` graph time since which the base is told to move; 0 = it is not.
    told_since_ns: u64,
    pub(crate) map_stamps: Stamps,
    /// Pose of the robot when the map was made.
    pub(crate) map_base: Pose2,
    pub(crate) map_frame: u64,
    pub(crate) goal_stamps: Stamps,
    pub(crate) goal_x_m: f32,
    pub(crate) goal_y_m: f32,
    /// `[m]` way left to the last goal.
    pub(crate) goal_left_m: f32,
    pub(crate) goal_status: u32,
    pub(crate) map_epoch: u32,
    /// 1 while the frozen odometry was not seen to change.
    frozen: u32,
    pub(crate) policy: Wish,
    pub(crate) expert: Wish,
    pub(crate) teleop: Teleop,
    pub(crate) teleop_stamps: Stamps,
    pub(crate) ranges_stamps: Stamps,
    pub(crate) sensors: [Range; 8],
    pub(crate) sensor_count: u32,
    pub(crate) near_left_rad: f32,
    pub(crate) near_sector_rad: f32,
    /// 1 once a near field came.
    pub(crate) near_known: u32,
    pub(crate) near_stamps: Stamps,
    pub(crate) near_m: [f32; 64],
}

impl Inputs {
    pub(crate) fn take_odometry(&mut self, odometry: &Odometry, header: &Header) {
        // Copied, then checked: the original lies in shared memory.
        let odometry = *odometry;
        let numbers = [odometry.roll_rad, odometry.pitch_rad];
        let fit = odometry.pose.is_finite()
            && odometry.twist.is_finite()
            && numbers.iter().all(|number| number.is_finite());
        if !self.odometry_stamps.offer(odometry.stamp_ns, header.now_ns, fit) {
            return;
        }
        let same = same_bits(&odometry.pose, &self.odometry.pose)
            && same_bits(&odometry.twist, &self.odometry.twist);
        if !same {
            self.same_since_ns = odometry.stamp_ns;
            self.frozen = 0;
        }
        self.odometry = odometry;
    }

    /// Notes the header and the stamp of a safety map; returns whether its cells may be taken.
    pub(crate) fn take_map(&mut self, map: &SafetyMap, header: &Header) -> bool {
        let pose = map.base;
        let fit = header.status == Status::Ok as u32 && pose.is_finite();
        if !self.map_stamps.offer(map.capture_ns, header.now_ns, fit) {
            return false;
        }
        self.map_base = pose;
        self.map_epoch = map.pose_epoch;
        self.map_frame = header.source_frame;
        true
    }

    pub(crate) fn take_goal(&mut self, goal: &LocalGoal, header: &Header) {
        let told = [Status::Ok, Status::Arrived, Status::NoGoal, Status::Hold, Status::Lost];
        let is_placed = goal.x_m.is_finite() && goal.y_m.is_finite();
        let fit = told.iter().any(|status| *status as u32 == header.status)
            && (is_placed || header.status != Status::Ok as u32);
        if self.goal_stamps.offer(goal.capture_ns, header.now_ns, fit) {
            self.goal_status = header.status;
            self.goal_x_m = goal.x_m;
            self.goal_y_m = goal.y_m;
            let range_m = libm::hypotf(goal.x_m, goal.y_m);
            self.goal_left_m = if goal.remaining_m.is_finite() { goal.remaining_m } else { range_m };
        }
    }

    pub(crate) fn take_teleop(&mut self, teleop: &Teleop) {
        let teleop = *teleop;
        let fit = teleop.v_m_s.is_finite() && teleop.w_rad_s.is_finite();
        if self.teleop_stamps.offer(teleop.stamp_ns, 0, fit) {
            self.teleop = teleop;
        } else if !fit && teleop.dead_man != 0 {
            // A person holds on and cannot be understood: stop. What a released stick said before is nobody's wish.
            if self.teleop.dead_man == 0 {
                (self.teleop.v_m_s, self.teleop.w_rad_s) = (0.0, 0.0);
            }
            self.teleop.dead_man = 1;
        }
    }

    /// Gives the robot back to the graph after a stick fell silent; one that speaks keeps it.
    pub(crate) fn release_teleop(&mut self, now_ns: u64, limit_s: f32) {
        if !self.teleop_stamps.is_fresh(now_ns, limit_s) {
            self.teleop.dead_man = 0;
        }
    }

    pub(crate) fn take_ranges(&mut self, ranges: &Ranges) {
        if self.ranges_stamps.offer(ranges.stamp_ns, 0, true) {
            self.sensors = ranges.sensors;
            self.sensor_count = ranges.count.min(self.sensors.len() as u32);
        }
    }

    pub(crate) fn take_near_field(&mut self, near: &NearField) {
        let fit = near.left_rad.is_finite() && near.sector_rad.is_finite();
        if self.near_stamps.offer(near.capture_ns, 0, fit) {
            self.near_m = near.range_m;
            self.near_left_rad = near.left_rad;
            self.near_sector_rad = near.sector_rad;
            self.near_known = 1;
        }
    }

    /// Forgets stamps that lie in the future.
    pub(crate) fn distrust_future(&mut self, now_ns: u64) {
        for stamps in [
            &mut self.odometry_stamps,
            &mut self.map_stamps,
            &mut self.goal_stamps,
            &mut self.policy.stamps,
            &mut self.expert.stamps,
            &mut self.teleop_stamps,
            &mut self.ranges_stamps,
            &mut self.near_stamps,
        ] {
            stamps.distrust_future(now_ns);
        }
    }

    /// Notes what the base is told, to know when it should have moved.
    pub(crate) fn told(&mut self, now_ns: u64, command: Twist) {
        let moves = command.v_m_s.abs() > TOLD_M_S || command.w_rad_s.abs() > TOLD_RAD_S;
        if !moves {
            self.told_since_ns = 0;
        } else if self.told_since_ns == 0 {
            self.told_since_ns = now_ns;
        }
    }

    /// An operator's word ends the suspicion that the odometry is frozen.
    pub(crate) fn forgive_frozen(&mut self) {
        self.frozen = 0;
        self.told_since_ns = 0;
    }

    /// Whether the odometry repeats its bytes although the base is told to move; kept until it changes.
    fn is_frozen(&mut self, now_ns: u64, open_loop: bool, robot: &Robot) -> bool {
        let patience_ns = span_ns(robot.actuator.dead_time_max_s + REACTION_S);
        let told = self.told_since_ns != 0 && now_ns.saturating_sub(self.told_since_ns) > patience_ns;
        let same_ns = self.odometry.stamp_ns.saturating_sub(self.same_since_ns);
        if told && same_ns > FROZEN_NS && !open_loop {
            self.frozen = 1;
        }
        self.frozen != 0
    }

    /// Why nothing may move: odometry and map come first.
    pub(crate) fn fault(
        &mut self,
        now_ns: u64,
        open_loop: bool,
        config: &Config,
        robot: &Robot,
    ) -> Option<Reason> {
        if let Some(trouble) = self.odometry_stamps.trouble(now_ns, config.odometry_age_s) {
            return Some(match trouble {
                Trouble::Never => Reason::NoOdometry,
                Trouble::Stale => Reason::StaleOdometry,
                Trouble::Repeated | Trouble::Backward => Reason::BackwardOdometry,
                Trouble::Unfit => Reason::UnfitOdometry,
            });
        }
        if self.odometry.slip != 0 {
            return Some(Reason::Slip);
        }
        if self.is_frozen(now_ns, open_loop, robot) {
            return Some(Reason::FrozenOdometry);
        }
        if let Some(trouble) = self.map_stamps.trouble(now_ns, config.map_age_s) {
            return Some(match trouble {
                Trouble::Never => Reason::NoMap,
                Trouble::Stale => Reason::StaleMap,
                Trouble::Repeated => Reason::RepeatedMap,
                Trouble::Backward => Reason::BackwardMap,
                Trouble::Unfit => Reason::RefusedMap,
            });
        }
        if self.map_epoch != self.odometry.pose_epoch {
            return Some(Reason::PoseJump);
        }
        if self.near_known != 0 && !self.near_stamps.is_fresh(now_ns, config.near_field_age_s) {
            return Some(Reason::StaleNearField);
        }
        None
    }
}

fn same_bits<T: Pod>(a: &T, b: &T) -> bool {
    bytemuck::bytes_of(a) == bytemuck::bytes_of(b)
}

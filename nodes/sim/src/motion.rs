//! Robot and people together, stepped in time; contact stops the robot where it stands.

use crate::base::{Base, Response};
use crate::people::People;
use crate::solid::Solid;
use crate::world::{CLEARANCE_MAX_M, World};
use sidestep_msgs::{Pose2, Robot};

/// `[m]` whatever reaches below this height can be touched.
const ROBOT_TOP_M: f64 = 1.0;
/// `[m]` a contact ends when the gap exceeds this.
const APART_M: f64 = 0.005;
/// `[m/s]` a contact that begins slower than this is no collision.
const MOVING_M_S: f64 = 0.02;
/// `[m]` gaps below this count as touching.
const TOUCH_M: f64 = 1e-6;

/// The outline of the robot.
#[derive(Debug, Clone)]
pub(crate) struct Outline {
    corners_m: [[f64; 2]; 8],
    count: usize,
    reach_m: f64,
}

impl Outline {
    pub(crate) fn new(robot: &Robot) -> Self {
        let mut corners_m = [[0.0; 2]; 8];
        let count = robot.footprint.polygon_m.len().min(8);
        for (to, from) in corners_m.iter_mut().zip(&robot.footprint.polygon_m) {
            *to = from.map(f64::from);
        }
        Self { corners_m, count, reach_m: f64::from(robot.radius_m()) }
    }

    /// `[m]` gap between the outline at `pose` and the nearest of the solids, up to [`CLEARANCE_MAX_M`].
    fn gap_m(&self, pose: &Pose2, solids: impl Iterator<Item = Solid>) -> f64 {
        let mut placed = [[0.0; 2]; 8];
        for (to, from) in placed.iter_mut().zip(&self.corners_m[..self.count]) {
            let (x, y) = pose.transform(from[0], from[1]);
            *to = [x, y];
        }
        let mut least = CLEARANCE_MAX_M;
        for solid in solids {
            let apart = solid.distance_m([pose.x_m, pose.y_m]) - self.reach_m;
            if apart < least && solid.is_in_band(ROBOT_TOP_M) {
                least = least.min(solid.gap_m(&placed[..self.count]));
            }
        }
        least
    }
}

/// What moves.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub(crate) base: Base,
    pub(crate) people: People,
    pub(crate) contact: bool,
    pub(crate) collisions: u32,
    pub(crate) min_clearance_m: f64,
    /// `[m]` nothing can be touched before this much relative motion.
    slack_m: f64,
}

impl Motion {
    pub(crate) fn new(start: Pose2, people: People) -> Self {
        let base = Base::new(start);
        Self { base, people, contact: false, collisions: 0, min_clearance_m: CLEARANCE_MAX_M, slack_m: 0.0 }
    }

    /// `[m]` gap between robot and the nearest thing; 0 = contact.
    pub(crate) fn clearance_m(&self, world: &World, outline: &Outline) -> f64 {
        self.clearance_at_m(&self.base.pose, world, outline)
    }

    /// `[m]` the gap that there would be at another pose.
    pub(crate) fn clearance_at_m(&self, pose: &Pose2, world: &World, outline: &Outline) -> f64 {
        outline.gap_m(pose, world.solids.iter().copied().chain(self.people.solids(&world.walkers)))
    }

    /// The world has changed: what is near must be looked at again.
    pub(crate) fn look_again(&mut self) {
        self.slack_m = 0.0;
    }

    /// Pushes the robot to a pose; it stands there, and its wheels know how it came there.
    pub(crate) fn push(&mut self, pose: &Pose2) {
        let moved = self.base.pose.relative(pose);
        let believed = self.base.believed.compose(&moved);
        self.base.stop_at(*pose, believed);
        self.contact = false;
        self.look_again();
    }

    /// Moves on by `dt_s` from the graph time `now_ns`.
    pub(crate) fn step(
        &mut self,
        now_ns: u64,
        dt_s: f64,
        world: &World,
        outline: &Outline,
        response: &Response,
    ) {
        let (pose, believed) = (self.base.pose, self.base.believed);
        self.base.step(now_ns, dt_s, response);
        self.people.step(&world.walkers, [pose.x_m, pose.y_m], dt_s);
        let speed = self.base.v_m_s.abs() + self.base.w_rad_s.abs() * outline.reach_m;
        // Twice the speed bounds what a step can add to it.
        self.slack_m -= (2.0 * speed + self.people.fastest_m_s(&world.walkers)) * dt_s + 1e-9;
        if self.slack_m > 0.0 && !self.contact {
            return;
        }
        let gap = self.clearance_m(world, outline);
        self.min_clearance_m = self.min_clearance_m.min(gap);
        self.slack_m = gap - TOUCH_M;
        if gap <= TOUCH_M {
            if !self.contact && speed > MOVING_M_S {
                self.collisions += 1;
            }
            self.contact = true;
            self.base.stop_at(pose, believed);
        } else if gap > APART_M {
            self.contact = false;
        }
    }
}

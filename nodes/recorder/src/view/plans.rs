//! What policy and expert would do, and the goal they do it for.

use super::channels::{CANDIDATES, EXPERT_PLAN, GOAL, POLICY_PLAN};
use super::file_time::{FileTime, is_due};
use super::shapes::{BASE, EXPERT, FAINT, LINE_M, POLICY, arrows, entity, line, point, pose, scene};
use super::sheet::Sheet;
use super::{Fan, Seen};
use foxglove::messages::line_primitive::Type::{LineList, LineStrip};
use foxglove::messages::{Color, Duration, LinePrimitive, Point3, PoseInFrame};
use sidestep_msgs::{
    EXPERT_COMMAND, LOCAL_GOAL, LocalGoal, POLICY_COMMAND, Pose2, Proposal, Status, TRAJECTORY_MAX,
};

/// `[ns]` graph time between two fans of candidates: every fifth frame at 30 Hz.
const FAN_EVERY_NS: u64 = 160_000_000;
/// `[m]` heights that keep lines on the floor apart.
const FAN_HEIGHT_M: f64 = 0.01;
const PLAN_HEIGHT_M: f64 = 0.03;
/// `[m]` height of a proposal's arrows.
const ARROW_HEIGHT_M: f64 = 0.2;
/// Steps of a rolled-out velocity, 0.1 s each: the horizon of the expert.
const ROLLED_STEPS: usize = 24;
const STEP_S: f64 = 0.1;

const _: () = assert!(ROLLED_STEPS <= TRAJECTORY_MAX);

/// What is not renewed for a second is gone.
fn lifetime() -> Option<Duration> {
    Duration::new_checked(1, 0)
}

/// What is remembered of plans.
pub(crate) struct Plans {
    fan: Option<Fan>,
    fan_ns: Option<u64>,
}

impl Plans {
    pub(crate) fn new(fan: Option<Fan>) -> Self {
        Self { fan, fan_ns: None }
    }

    pub(crate) fn take(&mut self, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        let has_sense = seen.header.status == Status::Ok as u32;
        if let Some(goal) = seen.read(LOCAL_GOAL) {
            if has_sense {
                let place = Pose2::new(f64::from(goal.x_m), f64::from(goal.y_m), 0.0);
                let timestamp = time.stamp(goal.capture_ns);
                let pose = Some(pose(&place, 0.0));
                sheet.put(GOAL, &PoseInFrame { timestamp, frame_id: BASE.into(), pose });
                self.candidates(&goal, time, sheet);
            }
        } else if let Some(proposal) = seen.read(POLICY_COMMAND) {
            show(&proposal, has_sense, (POLICY_PLAN, "policy", POLICY), time, sheet);
        } else if let Some(proposal) = seen.read(EXPERT_COMMAND) {
            show(&proposal, has_sense, (EXPERT_PLAN, "expert", EXPERT), time, sheet);
        }
    }

    fn candidates(&mut self, goal: &LocalGoal, time: &FileTime, sheet: &mut Sheet) {
        let Some(fan) = &self.fan else { return };
        let capture_ns = goal.capture_ns;
        if !is_due(&mut self.fan_ns, capture_ns, FAN_EVERY_NS) {
            return;
        }
        let mut curves = entity("candidates", BASE, time.stamp(capture_ns));
        curves.lifetime = lifetime();
        curves.lines = vec![bundle(&fan(goal))];
        sheet.put(CANDIDATES, &scene(vec![curves]));
    }
}

/// Many curves as one list of lines, each point given once.
fn bundle(curves: &[Vec<[f32; 2]>]) -> LinePrimitive {
    let mut points = Vec::with_capacity(curves.iter().map(Vec::len).sum());
    let mut indices = Vec::new();
    for curve in curves {
        let first = points.len() as u32;
        points.extend(curve.iter().map(|[x_m, y_m]| point(f64::from(*x_m), f64::from(*y_m), FAN_HEIGHT_M)));
        indices.extend((first + 1..points.len() as u32).flat_map(|index| [index - 1, index]));
    }
    LinePrimitive { indices, scale_invariant: true, ..line(LineList, points, 1.0, FAINT) }
}

/// The poses of a proposal from the robot on; a velocity without poses is rolled out.
fn way(proposal: &Proposal) -> Vec<Point3> {
    let place = |x_m: f64, y_m: f64| point(x_m, y_m, PLAN_HEIGHT_M);
    let mut points = vec![place(0.0, 0.0)];
    let count = (proposal.trajectory_count as usize).min(TRAJECTORY_MAX);
    let poses = proposal.trajectory_x_m.iter().zip(&proposal.trajectory_y_m).take(count);
    points.extend(poses.map(|(x_m, y_m)| place(f64::from(*x_m), f64::from(*y_m))));
    if count == 0 {
        let mut at = Pose2::ORIGIN;
        for _ in 0..ROLLED_STEPS {
            at = at.advance(&proposal.twist, STEP_S);
            points.push(place(at.x_m, at.y_m));
        }
    }
    points
}

/// A proposal that is none leaves its entity empty, which takes the last one away.
fn show(
    proposal: &Proposal,
    has_sense: bool,
    (channel, id, color): (usize, &str, Color),
    time: &FileTime,
    sheet: &mut Sheet,
) {
    let mut plan = entity(id, BASE, time.stamp(proposal.capture_ns));
    plan.lifetime = lifetime();
    if has_sense && proposal.twist.is_finite() {
        plan.lines = vec![line(LineStrip, way(proposal), LINE_M, color)];
        plan.arrows = arrows(&proposal.twist, ARROW_HEIGHT_M, color);
    }
    sheet.put(channel, &scene(vec![plan]));
}

//! The robot and, in simulation, the world as it is.

use super::Seen;
use super::channels::{ROBOT, TRUE_WORLD};
use super::file_time::{FileTime, is_due};
use super::shapes::{
    ALARM, BASE, COMMANDED, LINE_M, OUTLINE, PERSON, WISHED, WORLD, arrows, entity, line, point, pose, scene,
    vector,
};
use super::sheet::Sheet;
use foxglove::messages::line_primitive::Type::LineLoop;
use foxglove::messages::{CylinderPrimitive, SpherePrimitive};
use sidestep_msgs::{COMMAND, Command, Pose2, TRUTH, Truth};

/// `[ns]` graph time between two pictures of the robot.
const ROBOT_EVERY_NS: u64 = 33_000_000;
/// `[ns]` graph time between two pictures of the world.
const WORLD_EVERY_NS: u64 = 100_000_000;
/// `[m]` people are drawn this wide and high.
const PERSON_M: [f64; 2] = [0.4, 1.7];
/// `[m]` height of the arrows of the command; the wish lies below.
const COMMAND_HEIGHT_M: f64 = 0.3;
const WISH_HEIGHT_M: f64 = 0.25;

/// What is remembered of scenes.
pub(crate) struct Scenes {
    footprint_m: Vec<[f32; 2]>,
    robot_ns: Option<u64>,
    world_ns: Option<u64>,
}

impl Scenes {
    pub(crate) fn new(footprint_m: Vec<[f32; 2]>) -> Self {
        Self { footprint_m, robot_ns: None, world_ns: None }
    }

    pub(crate) fn take(&mut self, seen: &Seen, time: &FileTime, sheet: &mut Sheet) {
        if let Some(command) = seen.read(COMMAND) {
            if is_due(&mut self.robot_ns, seen.header.now_ns, ROBOT_EVERY_NS) {
                self.robot(&command, seen.header.now_ns, time, sheet);
            }
        } else if let Some(truth) = seen.read(TRUTH)
            && is_due(&mut self.world_ns, truth.stamp_ns, WORLD_EVERY_NS)
        {
            world(&truth, time, sheet);
        }
    }

    /// Each picture is whole, so that one message is enough wherever a viewer begins.
    fn robot(&self, command: &Command, now_ns: u64, time: &FileTime, sheet: &mut Sheet) {
        let part = |id| {
            let mut part = entity(id, BASE, time.stamp(now_ns));
            part.frame_locked = true;
            part
        };
        let corner = |[x_m, y_m]: &[f32; 2]| point(f64::from(*x_m), f64::from(*y_m), 0.02);
        let mut outline = part("footprint");
        outline.lines = vec![line(LineLoop, self.footprint_m.iter().map(corner).collect(), LINE_M, OUTLINE)];
        let mut driven = part("command");
        driven.arrows = arrows(&command.twist, COMMAND_HEIGHT_M, COMMANDED);
        let mut wish = part("wish");
        wish.arrows = arrows(&command.wish, WISH_HEIGHT_M, WISHED);
        sheet.put(ROBOT, &scene(vec![outline, driven, wish]));
    }
}

fn world(truth: &Truth, time: &FileTime, sheet: &mut Sheet) {
    let stamp = time.stamp(truth.stamp_ns);
    let count = (truth.people_count as usize).min(truth.people.len());
    let [width_m, height_m] = PERSON_M;
    let mut people = entity("people", WORLD, stamp);
    people.cylinders = truth.people[..count]
        .iter()
        .map(|person| CylinderPrimitive {
            pose: Some(pose(&Pose2::new(f64::from(person.x_m), f64::from(person.y_m), 0.0), 0.5 * height_m)),
            size: vector(width_m, width_m, height_m),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(PERSON),
        })
        .collect();
    let mut contact = entity("contact", WORLD, stamp);
    if truth.contact != 0 {
        let ball = SpherePrimitive {
            pose: Some(pose(&truth.pose, 0.5)),
            size: vector(0.4, 0.4, 0.4),
            color: Some(ALARM),
        };
        contact.spheres = vec![ball];
    }
    sheet.put(TRUE_WORLD, &scene(vec![people, contact]));
}

//! The counterpart of the paper's Fig. 8: something appears on the path, and the map, the camera's view and the command
//! of the moment at which the policy first reacts.
//!
//! Two drives with the same seeds go side by side, one of them without the obstacle: the policy reacts in the first frame
//! in which it proposes something else than it does there.

use crate::error::NavigateError;
use crate::pilot::{Conditions, Pilot};
use crate::room::Course;
use serde::Serialize;
use sidestep_drive::{Drive, Lead, Sight};
use sidestep_msgs::{AGE_NEVER, LOCAL_CELLS, Pose2, Robot, Twist};
use sidestep_sim::{Solid, World};
use sidestep_train::{LARGE_V_M_S, LARGE_W_RAD_S};

/// `[m]` along the path, where the robot is when it happens.
const PASSED_M: f64 = 1.5;
/// `[m]` ahead of the axle, where the middle of the obstacle stands.
const AHEAD_M: f64 = 1.8;
/// Where to the left of the path it stands `[m]`, and its side `[m]`.
const SCENES: [(&str, f64, f64); 2] =
    [("a box left of the path", 0.12, 0.3), ("a post right of the path", -0.1, 0.16)];
/// `[s]` longest time in which a reaction is waited for, and longest drive.
const WAIT_S: f64 = 3.0;
const LIMIT_S: f64 = 30.0;
const SEED: u64 = 8;
/// `[m]` length of the path.
const LENGTH_M: f64 = 8.0;

/// One obstacle that appears.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sudden {
    /// What appeared.
    pub name: &'static str,
    /// `[s]` from its appearance to the first frame in which the policy proposes something else; `None` = never.
    pub reaction_s: Option<f64>,
    /// `[m]` gap between robot and obstacle at that time.
    pub clearance_m: f64,
    /// Velocity at that time: m/s, rad/s.
    pub velocity: [f32; 2],
    /// The policy's command: m/s, rad/s.
    pub command: [f32; 2],
    /// What it would have commanded without the obstacle: m/s, rad/s.
    pub command_without: [f32; 2],
    /// Whether the goal was then reached without contact.
    pub reached: bool,
    /// `[m]` smallest gap of the whole drive.
    pub min_clearance_m: f64,
    /// What the policy saw.
    #[serde(skip)]
    pub view: View,
}

/// Map and camera image of one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// `[1]` planning cost of each cell; `None` = never seen.
    pub cells: Vec<Option<f32>>,
    /// `[m]` the path ahead, in `base`.
    pub path_m: Vec<(f64, f64)>,
    /// Columns and rows of the depth image.
    pub size: [u32; 2],
    /// `[m]` depth of each pixel; 0 = not measured.
    pub depth_m: Vec<f32>,
}

/// Drives both scenes through the whole chain; nothing filters the policy, as in the paper.
///
/// # Errors
/// [`NavigateError`] where the model or a node refuses.
pub fn sudden(robot: &Robot, model: &[u8], model_name: &str) -> Result<Vec<Sudden>, NavigateError> {
    let mut pilots = [Pilot::new(robot, model, model_name)?, Pilot::new(robot, model, model_name)?];
    SCENES.iter().map(|(name, left_m, side_m)| scene(&mut pilots, name, *left_m, *side_m)).collect()
}

fn scene(
    [pilot, other]: &mut [Pilot<'_>; 2],
    name: &'static str,
    left_m: f64,
    side_m: f64,
) -> Result<Sudden, NavigateError> {
    let course = Course::of(name, "sudden", SEED, hall());
    let conditions = Conditions { lead: Lead::Policy, arbitrated: false, sight: Sight::Camera };
    let (mut drive, mut without) = (pilot.begin(&course, conditions)?, other.begin(&course, conditions)?);
    while drive.truth().pose.x_m < course.world.start.x_m + PASSED_M && drive.outcome().time_s < LIMIT_S {
        drive.tick();
        without.tick();
    }
    let begun_s = drive.outcome().time_s;
    let ahead_m = drive.truth().pose.x_m + AHEAD_M;
    let centre = [ahead_m, course.world.start.y_m + left_m];
    drive.place(Solid::block(centre, [side_m, side_m], 0.3, [0.0, 0.9]));
    let mut found = None;
    while found.is_none() && drive.outcome().time_s < begun_s + WAIT_S {
        drive.tick();
        without.tick();
        let (now, else_now) = (proposed(&drive), proposed(&without));
        let reacts = (now.v_m_s - else_now.v_m_s).abs() > LARGE_V_M_S
            || (now.w_rad_s - else_now.w_rad_s).abs() > LARGE_W_RAD_S;
        if reacts {
            found = Some(drive.outcome().time_s - begun_s);
        }
    }
    let (now, else_now, velocity) = (proposed(&drive), proposed(&without), drive.chain().local_goal().twist);
    let (clearance_m, view) = (f64::from(drive.truth().clearance_m), view(&drive, &course.world));
    drive.run(1, LIMIT_S);
    let outcome = drive.outcome();
    let sudden = Sudden {
        name,
        reaction_s: found,
        clearance_m,
        velocity: [velocity.v_m_s, velocity.w_rad_s],
        command: [now.v_m_s, now.w_rad_s],
        command_without: [else_now.v_m_s, else_now.w_rad_s],
        reached: outcome.arrivals > 0 && outcome.collisions == 0,
        min_clearance_m: f64::from(outcome.min_clearance_m),
        view,
    };
    pilot.take_back(drive);
    other.take_back(without);
    Ok(sudden)
}

fn proposed(drive: &Drive) -> Twist {
    drive.chain().proposals()[0].twist
}

fn view(drive: &Drive, world: &World) -> View {
    let (map, depth, pose) = (drive.chain().local_map(), drive.depth(), drive.truth().pose);
    let cell =
        |index: usize| (map.age[index] != AGE_NEVER).then(|| f32::from(map.planning_cost[index]) / 255.0);
    View {
        cells: (0..LOCAL_CELLS).map(cell).collect(),
        path_m: world.legs_m[0].iter().map(|point| pose.inverse_transform(point[0], point[1])).collect(),
        size: [depth.width, depth.height],
        depth_m: depth
            .used_pixels()
            .iter()
            .map(|&raw| if raw == u16::MAX { 0.0 } else { f32::from(raw) * depth.metres_per_unit })
            .collect(),
    }
}

/// A corridor of 3 m with nothing in it.
fn hall() -> World {
    let mut world = World::empty();
    let (length, width) = (LENGTH_M + 3.0, 3.0);
    let corners = [[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]];
    for index in 0..4 {
        world.solids.push(Solid::wall(corners[index], corners[(index + 1) % 4], 0.1, 2.4));
    }
    world.start = Pose2::new(1.4, 0.5 * width, 0.0);
    world.legs_m = vec![vec![[1.4, 0.5 * width], [1.4 + LENGTH_M, 0.5 * width]]];
    world
}
